"""Noise of measured points, as of digital image correlation: what no smooth field of displacement can do."""

from __future__ import annotations

import numpy as np

DEGREE = 5
"""Of the polynomial that takes up the field of displacement of a step."""
SURPLUS = 3
"""Points for each of its coefficients; with fewer points the degree is lower."""


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
    if any(part.sum() != len(first) or not np.allclose(points[part], first) for part in parts):
        raise ValueError("steps with different points")
    basis = _polynomials(first, DEGREE)
    for degree in range(DEGREE - 1, 0, -1):
        if SURPLUS * basis.shape[1] > len(first):
            basis = _polynomials(first, degree)
    if SURPLUS * basis.shape[1] > len(first):
        raise ValueError(f"{len(first)} points a step")
    rest = np.stack([displacement[part] for part in parts])
    rest = rest - np.einsum("ij,tjk->tik", basis @ np.linalg.pinv(basis), rest)
    freedom = (len(first) - basis.shape[1]) * points.shape[1]
    found[np.ix_(used, used)] = np.einsum("tik,sik->ts", rest, rest) / freedom
    return found


def _polynomials(points: np.ndarray, degree: int) -> np.ndarray:
    """Products of powers of the coordinates up to a degree, shape (points, coefficients)."""
    size = np.ptp(points, axis=0)
    unit = 2 * (points - points.mean(axis=0)) / np.where(size > 0, size, 1.0)
    powers = [p for p in np.ndindex(*[degree + 1] * points.shape[1]) if sum(p) <= degree]
    return np.stack([np.prod(unit**power, axis=1) for power in powers], axis=1)
