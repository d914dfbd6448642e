"""Least squares on displacements and reactions: Gauss-Newton's steps within a trust region that bounds and solutions
set."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass

import numpy as np

from fingerfit.search.simplex import Request
from fingerfit.search.stages import MET, NO_SOLUTION, UNIT, Point, Search, Space, Stage

STEP = 0.03
"""Longest step of a slope: in the logarithm, or as a share of the scale of a parameter or of the distance of its
bounds. A choice: of central differences of an exponential it makes an error of STEP^2 / 6, 0.015 %. Where only shorter
moves are trusted, it is shorter in proportion, to see what bends over such a move."""
LEAST = 0.1
"""Shortest step of a slope, as a share of the longest: a solver has a tolerance. A choice."""
MOVE = 0.7
"""Longest move, in the same coordinates: a modulus doubles. A choice."""
MOVES = 30
"""A descent that has not ended after as many moves has not converged. The longest way between bounds that are a factor
of a thousand apart takes ten."""
NEGLIGIBLE = 0.1
"""Fall of the misfit, in squares of the noise, that moves constants by a third of their standard errors: where a move
promises less and does not keep it, the descent has ended. What is left is up to the slopes that follow a search."""
STILL = 1.0
"""Damping: what moves nothing by the noise of one value stays where it is (Levenberg 1944)."""
NO_SLOPE = "not converged: no solution beside the best guess"
TOO_FAR = "not converged: all that was measured is too far off to be registered"
NO_FALL = "not converged: no move lowers the misfit"
TOO_MANY = f"not converged in {MOVES} moves"
"""Reasons for the end."""


@dataclass(frozen=True)
class Match:
    """What a guess says of the measured displacements and reactions.

    Parameters
    ----------
    read : ndarray, shape (values,)
        What its solution has in their place.
    left : ndarray, shape (values,)
        Measured less that, registered at this guess; NaN where nobody knows.
    noise : ndarray, shape (values,)
        Standard deviations of `left`.
    """

    read: np.ndarray
    left: np.ndarray
    noise: np.ndarray


Matches = Mapping[Point, Match | None]


def descend(stage: Stage, space: Space, start: np.ndarray, matches: Matches) -> Search:
    """Gauss-Newton's steps from `start`; returns the best coordinates and why it ended.

    What is left is registered at each guess that a move leads to, so that a registration from afar is corrected by one
    from nearby; a move is judged by what it leaves of the registration that it came from (trust region: More 1978).

    Parameters
    ----------
    stage : Stage
        It ends with a step that is shorter than `tolx`.
    space : Space
    start : ndarray, shape (parameters,)
    matches : mapping
        What is known of guesses, None without solution; it has all points that were asked for.
    """
    z, trust = space.clip(start), MOVE
    yield Request((z, *_beside(space, z, STEP))), 0
    here = matches[space.point(z)]
    if here is None:
        return z, NO_SOLUTION
    slopes = yield from _slopes(space, z, here, matches, 0, STEP)
    for move in range(1, MOVES + 1):
        known = np.isfinite(here.left) & np.isfinite(slopes).all(axis=1)
        if not known.any():
            return z, TOO_FAR
        weight = 1.0 / here.noise[known]
        left, columns = here.left[known] * weight, slopes[known] * weight[:, None]
        step = _step(columns, left, np.maximum(space.low - z, -trust), np.minimum(space.high - z, trust))
        trial = space.clip(z + step)
        far = _length(stage, space, z, trial)
        if far <= stage.tolx:
            return z, MET if slopes.any(axis=0).all() else NO_SLOPE
        reach = _reach(trust)
        yield Request((trial, *_beside(space, trial, reach)), (), (far,)), move
        there = matches[space.point(trial)]
        promised = left @ left - np.square(left - columns @ step).sum()
        true = -1.0
        if there is not None:
            after = left - (there.read - here.read)[known] * weight
            true = (left @ left - np.nan_to_num(after @ after, nan=np.inf)) / max(promised, 1e-300)
        trust = 0.4 * trust if true < 0.25 else min(2 * trust, MOVE) if true > 0.75 else trust
        if there is not None and true > 0:
            z, here = trial, there
            slopes = yield from _slopes(space, z, here, matches, move, reach)
        elif promised < NEGLIGIBLE:
            return z, MET
        elif trust <= stage.tolx:
            return z, NO_FALL
        else:
            reach = _reach(trust)
            yield Request(tuple(_beside(space, z, reach))), move
            slopes = yield from _slopes(space, z, here, matches, move, reach)
    return z, TOO_MANY


def _reach(trust: float) -> float:
    return STEP * max(trust / MOVE, LEAST)


def _beside(space: Space, z: np.ndarray, reach: float, sign: float = 1.0) -> list[np.ndarray]:
    return [space.clip(z + sign * space.inward(z, reach * axis)) for axis in np.eye(len(z))]


def _length(stage: Stage, space: Space, z: np.ndarray, trial: np.ndarray) -> float:
    step = np.subtract(space.point(trial), space.point(z)) if stage.tolx_in == UNIT else trial - z
    return float(np.abs(step).max())


def _slopes(
    space: Space, z: np.ndarray, here: Match, matches: Matches, count: int, reach: float
) -> Generator[tuple[Request, int], list[float], np.ndarray]:
    """Derivatives of what is read, shape (values, parameters): by the other side where one has no solution, 0 where
    neither has."""
    ahead, behind = _beside(space, z, reach), [space.clip(point) for point in _beside(space, z, reach, -1.0)]
    other = [n for n, point in enumerate(ahead) if matches[space.point(point)] is None]
    if other:
        yield Request(tuple(behind[n] for n in other)), count
    columns = []
    for n, axis in enumerate(np.eye(len(z))):
        point = behind[n] if n in other else ahead[n]
        there, step = matches[space.point(point)], float((point - z) @ axis)
        columns.append((there.read - here.read) / step if there is not None and step else 0.0 * here.read)
    return np.stack(columns, axis=1)


def _step(columns: np.ndarray, left: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The damped least-squares step between bounds."""
    from scipy.optimize import lsq_linear

    size = len(low)
    whole, right = np.concatenate([columns, STILL * np.eye(size)]), np.concatenate([left, np.zeros(size)])
    # bounds that coincide, as at a corner of the space, are kept a little apart
    return np.asarray(lsq_linear(whole, right, (low - 1e-9, high + 1e-9)).x)
