"""Data, formulas and results that no plain Python exception may escape from: each is one line."""

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY
from scripts import script_of
from seeds import generator

from fingerfit import cli
from fingerfit.cli import main
from fingerfit.core.errors import FingerfitError, InputError, Problems, StateError
from fingerfit.core.files import keep_json, read_json, read_npz, read_record, write_json, write_npz
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.verdict import _rival
from fingerfit.fit.check import check_data
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.rounds import Round
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.forward.patches import Patches
from fingerfit.model.catalogue import catalogue
from fingerfit.model.formulas import evaluate
from fingerfit.report.page.inputs import read_inputs
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import _as_measured


def write(folder, steps=STEPS, study=STUDY, model=MODEL, fit=FIT):
    (folder / "study").mkdir(exist_ok=True)
    (folder / "study/study.yaml").write_text(yaml.safe_dump(study))
    (folder / "study/steps.csv").write_text(steps)
    (folder / "config.yaml").write_text(yaml.safe_dump({"study": "study", "model": model, "fit": fit}))


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path)
    return tmp_path


def fitted():
    problem, _ = begin(load_settings({"study": "study", "model": MODEL, "fit": FIT}), Path("m"))
    return problem, run_fit(problem, 1)[0]


def steps(*rows):
    return "\n".join(["step,displacement,force", *rows]) + "\n"


LINE = steps(*[f"{n},{0.1 * n},{2 * n}" for n in range(1, 9)])
TABLES = {
    "a cell of a megabyte": (steps("1,0.4," + "1" * 1_000_000), {}, {}, "steps.csv: steps: found field larger than"),
    "a number beyond all units": (
        steps("1,1e308,1"), {"units": {"length": "m", "force": "N", "time": "s"}}, {},
        "steps.csv: row 2, displacement: found 1e308; expected a number that is finite in N, mm and s",
    ),
    "noise of a line": (LINE, {"noise": {"force": "estimated"}}, {}, "noise.force: found estimated, from values on a"),
    "noise of no indentation": (
        steps(*[f"{n},0,{n**3 % 7}" for n in range(1, 9)]), {"noise": {"force": "estimated"}}, {},
        "noise.force: found estimated, from steps without a displacement; expected a number",
    ),
    "no steps are fitted": (STEPS, {}, {"steps": []}, "config.yaml: fit.steps: found []; expected 1 or more of them"),
    "nothing measured at what is fitted": (
        steps("1,0.4,", "2,0.8,21"), {}, {"steps": [1]},
        "config.yaml: fit.steps: found steps [1] without force and points; expected a step with something measured",
    ),
    "a grid without an end": (
        STEPS, {}, {"stages": [{"name": "g", "kind": "grid", "points": 10**400}]}, "config.yaml: line 6: found a number of 401 characters"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_measurements_and_settings(name, place, capsys):
    table, study, fit, says = TABLES[name]
    write(place, table, {**STUDY, **study}, fit={**FIT, **fit})
    assert main(["check", "study"]) == 1
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1, said
    assert says in said[0]
    assert "unexpected" not in said[0]


@pytest.mark.parametrize(
    "formula",
    [
        "(" * 3000 + "x" + ")" * 3000, "-" * 3000 + "x", "1" + "+1" * 5000, "1e400", "exp(1000)", "10.0**400", "x / 0",
        "log(0 * x)", "sqrt(-x)", "9**(9**9)", "'a' * 10**9", "x.__class__", "x[0] + 1", "minimum(x)", "-", "",
    ],
    ids=lambda formula: formula[:12],
)  # fmt: skip
def test_formulas(formula):
    with pytest.raises(ValueError) as raised:
        evaluate(formula, {"x": 2.0})
    assert len(str(raised.value)) < 200  # more is not shown of it


def test_a_formula_of_what_is_not_known_stays_unknown():
    assert np.isnan(evaluate("2 * x", {"x": np.array([np.nan, 1.0])})).tolist() == [True, False]
    assert evaluate("where(x > 0, log(x), 0 * x)", {"x": np.array([0.0, 1.0])}).tolist() == [0.0, 0.0]


EFFECT = {
    "title": "t", "acts": "material", "words": "w", "look": "l", "confirm": "c",
    "parameters": {"size": {"unit": "1", "absent": 0, "lower": 0, "upper": 1, "step": 0.1}},
    "scan": {"layer": [1, 2]}, "changes": {"alpha": "alpha + size"},
}  # fmt: skip
LAYER = {"layer": [1.0, 2.0]}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"refine": {"layer": [2, 1]}}, "refine.layer: found [2.0, 1.0]; expected a lower bound and a higher one"),
        ({"refine": {"layer": [1, 1]}}, "refine.layer: found [1.0, 1.0]; expected a lower bound and a higher one"),
        ({"scan": {"layer": [float("nan")]}}, "scan.layer: found [nan]; expected a list of finite numbers"),
        ({"scan": {"a{b": [1]}}, "scan.a{b: found a{b; expected a name of its own"),
        ({"scan": {"a.b": [1]}}, "scan.a.b: found a.b; expected a name of its own"),
        ({"scan": {"size": [1]}}, "scan.size: found size; expected a name that no other number of the effect has"),
        ({"parameters": {"si ze": EFFECT["parameters"]["size"]}}, "parameters.si ze: found si ze; expected a name"),
    ],
)
def test_effects(place, changes, says):
    (place / "study/effects").mkdir()
    (place / "study/effects/mine.yaml").write_text(yaml.safe_dump({**EFFECT, **changes}))
    with pytest.raises(Problems) as raised:
        catalogue(place / "study")
    assert len(raised.value.problems) == 1
    assert says in str(raised.value)


