"""The least squares of the search, on displacements with a closed form."""

import numpy as np
import pytest

from fingerfit.model.parameters import Parameter
from fingerfit.search import Evaluation, Match, Plan, Stage, propose

TRUE = (0.021, 0.036, 0.066)
PARAMETERS = tuple(Parameter(f"mu_{n}", "MPa", 1e-3, 1.0, 0.1) for n in ("top", "middle", "bottom"))
TOL = 1e-3
DESCENT = Stage("d", "least_squares", TOL)
HEIGHTS = np.tril(np.ones((3, 3)))
"""Layers on top of each other: each moves by its own compliance, and with those below it."""


def moved(point):
    return HEIGHTS @ (0.1 / np.asarray(point)) ** 0.8


def matched(point, reach=np.inf):
    """What is left at a guess; displacements that are farther off than `reach` are not known."""
    left = moved(TRUE) - moved(point)
    return Match(moved(point), np.where(abs(left) < reach, left, np.nan), np.full(3, 1e-3))


def search(match=matched, parameters=PARAMETERS, stage=DESCENT, plan=None):
    history = []
    while not (proposal := propose(history, parameters, plan or Plan((stage,)))).stop:
        found = [match(point) for point in proposal.batch]
        history += [
            Evaluation(p, None if m is None else float(np.nansum(m.left**2)), m)
            for p, m in zip(proposal.batch, found, strict=True)
        ]
    return proposal, history


def test_finds_the_constants_in_few_guesses():
    proposal, history = search()
    assert proposal.stop == "tolerances met"
    assert np.log(proposal.best) == pytest.approx(np.log(TRUE), abs=TOL)
    # four guesses a move, from a factor of five away; the simplex takes 61
    assert len(history) <= 24


def test_asks_for_the_same_again():
    """The search is a pure function of what is known: replayed from any part of it, it goes on as it did."""
    _, history = search()
    for count in (4, 8, 12):
        batch = propose(history[:count][::-1], PARAMETERS, Plan((DESCENT,))).batch
        assert batch == tuple(e.point for e in history[count : count + 4])


def test_stays_within_bounds():
    low = tuple(Parameter(p.name, "MPa", 0.03, 1.0, 0.1) for p in PARAMETERS)
    proposal, history = search(parameters=low)
    assert proposal.stop == "tolerances met"
    assert proposal.best[0] == 0.03
    assert all(x >= 0.03 for e in history for x in e.point)


def test_guesses_without_solution_shorten_the_steps():
    def soft(point):
        return None if 0.045 < point[0] < 0.055 else matched(point)

    proposal, history = search(soft)
    assert any(e.match is None for e in history)
    assert proposal.stop == "tolerances met"
    assert np.log(proposal.best) == pytest.approx(np.log(TRUE), abs=TOL)


def test_what_is_too_far_to_be_registered_comes_in_later():
    proposal, _ = search(lambda point: matched(point, reach=4.0))
    assert np.log(proposal.best) == pytest.approx(np.log(TRUE), abs=TOL)


@pytest.mark.parametrize(
    ("match", "stop"),
    [
        (lambda point: None, "no guess has a solution"),
        # nothing but the start has a solution
        (
            lambda point: matched(point) if point == (0.1, 0.1, 0.1) else None,
            "not converged: no solution beside the best guess",
        ),
        # as much is left wherever a move leads
        (lambda point: Match(-np.log(point), np.ones(3), np.full(3, 1e-3)), "not converged in 30 moves"),
        (
            lambda point: matched(point, reach=2.0),
            "not converged: all that was measured is too far off to be registered",
        ),
    ],
)
def test_says_why_it_did_not_converge(match, stop):
    wide = tuple(Parameter(p.name, "MPa", 1e-12, 1e6, 0.1) for p in PARAMETERS)
    proposal, _ = search(match, wide)
    assert proposal.stop == stop


def test_slopes_that_promise_in_vain_are_said():
    """Slopes of one sign and moves of the other, however short."""

    def vain(point):
        away = np.log(np.asarray(point) / 0.1)
        return Match(np.where(abs(away) < 0.031, away * np.sign(away), away**2), np.full(3, -1.0), np.full(3, 1e-3))

    proposal, _ = search(vain)
    assert proposal.stop == "not converged: no move lowers the misfit"


def test_bounds_of_evaluations_and_units_hold():
    proposal, _ = search(plan=Plan((DESCENT,), max_evaluations=9))
    assert proposal.stop == "evaluations used up"
    rough, _ = search(stage=Stage("d", "least_squares", 0.02, tolx_in="unit"))
    assert rough.used < search()[0].used
    assert np.array(rough.best) == pytest.approx(TRUE, abs=0.02)
