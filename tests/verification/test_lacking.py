"""What a solver lacks is refused before anything runs: at the start of a fit, among the candidates, by `fingerfit add`."""

import json
from dataclasses import replace

import pytest
import yaml
from blocks import FIT, MESH, MODEL, STUDY

from fingerfit.core.errors import InputError
from fingerfit.core.files import write_json
from fingerfit.core.folders import OURS
from fingerfit.deck.borders import moves_borders
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.diagnosis.candidates import candidates, untestable
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.ladder import add
from fingerfit.fit.course import next_round
from fingerfit.fit.problem import SEARCH
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.catalogue import catalogue
from fingerfit.report.findings import write_diagnosis
from fingerfit.settings.config import load_settings
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.needs import FEATURES, refuse_lacking

STEPS = "step,displacement,force,time\n1,0.4,10.0,10\n2,0.8,21.0,20\n3,1.2,32.0,30\n"
MESHLESS = {key: value for key, value in MODEL.items() if key != "mesh"}


def made(folder, solver, element="CPE8", own_mesh=False, template=None):
    """Study and config.yaml in a folder; the mesh is the study's or the model's, the template a text of its own or none."""
    (folder / "study").mkdir()
    study, model = STUDY, {**MODEL, "mesh": {**MESH, "element": element}}
    if own_mesh:
        mesh = layered_block(12.0, [("top", 4.0), ("bottom", 4.0)], 2, 2, element)
        (folder / "study/mesh.inp").write_text(format_mesh(mesh))
        layers = [{"name": "top"}, {"name": "bottom"}]
        study = {**STUDY, "body": {"mesh": "mesh.inp", "thickness": 70, "layers": layers}}
        model = MESHLESS
    if template is not None:
        (folder / "study/own.inp.j2").write_text(template)
        model = {**model, "template": "own.inp.j2"}
    write_json(folder / "study/study.yaml", study)
    (folder / "study/steps.csv").write_text(STEPS)
    config = {"study": str(folder / "study"), "solver": solver, "model": model, "fit": FIT}
    (folder / "config.yaml").write_text(yaml.safe_dump({**config, "results": str(folder / "results")}))
    return load_settings(folder / "config.yaml")


def test_elements_of_a_study_that_brings_its_mesh(tmp_path, needs_ccx):
    settings = made(tmp_path, "calculix", "CPE8H", own_mesh=True)
    problem, _ = begin(settings, tmp_path / "model")
    with pytest.raises(InputError, match=r"solver calculix: \*ELEMENT: found CPE8H; .*CPE8R"):
        next_round(problem, None)
    assert not (tmp_path / "model/sims").exists()


