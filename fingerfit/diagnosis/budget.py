"""How many models the first pass can try in the time that a user waits for it."""

from __future__ import annotations

from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.solvers.cost import expected_seconds

LONGEST, QUICK = 1200.0, 20.0
"""Seconds of one processor that the first moves of all starts may take together, as expected: ten minutes on two; and
that a user hardly notices. Choices (decision 15)."""
FIRST_MOVES, MOVES, FEWEST = 4, 12, 6
"""A refit that has not ended after so many moves has not converged. After the first few only a third of the candidates
goes on, but so many at least (successive halving: Jamieson and Talwalkar 2016)."""


def starts(problem: InverseProblem) -> int:
    """How many starts of the first pass take `LONGEST` together, at least `FEWEST`."""
    return max(FEWEST, _affordable(problem, LONGEST, FIRST_MOVES))


def going_on(problem: InverseProblem, effects: int) -> int:
    """How many of so many effects make all their moves: a third, or as many as take `QUICK`."""
    return max(FEWEST, effects // 3, _affordable(problem, QUICK, MOVES - FIRST_MOVES))


def _affordable(problem: InverseProblem, seconds: float, moves: int) -> int:
    """By the expected time of a simulation. Processors do not count: on any machine the same ones are made."""
    solver, meshes = problem.settings.solver, [test.meshes[SEARCH] for test in problem.every]
    return int(seconds / moves / sum(expected_seconds(solver, m.dim, len(m.points)) for m in meshes))
