"""Every mistake in experiment.yaml is one clear line that begins with the file and the field, before anything is solved."""

from __future__ import annotations

import copy
import re
import warnings
from pathlib import Path

import pytest
import yaml
from seeds import seed_of

from fingerfit.cli import main
from fingerfit.core import files
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.blocks import brick
from fingerfit.virtual import scan
from fingerfit.virtual.experiment import add_noise, run_experiment, solve
from fingerfit.virtual.file import read_truth

ROOT = Path(__file__).resolve().parents[2]
GONE = object()
NAN, INF = float("nan"), float("inf")
LAYER = {"name": "top", "height": 6, "mu": 0.03, "intensity": 0.5}
PLANE = {
    "title": "small",
    "body": {"width": 12, "thickness": 70, "layers": [LAYER, {**LAYER, "name": "bottom"}]},
    "material": {"alpha": 1.4, "poisson": 0.45},
    "mesh": {"element": "CPE4", "across": 2, "per_layer": 1, "grading": 1},
    "solver": "builtin",
    "displacement": [0.3, 0.6],
    "picture": {"pixels": 16, "side": 20, "texture": 0.1, "correlation": 2.0, "noise": 0.02, "pictured": [1, 2]},
    "noise": {"force": 0.01, "displacement": 0.02},
    "seed": seed_of(3),
}
BRICK = {
    **PLANE,
    "body": {"brick": [8, 7, 6], "layers": [LAYER]},
    "mesh": {**PLANE["mesh"], "element": "C3D8"},
    "picture": {**{k: v for k, v in PLANE["picture"].items() if k != "side"}, "pixels": [10, 9, 8], "spacing": [1, 1, 1]},
}  # fmt: skip
MESHED = {
    **{key: value for key, value in BRICK.items() if key != "mesh"},
    "body": {"mesh": "true.inp", "layers": [{"name": "top", "mu": 0.03, "intensity": 0.5}]},
    "study": {"body": {"mesh": "true.inp", "layers": [{"name": "top"}]}},
}
KINDS = {"plane": PLANE, "brick": BRICK, "mesh": MESHED}
WHOLE, NUMBER, ABOVE = "a whole number", "a number", "greater than 0"
# (kind of the body, key, values, field that is named where it is not the key, what is expected)
WRONG = [
    ("plane", "title", ["", " ", "a\nb"], "", "a text of one line"),
    ("plane", "title", [3, None], "", "a text"),
    ("plane", "titel", ["t"], "", "title"),
    ("plane", "body", [GONE], "", "a value: The body as it really is"),
    ("plane", "body", [3, [], None, "x"], "", "keys and values"),
    ("plane", "body.width", [GONE], "", "a value"),
    ("plane", "body.width", [0, -12], "", ABOVE),
    ("plane", "body.width", [NAN, INF, -INF], "", "a finite number"),
    ("plane", "body.width", ["12 mm", True, [12], None, 10**350], "", NUMBER),
    ("plane", "body.width", [1e308, 1e-320], "", "a length with which the volume of layer top"),
    ("plane", "body.thickness", [1e308], "", "a length with which the volume of layer top"),
    ("plane", "body.layers.1.height", [1e308, 1e-320], "", "a length with which the volume of layer bottom"),
    ("plane", "body.layers", [[]], "", "1 or more"),
    ("plane", "body.layers", [3, {}], "", "a list"),
    ("plane", "body.layers", [["top"]], "body.layers.0", "keys and values"),
    ("plane", "body.layers.0.name", [3], "", "a text"),
    ("plane", "body.layers.1.name", ["top", "TOP"], "", "a name that no other layer has"),
    ("plane", "body.layers.1.name", ["a b", "1st", "a,b", "*", "a-b"], "", "letters, digits and _"),
    ("plane", "body.layers.0.mu", [0, -0.03], "", ABOVE),
    ("plane", "body.layers.0.mu", [1e308, 5e-324], "", "a shear modulus whose bulk modulus"),
    ("plane", "body.layers.0.intensity", [0], "", ABOVE),
    ("plane", "body.layers.0.intensity", [1e308, 1.5], "", "less than or equal to 1"),
    ("plane", "body.layers.0.colour", ["red"], "", "name, height, mu, intensity"),
    ("plane", "body.layers.0.hight", [6], "", "did you mean that"),
    ("plane", "material", [GONE], "", "a value"),
    ("plane", "material", [3], "", "keys and values"),
    ("plane", "material.alpha", [0], "", "not 0"),
    ("plane", "material.alpha", [NAN], "", "a finite number"),
    ("plane", "material.alpha", ["x", [1.4], True], "", NUMBER),
    ("plane", "material.poisson", [0.5, 0.6, -1], "", "between -1 and 0.5"),
    ("plane", "material.poisson", [NAN], "", "a finite number"),
    ("plane", "material.poisson", ["x"], "", NUMBER),
    ("plane", "material.mu", [0.1], "", "alpha, poisson"),
    ("plane", "mesh", [GONE], "", "a value"),
    ("plane", "mesh", [3, "fine", []], "", "keys and values"),
    ("plane", "mesh.element", ["CPE5", 4], "", "'CPE3', "),
    ("plane", "mesh.element", ["C3D8"], "", "for a block in the plane and solver builtin"),
    ("brick", "mesh.element", ["CPE4"], "", "for a brick and solver builtin"),
    ("plane", "mesh.across", [0, -3], "", "greater than or equal to 1"),
    ("plane", "mesh.across", [10**6], "", "less than or equal to 1000"),
    ("plane", "mesh.across", [2.5, "x", "3", NAN, None], "", WHOLE),
    ("plane", "mesh.across", [True], "", "not true or false"),
    ("plane", "mesh.per_layer", [None], "", WHOLE),
    ("plane", "mesh.per_layer", [0], "", "greater than or equal to 1"),
    ("plane", "mesh.grading", [GONE], "", "a value: Largest over smallest element"),
    ("plane", "mesh.grading", [0.5], "", "greater than or equal to 1"),
    ("plane", "mesh.grading", [NAN, INF], "", "a finite number"),
    ("plane", "mesh.grading", ["x"], "", NUMBER),
    ("mesh", "mesh", [PLANE["mesh"]], "", "no such key"),
    ("plane", "solver", ["calculx"], "", "did you mean calculix"),
    ("plane", "solver", [GONE], "", "a value"),
    ("plane", "displacement", [[]], "", "1 or more"),
    ("plane", "displacement", [3, "0.3"], "", "a list"),
    ("plane", "displacement", [["a", 0.6], [[0.3]], [True, 0.6], ["0.3"]], "displacement.0", NUMBER),
    ("plane", "displacement", [[0.3, None]], "displacement.1", NUMBER),
    ("plane", "displacement", [[NAN, 0.6]], "displacement.0", "a finite number"),
    ("plane", "displacement", [[-0.3, 0.6]], "displacement.0", "greater than or equal to 0"),
    ("plane", "displacement", [[0.6, 0.3], [0.3, 0.3]], "", "numbers that increase"),
    ("plane", "displacement", [[0.3, 12], [1, 1e308]], "", "less than 12 mm, the height of the body"),
    ("brick", "displacement", [[0.3, 6]], "", "less than 6 mm, the height of the body"),
    ("mesh", "displacement", [[0.3, 8]], "", "less than 8 mm, the largest extent of the body"),
    ("plane", "picture", [GONE], "", "a value"),
    ("plane", "picture", [3, []], "", "keys and values"),
    ("plane", "picture.pixels", [0, -24, 1], "", "greater than or equal to 2"),
    ("plane", "picture.pixels", [2.5, "x", NAN, [16, 16]], "", WHOLE),
    ("plane", "picture.pixels", [10**6], "", "less than or equal to 32767"),
    ("brick", "picture.pixels", [[10**5, 10, 10]], "picture.pixels.0", "less than or equal to 32767"),
    ("brick", "picture.pixels", [[30000, 30000, 30000]], "", "what fits into the .* MB of memory that are free"),
    ("brick", "picture.pixels", [[10, 9]], "", "3 numbers"),
    ("brick", "picture.spacing", [[1, 1, -1]], "picture.spacing.2", ABOVE),
    ("brick", "picture.spacing", [[1, 1, 1e300]], "picture.spacing.2", "single precision"),
    ("brick", "picture.origin", [[0, 0, 1e300]], "picture.origin.2", "single precision"),
    ("brick", "picture.samples", [0, 513], "", "(greater|less) than or equal to (1|512)"),
    ("plane", "picture.side", [0, -22], "", ABOVE),
    ("plane", "picture.side", [NAN], "", "a finite number"),
    ("plane", "picture.side", ["x"], "", NUMBER),
    ("plane", "picture.side", [1e300], "", "single precision"),
    ("plane", "picture.texture", [-1], "", "greater than or equal to 0"),
    ("plane", "picture.texture", [NAN], "", "a finite number"),
    ("plane", "picture.texture", ["x"], "", NUMBER),
    ("plane", "picture.texture", [1e308], "", "less than or equal to 16"),
    ("plane", "picture.correlation", [0, -2], "", ABOVE),
    ("plane", "picture.correlation", [NAN], "", "a finite number"),
    ("plane", "picture.correlation", ["x"], "", NUMBER),
    ("plane", "picture.correlation", [1e308, 20.1], "", "at most 20 mm, the longest side of the picture"),
    ("brick", "picture.correlation", [1e-300], "", "what fits into the .* MB of memory that are free"),
    ("plane", "picture.noise", [-0.01], "", "greater than or equal to 0"),
    ("plane", "picture.noise", [NAN], "", "a finite number"),
    ("plane", "picture.noise", ["x"], "", NUMBER),
    ("plane", "picture.noise", [1e308], "", "less than or equal to 16"),
    ("plane", "picture.pictured", [[3]], "", "steps from 1 to 2"),
    ("plane", "picture.pictured", [[0], [-1]], "picture.pictured.0", "greater than or equal to 1"),
    ("plane", "picture.pictured", [1], "", "a list"),
    ("plane", "picture.pictured", [["x"], [1.5]], "picture.pictured.0", WHOLE),
    ("plane", "picture.pictured", [[1, 1]], "", "each of them once"),
    ("plane", "noise", [GONE], "", "a value"),
    ("plane", "noise.force", [-0.1], "", "greater than or equal to 0"),
    ("plane", "noise.force", [1e308], "", "one that leaves each force finite"),
    ("plane", "noise.displacement", [-0.1], "", "greater than or equal to 0"),
    ("plane", "noise.displacement", [1e308], "", "less than 12 mm, the height of the body"),
    ("plane", "seed", [-1], "", "greater than or equal to 0"),
    ("plane", "seed", [1.5, "x", True], "", WHOLE),
    ("plane", "time", [3], "", "a list"),
    ("plane", "time", [[1]], "", "2, as many as displacements"),
    ("plane", "time", [[1, "x"]], "time.1", NUMBER),
    ("plane", "time", [[2, 1], [1, 1]], "", "numbers that increase"),
    ("plane", "time", [[NAN, 1]], "time.0", "a finite number"),
    ("plane", "time", [[0, 1]], "time.0", ABOVE),
    ("plane", "effects", [3], "", "keys and values"),
    ("plane", "effects.tillt", [{"slope": 0.01}], "", "tilt"),
    ("plane", "effects.tilt", [{"slop": 0.01}], "effects.tilt.slop", "slope"),
    ("plane", "effects.tilt", [{"slope": 99}], "effects.tilt.slope", "the bounds"),
    ("plane", "effects.tilt", [{"slope": True}, {"slope": "x"}], "effects.tilt.slope", NUMBER),
    ("plane", "own", ["nowhere", "experiment.yaml"], "", "a folder beside the description"),
    ("plane", "template", ["none.inp.j2", "../block.inp.j2"], "", "a template beside it or in templates/"),
    ("plane", "boundary.base", ["hold", 3], "", "'held' or 'slides'"),
    ("plane", "study", [{"control": "forced"}], "study.control", "'force' or 'displacement'"),
    ("plane", "study", [{"pictures": {}}], "study.pictures", "boundary or control|control|boundary"),
    ("mesh", "study", [GONE], "", "a value"),
    ("mesh", "study.body", [GONE], "", "a value: As in study.yaml, with a mesh of its own"),
    ("mesh", "body.mesh", ["none.inp"], "", "a file that exists"),
    ("brick", "body.mesh", ["true.inp"], "body", "one of width .with layers., brick, mesh"),
    ("brick", "body.brick", [[8, 7, 5]], "", "the last that of all layers"),
    ("brick", "body.brick", [[8, 7]], "", "3 numbers"),
    ("brick", "body.brick", [[0, 7, 6]], "body.brick.0", ABOVE),
    ("brick", "body.drawn", [[{"shape": "box", "low": [0, 0, 0], "high": [1, 1, 1]}]], "body.drawn.0.intensity", "a val"),
    ("brick", "body.drawn", [[{"shape": "box", "low": [0, 0, 0], "radius": 1, "intensity": 1}]], "body.drawn.0",
     "shape, intensity, low, high, the keys of a box"),
    ("brick", "body.drawn", [[{"shape": "capsule", "from": [0, 0], "to": [1, 1, 1], "radius": 1, "intensity": 1}]],
     "body.drawn.0.from", "3 numbers"),
    ("brick", "body.tissues", [{"BONE": 2}], "body.tissues.BONE", "less than or equal to 1"),
]  # fmt: skip
CASES = [(kind, key, value, field or key, text) for kind, key, values, field, text in WRONG for value in values]


