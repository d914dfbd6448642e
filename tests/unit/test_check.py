"""`fingerfit check`: what a fit would refuse it refuses, with which settings, and how long a fit will take."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from blocks import FIT, MESH, MODEL, STEPS, STUDY
from conftest import ROOT
from matplotlib.quiver import Quiver

from fingerfit.check.check import check_study
from fingerfit.check.expect import expected
from fingerfit.check.overview import figure_study
from fingerfit.cli import main
from fingerfit.core.errors import Problems
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.settings.config import MeshSettings, load_settings
from fingerfit.study.reader import load_study

CONFIG = {"study": "study", "model": MODEL, "fit": FIT}
SIMPLEX = {"name": "independent", "kind": "independent", "tolx": 1e-3, "tolf": 1e-3}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A study with forces alone, and config.yaml beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study").mkdir()
    write("study/study.yaml", STUDY)
    Path("study/steps.csv").write_text(STEPS)
    write("config.yaml", CONFIG)
    return tmp_path


def write(name, data):
    Path(name).write_text(yaml.safe_dump(data))


def model(**changes):
    write("config.yaml", {**CONFIG, "model": {**MODEL, **changes}})


def lines(capsys, *arguments):
    """Lines of errors."""
    assert main(["check", "study", *arguments]) == 1
    found = [line for line in capsys.readouterr().err.splitlines() if line]
    assert all(line.startswith("fingerfit: error: ") for line in found)
    return [line.removeprefix("fingerfit: error: ") for line in found]


# --- what a run would refuse


def test_names_and_models_that_a_run_refuses(place, capsys):
    model(name="sims")
    assert lines(capsys) == [
        "config.yaml: model.name: found sims; expected another name: sims and meshes are folders of all models"
    ]
    write("config.yaml", {**CONFIG, "runs": [{}, {"model": {"mesh": {**MESH, "across": 3}}}]})
    assert re.match(r"config.yaml: runs.1: model.name: found a second model base of results/study;", *lines(capsys))


def test_a_study_that_is_not_there(place, capsys):
    assert main(["run", "nosuch"]) == 1
    assert (
        capsys.readouterr().err
        == "fingerfit: error: nosuch: study: found no such folder; expected the folder of a study\n"
    )


def test_a_number_of_points_that_is_none_is_told_with_its_line(place):
    with pytest.raises(Problems, match=r"^study/points.csv: line 3: found 6,4,nan,-0.2; expected 4 finite numbers$"):
        study_of(STUDY["body"], [(3, 2, 0.01, -0.2), (6, 4, float("nan"), -0.2)])


def test_a_finer_mesh_that_is_coarser(place, capsys):
    mesh = {"element": "CPE4", "across": 4, "per_layer": 2}
    model(mesh=mesh, refined={**mesh, "across": 3})
    assert lines(capsys) == [
        "config.yaml: model.refined: found across 3, per_layer 2, CPE4, coarser than model.mesh with across 4,"
        " per_layer 2, CPE4; expected a finer mesh: more across or per_layer"
    ]
    model(mesh=mesh, refined={**mesh, "element": "CPE8", "across": 3})  # with nodes between the corners it is finer
    assert main(["check", "study", "--no-solve"]) == 0


# --- the deck and the solver


def test_a_template_that_is_not_there(place, capsys):
    model(template="blok.inp.j2")
    assert re.match(r"config\.yaml: model\.template: found blok\.inp\.j2; expected a template in", *lines(capsys))


def test_a_template_that_names_what_is_not_there(place, capsys):
    Path("study/own.inp.j2").write_text("*NODE\n{{ layers[0].mue }}\n")
    model(template="own.inp.j2")
    assert re.match(r"study/own\.inp\.j2: line 2: found .*no attribute 'mue'", *lines(capsys))


@pytest.mark.parametrize(
    ("wrong", "told"),
    [("*MATERAIL, NAME=M\n", r"deck of own\.inp\.j2 for solver builtin: line \d+, \*MATERAIL: found an unknown keyword"),
     ("*BOUNDARY\nNOWHERE, 1\n", r"deck of own\.inp\.j2 for solver builtin: line \d+, \*BOUNDARY: found NOWHERE")],
)  # fmt: skip
def test_a_deck_that_the_solver_does_not_take(place, capsys, wrong, told):
    Path("study/own.inp.j2").write_text("{% include 'block.inp.j2' %}\n" + wrong)
    model(template="own.inp.j2")
    assert re.match(told, *lines(capsys))
    assert re.match(told, *lines(capsys, "--no-solve"))


def test_a_solver_that_is_not_there_and_a_template_are_told_at_once(place, capsys, monkeypatch):
    monkeypatch.setenv("FINGERFIT_CCX", "no-such-ccx")
    write("config.yaml", {**CONFIG, "solver": "calculix", "model": {**MODEL, "template": "own.j2"}})
    Path("study/own.j2").write_text("{% include 'none.j2' %}")
    solver, template = lines(capsys)
    assert solver.startswith("solver calculix: no executable no-such-ccx")
    assert template.startswith("own.j2: template: found no file none.j2")


@pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
def test_the_solver_is_named_with_version_and_place(place):
    write("config.yaml", {**CONFIG, "solver": "calculix"})
    told = check_study(Path("study"), solve=False)
    assert re.search(rf"^solver: calculix [\d.]+, {shutil.which('ccx')}$", told, re.MULTILINE)


# --- the start


def test_the_start_is_simulated(place):
    told = check_study(Path("study"))
    assert re.search(r"^solver: builtin \d", told, re.MULTILINE)
    assert re.search(
        r"^start \(mu 0\.05\): solved, 2 steps .* in [\d.e+]+ s; score likelihood [\d.]+$", told, re.MULTILINE
    )
    assert re.search(r"^to expect: .* (s|minutes) on \d+ cores? as busy as now$", told, re.MULTILINE)


def test_a_start_without_a_solution_is_told(place):
    """The block is pressed to an eightieth of its height in increments that are not to be cut: triangles turn over."""
    model(mesh={**MODEL["mesh"], "element": "CPE6"})
    Path("study/steps.csv").write_text("step,displacement,force\n1,0.4,10.0\n2,7.9,2100.0\n")
    Path("study/step").mkdir()
    Path("study/step/static.inp.j2").write_text("*STEP, NLGEOM\n*STATIC\n1., 1., 1., 1.\n")
    told = check_study(Path("study"))
    assert re.search(r"^start \(mu 0\.05\): no equilibrium in step 2 of 2; such guesses get", told, re.MULTILINE)


def test_without_a_simulation(place, capsys):
    assert main(["check", "study", "--no-solve"]) == 0
    told = capsys.readouterr().out
    assert "start: not simulated\n" in told
    assert re.search(r"^to expect: about \d+ to \d+ simulations in \d+ to \d+ rounds$", told, re.MULTILINE)


# --- which settings


def test_settings_of_another_study_are_refused(place, capsys):
    shutil.copytree("study", "other")
    assert main(["check", "other", "--config", "config.yaml"]) == 1
    assert capsys.readouterr().err == (
        "fingerfit: error: config.yaml: study: found study; expected other, the study that is checked, or other settings\n"
    )


def test_of_several_models_the_first_of_the_study_is_checked(place, capsys):
    shutil.copytree("study", "other")
    models = [{"model": {"name": name}} for name in ("stiff", "soft")]
    write("config.yaml", {**CONFIG, "runs": [{"study": "other"}, *models]})
    assert main(["check", "study", "--no-solve"]) == 0
    assert "settings: config.yaml; of its 2 models of this study the first, stiff\n" in capsys.readouterr().out
    assert main(["check", "other", "--no-solve"]) == 0
    assert "settings: config.yaml\n" in capsys.readouterr().out


@pytest.mark.parametrize("runs", [None, 3, "study", [], [{}], [3]])
def test_runs_that_are_none_are_told_in_one_line(place, capsys, runs):
    write("config.yaml", {**CONFIG, "runs": runs})
    assert main(["check", "study", "--no-solve"]) == int(runs != [{}])
    assert "Traceback" not in capsys.readouterr().err


def test_settings_of_another_study_are_not_taken(place, capsys):
    shutil.copytree("study", "other")
    assert main(["check", "other"]) == 0
    told = capsys.readouterr().out
    assert "settings: none: config.yaml is for study, so mesh" in told
    assert "mesh:" not in told
    assert "to expect" not in told


@pytest.mark.parametrize("name", ["study", "study/study.yaml", "./study/", "../{}/study"])
def test_settings_that_name_the_study_in_another_way(place, name):
    told = check_study(Path(name.format(place.name)), solve=False)
    assert "settings: config.yaml\n" in told


def test_settings_in_the_folder_of_the_study_go_first(place, capsys):
    write("study/config.yaml", CONFIG)
    write("config.yaml", {**CONFIG, "study": "other"})
    assert main(["check", "study", "--no-solve"]) == 0
    assert "settings: study/config.yaml\n" in capsys.readouterr().out
    write("study/config.yaml", {**CONFIG, "study": "other"})
    assert lines(capsys) == [
        "study/config.yaml: study: found other; expected study, the study that is checked, or other settings"
    ]


def test_without_any_settings(place, capsys):
    Path("config.yaml").unlink()
    assert main(["check", "study", "--picture", "study.png"]) == 0
    assert "settings: none: there is no config.yaml" in capsys.readouterr().out
    assert Path("study.png").stat().st_size > 5000
    assert lines(capsys, "--config", "config.yaml")[0].startswith("config.yaml: file: found No such file")


# --- how many simulations


def test_a_grid_is_counted_exactly(place):
    """Three points in one round; slopes of one constant, of the control and the finest solution after it."""
    found = expected(load_settings(CONFIG), refined=False)
    assert found.simulations[0] == 3 + 3 + 2 + 1
    assert found.rounds[0] == 1 + 2


@pytest.mark.parametrize("parameters", [("mu",), ("mu_top", "mu_bottom")])
def test_fits_take_what_was_expected(place, parameters):
    """A fit with a solution that is known: forces of mu = 0.03 and 0.06 by the same solver, without noise."""
    constant = MODEL["parameters"]["mu"]
    settings = load_settings(
        {
            **CONFIG,
            "model": {**MODEL, "parameters": dict.fromkeys(parameters, constant)},
            "fit": {**FIT, "stages": [*FIT["stages"], SIMPLEX]},
        }
    )
    problem, _ = begin(settings, place / "work")
    last, _ = run_fit(problem, 1)
    found = expected(settings, refined=False)
    asked = len(problem.asked)
    assert last.stop == "tolerances met"
    # quartiles of bowls: a fit outside of them is no wonder, by half as much again it is
    assert found.simulations[0] / 1.5 <= asked <= 1.5 * found.simulations[1]
    assert found.rounds[0] / 1.5 <= last.number <= 1.5 * found.rounds[1]


def test_the_phantom_takes_what_was_expected():
    """What the benchmark of the phantom counted."""
    text = (ROOT / "benchmarks/phantom.md").read_text(encoding="utf-8")
    rounds, simulations = map(int, re.search(r"(\d+) rounds, (\d+) simulations", text).groups())
    found = expected(load_settings(ROOT / "config.yaml"), refined=True, short=True)
    assert found.rounds[0] <= rounds <= found.rounds[1]
    assert found.simulations[0] <= simulations <= found.simulations[1]


def test_tolerances_and_parameters_count():
    def middle(**changes):
        stage = {**SIMPLEX, **changes.pop("stage", {})}
        found = expected(
            load_settings({**CONFIG, "model": {**MODEL, **changes}, "fit": {**FIT, "stages": [stage]}}), False
        )
        return np.mean(found.simulations)

    constant = MODEL["parameters"]["mu"]
    assert middle(stage={"tolx": 1e-6, "tolf": 1e-9}) > 1.3 * middle()
    assert middle(parameters=dict.fromkeys(("mu_top", "mu_bottom"), constant)) > 1.5 * middle()
    assert middle(stage={"restarts": 2}) > 1.3 * middle()


# --- the picture


def study_of(body, points=None):
    """A study with forces, and with points that move where they are said to."""
    dim = 3 if "brick" in body else 2
    steps = "step,displacement,force" + (",points\n1,0.5,7,points.csv\n" if points is not None else "\n1,0.5,7\n")
    Path("study/steps.csv").write_text(steps)
    if points is not None:
        head = ",".join([*"xyz"[:dim], *("u" + axis for axis in "xyz"[:dim])])
        rows = "\n".join(",".join(map(str, row)) for row in points)
        Path("study/points.csv").write_text(f"{head}\n{rows}\n")
    write("study/study.yaml", {**STUDY, "body": body, "noise": {"force": 0.1, "points": 0.01}})
    study = load_study(Path("study"))
    mesh = make_mesh(study, MeshSettings(**({**MESH, "element": "C3D8"} if dim == 3 else MESH)))
    return study, mesh, prepare(study, mesh, None, 1.0, 0.3)


def words(figure):
    return {text.get_text() for text in figure.legends[0].get_texts()}


def test_forces_alone_are_drawn_with_mesh_and_sets(place):
    figure = figure_study(*study_of(STUDY["body"]))
    assert words(figure) >= {
        "top", "bottom", "nodes TOP (indenter: glued)", "nodes BOTTOM (base: held)", "nodes INDENTER (indenter's node)"
    }  # fmt: skip
    assert len(figure.axes) == 1


@pytest.mark.parametrize("high", [8, 12, 20])
def test_labels_of_the_axes_are_inside_the_picture(place, high):
    """At its first drawing, which is what is saved."""
    layers = [{"name": name, "height": high / 2} for name in ("top", "bottom")]
    figure = figure_study(*study_of({**STUDY["body"], "width": 20, "layers": layers}))
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.yaxis.label.get_window_extent().x0 >= 0 and axes.xaxis.label.get_window_extent().y0 >= 0


def test_a_region_is_in_the_legend_once(place):
    region = {"name": "scar", "outline": [[2, 1], [6, 1], [6, 5], [2, 5]]}
    named = words(figure_study(*study_of({**STUDY["body"], "regions": [region]})))
    assert "region scar" in named and "scar" not in named
    assert named >= {"top", "bottom"}


def test_points_are_drawn_with_arrows(place):
    figure = figure_study(*study_of(STUDY["body"], [(3, 2, 0.1, -0.1), (6, 4, 0.0, -0.4)]))
    arrows = next(one for one in figure.axes[1].collections if isinstance(one, Quiver))
    # the longest one is 0.4 mm, and twice that is the last of 1, 2, 5 below a tenth of 12 mm
    assert np.column_stack([arrows.U, arrows.V]) == pytest.approx(np.array([[0.2, -0.2], [0.0, -0.8]]))
    assert arrows.get_offsets() == pytest.approx(np.array([[3, 2], [6, 4]]))
    assert figure.axes[1].get_title() == "2 points at step 1, arrows 2 times as long"


def test_bodies_in_space_are_drawn_from_three_sides(place):
    body = {"brick": [12, 10, 8], "layers": [{"name": "all"}]}
    study, mesh, data = study_of(body, [(3, 2, 2, 0.1, 0.0, -0.1)])
    mesh = type(mesh)(mesh.points, mesh.blocks, mesh.node_sets, mesh.element_sets, {"SKIN": np.array([[0, 0], [0, 1]])})
    figure = figure_study(study, mesh, data)
    assert len(figure.axes) == 4 * 3
    assert words(figure) >= {"all", "nodes TOP (indenter: glued)", "surface SKIN"}
    assert sum(isinstance(one, Quiver) for axes in figure.axes for one in axes.collections) == 3


@pytest.mark.parametrize("points", [None, [(3, 2, 0.1, -0.1)]])
def test_a_picture_without_pictures(place, points):
    study_of(STUDY["body"], points)
    told = check_study(Path("study"), None, Path("study.png"), solve=False)
    assert told.endswith("drawn: study.png")
    assert Path("study.png").read_bytes().startswith(b"\x89PNG")
