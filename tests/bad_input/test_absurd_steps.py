"""Tables of steps whose numbers cannot belong to the body: one line each; what may be is a remark."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STUDY

from fingerfit.cli import main
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.blocks import brick, layered_block

TABLE = "step,displacement,force\n1,0.5,7.0\n2,1.0,14.5\n3,1.5,22.8\n4,2.0,32.8\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A study of forces alone on a block of 12 x 8 mm, 70 mm thick, and its config."""
    monkeypatch.chdir(tmp_path)
    study = copy.deepcopy(STUDY)
    study["noise"] = {"force": 0.3, "displacement": 0.01}
    config = {"study": "study", "model": copy.deepcopy(MODEL), "fit": copy.deepcopy(FIT)}
    (tmp_path / "study").mkdir()
    (tmp_path / "study/study.yaml").write_text(yaml.safe_dump(study))
    (tmp_path / "study/steps.csv").write_text(TABLE)
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    return tmp_path


def text(old, new):
    def change(place):
        path = place / "study/steps.csv"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return change


def study(change):
    def apply(place):
        path = place / "study/study.yaml"
        data = yaml.safe_load(path.read_text())
        change(data)
        path.write_text(yaml.safe_dump(data))

    return apply


def config(change):
    def apply(place):
        path = place / "config.yaml"
        data = yaml.safe_load(path.read_text())
        change(data)
        path.write_text(yaml.safe_dump(data))

    return apply


def both(*changes):
    return lambda place: [change(place) for change in changes]


FORCE = study(lambda d: d.update(control="force"))
BRICK = both(
    study(lambda d: (d["body"].pop("width"), d["body"].pop("thickness"), d["body"].update(brick=[12, 70, 8]))),
    config(lambda d: d["model"].update(mesh={"element": "C3D8", "across": 2, "per_layer": 1})),
)


def meshed(place, dim=2):
    mesh = layered_block(12.0, [("top", 4.0), ("bottom", 4.0)], 2, 2, "CPE8")
    if dim == 3:
        mesh = brick((12.0, 10.0, 8.0), (2, 2, 1), element="C3D8", layers=[("top", 4.0), ("bottom", 4.0)])
    (place / "study/mesh.inp").write_text(format_mesh(mesh))
    layers = [{"name": name, "elements": name.upper()} for name in ("top", "bottom")]
    body = {"mesh": "mesh.inp", "layers": layers, **({"thickness": 70} if dim == 2 else {})}
    study(lambda d: d.update(body=body))(place)
    config(lambda d: d["model"].pop("mesh"))(place)


CASES = {
    "deeper than the block": (text("4,2.0,", "4,20.0,"), "study/study.yaml: steps: found step 4: displacement 20 mm; expected less than 8 mm, the height of the body"),
    "as deep as the block": (text("4,2.0,", "4,8.0,"), "study/study.yaml: steps: found step 4: displacement 8 mm; expected less than 8 mm"),
    "measured, deeper than the block": (both(FORCE, text("4,2.0,", "4,2000,")), "study/study.yaml: steps: found step 4: displacement 2000 mm"),
    "deeper than the brick": (both(BRICK, text("4,2.0,", "4,9.0,")), "study/study.yaml: steps: found step 4: displacement 9 mm; expected less than 8 mm"),
    "deeper than the mesh": (both(meshed, text("4,2.0,", "4,13.0,")), "study/study.yaml: steps: found step 4: displacement 13 mm; expected less than 12 mm, the largest extent of the body"),
    "deeper than the mesh in space": (both(lambda p: meshed(p, 3), text("4,2.0,", "4,13.0,")), "study/study.yaml: steps: found step 4: displacement 13 mm; expected less than 12 mm, the largest extent"),
    "a force of 1e308 N": (text(",32.8", ",1e308"), "study/study.yaml: steps: found up to 1e+308 N and 2 mm, for which mu would be about"),
    "a force of 1e308 kN": (both(study(lambda d: d["units"].update(force="kN")), text(",32.8", ",1e308")), "study/steps.csv: row 5, force: found 1e308; expected a number that is finite in N, mm and s"),
    "a displacement of 1e308 mm": (text("4,2.0,", "4,1e308,"), "study/study.yaml: steps: found step 4: displacement 1e+308 mm"),
    "a displacement of 1e308 m": (both(study(lambda d: d["units"].update(length="m")), text("4,2.0,", "4,1e308,")), "study/steps.csv: row 5, displacement: found 1e308; expected a number that is finite"),
    "a force of 1e308 N at another step": (text(",14.5", ",1e308"), "study/study.yaml: steps: found up to 1e+308 N and 2 mm, for which mu would be about"),
    "a force of 1e308 N that is prescribed": (both(FORCE, text(",14.5", ",1e308")), "study/study.yaml: steps: found up to 1e+308 N and 2 mm"),
    "kN for N": (study(lambda d: d["units"].update(force="kN")), "study/study.yaml: steps: found up to 3.28e+04 N and 2 mm, for which mu would be about 25 MPa; expected forces and displacements for bounds that end at 0.5 MPa (config.yaml); look at units.force, units.length and steps.csv"),
    "mN for N": (study(lambda d: d["units"].update(force="mN")), "study/study.yaml: steps: found up to 0.0328 N and 2 mm, for which mu would be about 2.5e-05 MPa; expected forces and displacements for bounds that begin at 0.005 MPa"),
    "kN for N on a brick": (both(BRICK, study(lambda d: d["units"].update(force="kN"))), "study/study.yaml: steps: found up to 3.28e+04 N and 2 mm"),
    "kN for N on a mesh": (both(meshed, study(lambda d: d["units"].update(force="kN"))), "study/study.yaml: steps: found up to 3.28e+04 N and 2 mm"),
    "bounds of a metal": (config(lambda d: d["model"]["parameters"]["mu"].update(start=8e4, lower=1e3, upper=1e5)), "study/study.yaml: steps: found up to 32.8 N and 2 mm, for which mu would be about 0.025 MPa; expected forces and displacements for bounds that begin at 1000 MPa"),
    "a fixed constant in Pa": (config(lambda d: (d["model"]["material"].update(mu_bottom=25e3, mu_top=2e4), d["model"].update(parameters={"poisson": {"unit": "1", "start": 0.4, "lower": 0.3, "upper": 0.45, "log": False}}), d["model"]["material"].pop("poisson"))), "study/study.yaml: steps: found up to 32.8 N and 2 mm, for which mu would be about 0.025 MPa; expected forces and displacements for bounds that begin at 20000 MPa"),
}  # fmt: skip


