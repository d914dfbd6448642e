"""What follows a search: slopes around its best guess, the finer mesh, and the way to the minimum of the score.

Around the best guess of the search mesh the prediction is linear in the logarithms of the constants. With the
solution of the finer mesh as its base this linear model is moved to the minimum of the very score that was used,
and solved again there, until the steps are small (docs/decisions/0003-two-meshes.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from fingerfit.fit.minimum import TRUST, Minimum, best_values, minimum, unusable
from fingerfit.fit.problem import FINAL, SENSITIVITY, InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.slopes import STEP, coordinates, moved, neighbours

ANCHOR = "anchor"
"""Role of a guess that is solved on the search mesh to be compared with the finest one."""
ADDED = "effects added"
"""Reason for the slopes of a model with effects: it starts where the model without the last one ended."""
FAR, FIRST = 0.12, 0.005
"""A longer move, in the logarithm, needs new slopes: at any time (12 %, docs/decisions/0003-two-meshes.md), and after
the first slopes of a model with effects, taken where it was predicted to be. Choices."""
AGAIN, AGAIN_ADDED = 3, 15
"""How often slopes are taken at most: after a search, and in a model with effects, which has none. They bound the
cost."""
FALL, FALL_SHARE = 0.5, 1e-3
"""Promised fall of a likelihood, and share of it, from which slopes are taken again in studies without pictures: half
a unit of a negative log likelihood is what a move of one standard error costs; a thousandth is a choice."""
CLOSE = 0.05
"""A longer move, in the logarithm, is checked by another solution (docs/decisions/0003-two-meshes.md)."""
NEARER = 0.01
"""The same in a model with effects, where constants and an effect may compensate each other: with relaxation the score
fell along a valley, and an end at steps of 10 % left constants 15 % off (docs/decisions/0003-two-meshes.md)."""
STILL = 0.005
"""A move from the last solution that is this short, in the logarithm, needs no other one: what slopes do not know of it
is of the order of its square, 0.001 %. A choice."""
AS_TRUSTED = 0.9
"""Share of the longest move that is trusted from which one is as long as it: clearly shorter ones end of themselves. A
choice."""
PROMISED = 6.0
"""Log likelihood that slopes may promise beyond the end of a fit: odds of 400 to 1, as where two models are told apart
(`fingerfit.diagnosis.verdict`)."""
POOR, GOOD, WIDER = 0.25, 0.75, 2.0
"""Share of a promised fall that came true below which, and above which, moves are trusted less or more far, and by
which factor more: those of More (1978)."""
BACK = 0.4
"""Share of a move that raised the score which is gone from where it began, and by which moves are then trusted less: a
choice within the 0.1 to 0.5 of More (1978)."""
RAISED = 0.01
"""Share of a promised fall up to which a move that came to it counts as one that raised the score. A choice."""
SOLUTIONS = 4
"""At most as many on the finest mesh, the costliest there are (docs/decisions/0003-two-meshes.md)."""


def around_best(
    problem: InverseProblem,
    base: Mapping[str, Any],
    best: Mapping[str, float],
    reason: str,
    slopes: int = 1,
    rough: bool = False,
) -> Round:
    """The round that asks for the slopes around the best guess, and for the finest solution there.

    Rough slopes, by one side of each constant, are for guesses that will be left: others follow in any case.
    """
    settings = problem.settings
    effects = settings.effects(known=problem.effects)
    absent = {name: value for e in effects for key, value in e.null().items() for name in settings.names_of(key)}
    sides = neighbours(settings.parameters(), best, absent)
    if rough:
        sides = {role: values for role, values in sides.items() if role[0] == "+" or "+" + role[1:] not in sides}
    # the costly one first: it runs beside the others
    batch = [problem.ask(best, FINAL), problem.ask(best, ANCHOR)]
    beside = [problem.ask(values, role, nearby=best) for role, values in sides.items()]
    if not all(one.first_order for asked in beside for one in asked.every):
        # simulations that begin at that guess wait for it: the last ones fill the processors meanwhile
        first = max(0, len(beside) - problem.beside)
        beside[first:] = [problem.ask(asked.values, asked.role) for asked in beside[first:]]
    batch += beside
    if problem.observed.any():
        batch += _by_control(problem, best)
    return Round(stage=SENSITIVITY, stop=None, batch=batch, reason=reason, slopes=slopes, rough=rough, **base)


def _by_control(problem: InverseProblem, best: Mapping[str, float]) -> list[Asked]:
    """Slopes by the prescribed quantity: intervals and the diagnosis need them, a move seldom.

    Of long simulations by one side: the noise of that quantity need not be known to the percent.
    """
    gains = {"+control": 1.0 + STEP} | ({} if problem.long else {"-control": 1.0 - STEP})
    return [problem.ask(best, role, gain, nearby=best) for role, gain in gains.items()]


def refine_round(problem: InverseProblem, last: Round) -> Round:
    """The round after slopes or a finest solution are known: solve at the minimum of the linear model.

    Raises
    ------
    StateError, InputError
        As `minimum`.
    """
    found = minimum(problem, last)
    again = AGAIN if last.history else AGAIN_ADDED
    if last.slopes < again:
        back, trust = _nearer(problem, last, found)
        if back is not None:
            return _slopes_again(problem, last, back, {"before": (last.best or {})["before"], "trust": trust})
        # no search came before the first slopes of a model with effects: they are taken where it was predicted to be
        far = FAR if last.reason != ADDED else FIRST if last.slopes == 1 else CLOSE
        if last.rough or found.move > far or _cut_short(last, found, trust) or _promises(problem, found):
            before = {"values": dict(found.base.values), "score": _score(problem, found), "fall": found.fall}
            rough = last.reason == ADDED and found.move > FAR and last.slopes + 1 < again
            return _slopes_again(problem, last, found.values, {"before": before, "trust": trust}, rough)
    if last.stage == FINAL and found.move <= STILL and found.base == last.batch[-1]:
        return replace(last, number=last.number + 1, stop=last.reason)
    asked = problem.ask(found.values, FINAL)
    known = list(last.batch)
    if all(asked.role != "+control" for asked in known):
        known += _by_control(problem, best_values(last))
    solutions = sum(a.role == FINAL for a in last.batch)
    lost = solutions > 1 and unusable(problem, last.batch[-1])
    enough = found.move <= _close(last) or solutions + 1 >= SOLUTIONS or lost
    return Round(
        number=last.number + 1,
        stage=FINAL,
        stop=last.reason if enough else None,
        solver=last.solver,
        meshes=last.meshes,
        history=last.history,
        # the same guess on the search mesh shows what the finer mesh changes there
        batch=known if lost else [*known, problem.ask(found.values, ANCHOR), asked],
        best=last.best,
        reason=last.reason,
        slopes=last.slopes,
    )


def stopped_early(problem: InverseProblem, last: Round, found: Minimum) -> bool:
    """Whether a fit ended where slopes promise a better score farther away, which its last moves did not come to."""
    at_last = found.base == last.batch[-1]
    return at_last and found.move > _close(last) and found.fall > PROMISED * problem.unit


def _close(last: Round) -> float:
    """Move from which another solution checks it."""
    return NEARER if last.reason == ADDED else CLOSE


def _slopes_again(
    problem: InverseProblem, last: Round, values: dict[str, float], memory: dict[str, Any], rough: bool = False
) -> Round:
    """The round that asks for slopes elsewhere; it remembers where the step began and how far steps are trusted."""
    base: dict[str, Any] = {
        "number": last.number + 1,
        "solver": last.solver,
        "meshes": last.meshes,
        "history": last.history,
        "best": {"values": values, "score": None, **memory},
    }
    return around_best(problem, base, values, last.reason or "", last.slopes + 1, rough)


def _nearer(problem: InverseProblem, last: Round, found: Minimum) -> tuple[dict[str, float] | None, float]:
    """The guess at `BACK` of a move that raised the score, or None where it did not; how far the next one is trusted.

    By the share of the promised fall that came true (Levenberg and Marquardt's method with a trust region: More 1978).
    """
    best = last.best or {}
    before, trust = best.get("before"), best.get("trust", TRUST)
    if last.stage != SENSITIVITY or before is None or not before["fall"] > 0:
        return None, trust
    true = (before["score"] - _score(problem, found)) / before["fall"]
    trust = BACK * trust if true < POOR else min(WIDER * trust, TRUST) if true > GOOD else trust
    parameters = problem.settings.parameters()
    way = BACK * (coordinates(parameters, found.base.values) - coordinates(parameters, before["values"]))
    # so near to where the move began that there is nothing to go back to
    if true > RAISED or np.abs(way).max() < NEARER:
        return None, trust
    return moved(parameters, before["values"], way), trust


def _cut_short(last: Round, found: Minimum, trust: float) -> bool:
    """Whether a move is short only because a longer one was not trusted, after one that came true: no minimum is near.

    `trust` is how far the next one is trusted: less than this one where that before it did not come true.
    """
    now = (last.best or {}).get("trust", TRUST)
    return last.stage == SENSITIVITY and found.move > AS_TRUSTED * now and trust >= now


def _promises(problem: InverseProblem, found: Minimum) -> bool:
    """Whether forces and points alone, cheap and exact, still see a move that is short."""
    return problem.exact and found.fall > max(FALL, FALL_SHARE * _score(problem, found))


def _score(problem: InverseProblem, found: Minimum) -> float:
    return problem.score(found.model.base, found.base.values)
