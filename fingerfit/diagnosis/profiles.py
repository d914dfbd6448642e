"""The profile of a constant: how far the misfit rises when it is held elsewhere and all other numbers follow.

Every point is a refit by simulations, to residual displacements and response, with priors and weighed as in the first
pass. So a profile knows what slopes at the estimate do not: that a constant is open to one side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.progress import tell
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.first_pass import FirstPass, Way
from fingerfit.fit.intervals import NORMAL
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.slopes import bounds_of, coordinates, evenly, moved
from fingerfit.model.parameters import Parameter

APART, LONGEST = 0.6, 0.5
"""Wanted distance of points in that root, and the longest in search coordinates: two thirds of a modulus. Choices."""
SHORTEST = 1e-3
"""Shortest step to a wall: 0.1 % of a modulus. A choice, as the following."""
BACK, ON = (0.1, 0.5), (0.5, 2.0)
"""Factors between which a step changes: beyond a wall, and else. Choices."""
POINTS = 15
"""At most as many to each side."""
FALL, MOVES = 0.02, 6
"""Fall of the misfit by which a move must lower it for another one to follow, where 3.84 matter; at most as many moves
to a point. Choices."""
RISEN, BOUND, LOST, MANY = "risen", "bound", "no solution", "points used up"
"""Why a side ended."""


@dataclass(frozen=True)
class Profile:
    """A profile.

    Parameters
    ----------
    name : str
    guesses : list of dict
        All numbers at each point, in their units, by growing values of the constant.
    rise : ndarray, shape (points,)
        Of the misfit, above the least of them.
    interval : (float or None, float or None)
        Ends of the 95 % interval, in the unit of the constant; None where the misfit does not rise by 3.84.
    ends : (str, str)
        Why the profile ends below and above.
    """

    name: str
    guesses: list[dict[str, float]]
    rise: np.ndarray
    interval: tuple[float | None, float | None]
    ends: tuple[str, str]

    @property
    def sentence(self) -> str:
        """What it says of the constant."""
        low, high = self.interval
        if low is not None and high is not None:
            return f"{self.name}: 95 % interval {low:.4g} to {high:.4g}"
        sides = {"below": (low, self.ends[0], self.guesses[0]), "above": (high, self.ends[1], self.guesses[-1])}
        lacks = [
            f"{side}: up to {guess[self.name]:.4g} the misfit does not rise by 3.84 ({why})"
            for side, (end, why, guess) in sides.items()
            if end is None
        ]
        known = [
            f"{'from' if side == 'below' else 'up to'} {end:.4g}"
            for side, (end, *_) in sides.items()
            if end is not None
        ]
        return f"{self.name} is not identified {'; '.join(lacks)}{f'; 95 % interval {known[0]}' if known else ''}"


def profile(comparison: Comparison, name: str, threads: int = 1) -> Profile:
    """The profile of a constant, or of a number of an effect.

    Parameters
    ----------
    comparison : Comparison
        Of the fitted model; its anchor is solved.
    name : str
        As in estimate.json.
    threads : int
        Simulations beside each other.
    """
    first, problem = FirstPass(comparison, threads), comparison.problem
    parameters = problem.settings.parameters()
    index = [p.name for p in parameters].index(name)
    values, least, slopes = _held(first, problem, comparison.base.values)
    where = coordinates(parameters, values)
    edges = [end[index] for end in bounds_of(parameters)]
    around = np.diag(np.linalg.pinv(slopes.T @ slopes + np.diag(evenly(parameters)), hermitian=True))
    found, ends = [(float(where[index]), least, values)], list[str]()
    for edge in edges:
        here, root, step = (values, slopes), 0.0, APART * float(np.sqrt(around[index]))
        why = MANY if where[index] != edge else BOUND
        for _ in range(POINTS if why == MANY else 0):
            left = edge - coordinates(parameters, here[0])[index]
            step = min(step, LONGEST, abs(left))
            move = np.sign(left) * step * _follow(here[1], index)
            try:
                at, misfit, slopes_there = _held(first, problem, moved(parameters, here[0], move), name)
            except StateError:
                why = LOST
                break
            z = float(coordinates(parameters, at)[index])
            found.append((z, misfit, at))
            rise = float(np.sqrt(max(misfit - least, 0.0)))
            tell(f"{name} {at[name]:.4g}: the misfit rises by {misfit - least:.3g}")
            wanted = APART / max(rise - root, 1e-300)
            if rise > NORMAL + 2 * APART and step > SHORTEST:
                step *= min(max(wanted, BACK[0]), BACK[1])  # beyond a wall: once more, nearer
                continue
            here, root, step = (at, slopes_there), rise, step * min(max(wanted, ON[0]), ON[1])
            if rise >= NORMAL or abs(edge - z) < 1e-9:
                why = RISEN if rise >= NORMAL else BOUND
                break
        ends.append(why)
    found.sort(key=lambda one: one[0])
    return _profile(name, found, (ends[0], ends[1]), parameters[index])


def _held(
    first: FirstPass, problem: InverseProblem, start: Mapping[str, float], name: str | None = None
) -> tuple[dict[str, float], float, np.ndarray]:
    """Minimum with one number held where the start has it; without a name, that of all numbers.

    Returns
    -------
    values : dict
    misfit : float
    slopes : ndarray, shape (values, parameters)
        Of what is left, in units of the noise, near there.

    Raises
    ------
    StateError
        When the start has no solution.
    """
    way = Way(first, problem, start, {}, secant=True)
    here = np.zeros(len(way.parameters))
    free = np.array([p.name != name for p in way.parameters], dtype=bool)
    left = way.residual(here)
    if not np.isfinite(left).all():
        raise StateError("the start of a refit has no solution")

    if not free.any():
        return way.values(here), float(left @ left), way.slopes(here)
    end, found = way.minimum(free, FALL / max(left @ left, 1.0), MOVES)
    return way.values(end), float(2.0 * found.cost), way.slopes(end)


def _follow(slopes: np.ndarray, index: int) -> np.ndarray:
    """How all numbers move when one moves by 1, shape (parameters,): the others as their least squares say."""
    others = np.delete(np.arange(slopes.shape[1]), index)
    way: np.ndarray = np.ones(slopes.shape[1])
    way[others] = -np.linalg.lstsq(slopes[:, others], slopes[:, index], rcond=1e-6)[0]
    return way


def _profile(
    name: str, found: list[tuple[float, float, dict[str, float]]], ends: tuple[str, str], parameter: Parameter
) -> Profile:
    z, misfit = (np.array([one[n] for one in found]) for n in (0, 1))
    rise = misfit - misfit.min()
    root, best = np.sqrt(rise), int(misfit.argmin())

    def end(there: np.ndarray) -> float | None:
        """Where the root crosses, along points that begin at the best one."""
        beyond = np.flatnonzero(root[there] >= NORMAL)
        if not beyond.size:
            return None
        n = there[beyond[0]]
        before = there[beyond[0] - 1]
        at = z[before] + (z[n] - z[before]) * (NORMAL - root[before]) / (root[n] - root[before])
        return float(np.exp(at) if parameter.log else at * parameter.scale)

    sides = end(np.arange(best, -1, -1)), end(np.arange(best, len(z)))
    return Profile(name, [one[2] for one in found], rise, sides, ends)
