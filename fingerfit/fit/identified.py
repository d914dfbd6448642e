"""What a score sees of the constants, and how far those may be from their values that it does not see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingerfit.fit.slopes import bounds_of, coordinates
from fingerfit.model.parameters import Parameter

FLAT = 1e-4
"""Curvature along a direction, relative to the steepest, below which the data do not see it: its standard error would
be a hundred times that of the best one. A choice ..."""
SURE = 4.0
"""... unless the score has a scale of its own: half a chi-square of this curvature tells a constant to half of itself,
however much better another direction is known."""
PART = 0.1
"""Of a direction of unit length, what a constant must have of it to be named with it."""
EVEN = 0.3
"""Difference of the parts of a direction of logarithms, as a share of the largest one, up to which it is told as a
common scale. A choice."""


def positive(hessian: np.ndarray) -> np.ndarray:
    """The same matrix with the size of its eigenvalues: a step always goes downhill."""
    values, vectors = np.linalg.eigh(hessian)
    return (vectors * np.abs(values)) @ vectors.T


def unseen(steepest: float, sure: float) -> float:
    """Curvature below which a direction is not seen, as a share of the steepest one."""
    return min(FLAT, max(sure / max(steepest, 1e-300), 1e-10))


def seen_directions(hessian: np.ndarray, sure: float = np.inf) -> np.ndarray:
    """Directions that the score sees, as `repeat` takes them, shape (parameters, directions)."""
    values, vectors = np.linalg.eigh(positive(hessian))
    return np.asarray(vectors[:, values > unseen(values[-1], sure) * values[-1]])


def unseen_constants(hessian: np.ndarray, sure: float) -> np.ndarray:
    """Which constants the score does not see, whatever the others are, bool."""
    return np.asarray(np.linalg.norm(seen_directions(hessian, sure), axis=1) < PART)


def unseen_combinations(hessian: np.ndarray, sure: float = np.inf) -> np.ndarray:
    """Directions that the score does not see, of constants that it sees by themselves, shape (parameters, directions).

    A direction along which the score curves down has no minimum, and counts as one that is not seen.
    """
    seen = ~unseen_constants(hessian, sure)
    values, vectors = np.linalg.eigh(hessian[np.ix_(seen, seen)])
    flat = values <= unseen(values[-1], sure) * max(values[-1], 1e-300) if len(values) else np.zeros(0, dtype=bool)
    found = np.zeros((len(hessian), int(flat.sum())))
    found[seen] = vectors[:, flat]
    return found


def room(
    directions: np.ndarray, parameters: Sequence[Parameter], values: Sequence[float], untold: np.ndarray
) -> np.ndarray:
    """How far constants may go down and up along directions that are not seen, within the bounds of all of them.

    Parameters
    ----------
    directions : ndarray, shape (parameters, directions)
        As of `unseen_combinations`.
    parameters, values
        What was estimated, values in units.
    untold : ndarray of bool, shape (parameters,)
        Which of them no prior tells.

    Returns
    -------
    ndarray, shape (parameters, 2)
        Search coordinates, at most and at least 0; 0 for a constant that is in none of the directions.
    """
    found = np.zeros((len(parameters), 2))
    moving = np.flatnonzero((np.linalg.norm(directions, axis=1) > PART) & untold)
    if not len(moving):
        return found
    # imported here, because rounds, which import `minimise`, need no scipy
    from scipy.optimize import linprog

    at = coordinates(parameters, {p.name: value for p, value in zip(parameters, values, strict=True)})
    low, high = bounds_of(parameters)
    low, high = np.minimum(low - at, 0.0)[moving], np.maximum(high - at, 0.0)[moving]
    ways = directions[moving]
    within = np.concatenate([ways, -ways]), np.concatenate([high, -low])
    for n, way, edges in zip(moving, ways, zip(low, high, strict=True), strict=True):
        for side, (sign, edge) in enumerate(zip((1.0, -1.0), edges, strict=True)):
            best = linprog(sign * way, *within, bounds=(None, None))
            found[n, side] = sign * best.fun if best.status == 0 else edge
    return found


def identifiability(hessian: np.ndarray, parameters: Sequence[Parameter], sure: float = np.inf) -> tuple[str, ...]:
    """Sentences on what the score does not see, from its curvature in search coordinates.

    >>> two = [Parameter(name, "MPa", 0.01, 1.0, 0.1) for name in ("mu_a", "mu_b")]
    >>> identifiability(np.array([[1.0, -1.0], [-1.0, 1.0]]), two)[0]
    'only ratios of mu_a, mu_b are identifiable: these data do not see their common scale'
    """
    blind = unseen_constants(hessian, sure)
    alone = [p.name for p, unknown in zip(parameters, blind, strict=True) if unknown]
    verb = "is" if len(alone) == 1 else "are"
    remarks = [f"{', '.join(alone)} {verb} not identifiable from these data"] if alone else []
    for vector in unseen_combinations(hessian, sure).T:
        involved = [p for p, part in zip(parameters, vector, strict=True) if abs(part) > PART]
        parts = vector[np.abs(vector) > PART]
        parts = parts * np.sign(parts[:1])  # a direction has no sign of its own
        logs, names = all(p.log for p in involved), ", ".join(p.name for p in involved)
        if len(involved) > 1 and logs and np.ptp(parts) < EVEN * np.abs(parts).max():
            text = f"only ratios of {names} are identifiable: these data do not see their common scale"
        elif len(involved) == 1:
            text = f"{names} is not identifiable from these data"
        else:
            terms = " ".join(
                f"{part:+.2f} log {p.name}" if p.log else f"{part / p.scale:+.3g} {p.name}"
                for p, part in zip(involved, parts, strict=True)
            )
            text = f"the combination {terms} is not identifiable from these data"
        remarks.append(text)
    return tuple(remarks)
