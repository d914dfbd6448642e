"""Slopes of a model's own numbers, and what is seen by them, against the model moved to either side."""

import numpy as np
import pytest
from small_body import SMALL, config_of, written

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.fit.slopes import moved
from fingerfit.settings.config import load_settings

STEP = 0.05
STRETCH = {"growing": 1, "across": 0.01, "along": 0.006, "lean": 0.004, "climb": -0.005}


@pytest.mark.parametrize(
    ("effects", "where"),
    [({"stretched_pictures": STRETCH}, slice(None, -4)), ({"ageing": {"change": 0.2}}, slice(-4, None))],
    ids=["seen alone, with a place that is not fitted", "in the deck and seen"],
)
def test_they_are_those_of_the_search(effects, where, tmp_path):
    """By search coordinates, as those of the constants: both are weighed together."""
    study = written(tmp_path, effects={})
    config = config_of(study, {"mesh": SMALL["mesh"]})
    config["model"]["effects"] = effects
    config["fit"]["stages"] = [{"name": "steps", "kind": "least_squares", "tolx": 0.2, "tolf": 0.02}]
    problem, everything = begin(load_settings(config), tmp_path / "model")
    last, _ = run_fit(problem, 1)
    comparison = Comparison(problem, last, everything)
    of_interest = np.zeros(comparison.residual.kept.shape, dtype=bool)
    of_interest[where] = True
    parameters, best = problem.settings.parameters(), comparison.base.values
    for n, parameter in enumerate(parameters):
        step = STEP * np.eye(len(parameters))[n]
        sides = [problem.ask(moved(parameters, best, sign * step)) for sign in (1.0, -1.0)]
        solve_missing(problem, sides, 1)
        ahead, behind = (Comparison(problem, last, everything, base=one).residual for one in sides)
        both = comparison.residual.kept & ahead.kept & behind.kept & of_interest
        left = [one.vector[both[one.kept]] for one in (ahead, behind)]
        wanted = (left[1] - left[0]) / (2 * STEP)
        found = comparison.column(parameter)[both]
        # registered pictures differ by what they do not follow: 0.95 to 1.00 and 0.13 to 0.23 on three seeds
        assert found @ wanted == pytest.approx(wanted @ wanted, rel=0.15)
        assert np.linalg.norm(found - wanted) < 0.35 * np.linalg.norm(wanted)