def test_an_effect_whose_name_is_no_name(place):
    (place / "study/effects").mkdir()
    (place / "study/effects/my.own.yaml").write_text(yaml.safe_dump(EFFECT))
    with pytest.raises(InputError, match=r"my.own.yaml: name: found my.own; expected letters, digits"):
        catalogue(place / "study")


class Sensor:
    """A truth with one effect on the force, whose formula is given."""

    def __init__(self, place, formula):
        (place / "study/effects").mkdir(exist_ok=True)
        path = place / "study/effects/sensor.yaml"
        path.write_text(yaml.safe_dump({**EFFECT, "acts": "loading", "changes": {"force": formula}}))
        self.effects = {"sensor": catalogue(place / "study")["sensor"]}
        self.values, self.time = {"sensor.size": 0.5}, None


@pytest.mark.parametrize("formula", ["0 * force", "1 / (force - 1)", "nonsense"])
def test_a_sensor_that_shows_no_straight_line(place, monkeypatch, formula):
    truth = Sensor(place, formula)
    monkeypatch.setattr("fingerfit.virtual.experiment._present", lambda truth: list(truth.effects.values()))
    with pytest.raises(InputError, match=r"effect sensor: changes.force: found .*; expected a straight line in force"):
        _as_measured(truth, np.ones(2), {"k": np.array([1.0, 2.0])})


@pytest.mark.parametrize("force", ["1e300", "1e305"])
def test_scores_that_overflow_are_no_scores(place, force):
    write(place, steps(f"1,0.4,{force}", f"2,0.8,{force}"))
    problem, last = fitted()
    assert last.stop == "no guess has a solution"
    with pytest.raises(
        StateError, match=r"no guess had a solution \(a score of inf\): .* look at .* forces and their noise"
    ):
        estimate_of(problem, last)


def test_bounds_too_near_for_a_slope(place):
    mu = {**MODEL["parameters"]["mu"], "start": 0.05, "lower": 0.05, "upper": 0.0501}
    problem, _ = begin(
        load_settings({"study": "study", "model": {**MODEL, "parameters": {"mu": mu}}, "fit": FIT}), Path("m")
    )
    with pytest.raises(InputError, match=r"config.yaml: model.parameters.mu: found bounds next to each other"):
        run_fit(problem, 1)


@pytest.mark.parametrize("noise", [{}, {"displacement": 0.01}])
def test_a_likelihood_of_what_has_no_noise(place, noise):
    write(place, study={**STUDY, "noise": noise})
    with pytest.raises(InputError, match=r"study.yaml: noise: found 0 for all that is compared"):
        fitted()


def test_a_likelihood_of_pictures_without_noise(place):
    problem, _ = begin(load_settings({"study": "study", "model": MODEL, "fit": FIT}), Path("m"))
    pictured = replace(problem.data, measured=np.ones((1, 4, 4)), picture_noise=0.0)
    with pytest.raises(InputError, match=r"pictures.noise: found 0, as estimated; expected a number above 0"):
        check_data(problem.settings, problem.study, pictured)


