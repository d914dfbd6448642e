"""Answers to guesses beside one that is solved, without simulations of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.solvers.contract import Outcome, SolverToFirstOrder
from fingerfit.solvers.registry import get_solver


def beside(problem: InverseProblem, here: Asked, guesses: Sequence[Asked]) -> list[Outcome | None]:
    """Answers to guesses a small step from one that is solved, to first order, as `InverseProblem.outcome` has them.

    They are no simulations, and are not kept.

    Returns
    -------
    list
        None where a guess has to be simulated: where the solver cannot, with several tests, and on another mesh.
    """
    solver = get_solver(problem.settings.solver)
    if not solver.capabilities.first_order or len(problem.every) > 1:
        return [None] * len(guesses)
    folder, moved = problem.sims / here.sim, [one.deck for one in guesses]
    found = cast(SolverToFirstOrder, solver).first_order(folder, here.deck, problem.answer(here.sim), moved)
    return [
        problem.seen_since(answer, one) if answer and one.mesh == here.mesh else None
        for one, answer in zip(guesses, found, strict=True)
    ]
