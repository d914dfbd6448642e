"""Two searches for the same constants, compared."""

import pytest

from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.simulate import begin, run_fit


def ends_alike_in_half(settings, quicker, folder):
    """Both end at the same constants, within half a standard error; the quicker one asks half the guesses at most."""
    found, asked = [], []
    for n, one in enumerate((settings, quicker)):
        problem, _ = begin(one, folder / f"search_{n}")
        last, _ = run_fit(problem, 2)
        assert last.stop == "tolerances met"
        found.append(estimate_of(problem, last, 1)["parameters"])
        asked.append(len(last.history))
    for name, entry in found[0].items():
        assert found[1][name]["value"] == pytest.approx(entry["value"], abs=0.5 * entry["standard_error"])
    assert asked[1] <= 0.5 * asked[0]