def put(data, key, value):
    *parents, last = (int(part) if part.isdigit() else part for part in key.split("."))
    for part in parents:
        data = data.setdefault(part, {}) if isinstance(data, dict) else data[part]
    if value is GONE:
        del data[last]
    else:
        data[last] = value


def described(folder, kind="plane", **changes):
    data = copy.deepcopy(KINDS[kind])
    for key, value in changes.items():
        put(data, key.replace("__", "."), value)
    (folder / "experiment.yaml").write_text(yaml.dump(data, Dumper=yaml.SafeDumper), encoding="utf-8")
    mesh = brick([8.0, 7.0, 6.0], (2, 2, 2), element="C3D8", name="top")
    (folder / "true.inp").write_text(format_mesh(mesh), encoding="utf-8")
    return folder / "experiment.yaml"


@pytest.mark.parametrize(
    ("kind", "key", "value", "field", "text"), CASES, ids=lambda v: "left out" if v is GONE else repr(v)[:30]
)
def test_a_mistake_is_one_line_with_file_and_field(kind, key, value, field, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    described(tmp_path, kind, **{key.replace(".", "__"): value})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["experiment", "experiment.yaml", "--out", "made"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    wanted = rf"fingerfit: error: experiment\.yaml: {re.escape(field)}: found .*; expected .*({text})"
    assert re.match(wanted, line), line
    assert not (tmp_path / "made").exists()


def test_all_mistakes_are_told_at_once(tmp_path):
    """Those within one key beside those between keys, with the solver and with files."""
    path = described(
        tmp_path, mesh__across=0, solver="calculx", displacement=[0.3, 13], seed=-1, own="nowhere", time=[1],
        picture__pictured=[5], template="none.j2", material__poisson=0.5, body__colour="red",
    )  # fmt: skip
    with pytest.raises(Problems) as raised:
        read_truth(path)
    fields = sorted(str(problem).removeprefix(f"{path}: ").split(":")[0] for problem in raised.value.problems)
    assert fields == sorted(
        ["mesh.across", "solver", "seed", "own", "time", "picture.pictured", "template", "material.poisson", "body.colour"]
    )  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_the_descriptions_are_fine_before_they_are_changed(kind, tmp_path):
    run_experiment(described(tmp_path, kind), tmp_path / "made")
    assert (tmp_path / "made/study.yaml").exists()


@pytest.mark.parametrize("seed", [0, 2**63, 2**80])
def test_a_seed_is_any_whole_number(seed, tmp_path):
    truth = read_truth(described(tmp_path, seed=seed))
    assert truth.seed == seed
    add_noise(truth, solve(truth, tmp_path), truth.seed)


def test_other_files_are_not_descriptions(tmp_path):
    for text in ("", "[1, 2]", "3"):
        (tmp_path / "e.yaml").write_text(text)
        with pytest.raises(Problems, match=r"e.yaml: file: found .*expected") as raised:
            read_truth(tmp_path / "e.yaml")
        assert len(str(raised.value).splitlines()) == 1


@pytest.mark.parametrize("path", sorted(ROOT.glob("studies/*/experiment.yaml")), ids=lambda path: path.parent.name)
def test_the_shipped_descriptions_are_right(path, tmp_path):
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    if "mesh" in data["body"]:  # `make fingertip-data` makes it
        (tmp_path / "sealed").mkdir()
        (tmp_path / data["body"]["mesh"]).touch()
    (tmp_path / path.name).write_bytes(path.read_bytes())
    truth = read_truth(tmp_path / path.name)
    assert truth.seed == data["seed"]
    assert truth.mesh == data.get("mesh", {})
    assert truth.displacement == tuple(data["displacement"])


def test_that_there_are_shipped_descriptions():
    assert len(list(ROOT.glob("studies/*/experiment.yaml"))) >= 4


def test_an_error_of_the_deck_names_the_description(tmp_path):
    (tmp_path / "own.inp.j2").write_text("*HEADING\nt\n*INCLUDE, INPUT={{ mesh }}\n*NONSENSE\n")
    path = described(tmp_path, template="own.inp.j2")
    with pytest.raises(
        InputError, match=r"experiment.yaml: template: found own.inp.j2, with which a deck has"
    ) as raised:
        run_experiment(path, tmp_path / "made")
    assert "deck.inp" not in str(raised.value)


def test_a_body_without_solution_is_told_with_the_description(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # many triangles that are pressed to a ten thousandth of the height: they turn over
    described(tmp_path, displacement=[0.3, 11.999], mesh__element="CPE6", mesh__across=8, mesh__per_layer=4)
    assert main(["experiment", "experiment.yaml", "--out", "made"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fingerfit: error: experiment.yaml: displacement: builtin: ")


def test_pictures_that_do_not_fit_into_memory_are_told_before_anything_is_solved(tmp_path, monkeypatch):
    path = described(tmp_path)
    monkeypatch.setattr(scan, "free_memory", lambda: 10**5)
    assert files.free_memory() > 10**5
    with pytest.raises(InputError, match=r"experiment.yaml: picture.pixels: found 16, with 0.104 MB"):
        run_experiment(path, tmp_path / "made")


@pytest.mark.parametrize("text", ["[1, 2]", "{}", '{"name": 3}', "3", "null"])
def test_a_solver_of_a_wrong_shape_is_one_line(text, tmp_path, capsys):
    (tmp_path / "solver.json").write_text(text)
    (tmp_path / "deck.inp").write_text("*HEADING\n")
    arguments = ["simulate", str(tmp_path / "deck.inp"), "--solver", str(tmp_path / "solver.json")]
    assert main([*arguments, "--out", str(tmp_path / "solution.npz")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "solver.json: cannot be read: " in line


OWN = """\
title: an effect that asks too much
acts: material
words: Poisson's ratio grows.
look: Nothing.
confirm: Nothing.
parameters:
  more: {unit: "1", absent: 0, lower: 0, upper: 1, step: 0.1}
changes:
  poisson: "poisson + more"
"""


def test_an_effect_is_named_that_makes_wrong_numbers_of_right_ones(tmp_path):
    (tmp_path / "own/effects").mkdir(parents=True)
    (tmp_path / "own/effects/growth.yaml").write_text(OWN)
    path = described(tmp_path, own="own", effects={"growth": {"more": 0.3}})
    with pytest.raises(InputError, match=r"experiment.yaml: effects: found growth, with which a deck has in line 6"):
        run_experiment(path, tmp_path / "made")


def test_an_element_of_a_mesh_that_no_solver_takes_is_named(tmp_path):
    path = described(tmp_path, "mesh")
    lines = (tmp_path / "true.inp").read_text().splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("*ELEMENT")) + 1
    number, first, second, *others = lines[at].split(",")
    lines[at] = ",".join([number, second, first, *others])  # turned inside out
    (tmp_path / "true.inp").write_text("\n".join(lines) + "\n")
    with pytest.raises(Problems, match=r"true.inp: elements: found no volume, or a negative one, in number 1"):
        run_experiment(path, tmp_path / "made")


def test_forces_that_are_not_finite_are_told(tmp_path):
    path = described(tmp_path, body__thickness=1e200, body__layers__0__mu=1e120, body__layers__1__mu=1e120)
    with warnings.catch_warnings(), pytest.raises(FingerfitError, match=r"experiment.yaml: (body|displacement): "):
        warnings.simplefilter("error")
        run_experiment(path, tmp_path / "made")


def test_no_memory_for_the_solution_is_told(tmp_path, monkeypatch):
    def fail(*args, **options):
        raise MemoryError

    monkeypatch.setattr("fingerfit.virtual.experiment.make_mesh", fail)
    with pytest.raises(
        InputError, match=r"experiment.yaml: mesh: found no memory for its solution; expected a coarser"
    ):
        run_experiment(described(tmp_path), tmp_path / "made")
