"""The stages of a search, replayed over what is known: grid, all alike, each by itself, least squares."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fingerfit.model.parameters import DIGITS, Parameter, round_value
from fingerfit.search.simplex import Request, Simplex, downhill

Point = tuple[float, ...]

MET = "tolerances met"
NO_SOLUTION = "no guess has a solution"
NO_SMALLER = "guesses differ in their last digit only"
"""Reasons for the end of a stage."""
SHARE, UNIT = "share", "unit"
"""Measures of `Stage.tolx`."""
GRID, EQUAL, INDEPENDENT, LEAST_SQUARES = "grid", "equal", "independent", "least_squares"
"""Kinds of stages."""


@dataclass(frozen=True)
class Stage:
    """One stage of a search.

    Parameters
    ----------
    name : str
        For reports.
    kind : str
        ``grid``: forward analyses with all tied parameters alike, over the bounds they share; ``equal``: a simplex with
        all tied parameters alike; ``independent``: a simplex over all parameters; ``least_squares``: steps of
        Gauss-Newton over all parameters, on displacements and reactions.
    tolx : float
        Largest difference of a parameter between the best vertex and the others: in search coordinates, which are the
        logarithm (0.01: 1 % of the value) or the share of the distance of the bounds. A thousandth is the paper's 1e-5
        MPa for a soft tissue of 0.01 MPa (docs/decisions/0013-search.md). Least squares end with a shorter step.
    tolf : float
        Largest difference of the score, as the paper's second stage has it. A simplex stops when both are met.
    points : int
        Of a grid; a choice.
    step : float
        Size of the first simplex, in search coordinates: a factor of 1.5 of a modulus; a choice.
    restarts : int
        How often a new simplex is started at the best point, in any case.
    tied : tuple of str
        Names of the tied parameters; all when empty.
    tolx_in : str
        ``share``: `tolx` is one of search coordinates; ``unit``: one in the unit of the parameters, as in the paper.
    """

    name: str
    kind: str
    tolx: float = 1e-3
    tolf: float = 1e-5
    points: int = 6
    step: float = 0.4
    restarts: int = 0
    tied: tuple[str, ...] = ()
    tolx_in: str = SHARE


@dataclass(frozen=True)
class Space:
    """Parameters and their search coordinates: the logarithm, or the share of the distance of the bounds."""

    parameters: tuple[Parameter, ...]

    @cached_property
    def low(self) -> np.ndarray:
        """Lower bounds in search coordinates."""
        return self.coordinates([p.lower for p in self.parameters])

    @cached_property
    def high(self) -> np.ndarray:
        """Upper bounds in search coordinates."""
        return self.coordinates([p.upper for p in self.parameters])

    @cached_property
    def digit(self) -> np.ndarray:
        """What the last digit of a guess is worth at most, in search coordinates."""
        last = 10.0 ** (1 - DIGITS)
        return np.array([last if p.log else last * max(-p.lower, p.upper) / _distance(p) for p in self.parameters])

    def clip(self, z: np.ndarray) -> np.ndarray:
        """Move search coordinates into the bounds, and to what a guess's digits can hold."""
        return self.coordinates(self.point(z))

    def point(self, z: np.ndarray) -> Point:
        """Values in their units, with the digits of a guess."""
        return tuple(
            round_value(min(max(float(np.exp(x)) if p.log else p.lower + x * (p.upper - p.lower), p.lower), p.upper))
            for p, x in zip(self.parameters, z, strict=True)
        )

    def coordinates(self, point: Sequence[float]) -> np.ndarray:
        """Search coordinates of values."""
        return np.array(
            [np.log(v) if p.log else (v - p.lower) / _distance(p) for p, v in zip(self.parameters, point, strict=True)]
        )

    def inward(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Steps that stay within the bounds: the other way where a bound is nearer, shorter where both are."""
        ahead = np.where(step > 0, self.high - z, z - self.low)
        behind = np.where(step > 0, z - self.low, self.high - z)
        size, sign = np.abs(step), np.sign(step)
        other = (ahead < size) & (behind > ahead)
        return np.where(other, -sign * np.minimum(size, behind), sign * np.minimum(size, ahead))

    def at_bound(self, points: np.ndarray) -> bool:
        """Whether any of points, shape (points, parameters), is at a bound, to the digits of a guess."""
        return bool(((points <= self.low + self.digit) | (points >= self.high - self.digit)).any())

    def flat(self, points: np.ndarray) -> bool:
        """Whether a simplex, shape (vertices, parameters), has lost a direction, to the digits of a guess."""
        edges = points[1:] - points[0]
        rank = np.linalg.matrix_rank(edges, tol=float(np.linalg.norm(self.digit)))
        return bool(rank < edges.shape[1])

    def flattened(self, points: np.ndarray) -> bool:
        """Whether the last vertex of a simplex was moved onto a bound and there takes a direction from it."""
        return self.at_bound(points[-1:]) and self.flat(points)


def _distance(parameter: Parameter) -> float:
    return parameter.upper - parameter.lower or 1.0


class Tie:
    """Parameters that are alike in some stages.

    Parameters
    ----------
    space : Space
    names : sequence of str
        Of the tied parameters; all when empty.

    Attributes
    ----------
    tied : ndarray of bool, shape (parameters,)
    """

    def __init__(self, space: Space, names: Sequence[str]) -> None:
        self.space = space
        self.tied = np.array([not names or p.name in names for p in space.parameters])

    @cached_property
    def shared(self) -> Space:
        """Space of the one number that they have in common: its bounds are those that all of them have."""
        own = [p for p, tied in zip(self.space.parameters, self.tied, strict=True) if tied]
        lower, upper = max(p.lower for p in own), min(p.upper for p in own)
        return Space((replace(own[0], lower=lower, upper=upper, start=lower),))

    def alike(self, z: np.ndarray, common: float) -> np.ndarray:
        """Coordinates with all tied parameters at one value."""
        (parameter,) = self.shared.parameters
        if parameter.log:
            return np.where(self.tied, common, z)
        value = parameter.lower + common * (parameter.upper - parameter.lower)
        return np.where(self.tied, self.space.coordinates([value] * len(z)), z)

    def common(self, z: np.ndarray) -> np.ndarray:
        """Mean of the tied parameters as a coordinate of `shared`, within its bounds, shape (1,)."""
        mean = z[self.tied].mean()
        if not self.shared.parameters[0].log:
            mean = self.shared.coordinates([float(np.mean(np.array(self.space.point(z))[self.tied]))])[0]
        return np.clip([mean], self.shared.low, self.shared.high)


Search = Generator[tuple[Request, int], list[float], tuple[np.ndarray, str]]


def run_stage(stage: Stage, space: Space, start: np.ndarray) -> Search:
    """One stage from `start`; returns the best coordinates and why it ended."""
    tie = Tie(space, stage.tied)
    if stage.kind == GRID:
        return (yield from _grid(stage, tie, start))
    if stage.kind == INDEPENDENT:
        return (yield from _simplexes(stage, space, start, lambda z: _first(stage, tie, z)))
    half = np.array([-stage.step / 2])
    best, reason = yield from _simplexes(
        stage,
        tie.shared,
        tie.common(start),
        lambda z: np.array([z, z + tie.shared.inward(z, half)]),
        lambda z: tie.alike(start, z[0]),
    )
    return (start if reason == NO_SOLUTION else tie.alike(start, best[0])), reason


def _grid(stage: Stage, tie: Tie, start: np.ndarray) -> Search:
    inner = np.linspace(tie.shared.low[0], tie.shared.high[0], stage.points + 2)[1:-1]
    points = tuple(tie.alike(start, common) for common in inner)
    values = yield Request(points), 0
    return points[int(np.argmin(values))], MET


def _first(stage: Stage, tie: Tie, best: np.ndarray) -> np.ndarray:
    """First simplex: the tied parameters together, each but the last by itself, the others by themselves."""
    alone, space = np.flatnonzero(tie.tied), tie.space
    steps = []
    if len(alone) > 1:
        steps.append(space.inward(best, -stage.step / 4 * tie.tied))
        alone = alone[:-1]
    axes = np.eye(len(best))
    steps += [space.inward(best, -stage.step * axes[axis]) for axis in alone]
    steps += [space.inward(best, stage.step / 2 * axes[axis]) for axis in np.flatnonzero(~tie.tied)]
    return np.array([best, *(best + step for step in steps)])


def _simplexes(
    stage: Stage,
    space: Space,
    best: np.ndarray,
    first: Callable[[np.ndarray], np.ndarray],
    lift: Callable[[np.ndarray], np.ndarray] = lambda z: z,
) -> Search:
    """Simplexes, each started at the best point so far, until the end of one is to be believed.

    Bounds deform a simplex, and a deformed one may end at a point that is no minimum. So where one has touched a bound
    or lost a direction, both sides of its end are tried along each parameter, `tolx` away, and one that is better
    starts a fresh simplex. Within bounds no more directions are needed to see that a score does not fall (Lewis and
    Torczon 1999, Pattern search algorithms for bound constrained minimization, SIAM J. Optim. 9).
    """
    count = 0
    while True:
        watch = _Watch(stage, space)
        simplex = yield from _relay(downhill(first(best), watch.finished, space.clip, space.flattened), lift, watch)
        if not np.isfinite(simplex.values[0]):
            return best, NO_SOLUTION
        best, reason = simplex.points[0], MET if watch.met else NO_SMALLER
        count += 1
        if count <= stage.restarts:
            continue
        sides = _sides(stage, space, best) if watch.touched or space.flat(simplex.points) else []
        if not sides:
            return best, reason
        values = yield Request(tuple(lift(z) for z in sides)), simplex.iterations
        lowest = int(np.argmin(values))
        if values[lowest] < simplex.values[0]:
            best = sides[lowest]
        if not values[lowest] < simplex.values[0] - stage.tolf:
            return best, reason


def _sides(stage: Stage, space: Space, best: np.ndarray) -> list[np.ndarray]:
    """Points at either side of the best one along each parameter, `tolx` away, or at the bound where it is nearer."""
    steps = [sign * stage.tolx * axis for axis in np.eye(len(best)) for sign in (-1.0, 1.0)]
    if stage.tolx_in == UNIT:
        points = [np.maximum(space.point(best) + step, [p.lower for p in space.parameters]) for step in steps]
        found = [space.clip(space.coordinates(point.tolist())) for point in points]
    else:
        found = [space.clip(best + step) for step in steps]
    return [point for point in found if not np.array_equal(point, best)]


class _Watch:
    """Looks at a simplex before each iteration: whether it may end, and whether it has touched a bound."""

    def __init__(self, stage: Stage, space: Space) -> None:
        self.stage, self.space = stage, space
        self.met = self.touched = False
        self.spread: tuple[float, float] | None = None

    def finished(self, simplex: Simplex) -> bool:
        """Whether the tolerances are met, or no vertex has a solution: then there is nothing to go by."""
        self.met = self.close(simplex)
        self.touched |= self.space.at_bound(simplex.points)
        return self.met or not np.isfinite(simplex.values[0])

    def close(self, simplex: Simplex) -> bool:
        """Whether all vertices and their scores are within the tolerances of the best one."""
        if not np.isfinite(simplex.values[-1]):
            return False
        points = simplex.points
        if self.stage.tolx_in == UNIT:
            points = np.array([self.space.point(z) for z in points])
        self.spread = float(np.abs(points - points[0]).max()), float(simplex.values[-1] - simplex.values[0])
        return self.spread[0] <= self.stage.tolx and self.spread[1] <= self.stage.tolf


def _relay(
    asking: Generator[Request, list[float], Simplex], lift: Callable[[np.ndarray], np.ndarray], watch: _Watch
) -> Generator[tuple[Request, int], list[float], Simplex]:
    """Pass a simplex's requests on in full coordinates."""
    count = 0
    request = next(asking)
    while True:
        full = Request(tuple(lift(z) for z in request.needed), tuple(lift(z) for z in request.likely), watch.spread)
        values = yield full, count
        count += 1
        try:
            request = asking.send(values)
        except StopIteration as finished:
            return finished.value
