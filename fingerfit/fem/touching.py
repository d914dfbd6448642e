"""The step of Newton's method in which a linearised body meets contact as it is.

A tangent knows which points touch, stick and slip before a step, not after it; with a stiff penalty a step that trusts
it lets too many points lift off, and the next one too many touch. So the body alone is linearised, and its equilibrium
with the contact sought by iterations of its own: those of a semismooth Newton method (Qi and Sun 1993), which change
nothing but the contact (docs/decisions/0033-force-control.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.factor import inner
from fingerfit.fem.system import Contribution, Evaluation, System

_ROUNDS = 20
"""Iterations at most in search of a step, as many as of an increment; a choice."""
_STALLED, _LOWER = 3, 0.9
"""Iterations in a row whose residual is not below this share of the least one before, after which nothing nearer is
found: a point goes to and fro between two facets. A choice."""
_SECANTS, _FLAT = 8, 0.3
"""Secants at most along one of them, which cost next to nothing, and the share of the first slope that ends it; a
choice."""
_RUBBED = 0.1
"""Residual that is enough with friction, relative to the first one: a hundredth took 65 iterations for 30 in a case
where points slip and stick in turn (docs/decisions/0033-force-control.md)."""


def meet(
    system: System, u: np.ndarray, evaluation: Evaluation, change: np.ndarray, force: np.ndarray, close: float
) -> tuple[np.ndarray | None, Any]:
    """Change of the unknowns after which contact and the linearised body are in equilibrium.

    Parameters
    ----------
    system : System
    u : ndarray, shape (size,)
        Displacements, mm.
    evaluation : Evaluation
        There, with the tangent.
    change : ndarray, shape (size,)
        Of the prescribed displacements, mm.
    force : ndarray, shape (size,)
        N.
    close : float
        Residual that is wanted, relative to the first one; that of the linear systems, too.

    Returns
    -------
    step : ndarray or None
        As near as was found, with friction the first of the iterations where none comes near; None where the tangent is
        singular.
    matrix : as of `System.matrix`
        The last tangent.
    """
    matrix: Any = None
    body = system.replaced(evaluation, system.none())
    way = system.along(u, change)
    fixed = system.reduce(system.push(body, way) - force)
    here = u + way
    touching = system.touching(here)
    residual = fixed + system.reduce(_force(touching, system.size))
    enough = (max(close, _RUBBED) if system.remembers else close) * np.abs(residual).max()
    total, first, least, stalled = np.zeros(len(residual)), None, np.inf, 0
    for _ in range(_ROUNDS):
        matrix = system.matrix(system.replaced(evaluation, touching))
        step = system.solve(matrix, -residual, close)
        if step is None:
            return (total if total.any() else None), matrix
        falls = inner(step, residual)
        if falls >= 0:
            # uphill: the caller turns round what he gets
            return (total if total.any() else step), matrix
        way = system.along(u, np.zeros(system.size), step)
        bends = system.product(matrix, step) - system.reduce(_along(touching, way, system.size))
        line = _Line(here, fixed, way, bends)
        share, residual = _ahead(system, line, step, falls)
        total, here, fixed = total + share * step, here + share * way, fixed + share * bends
        first = step if first is None else first
        left = float(np.abs(residual).max())
        least, stalled = min(least, left), 0 if left < _LOWER * least else stalled + 1
        if left <= enough or (stalled == _STALLED and not system.remembers):
            break
        touching = system.touching(here)
    else:
        # points that slip and stick in turn have no equilibrium with a linear body
        total = first if system.remembers and first is not None else total
    return total, matrix


@dataclass(frozen=True)
class _Line:
    """Where a step leads: displacements, forces of the body on the unknowns, and both per step."""

    here: np.ndarray
    fixed: np.ndarray
    way: np.ndarray
    bends: np.ndarray

    def residual(self, system: System, share: float) -> np.ndarray:
        """Forces on the unknowns after a share of the step, N."""
        touching = system.touching(self.here + share * self.way, tangent=False)
        return self.fixed + share * self.bends + system.reduce(_force(touching, system.size))


def _ahead(system: System, line: _Line, step: np.ndarray, falls: float) -> tuple[float, np.ndarray]:
    """Share of a step where the slope of the energy is small, or still falls, and the residual there.

    Friction has no energy, but slopes all the same.
    """
    share, residual = 1.0, line.residual(system, 1.0)
    (low, below), (high, above) = (0.0, falls), (1.0, inner(step, residual))
    slope = above
    for _ in range(_SECANTS):
        if not (above > 0 and abs(slope) > _FLAT * abs(falls)):
            break
        share = low + (high - low) * below / (below - above)
        residual = line.residual(system, share)
        slope = inner(step, residual)
        if slope < 0:
            low, below = share, slope
        else:
            high, above = share, slope
    return share, residual


def _force(parts: Sequence[Contribution], size: int) -> np.ndarray:
    return np.asarray(sum((part.force for part in parts), np.zeros(size)))


def _along(parts: Sequence[Contribution], way: np.ndarray, size: int) -> np.ndarray:
    """Change of forces along a displacement of all degrees of freedom, by their stiffness."""
    return np.asarray(
        sum(
            (np.bincount(part.rows, weights=part.values * way[part.columns], minlength=size) for part in parts),
            np.zeros(size),
        )
    )
