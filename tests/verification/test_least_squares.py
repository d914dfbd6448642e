"""The least squares of the search and its simplex, on one study."""

import pytest
import small_body

from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings

DESCENT = {"name": "least squares", "kind": "least_squares", "tolx": 0.02}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return small_body.written(tmp_path_factory.mktemp("made"), effects={})


def test_least_squares_find_the_constants_of_the_simplex_in_half_of_its_simulations(study, tmp_path):
    config = small_body.config_of(study, small_body.SMALL)
    grid, simplex = config["fit"]["stages"]
    finer = [grid, {**simplex, "tolx": DESCENT["tolx"], "tolf": 1e-3}]
    found, asked = {}, {}
    for kind, stages in (("simplex", finer), ("least squares", [DESCENT])):
        problem, _ = begin(load_settings({**config, "fit": {**config["fit"], "stages": stages}}), tmp_path / kind)
        last, _ = run_fit(problem, 2)
        assert last.stop == "tolerances met"
        found[kind], asked[kind] = estimate_of(problem, last, 1)["parameters"], len(last.history)
    for name, entry in found["simplex"].items():
        # both searches end within their tolerances; from there slopes lead to the same minimum of one score. Measured:
        # within 0.1 standard errors
        assert found["least squares"][name]["value"] == pytest.approx(entry["value"], abs=0.5 * entry["standard_error"])
    assert asked["least squares"] <= 0.5 * asked["simplex"]