def told(capsys):
    return [line for line in capsys.readouterr().err.splitlines() if line]


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("command", ["check", "prepare"])
def test_what_no_body_could_give_is_refused(place, name, command, capsys):
    change, expected = CASES[name]
    change(place)
    arguments = {
        "check": ["check", "study"],
        "prepare": ["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"],
    }[command]
    assert main(arguments) == 1
    lines = told(capsys)
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"fingerfit: error: {expected}")
    assert not (place / "data.npz").exists()


FALLS = {
    "force": (text(",32.8", ",1"), "step 4: force falls from 22.8 to 1 N (noise 0.3 N) while displacement grows from 1.5 to 2 mm"),
    "one outlier": (text(",14.5", ",55.5"), "step 3: force falls from 55.5 to 22.8 N"),
    "displacement": (both(FORCE, text("3,1.5,", "3,0.3,")), "step 3: displacement falls from 1 to 0.3 mm (noise 0.01 mm) while force grows from 14.5 to 22.8 N"),
    "force that is prescribed": (both(FORCE, text(",32.8", ",1")), "step 4: displacement grows from 1.5 to 2 mm (noise 0.01 mm) while force falls from 22.8 to 1 N"),
    "a displacement of nothing": (text("2.0,", "1e-300,"), "step 4: force grows from 22.8 to 32.8 N (noise 0.3 N) while displacement falls from 1.5 to 1e-300 mm"),
    "without a known noise": (both(study(lambda d: d["noise"].pop("displacement")), text(",32.8", ",1")), "step 4: force falls from 22.8 to 1 N"),
}  # fmt: skip


@pytest.mark.parametrize("name", FALLS)
def test_a_fall_is_a_remark(place, name, capsys):
    change, expected = FALLS[name]
    change(place)
    assert main(["check", "study"]) == 0, told(capsys)
    said = [line for line in capsys.readouterr().out.splitlines() if "remark" in line]
    assert len(said) == 1
    assert said[0].startswith(f"remark: {expected}")
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 0
    assert f"study/study.yaml: remark: {expected}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "change",
    [
        lambda place: None,
        text("3,1.5,22.8", "3,1.5,13.9"),  # 0.6 N less: 1.4 standard deviations of a difference
        text("4,2.0,32.8", "4,1.5,20.0"),  # a hold: relaxation
        text("4,2.0,32.8", "4,1.2,17.0"),  # back again
        BRICK,
        meshed,
    ],
)
def test_what_may_be_is_not_told(place, change, capsys):
    change(place)
    assert main(["check", "study"]) == 0, told(capsys)
    assert "remark" not in capsys.readouterr().out


def test_the_remark_reaches_the_estimate(place, capsys):
    """The table and estimate.json say what `prepare` saw."""
    from conftest import all_rounds

    from fingerfit.fit.estimate import estimate_of, table_of
    from fingerfit.fit.simulate import begin
    from fingerfit.settings.config import load_settings

    text("3,1.5,22.8", "3,1.5,3.8")(place)
    problem, _ = begin(load_settings(place / "config.yaml"), place / "work")
    last, _ = all_rounds(problem, place / "rounds")
    found = estimate_of(problem, last)
    (remark,) = [line for line in found["remarks"] if line.startswith("measurements: step 3: force falls")]
    assert remark in table_of(found)
    assert json.loads(json.dumps(found))["remarks"] == found["remarks"]


def test_the_simple_formula_is_right_within_its_factor(place):
    """The modulus that a glued block needs, against the built-in solver: within a factor of 3, where 9.8 is refused."""
    from fingerfit.prepare.plausible import SLIP, needed_modulus
    from fingerfit.solvers.builtin import BuiltinSolver
    from fingerfit.study.study import Body, Layer, Noise, Study
    from fingerfit.testing.block import DEPTH, MATERIAL, SIZE, write_block

    assert pytest.approx(9.80665) == SLIP
    for element, dim in (("CPE8", 2), ("C3D8", 3)):
        for depth in (0.2, 3.0):
            outcome = BuiltinSolver().solve(write_block(place, "displacement", [depth], element), place)
            body = Body((Layer("body", SIZE),), width=SIZE, thickness=DEPTH)
            one = Study(place, "t", "displacement", (), None, Noise(), body, "held", "glued")
            needed = needed_modulus(one, np.full(dim, SIZE), -float(outcome.reaction[0, -1]), depth)
            assert 1 / 3 < needed / MATERIAL.mu[0] < 3  # measured: 1.2, and 2.5 at 30 %
