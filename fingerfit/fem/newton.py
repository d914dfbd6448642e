"""Newton's method with a predictor, a line search and step cutting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.factor import CLOSE, LARGE, inner
from fingerfit.fem.system import System

TOLERANCE = 1e-8
"""Largest residual force, relative to the largest internal force."""
_SAME_TANGENT = 1e-6
"""Error below which the tangent is not made anew."""
_BEND = 0.5
"""Share of the curvature that a prediction takes on: all of it goes too far where the body gives way suddenly."""
_PATIENCE = ((4, 0.5), (8, 0.1))
"""Iterations after which at most this share of the first force may be left, for a body in contact."""
_ROUGH = 1e-2
"""Residual that is enough before the end of a step, where contact opens and closes without friction."""
_HELD = 3
"""Iterations at most in which a surface that is pushed keeps its predicted place."""
_SETTLED = 0.1
"""Error of the body below which such a surface is let go."""
_HERTZ = 2.0 / 3.0
"""Power of the force with which a round body goes deeper (Hertz)."""
_TOUCH = (0.125, 0.5)
"""First increment of a surface that must find the body first: moved, or pushed by a force."""
_SECANTS, _FLAT = 3, 0.3
"""Secants at most in search of the least energy along a step, and the share of the first slope that ends it."""
_KEEP = 2
"""Increments of the same length after one that failed."""
ITERATIONS = 20
CUTS = 7


@dataclass(frozen=True)
class State:
    """An equilibrium.

    Parameters
    ----------
    q : ndarray
        Unknowns, mm.
    u : ndarray, shape (size,)
        All displacements, mm.
    internal : ndarray, shape (size,)
        Internal forces, N: the reaction where something is prescribed.
    """

    q: np.ndarray
    u: np.ndarray
    internal: np.ndarray


@dataclass(frozen=True)
class Load:
    """What is prescribed: displacements in mm and forces in N, shape (size,)."""

    given: np.ndarray
    force: np.ndarray

    def away(self, other: Load) -> np.ndarray:
        """Difference from another load, shape (2 size,)."""
        return np.concatenate([self.given - other.given, self.force - other.force])

    def between(self, other: Load, share: float) -> Load:
        """Load on the straight way to `other`."""
        return Load(self.given + share * (other.given - self.given), self.force + share * (other.force - self.force))


@dataclass(frozen=True)
class Increments:
    """How a step is gone through.

    Parameters
    ----------
    first, largest : float
        First and largest increment as shares of the step.
    fixed : bool
        Whether all have the length of the first; a step that does not converge then is not cut.
    period : float
        Length of the step, s.
    viscous : bool
        Whether time passes for materials that relax; else they answer as to a fast load.
    relaxed : bool
        Whether they answer as to an infinitely slow load.
    stops : tuple of float
        Shares of the step at which an increment ends.
    """

    first: float = 1.0
    largest: float = 1.0
    fixed: bool = False
    period: float = 1.0
    viscous: bool = False
    relaxed: bool = False
    stops: tuple[float, ...] = ()


class Newton:
    """Follows a loading path.

    Parameters
    ----------
    system : System
        Elements and constraints.
    floor : float
        N; residuals below `TOLERANCE` times this are none, for bodies that come to rest without any force.
    """

    def __init__(self, system: System, floor: float = 0.0) -> None:
        self.system, self.floor = system, max(floor, 1e-300)
        zero = np.zeros(system.size)
        self.state = State(np.zeros(len(system.free)), zero, zero)
        self.load = Load(zero, zero)
        self._before: tuple[State, Load] | None = None
        self._earlier: tuple[State, Load] | None = None
        self._pace: float | None = None  # length of the last increments of a step that was hard, as of `Load.away`

    def change(self, system: System) -> None:
        """Go on with other constraints, from the present displacements."""
        self.system = system
        self.state = State(self.state.u[system.free], self.state.u, self.state.internal)
        self.load = Load(np.where(system.prescribed, self.state.u, 0.0), self.load.force)
        self._before = self._earlier = None

    def advance(self, target: Load | Callable[[float], Load], increments: Increments | float = 1.0) -> tuple[bool, int]:
        """Go to a load, in one increment or as many as it needs.

        Parameters
        ----------
        target : Load, or function of the share of the step
            A load is approached on a straight line.
        increments : Increments or float
            A number is the first increment.

        Returns
        -------
        arrived : bool
        iterations : int
        """
        how = increments if isinstance(increments, Increments) else Increments(first=increments)
        path = _line(self.load, target) if isinstance(target, Load) else target
        share, size, total = 0.0, min(how.first, how.largest), 0
        if self.system.slides and self._before is None and not how.fixed:
            size = min(size, _TOUCH[self.system.driven])
        length = float(np.linalg.norm(path(1.0).away(self.load)))
        if self._pace is not None and not how.fixed and length > 0:
            size = min(size, max(self._pace / length, 0.5**CUTS))
        smallest, failed, keep = min(0.5**CUTS * how.largest, size / 8), False, 0
        while share < 1.0:
            end = min([1.0, share + size, *(stop for stop in how.stops if share + 1e-9 < stop < share + size)])
            if end > 1 - 1e-9:
                end = 1.0
            dt = (end - share) * how.period if how.viscous else 0.0
            self.system.begin(dt, how.relaxed)
            load = path(end)
            # on the way, where the path does not matter, near an equilibrium is enough
            rough = end < 1.0 and self.system.slides and not (self.system.remembers or how.viscous)
            state, used = self._equilibrium(load, _ROUGH if rough else TOLERANCE)
            total += used
            if state is None:
                size = min(size, end - share) / 2
                if size < smallest or how.fixed:
                    return False, total
                failed, keep = True, _KEEP
                continue
            self.system.commit(state.u, dt, how.relaxed)
            self._earlier, self._before = self._before, (self.state, self.load)
            self.state, self.load, share = state, load, end
            if failed:
                self._pace = size * length
            keep -= 1
            size = how.first if how.fixed else min(size if keep > 0 else 2 * size, how.largest)
        return True, total

    def _predict(self, load: Load) -> np.ndarray | None:
        """Unknowns continued on the curve through the last states; None where there is only one."""
        if self._before is None:
            return None
        (before, first), last = self._before, self.load
        done = last.away(first)
        length = inner(done, done)
        if length == 0:
            return None
        ahead, slope = inner(done, load.away(last)) / length, self.state.q - before.q
        if self.system.driven:
            # a round body goes deeper with a power of the force
            begun, now, then = (float(np.abs(part.force).max()) ** _HERTZ for part in (first, last, load))
            return self.state.q + ((then - now) / (now - begun) if then > now > begun else ahead) * slope
        predicted = self.state.q + ahead * slope
        # where contact opens and closes there is no curve
        if self._earlier is None or self.system.touches:
            return predicted
        earlier, start = self._earlier
        back = inner(done, first.away(start)) / length
        if not 0.2 < back < 5.0 or not 0.0 < ahead < 2.0:
            return predicted
        bend = (slope - (before.q - earlier.q) / back) / (1 + back)
        return predicted + _BEND * ahead * (1 + ahead) * bend

    def _equilibrium(self, load: Load, tolerance: float = TOLERANCE) -> tuple[State | None, int]:
        system = self.system
        q = self._predict(load)
        held = np.zeros(len(system.free), dtype=bool)
        held[system.pushed] = True
        if q is not None and system.driven:
            if self._forces(system.expand(q, load.given)) is None:
                q = self._nearest(q, load)
        elif q is not None and self._forces(system.expand(q, load.given)) is None:
            q = None
        if q is None:
            q = self._tangent_start(load)
            if q is None:
                return None, 1
        matrix: Any = None
        first = 0.0
        for iteration in range(1, ITERATIONS + 1):
            u = system.expand(q, load.given)
            evaluation = system.evaluate(u, tangent=False)
            if evaluation is None:
                return None, iteration
            internal = evaluation.internal
            residual = self._residual(internal, load, held)
            scale = max(evaluation.largest, np.abs(load.force).max(), self.floor)
            error = np.abs(residual).max() / scale if len(residual) else 0.0
            if held.any() and (error < _SETTLED or iteration > _HELD):
                held[:] = False
                residual = self._residual(internal, load, held)
                error = np.abs(residual).max() / scale
            # in N: of a surface that was pushed in too deep, the largest force falls with the residual
            left = error * scale
            first = first or left
            if system.slides and any(iteration > after and left > share * first for after, share in _PATIENCE):
                return None, iteration
            if error < tolerance:
                return State(q, u, internal), iteration
            # near the end the tangent of the last iteration is as good, but a small one costs nothing
            if matrix is None or error > _SAME_TANGENT or len(q) < LARGE:
                evaluation = system.evaluate(u, led=True)
                if evaluation is None:
                    return None, iteration
                matrix = system.matrix(evaluation)
            # what is solved more exactly than Newton's method converges is of no use
            close = min(max(CLOSE, 0.1 * error, 0.1 * TOLERANCE / error), 1e-2)
            step = system.solve(matrix, -residual, close, np.flatnonzero(held))
            if step is None:
                return None, iteration
            # an indefinite tangent points uphill in energy: turn it round
            if inner(step, residual) > 0 and error > 1e-4:
                step = -step
            moved = self._search(q, step, residual, load, held)
            if moved is None:
                return None, iteration
            q = moved
        return None, ITERATIONS

    def _nearest(self, q: np.ndarray, load: Load) -> np.ndarray | None:
        """The place of least energy on the way to predicted unknowns: what is pushed into contact goes too far."""
        best, least = None, np.inf
        for share in (1.0, 0.5, 0.25, 0.0):
            trial = self.state.q + share * (q - self.state.q)
            energy = self._potential(self.system.expand(trial, load.given), load)
            if not energy < least:
                break
            best, least = trial, energy
        return best

    def _tangent_start(self, load: Load) -> np.ndarray | None:
        """First step from the last state with its own tangent, the prescribed displacements moved along."""
        system, state = self.system, self.state
        evaluation = system.evaluate(state.u)
        if evaluation is None:
            return None
        move = system.along(state.u, load.given - self.load.given)
        residual = system.reduce(system.push(evaluation, move) - load.force)
        step = system.solve(system.matrix(evaluation), -residual)
        if step is None:
            return None
        q = state.q + step
        return q if self._forces(system.expand(q, load.given)) is not None else None

    def _forces(self, u: np.ndarray) -> np.ndarray | None:
        evaluation = self.system.evaluate(u, tangent=False)
        return None if evaluation is None else evaluation.internal

    def _residual(self, internal: np.ndarray, load: Load, held: np.ndarray) -> np.ndarray:
        """Forces on the unknowns that are not in equilibrium, N; none on those that are held."""
        residual = self.system.reduce(internal - load.force)
        residual[held] = 0.0
        return residual

    def _search(
        self, q: np.ndarray, step: np.ndarray, residual: np.ndarray, load: Load, held: np.ndarray
    ) -> np.ndarray | None:
        """Shorten a step until it lowers the residual or the potential energy."""
        system = self.system
        norm, slope = np.abs(residual).max(), inner(step, residual)
        start: float | None = None
        # where contact opens and closes, residuals say little
        enough = 0.3 if system.slides else 1.0
        for cut in range(9):
            trial = q + 0.5**cut * step
            u = system.expand(trial, load.given)
            internal = self._forces(u)
            if internal is None:
                continue
            ahead = self._residual(internal, load, held)
            if np.abs(ahead).max() < enough * norm:
                return trial
            if start is None:
                start = self._potential(system.expand(q, load.given), load)
            if self._potential(u, load) < start + 1e-4 * 0.5**cut * slope:
                slopes = 0.5**cut * slope, inner(trial - q, ahead)
                return q + self._least(q, trial - q, slopes, load, held) * (trial - q)
        return None

    def _least(
        self, q: np.ndarray, step: np.ndarray, slopes: tuple[float, float], load: Load, held: np.ndarray
    ) -> float:
        """Share of a step where the energy is least, by secants between its slopes at both ends.

        Where contact opens or closes on the way a whole step goes too far, and the next one too far back.
        """
        (low, falls), (high, rises) = (0.0, slopes[0]), (1.0, slopes[1])
        share, slope = high, rises
        for _ in range(_SECANTS if self.system.slides else 0):
            if not falls < 0 < rises or abs(slope) < _FLAT * abs(slopes[0]):
                break
            share = low + (high - low) * falls / (falls - rises)
            internal = self._forces(self.system.expand(q + share * step, load.given))
            if internal is None:
                return high
            slope = inner(step, self._residual(internal, load, held))
            if slope < 0:
                low, falls = share, slope
            else:
                high, rises = share, slope
        return share

    def _potential(self, u: np.ndarray, load: Load) -> float:
        return self.system.energy(u) - inner(load.force, u)


def _line(start: Load, target: Load) -> Callable[[float], Load]:
    return lambda share: start.between(target, share) if share < 1.0 else target
