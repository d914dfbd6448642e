"""Jobs of a fit whose simulations are short: several rounds each, with the same end as round by round."""

import time

import pytest
from test_nearby import fit  # noqa: F401

from fingerfit.fit.jobs import next_job
from fingerfit.fit.simulate import run_fit
from fingerfit.fit.took import Took


@pytest.fixture
def short(fit, monkeypatch):  # noqa: F811
    """The fit of the other tests, whose simulations count as what they are."""
    monkeypatch.undo()
    return fit


def test_one_job_makes_all_rounds_that_follow_a_search(short):
    jobs, last, took, began = 0, None, Took(), time.monotonic()
    while last is None or last.stop is None:
        last, jobs = next_job(short, last, 1, took=took), jobs + 1
    # each simulation was solved, and timed, once: those that are answered beside another one, too
    assert took.number == len(list(short.sims.glob("*/solution.npz"))) > 1
    assert 0 < took.seconds < time.monotonic() - began
    expected, run = run_fit(short, 1)
    assert run == 0
    assert jobs < expected.number + 1
    assert (last.batch, last.best, last.slopes, last.stop) == (
        expected.batch, expected.best, expected.slopes, expected.stop
    )  # fmt: skip
    # what is repeated is not counted twice
    assert not [one for one in last.solved if one in last.batch]
