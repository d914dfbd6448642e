"""The least squares of the search and its simplex, on one study."""

import pytest
import small_body
from searches import ends_alike_in_half

from fingerfit.settings.config import load_settings

DESCENT = {"name": "least squares", "kind": "least_squares", "tolx": 0.02}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return small_body.written(tmp_path_factory.mktemp("made"), effects={})


def test_least_squares_find_the_constants_of_the_simplex_in_half_of_its_simulations(study, tmp_path):
    config = small_body.config_of(study, small_body.SMALL)
    grid, simplex = config["fit"]["stages"]
    finer = [grid, {**simplex, "tolx": DESCENT["tolx"], "tolf": 1e-3}]
    simplex, descent = (load_settings({**config, "fit": {**config["fit"], "stages": s}}) for s in (finer, [DESCENT]))
    # both searches end within their tolerances; from there slopes lead to the same minimum of one score. Measured:
    # within 0.1 standard errors
    ends_alike_in_half(simplex, descent, tmp_path)