def test_the_solver_is_asked_once(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(BuiltinSolver, "check", lambda self, deck: asked.append(deck.read_text()))
    problem, _ = begin(made(tmp_path, "builtin"), tmp_path / "model")
    run_fit(problem, 1)
    assert len(asked) == 1
    assert "*MATERIAL" in asked[0]


def test_control_is_asked_for(tmp_path, monkeypatch, needs_ccx):
    pushing = replace(CalculixSolver.capabilities, control=frozenset({"force"}))
    monkeypatch.setattr(CalculixSolver, "capabilities", pushing)
    problem, _ = begin(made(tmp_path, "calculix"), tmp_path / "model")
    with pytest.raises(InputError, match=r"solver calculix: \*BOUNDARY: found displacement control; .*force control"):
        next_round(problem, None)


def test_effects_that_the_solver_lacks_are_no_candidates(tmp_path, needs_ccx):
    names = {}
    for solver in ("builtin", "calculix"):
        folder = tmp_path / solver
        folder.mkdir()
        problem, _ = begin(made(folder, solver), folder / "model")
        found, lacking = candidates(problem, {"mu": 0.05})
        names[solver] = {one.effect.name for one in found}, set(lacking)
    assert names["builtin"][1] == set()
    lacking = {"exponential", "fibres", "prestretch", "relaxation", "softening", "yeoh"}
    assert names["calculix"][1] == {catalogue()[name].title for name in lacking}
    assert names["builtin"][0] - names["calculix"][0] == lacking
    assert "base_slip" in names["calculix"][0]


def test_a_template_with_nodes_of_its_own_has_no_others(tmp_path):
    plain, _ = begin(made(tmp_path, "builtin"), tmp_path / "model")
    text = (OURS / "block.inp.j2").read_text()
    line = "*INCLUDE, INPUT={{ mesh }}\n"
    assert line in text
    (tmp_path / "own").mkdir()
    template = text.replace(line, format_mesh(plain.meshes[SEARCH]))
    problem, _ = begin(made(tmp_path / "own", "builtin", template=template), tmp_path / "own/model")
    of = {}
    for name, one in (("plain", plain), ("own", problem)):
        found, lacking = candidates(one, {"mu": 0.05})
        of[name] = {each.effect.name for each in found}, lacking
    assert of["plain"][1] == {}
    gone = of["plain"][0] - of["own"][0]
    assert "split_layer" in gone
    assert all(moves_borders(catalogue()[name]) for name in gone)
    assert of["own"][1].keys() == {catalogue()[name].title for name in gone}
    assert "no line *INCLUDE" in of["own"][1][catalogue()["split_layer"].title].found


def test_the_diagnosis_says_so(tmp_path, monkeypatch):
    less = replace(BuiltinSolver.capabilities, features=FEATURES - {"*VISCOELASTIC"})
    monkeypatch.setattr(BuiltinSolver, "check", lambda self, deck: refuse_lacking(read_deck(deck), deck, "less", less))
    problem, everything = begin(made(tmp_path, "builtin"), tmp_path / "model")
    last, _ = run_fit(problem, 1)
    found = diagnose(problem, last, everything)
    write_diagnosis(found, tmp_path / "diagnosis.json")
    diagnosis = json.loads((tmp_path / "diagnosis.json").read_text())
    said = "; not tried, since solver builtin or the deck lacks what they need: viscoelastic relaxation"
    assert diagnosis["sentence"].endswith(said)
    assert [(entry["title"], entry["lacks"]) for entry in diagnosis["not_tried"]] == [
        ("viscoelastic relaxation", "*VISCOELASTIC"),
        # of forces alone these cannot be tested either
        ("band of another stiffness", "pictures or measured points"),
        ("mesh too coarse", "a finer mesh"),
        ("indenter that is not flat", "pictures or measured points"),
        ("wrong scale of the displacement sensor", "pictures or measured points"),
        ("inclusion of any size and shape", "pictures or measured points"),
        ("inclusion in the plane", "pictures or measured points"),
        ("interface elsewhere", "pictures or measured points"),
        ("shear before the first picture", "pictures or measured points"),
        ("skin at the free sides", "pictures or measured points"),
        ("indenter that moves sideways", "pictures or measured points"),
        ("stiffness gradient from side to side", "pictures or measured points"),
        ("swelling before the first picture", "pictures or measured points"),
        ("tilt of the indenter", "pictures or measured points"),
        ("wall beside the body", "pictures or measured points"),
    ]
    tested = {entry["effect"] for entry in diagnosis["ranking"]}
    assert "fibres" in tested
    assert "relaxation" not in tested


def test_what_was_not_measured_is_no_candidate_but_told(tmp_path):
    settings = made(tmp_path, "builtin")
    plain = "\n".join(line.rpartition(",")[0] for line in STEPS.splitlines())
    (tmp_path / "study/steps.csv").write_text(plain + "\n")
    problem, _ = begin(settings, tmp_path / "model")
    assert {title: str(error.found) for title, error in untestable(problem).items()} == {
        "band of another stiffness": "pictures or measured points",
        "mesh too coarse": "a finer mesh",
        "indenter that is not flat": "pictures or measured points",
        "wrong scale of the displacement sensor": "pictures or measured points",
        "inclusion of any size and shape": "pictures or measured points",
        "inclusion in the plane": "pictures or measured points",
        "interface elsewhere": "pictures or measured points",
        "skin at the free sides": "pictures or measured points",
        "shear before the first picture": "pictures or measured points",
        "indenter that moves sideways": "pictures or measured points",
        "stiffness gradient from side to side": "pictures or measured points",
        "swelling before the first picture": "pictures or measured points",
        "tilt of the indenter": "pictures or measured points",
        "wall beside the body": "pictures or measured points",
        "viscoelastic relaxation": "a time at every step",
    }
    tested = {one.effect.title for one in candidates(problem, {"mu": 0.05})[0]}
    assert not tested & set(untestable(problem))


def test_add_refuses_it(tmp_path, needs_ccx):
    made(tmp_path, "calculix")
    config = tmp_path / "config.yaml"
    before = config.read_text()
    with pytest.raises(InputError, match=r"found relaxation, which needs \*VISCOELASTIC; .*solver calculix"):
        add(config, "relaxation")
    assert config.read_text() == before
    assert "added base_slip" in add(config, "base_slip")


def test_a_model_with_such_an_effect_does_not_start(tmp_path, needs_ccx):
    settings = made(tmp_path, "calculix")
    data = settings.model_dump(mode="json")
    data["model"]["effects"] = {"relaxation": {"share": 0.2}}
    problem, _ = begin(load_settings(data), tmp_path / "model")
    with pytest.raises(InputError, match=r"solver calculix: \*VISCOELASTIC: found \*VISCOELASTIC"):
        next_round(problem, None)
