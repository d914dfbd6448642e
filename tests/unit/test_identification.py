"""Which further measurement identifies a constant: what is predicted is what that measurement gives."""

import copy

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STUDY
from one_layer import DESCRIPTION, SHARED

from fingerfit.core.files import write_json
from fingerfit.diagnosis.comparison import anchor_of
from fingerfit.diagnosis.designs import identification, separation
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.fit.intervals import NORMAL
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import solve, write_study
from fingerfit.virtual.file import read_truth

MU = {"unit": "MPa", "lower": 1e-4, "upper": 10.0}
TRUTH = {"mu_top": 0.09, "mu_bottom": 0.02}
WIDTH = np.log(MU["upper"] / MU["lower"])


def compared(folder, displacements, forces=None, truth=TRUTH, noise=0.05, bounds=None):
    """A block of two layers whose forces the start fits without any rest."""
    (folder / "study").mkdir(parents=True)
    (folder / "study/study.yaml").write_text(yaml.safe_dump({**STUDY, "noise": {"force": noise}}))
    rows = zip(displacements, np.ones(len(displacements)) if forces is None else forces, strict=True)
    lines = [f"{n},{displacement},{force:.10g}" for n, (displacement, force) in enumerate(rows, 1)]
    (folder / "study/steps.csv").write_text("\n".join(["step,displacement,force", *lines]) + "\n")
    parameters = {name: {**MU, **(bounds or {}).get(name, {}), "start": mu} for name, mu in truth.items()}
    model = {**copy.deepcopy(MODEL), "parameters": parameters}
    fit = {**FIT, "stages": [{"name": "descent", "kind": "least_squares"}]}
    problem, everything = begin(load_settings({"study": str(folder / "study"), "model": model, "fit": fit}), folder)
    if forces is None:
        asked = problem.ask(truth)
        solve_missing(problem, [asked], 1)
        return compared(folder / "true", displacements, problem.prediction(asked).response, truth, noise, bounds)
    last, _ = run_fit(problem, 1)
    solve_missing(problem, [anchor_of(problem, last)], 1)
    return comparison_of(problem, last, everything)


def deviation(further):
    """Standard deviation of the logarithm by the data alone: without what the bounds say."""
    half = np.log(further.interval[1] / further.interval[0]) / 2 / NORMAL
    return (half**-2 - 12 / WIDTH**2) ** -0.5


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    return compared(tmp_path_factory.mktemp("block"), [0.4, 0.8])


@pytest.fixture(scope="module")
def listed(block):
    found, run = identification(block)
    assert run > 0
    return {name: {one.title: one for one in entries} for name, entries in found.items()}


def test_two_forces_do_not_identify_two_layers(listed):
    assert set(listed) == {"mu_top"}
    for entries in listed.values():
        now, *others = entries.values()
        assert now.title == "as measured"
        assert not now.identified
        widths = [one.interval[1] / one.interval[0] for one in others]
        assert widths == sorted(widths)
        assert widths[0] < 0.5 * now.interval[1] / now.interval[0]


def test_forces_measured_better_are_worth_what_their_noise_says(listed):
    for entries in listed.values():
        better = deviation(entries["forces and displacements measured five times better"])
        assert better == pytest.approx(deviation(entries["as measured"]) / 5, rel=0.01)


def test_another_test_is_worth_what_its_data_are(listed, tmp_path):
    """The steps of both tests as one: an elastic body knows no other history."""
    both = compared(tmp_path, [0.4, 0.48, 0.8, 0.96]).score_test.own
    spread = np.sqrt(np.diag(np.linalg.inv(both.T @ both)))
    found = deviation(listed["mu_top"]["the same test to 1.2 times the displacement"])
    # 0.04 % found: slopes are differences
    assert found == pytest.approx(spread[0], rel=0.01)


def test_slopes_of_the_fit_which_may_be_from_beside_the_estimate_do_not_matter(block, listed, monkeypatch):
    taken = block.slope
    monkeypatch.setattr(block, "slope", lambda name: taken(name) * np.array([1.0, 1.05]))
    assert {entry.title: entry for entry in identification(block)[0]["mu_top"]} == listed["mu_top"]


