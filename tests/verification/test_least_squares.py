"""The least squares of the search and its simplex, on one study."""

from dataclasses import replace

import pytest
import small_body

from fingerfit.core.errors import Problems
from fingerfit.fit.check import check_against_study
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings
from fingerfit.study.reader import load_study

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


def test_forces_alone_are_refused(study):
    config = small_body.config_of(study)
    config["fit"] |= {"score": "likelihood", "stages": [DESCENT]}
    made = load_study(study)
    without = replace(made, before=None, steps=tuple(replace(step, picture=None) for step in made.steps))
    del config["fit"]["steps"]
    with pytest.raises(Problems, match=r"fit\.stages\.0\.kind: found least_squares, without pictures or points"):
        check_against_study(load_settings(config), without)
