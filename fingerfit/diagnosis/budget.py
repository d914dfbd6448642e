"""How many models the first pass can try in the time that a user waits for it."""

from __future__ import annotations

from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.solvers.cost import expected_seconds

LONGEST = 1200.0
"""Seconds of one processor that the first moves of all starts may take together, as expected: ten minutes on two. A
choice (decision 15)."""
FIRST_MOVES, FEWEST = 4, 6
"""After the first few moves only a third of the candidates goes on, but so many at least (successive halving: Jamieson
and Talwalkar 2016)."""


def affordable(problem: InverseProblem) -> float:
    """How many starts of the first pass take `LONGEST` together, by the expected time of a simulation; at least 6.

    The number of processors does not count: on any machine the same ones are made.
    """
    solver, meshes = problem.settings.solver, [test.meshes[SEARCH] for test in problem.every]
    return max(FEWEST, LONGEST / FIRST_MOVES / sum(expected_seconds(solver, m.dim, len(m.points)) for m in meshes))