def test_without_any_force_it_is_the_force(tmp_path):
    quiet = {**DESCRIPTION, "noise": {"force": 0.001, "displacement": 1e-5}}
    write_json(tmp_path / "experiment.yaml", quiet)
    truth = read_truth(tmp_path / "experiment.yaml")
    write_study(truth, solve(truth, tmp_path / "body", 1), tmp_path / "study")
    steps, description = tmp_path / "study/steps.csv", tmp_path / "study/study.yaml"
    description.write_text(description.read_text().replace("control: force", "control: displacement"))
    step, displacement, _, picture = steps.read_text().splitlines()[1].split(",")
    steps.write_text(f"step,displacement,picture\n{step},{displacement},{picture}\n")
    problem, everything = begin(load_settings({**SHARED, "study": str(tmp_path / "study")}), tmp_path)
    comparison = comparison_of(problem, run_fit(problem, 1)[0], everything)
    found, _ = identification(comparison)
    first, *others = found["mu"][1:]
    assert first.title == "the force measured, to 1 % of its largest value"
    assert first.identified
    # the force of one step is proportional to mu: its noise of 1 %; where the fit ends between the bounds is chance
    bounds = [SHARED["model"]["parameters"]["mu"][end] for end in ("lower", "upper")]
    expected = np.clip(comparison.base.values["mu"] * np.exp([-NORMAL * 0.01, NORMAL * 0.01]), *bounds)
    assert np.log(first.interval) == pytest.approx(np.log(expected), abs=0.02 * NORMAL * 0.01)
    assert not any(one.identified for one in others)


def fitted(folder, tables, truth=TRUTH, **how):
    """A block of two layers as one study of several tests, or of one: displacements and forces of each."""
    (folder / "study").mkdir(parents=True)
    for name, rows in tables.items():
        lines = [f"{n},{moved},{force:.10g}" for n, (moved, force) in enumerate(rows, 1)]
        (folder / f"study/{name}.csv").write_text("\n".join(["step,displacement,force", *lines]) + "\n")
    own = {name: {"steps": f"{name}.csv"} for name in tables}
    study = {**STUDY, "noise": {"force": 0.05}}
    study |= {"tests": own} if len(own) > 1 else {"steps": f"{next(iter(own))}.csv"}
    (folder / "study/study.yaml").write_text(yaml.safe_dump(study))
    model = {**copy.deepcopy(MODEL), "parameters": {name: {**MU, "start": mu} for name, mu in truth.items()}}
    fit = {**FIT, "stages": [{"name": "descent", "kind": "least_squares"}]}
    given = {"study": str(folder / "study"), "model": model, "fit": fit, **how}
    problem, everything = begin(load_settings(given), folder)
    last, _ = run_fit(problem, 1)
    solve_missing(problem, [anchor_of(problem, last)], 1)
    return problem, last, everything


def test_two_tests_tell_together_what_one_with_all_steps_does(block, listed, tmp_path):
    """An elastic body knows no history: forces of two tests are worth those of one, and so is what is measured next."""
    data = block.problem.data
    rows = list(zip(data.displacement, data.force, strict=True))
    found, run = identification(comparison_of(*fitted(tmp_path, {"low": rows[:1], "high": rows[1:]})))
    together = {one.title: one for one in found["mu_top"]}
    assert run > 0 and found["mu_top"][0].title == "as measured"
    assert deviation(together["as measured"]) == pytest.approx(deviation(listed["mu_top"]["as measured"]), rel=0.01)
    titles = {title for title in listed["mu_top"] if title != "as measured"}
    assert set(together) == {"as measured"} | {f"{test}: {title}" for test in ("low", "high") for title in titles}
    # a test to 0.96 mm beside 0.4 and 0.8 mm: slopes of the block with all of these steps
    both = compared(tmp_path / "all", [0.4, 0.8, 0.96]).score_test.own
    spread = np.sqrt(np.diag(np.linalg.inv(both.T @ both)))
    assert deviation(together["high: the same test to 1.2 times the displacement"]) == pytest.approx(
        spread[0], rel=0.02
    )


def test_of_two_equal_tests_a_better_one_is_worth_half_of_what_both_would_be(tmp_path):
    """Forces with a fifth of the noise bring 25 times the signal of one test, and 26 instead of 2 in both."""
    rows = [(0.4, 12.0), (0.8, 27.0), (1.2, 46.0), (1.6, 71.0)]
    gains, tried = {}, {"only": ["stiffening", "compressibility"]}
    for name, tables in (("one", {"a": rows}), ("two", {"a": rows, "b": rows})):
        problem, last, everything = fitted(tmp_path / name, tables, {"mu": 0.05}, diagnosis=tried)
        found = diagnose(problem, last, everything)
        ranking = {one.candidate.effect.name: one for one in found.ranking}
        gains[name], _ = separation(found.comparison, ranking["stiffening"], ranking["compressibility"])
    one, two = (dict(found) for found in gains.values())
    title = "forces and displacements measured five times better"
    assert one[title] == pytest.approx(25.0, rel=1e-6)
    assert [two[f"{test}: {title}"] for test in "ab"] == pytest.approx([13.0, 13.0], rel=1e-6)
    assert set(two) == {f"{test}: {title}" for test in "ab" for title in one}
    farther = "the same test to 1.2 times the displacement"
    assert two[f"a: {farther}"] > 1.0
