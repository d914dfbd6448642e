"""Newton's method with a line search: the equilibrium at one load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.factor import CLOSE, inner
from fingerfit.fem.system import Evaluation, System
from fingerfit.fem.touching import meet

TOLERANCE = 1e-8
"""Largest residual force, relative to the largest internal force. Far below what is compared: displacements of the
built-in solver and of CalculiX agree to 2e-7 (docs/solver.md)."""
_PATIENCE = ((4, 0.5), (8, 0.1))
"""Iterations after which at most this share of the first residual force may be left, for a body in contact: else
contact opens and closes from iteration to iteration, and a shorter increment is cheaper. Tried on fingers
(docs/decisions/0006-large-systems.md)."""
_STUCK = (4, 0.5)
"""Iterations that must halve the residual of a body in contact without friction: else a point goes to and fro between
two facets, and has no place at this load. A choice."""
_SECANTS, _FLAT = 3, 0.3
"""Secants at most in search of the least energy along a step, and the share of the first slope that ends it. An
evaluation costs a tenth of an iteration (docs/decisions/0006-large-systems.md); the share is a choice."""
_CLEARLY = 0.3
"""Share of the residual that a step of a body in contact must leave at most: elsewhere any fall is enough. A choice."""
_PAST = 0.5
"""Slope at the end of a step of a body in contact, over that at its beginning and upwards, from which the step went too
far, whatever its residual: points lift off there, and the next step is far too long
(docs/decisions/0033-force-control.md). A choice."""
_KINK = 0.1
"""Share of a step below which a slope of zero counts as a kink of friction, where points begin to slip, and not as the
end of the way (docs/decisions/0033-force-control.md). A choice."""
_ENOUGH = 1e-4
"""Share of the fall of energy that the slope promises which a step must bring: the condition of Armijo (1966)."""
_SHORTER = 9
"""Lengths that are tried of a step, each half of the one before: the shortest is 0.4 % of it. A choice."""
_UPHILL = 1e-4
"""Error, relative as `TOLERANCE`, above which a step that points uphill in energy is turned round (docs/solver.md);
a choice."""
_ROUGHEST = 1e-2
"""Residual of a linear system, relative to its right side, above which Newton's method takes more iterations. A
choice."""
ITERATIONS = 20
"""Of an increment, before it counts as one that does not converge; a choice."""


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


class Newton:
    """Finds the equilibrium at a load, from one nearby.

    Parameters
    ----------
    system : System
        Elements and constraints.
    floor : float
        N; residuals below `TOLERANCE` times this are none, for bodies that come to rest without any force.
    """

    def __init__(self, system: System, floor: float) -> None:
        self.system, self.floor = system, floor

    def equilibrium(
        self, state: State, before: Load, load: Load, predicted: np.ndarray | None, tolerance: float
    ) -> tuple[State | None, int]:
        """Iterate to an equilibrium.

        Parameters
        ----------
        state : State
            The last one.
        before : Load
            At which it is in equilibrium.
        load : Load
            At which the next one is wanted.
        predicted : ndarray or None
            Unknowns to begin with, mm; without them the tangent of the last state says where.
        tolerance : float
            Residual force, relative to the largest internal force.

        Returns
        -------
        state : State or None
            None where there is none to be found.
        iterations : int
        """
        system, q, known = self.system, predicted, None
        if q is not None:
            known = self._forces(system.expand(q, load.given))
            q = None if known is None else q
        if q is None:
            started = self._tangent_start(state, before, load)
            if started is None:
                return None, 1
            q, known = started
        matrix: Any = None
        made = np.inf
        residuals, frictionless = list[float](), system.touches and not system.remembers
        for iteration in range(1, ITERATIONS + 1):
            u = system.expand(q, load.given)
            # what led here has asked for the forces already
            evaluation = known or self._forces(u)
            if evaluation is None:
                return None, iteration
            internal = evaluation.internal
            residual = system.reduce(internal - load.force)
            scale = max(evaluation.largest, np.abs(load.force).max(), self.floor)
            error = np.abs(residual).max() / scale if len(residual) else 0.0
            # in N: of a surface that was pushed in too deep, the largest force falls with the residual
            left = error * scale
            if not np.isfinite(left):  # beyond double precision: of fibres that stiffen exponentially
                return None, iteration
            residuals.append(left)
            if system.slides and any(iteration > after and left > share * residuals[0] for after, share in _PATIENCE):
                return None, iteration
            if frictionless and iteration > _STUCK[0] and left > _STUCK[1] * residuals[-1 - _STUCK[0]]:
                return None, iteration
            if error < tolerance:
                return State(q, u, internal), iteration
            # with a tangent of before, the next error is about the product of this one and that at which it was made
            if made * error > TOLERANCE:
                evaluation = system.evaluate(u, led=True)
                if evaluation is None:
                    return None, iteration
                matrix, made = None, error
            # what is solved more exactly than Newton's method converges is of no use
            close = min(max(CLOSE, 0.1 * error, 0.1 * TOLERANCE / error), _ROUGHEST)
            if matrix is not None:
                step = system.solve(matrix, -residual, close)
            else:
                step, matrix = self._linear(u, evaluation, residual, load, close)
            if step is None:
                return None, iteration
            # an indefinite tangent points uphill in energy: turn it round
            if inner(step, residual) > 0 and error > _UPHILL:
                step = -step
            moved = self._search(q, step, residual, load)
            if moved is None:
                return None, iteration
            q, known = moved
        return None, ITERATIONS

    def _tangent_start(self, state: State, before: Load, load: Load) -> tuple[np.ndarray, Evaluation] | None:
        """First step from the last state with its own tangent, the prescribed displacements moved along; and forces."""
        system = self.system
        evaluation = system.evaluate(state.u)
        if evaluation is None:
            return None
        change = load.given - before.given
        if system.touches:
            step = meet(system, state.u, evaluation, change, load.force, _ROUGHEST)[0]
        else:
            residual = system.reduce(system.push(evaluation, system.along(state.u, change)) - load.force)
            step = system.solve(system.matrix(evaluation), -residual)
        if step is None:
            return None
        q = state.q + step
        there = self._forces(system.expand(q, load.given))
        return None if there is None else (q, there)

    def _forces(self, u: np.ndarray) -> Evaluation | None:
        return self.system.evaluate(u, tangent=False)

    def _linear(
        self, u: np.ndarray, evaluation: Evaluation, residual: np.ndarray, load: Load, close: float
    ) -> tuple[np.ndarray | None, Any]:
        """A step by the tangent, of contact as it will be after the step; and the tangent."""
        system = self.system
        if system.touches:
            return meet(system, u, evaluation, np.zeros(system.size), load.force, close)
        matrix = system.matrix(evaluation)
        return system.solve(matrix, -residual, close), matrix

    def _search(
        self, q: np.ndarray, step: np.ndarray, residual: np.ndarray, load: Load
    ) -> tuple[np.ndarray, Evaluation | None] | None:
        """Shorten a step until it lowers the residual or the potential energy; its end, and forces where known."""
        system = self.system
        norm, slope = np.abs(residual).max(), inner(step, residual)
        start: float | None = None
        # where contact opens and closes, residuals say little
        enough = _CLEARLY if system.slides else 1.0
        for cut in range(_SHORTER):
            trial = q + 0.5**cut * step
            u = system.expand(trial, load.given)
            there = self._forces(u)
            if there is None:
                continue
            ahead = system.reduce(there.internal - load.force)
            good = np.abs(ahead).max() < enough * norm
            if good and not (system.touches and inner(step, ahead) > _PAST * abs(slope)):
                return trial, there
            if not good:
                if start is None:
                    start = self._potential(system.expand(q, load.given), load)
                good = self._potential(u, load) < start + _ENOUGH * 0.5**cut * slope
            if good:
                slopes = 0.5**cut * slope, inner(trial - q, ahead)
                return q + self._least(q, trial - q, slopes, load) * (trial - q), None
        return None

    def _least(self, q: np.ndarray, step: np.ndarray, slopes: tuple[float, float], load: Load) -> float:
        """Share of a step where the energy is least, by secants between its slopes at both ends.

        Where contact opens or closes on the way a whole step goes too far, and the next one too far back. Friction has
        no energy, but slopes all the same.
        """
        (low, falls), (high, rises) = (0.0, slopes[0]), (1.0, slopes[1])
        share, slope = high, rises
        for _ in range(_SECANTS if self.system.touches else 0):
            if not falls < 0 < rises or abs(slope) < _FLAT * abs(slopes[0]):
                break
            share = low + (high - low) * falls / (falls - rises)
            there = self._forces(self.system.expand(q + share * step, load.given))
            if there is None:
                return high
            slope = inner(step, self.system.reduce(there.internal - load.force))
            if slope < 0:
                low, falls = share, slope
            else:
                high, rises = share, slope
        return share if self.system.slides or share > _KINK else high

    def _potential(self, u: np.ndarray, load: Load) -> float:
        return self.system.energy(u) - inner(load.force, u)
