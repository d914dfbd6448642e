"""Answers to guesses beside one that is solved, without simulations of their own."""

from __future__ import annotations

from collections.abc import Sequence

from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.solvers.contract import Outcome
from fingerfit.solvers.cost import BUILTIN


def beside(problem: InverseProblem, here: Asked, guesses: Sequence[Asked]) -> list[Outcome | None]:
    """Answers to guesses a small step from one that is solved, to first order, as `InverseProblem.outcome` has them.

    They are no simulations, and are not kept.

    Returns
    -------
    list
        None where a guess has to be simulated: see `fingerfit.solvers.first_order.answers`; with any other solver than
        the built-in one, with several tests, and on another mesh.
    """
    nothing: list[Outcome | None] = [None] * len(guesses)
    if problem.settings.solver != BUILTIN or len(problem.every) > 1:
        return nothing
    from fingerfit.solvers.first_order import answers

    folder = problem.sims / here.sim
    found = answers(folder, here.deck, Outcome.load(folder / "solution.npz"), [one.deck for one in guesses])
    return [
        problem.seen_since(answer, one) if answer and one.mesh == here.mesh else None
        for one, answer in zip(guesses, found, strict=True)
    ]
