"""The first pass on a body that is far from the fitted model: slopes there say little, refits what is hidden."""

import numpy as np
import pytest
from test_diagnosis import DESCRIPTION, MESHES

from fingerfit.core.errors import StateError
from fingerfit.core.files import write_json
from fingerfit.diagnosis import first_pass
from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.comparison import Comparison, anchor_of, best_places, rank_candidates
from fingerfit.diagnosis.first_pass import FirstPass, refit_all, widened
from fingerfit.fit.minimum import finest
from fingerfit.fit.simulate import begin, run_fit, solve_missing
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import read_truth, solve, write_study

SHIFT = 4.0
"""Exponent 5.4 where the model has 1.4: at the last step the reaction is half as large again."""
NAMES = ("stiffening", "compressibility", "tilt", "misregistration")


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stiff")
    own = {"displacement": [0.75, 1.5, 2.25, 3.0], "effects": {"stiffening": {"shift": SHIFT}}}
    write_json(folder / "experiment.yaml", {**DESCRIPTION, **own})
    truth = read_truth(folder / "experiment.yaml")
    write_study(truth, solve(truth, folder / "body", 1), folder / "study")
    mu = {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2}
    model = {"material": DESCRIPTION["material"], **MESHES, "parameters": {"mu_top": mu, "mu_bottom": mu}}
    stages = [{"name": "independent", "kind": "independent", "tolx": 0.2, "tolf": 2e-2}]
    fitting = {"score": "nmi", "bins": 16, "steps": [2, 4], "stages": stages}
    settings = load_settings({"study": str(folder / "study"), "model": model, "fit": fitting})
    problem, everything = begin(settings, folder / "model")
    last = run_fit(problem, 1)[0]
    found = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in NAMES]
    solve_missing(problem, [anchor_of(problem, last), *(asked for one in found for asked in one.asked)], 1)
    comparison = Comparison(problem, last, everything)
    ranking = best_places(rank_candidates(comparison, comparison.score_test, found))
    return comparison, last, ranking, refit_all(comparison, last, ranking)[0]


def test_the_hidden_effect_comes_first_and_explains_it(world):
    comparison, _, _, ranking = world
    best = ranking[0]
    assert best.candidate.effect.name == "stiffening"
    assert best.refitted.converged
    assert best.refitted.share > 0.9
    # what is left is noise: five of its standard deviations
    count = FirstPass(comparison).count
    assert best.refitted.misfit < count + 5 * np.sqrt(2 * count)
    assert all(one.refitted.share < best.refitted.share for one in ranking[1:])


def test_the_refit_ends_at_the_minimum_of_what_it_fits(world):
    """From the other side, it ends at the same place, within what the last move may still be worth."""
    comparison, last, _, ranking = world
    wider = widened(comparison.problem, last, ranking[0])
    first = FirstPass(comparison)
    start = {**ranking[0].refitted.values, "stiffening.shift": 1.5 * ranking[0].refitted.values["stiffening.shift"]}
    again = first.refit(wider, start)
    assert again.converged
    assert again.misfit == pytest.approx(ranking[0].refitted.misfit, rel=2 * first_pass.FALL)


def test_one_that_does_not_end_says_so(world, monkeypatch):
    comparison, last, ranking, _ = world
    monkeypatch.setattr(first_pass, "MOVES", 2)
    stiffening = next(one for one in ranking if one.candidate.effect.name == "stiffening")
    found = FirstPass(comparison).refit(
        wider := widened(comparison.problem, last, first_pass._just_present(stiffening)), wider.settings.starts()
    )
    assert not found.converged


def test_a_number_at_its_bound_is_said_so(world):
    comparison, last, _, ranking = world
    wider = widened(comparison.problem, last, ranking[0])
    for parameter in (parameters := list(wider.settings.parameters())):
        if parameter.name == "stiffening.shift":
            near = first_pass.replace(parameter, lower=0.0, upper=0.5, start=0.3, unity=parameter.scale)
            parameters[parameters.index(parameter)] = near
            break
    object.__setattr__(wider.settings, "parameters", lambda: tuple(parameters))
    found = FirstPass(comparison).refit(wider, {**wider.settings.starts(), "stiffening.shift": 0.3})
    assert found.at_bound == ("stiffening.shift",)


def test_no_start_no_refit(world, monkeypatch):
    comparison, last, _, ranking = world
    wider, first = widened(comparison.problem, last, ranking[0]), FirstPass(comparison)
    monkeypatch.setattr(comparison, "read", lambda asked: None)
    with pytest.raises(StateError, match="no solution"):
        first.refit(wider, wider.settings.starts())
