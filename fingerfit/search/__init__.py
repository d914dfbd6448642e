"""Search for the best guess: numbers only, and a pure function of what is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fingerfit.model.parameters import Parameter
from fingerfit.search.descent import Match, descend
from fingerfit.search.stages import LEAST_SQUARES, MET, Point, Space, Stage, run_stage

__all__ = ["Evaluation", "Match", "Plan", "Proposal", "Stage", "propose"]


@dataclass(frozen=True)
class Evaluation:
    """A guess and its score; None for a guess without solution. Least squares need its match, too."""

    point: Point
    value: float | None
    match: Match | None = None


@dataclass(frozen=True)
class Plan:
    """How to search.

    Parameters
    ----------
    stages : tuple of Stage
        In order; each starts at the best point of the one before.
    batch : int
        Guesses that can be tried at once; the path of the search does not depend on it.
    max_evaluations : int
        The search stops when its path has used as many.
    """

    stages: tuple[Stage, ...]
    batch: int = 2
    max_evaluations: int = 400


@dataclass(frozen=True)
class Proposal:
    """What to try next, or why to stop.

    Parameters
    ----------
    batch : tuple of Point
        Guesses in units; first those the search cannot go on without.
    stage : str
        Name of the stage.
    iteration : int
        Of the stage.
    best : Point or None
        Where the search stands; at the end its result.
    stop : str or None
        Why it ended.
    used : int
        Evaluations on the path of the search.
    tolerances : dict
        By the name of the tolerance what the stage reached and what is wanted; empty where there is nothing to compare.
    """

    batch: tuple[Point, ...]
    stage: str
    iteration: int
    best: Point | None
    stop: str | None
    used: int
    tolerances: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def propose(history: Sequence[Evaluation], parameters: tuple[Parameter, ...], plan: Plan) -> Proposal:
    """Replay the search over the known evaluations, and say what it needs next.

    Parameters
    ----------
    history : sequence of Evaluation
        In any order; points that the search does not ask for are no harm.
    parameters : tuple of Parameter
        With units, scales, bounds and start.
    plan : Plan
        Stages and limits.
    """
    space = Space(parameters)
    known = {e.point: np.inf if e.value is None or not np.isfinite(e.value) else e.value for e in history}
    matches = {e.point: e.match for e in history}
    best, used, reason = space.coordinates([p.start for p in parameters]), set[Point](), MET
    for stage in plan.stages:
        descends = stage.kind == LEAST_SQUARES
        running = descend(stage, space, best, matches) if descends else run_stage(stage, space, best)
        request, iteration = next(running)
        while True:
            needed = [space.point(z) for z in request.needed]
            missing = list(dict.fromkeys(point for point in needed if point not in known))
            if missing:
                likely = [space.point(z) for z in request.likely]
                extra = [p for p in dict.fromkeys(likely) if p not in known and p not in missing]
                batch = tuple(missing + extra[: max(0, plan.batch - len(missing))])
                reached = zip(("tolx", "tolf"), request.spread or (), (stage.tolx, stage.tolf), strict=False)
                told = {name: (value, wanted) for name, value, wanted in reached}
                return Proposal(batch, stage.name, iteration, space.point(best), None, len(used), told)
            used.update(needed)
            if len(used) > plan.max_evaluations:
                return Proposal((), stage.name, iteration, space.point(best), "evaluations used up", len(used))
            try:
                request, iteration = running.send([known[point] for point in needed])
            except StopIteration as finished:
                best, reason = finished.value
                break
    return Proposal((), plan.stages[-1].name, iteration, space.point(best), reason, len(used))
