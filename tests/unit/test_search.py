"""The downhill simplex against scipy's, and the properties of a replayed search."""

import numpy as np
import pytest
from scipy.optimize import minimize

from fingerfit.model.parameters import Parameter
from fingerfit.search import Evaluation, Plan, Stage, propose
from fingerfit.search.simplex import downhill

FUNCTIONS = {
    "rosenbrock": lambda x: 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2,
    "absolute": lambda x: abs(x[0] - 0.3) + 3 * abs(x[1] + 0.2),
    "plateau": lambda x: float(max(0.0, abs(x[0]) + abs(x[1]) - 0.5)),
    "wall": lambda x: np.inf if x[0] > 1.2 else (x[0] - 1) ** 2 + (x[1] - 2) ** 2,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_same_steps_as_scipy(name):
    function, first = FUNCTIONS[name], np.array([[-1.2, 1.0], [-1.0, 1.1], [-1.1, 0.7]])
    theirs, ours = [], []

    def watched(x):
        theirs.append(tuple(x))
        return function(x)

    minimize(
        watched, first[0], method="Nelder-Mead", options={"initial_simplex": first, "maxiter": 60, "xatol": 0, "fatol": 0}
    )  # fmt: skip
    running = downhill(first, lambda simplex: simplex.iterations >= 60)
    request = next(running)
    try:
        while True:
            ours += [tuple(point) for point in request.needed]
            request = running.send([function(point) for point in request.needed])
    except StopIteration:
        pass
    count = min(len(ours), len(theirs))
    assert count > 60
    assert np.array(ours[:count]) == pytest.approx(np.array(theirs[:count]), abs=1e-12)


OPTIMUM = np.log([2.11e-2, 3.57e-2, 6.56e-2])
PARAMETERS = tuple(Parameter(f"mu_{n}", "MPa", 1e-3, 1.0, 0.1) for n in ("top", "middle", "bottom"))


def bowl(point):
    d = np.log(point) - OPTIMUM
    return -0.3 / (1 + 0.1 * d @ d + 1.6 * d.mean() ** 2)


def search(plan, history=(), function=bowl):
    history, rounds = list(history), 0
    while True:
        proposal = propose(history, PARAMETERS, plan)
        if proposal.stop:
            return proposal, history, rounds
        rounds += 1
        history += [Evaluation(point, function(point)) for point in proposal.batch]


def plan(tol=1e-5, batch=2, limit=400):
    return Plan(
        (Stage("g", "grid"), Stage("e", "equal", 1e-3, 1e-3), Stage("i", "independent", tol, tol)),
        batch,
        limit,
    )


def test_finds_the_optimum_and_its_path_does_not_depend_on_the_batch():
    results = [search(plan(batch=batch)) for batch in (1, 2, 4)]
    best = {proposal.best for proposal, _, _ in results}
    assert len(best) == 1
    assert np.log(best.pop()) == pytest.approx(OPTIMUM, abs=1e-3)
    rounds = [count for _, _, count in results]
    assert rounds[0] > rounds[1] > rounds[2]


def test_a_tighter_tolerance_goes_on_where_the_looser_one_stopped():
    loose, known, _ = search(plan(1e-3))
    tight, more, _ = search(plan(1e-5), known)
    assert tight.used > loose.used
    assert {e.point for e in known} < {e.point for e in more}
    again, nothing_new, _ = search(plan(1e-3), more)
    assert nothing_new == more
    assert again.best == loose.best


def test_the_order_of_the_history_and_foreign_points_do_not_matter():
    proposal, known, _ = search(plan())
    shuffled = [*known[::-1], Evaluation((0.5, 0.5, 0.5), -9.0)]
    assert propose(shuffled, PARAMETERS, plan()).best == proposal.best


def test_diverged_guesses_are_worst_scores():
    proposal, known, _ = search(plan(), function=lambda p: None if p[0] < 0.018 else bowl(p))
    assert any(e.value is None for e in known)
    assert np.log(proposal.best) == pytest.approx(OPTIMUM, abs=2e-3)


def test_bounds_hold():
    narrow = tuple(Parameter(p.name, "MPa", 0.03, 0.2, 0.1) for p in PARAMETERS)
    history = []
    while not (proposal := propose(history, narrow, plan())).stop:
        history += [Evaluation(point, bowl(point)) for point in proposal.batch]
    assert all(0.03 <= x <= 0.2 for e in history for x in e.point)
    assert proposal.best[0] == 0.03


def test_the_limit_of_evaluations_is_a_reason_to_stop():
    proposal, _, _ = search(plan(limit=20))
    assert proposal.stop == "evaluations used up"


def test_restarts_keep_the_best():
    stages = (Stage("i", "independent", 1e-4, 1e-4, restarts=1),)
    once, _, _ = search(Plan((Stage("i", "independent", 1e-4, 1e-4),)))
    twice, _, _ = search(Plan(stages))
    assert twice.used > once.used
    assert bowl(twice.best) <= bowl(once.best)