def test_measurements_without_noise_cannot_be_weighed():
    with pytest.raises(StateError, match="some measurements have no noise of their own"):
        ScoreTest(np.ones(3), np.diag([1.0, 0.0, 1.0]), np.ones((3, 1)), np.zeros((3, 1)))


def test_json_of_what_is_not_finite(tmp_path):
    with pytest.raises(StateError, match=r"a.json: a number in it is not finite"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\x00", '{"a": 1'])
def test_json_that_is_damaged(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(StateError, match=r"a.json: cannot be read"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize(("text", "says"), [("[1]", "it is no JSON object"), ('{"a": 1}', "sim, score is missing")])
def test_json_that_is_something_else(tmp_path, text, says):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(StateError, match=rf"a.json: cannot be read: {says}"):
        read_record(tmp_path / "a.json", "a", "sim", "score", kept=False)


def test_rounds_of_something_else(tmp_path):
    for record in ({"a": 1}, {"batch": 3}, {"batch": [3]}):
        keep_json(tmp_path / "0.json", record)
        with pytest.raises(StateError, match=r"0.json: is not a round"):
            Round.load(tmp_path / "0.json")


def test_arrays_that_are_damaged_anywhere(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, {"a": np.arange(200.0), "b": np.array("text")})
    good, rng = path.read_bytes(), generator(1)
    refused = 0
    for _ in range(300):
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= int(rng.integers(1, 256))
        path.write_bytes(bad[: rng.integers(1, len(bad) + 1)] if rng.random() < 0.3 else bad)
        try:
            read_npz(path)
        except StateError as error:
            assert str(error).startswith(f"{path}: cannot be read")
            refused += 1
    assert refused == 300  # a checksum, so all of them
    np.save(tmp_path / "b.npy", np.ones(3))
    with zipfile.ZipFile(tmp_path / "c.npz", "w") as archive:
        archive.writestr("a.npy", b"not an array")
    for name in ("b.npy", "c.npz"):
        with pytest.raises(StateError, match="cannot be read"):
            read_npz(tmp_path / name)


def test_a_ladder_of_something_else(tmp_path):
    keep_json(tmp_path / "ladder.json", {"rungs": [{"effects": []}]})
    with pytest.raises(StateError, match=r"ladder.json: cannot be read: a rung without a model"):
        read_inputs(tmp_path)


HEAD = "Time (s),Compression (mm),Load (N)\n"


@pytest.mark.parametrize(
    ("rows", "says"),
    [("", "found missing or infinite numbers"), ("0,0\n", "found missing"), ("0,0,1\n1,0,2\n", "found none above 0"),
     ("0,0,nan\n", "found missing"), ("0,0,0\n1,1,0\n", "Load (N): found a mean load of 0 or less")],
)  # fmt: skip
def test_tests_of_silicone(tmp_path, rows, says):
    (tmp_path / "a.csv").write_text(HEAD + rows)
    with pytest.raises(InputError) as raised:
        script_of("ecoflex").make_study([tmp_path / "a.csv"], tmp_path / "out")
    assert says in str(raised.value)
    assert not (tmp_path / "out").exists()


def test_what_nobody_foresaw_is_one_line_and_a_file(monkeypatch, capsys, tmp_path):
    def broken(args):
        raise KeyError("a\nb")

    monkeypatch.setattr(cli.commands, "check", broken)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert main(["check", "study"]) == 1
    said = capsys.readouterr().err.splitlines()
    (file,) = tmp_path.iterdir()
    assert said == [f"fingerfit: error: unexpected KeyError: 'a\\nb'; please report it with {file}"]
    assert "in broken" in file.read_text()
    assert not issubclass(KeyError, FingerfitError)


@pytest.mark.parametrize(
    ("points", "count"),
    [([[1, 0], [1, 5], [1, 9]], (1, 6)), ([[0, 2], [5, 2]], (6, 1)), ([[1, 1]], (1, 1)), ([[1, 1, 0], [1, 1, 5]], (1, 1, 6))],
)  # fmt: skip
def test_points_on_a_line_have_one_layer_of_patches(points, count):
    points = np.array(points, dtype=float)
    patches = Patches.around(points, 6)
    assert patches.count == count
    assert (patches.size > 0).all()
    assert patches.of(points)[0] == 0


def test_refits_with_as_many_constants_as_values_can_be_compared():
    fitted = Refit(0.0, 0, 1.0, None, {})
    assert _rival(fitted, fitted)
    assert not _rival(Refit(1000.0, 0, 1.0, None, {}), fitted)
