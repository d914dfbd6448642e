"""Noise of measured points, as of digital image correlation: what no smooth field of displacement can do."""

from __future__ import annotations

import numpy as np

DEGREE = 5
"""Of the polynomial that takes up the field of displacement of a step; a choice."""
_LEAST = 0.5
"""Share of the points that must lie where the body is, as of a mesh in its pictures: beside it, a unit or an axis is
wrong. A choice."""
_APART = 1e-5
"""Distance, as a share of the extent of all points, by which a point may differ between steps; a choice."""
SURPLUS = 3
"""Points for each of its coefficients; with fewer points the degree is lower. A choice."""


def unusable(points: np.ndarray, displacement: np.ndarray, body: np.ndarray) -> tuple[str, str] | None:
    """What is wrong with measured points of a body: what was found and what is expected; None where nothing is.

    Parameters
    ----------
    points, displacement : ndarray, shape (points, dim)
        Of one step, mm.
    body : ndarray, shape (nodes, dim)
        Nodes of the body, mm.
    """
    low, high = body.min(axis=0), body.max(axis=0)
    extent = float((high - low).max())
    most = float(np.abs(displacement).max(initial=0.0))
    if most > extent:
        return f"a displacement of {most:.4g} mm", f"less than the body's extent, {extent:.4g} mm"
    inside = ((points >= low) & (points <= high)).all(axis=1).mean()
    if inside < _LEAST:
        found = f"{100 * inside:.0f} % of the points between the body's corners ({low.round(3)} to {high.round(3)} mm)"
        return found, "points on the body"
    places, count = np.unique(points, axis=0, return_counts=True)
    if (count > 1).any():
        return f"the point {', '.join(f'{x:g}' for x in places[count.argmax()])} mm twice", "each point once"
    return None


def estimate_covariance(points: np.ndarray, displacement: np.ndarray, step: np.ndarray, steps: int) -> np.ndarray:
    """Covariance of a point's error at two steps, mean over the components, shape (steps, steps), mm^2.

    A polynomial in the coordinates is fitted to the displacements of each step; what is left is noise. Errors of
    neighbouring points are taken as independent, those of one point at several steps are not: the first picture and a
    filter in time are common to them. Steps without points have no noise.

    Parameters
    ----------
    points, displacement : ndarray, shape (points, dim)
        Of all steps, mm.
    step : ndarray of int, shape (points,)
    steps : int

    Raises
    ------
    ValueError
        When a step has too few points, or steps do not have the same ones.
    """
    found = np.zeros((steps, steps))
    used = np.unique(step)
    parts = [step == number for number in used]
    first = points[parts[0]]
    apart = _APART * np.ptp(first, axis=0).max()
    if any(part.sum() != len(first) or (np.abs(points[part] - first) > apart).any() for part in parts):
        raise ValueError("steps with different points")
    basis = polynomials(first, DEGREE)
    for degree in range(DEGREE - 1, 0, -1):
        if SURPLUS * basis.shape[1] > len(first):
            basis = polynomials(first, degree)
    if SURPLUS * basis.shape[1] > len(first):
        raise ValueError(f"{len(first)} points a step")
    rest = np.stack([displacement[part] for part in parts])
    rest = rest - np.einsum("ij,tjk->tik", basis @ np.linalg.pinv(basis), rest)
    freedom = (len(first) - basis.shape[1]) * points.shape[1]
    found[np.ix_(used, used)] = np.einsum("tik,sik->ts", rest, rest) / freedom
    return found


def polynomials(points: np.ndarray, degree: int) -> np.ndarray:
    """Products of powers of the coordinates up to a degree, shape (points, coefficients)."""
    size = np.ptp(points, axis=0)
    unit = 2 * (points - points.mean(axis=0)) / np.where(size > 0, size, 1.0)
    powers = [p for p in np.ndindex(*[degree + 1] * points.shape[1]) if sum(p) <= degree]
    return np.stack([np.prod(unit**power, axis=1) for power in powers], axis=1)
