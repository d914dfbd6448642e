"""Deformation at the integration points of a body: principal stretches and their directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.fem.eigen import eigen


@dataclass(frozen=True)
class Strain:
    """Deformation at the integration points.

    Parameters
    ----------
    f : ndarray, shape (elements, points, dim, dim)
        Deformation gradient.
    squared : ndarray, shape (elements, points, 3)
        Squared principal stretches, the last one out of the plane in two dimensions.
    directions : ndarray, shape (elements, points, dim, dim)
        Principal directions in the reference state, as columns.
    frame : ndarray or None, shape (elements * points, 3, 3)
        The same in three dimensions; only where the material has directions.
    """

    f: np.ndarray
    squared: np.ndarray
    directions: np.ndarray
    frame: np.ndarray | None = None


def principal(f: np.ndarray, framed: bool) -> Strain | None:
    """Principal stretches and directions, out of a plane the stretch 1; None where J <= 0.

    Parameters
    ----------
    f : ndarray, shape (elements, points, dim, dim)
        Deformation gradient.
    framed : bool
        Whether the material has directions.
    """
    if not np.isfinite(f).all() or _determinants(f).min() <= 0:
        return None
    c = np.swapaxes(f, -1, -2) @ f
    if f.shape[-1] == 3:
        squared, directions = eigen(c)
        return Strain(f, squared, directions, directions.reshape(-1, 3, 3) if framed else None)
    half, shear = (c[..., 0, 0] - c[..., 1, 1]) / 2, c[..., 0, 1]
    mean, radius = (c[..., 0, 0] + c[..., 1, 1]) / 2, np.hypot(half, shear)
    angle = np.arctan2(shear, half) / 2
    cos, sin = np.cos(angle), np.sin(angle)
    # the smaller one from the determinant: mean - radius loses digits
    large = mean + radius
    small = (c[..., 0, 0] * c[..., 1, 1] - shear**2) / large
    directions = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    frame = None
    if framed:
        frame = np.zeros((large.size, 3, 3))
        frame[:, :2, :2] = directions.reshape(-1, 2, 2)
        frame[:, 2, 2] = 1.0
    return Strain(f, np.stack([large, small, np.ones_like(large)], -1), directions, frame)


def _determinants(f: np.ndarray) -> np.ndarray:
    """Determinants of many small matrices, shape (..., dim, dim)."""
    if f.shape[-1] == 2:
        return f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0]
    minors = f[..., 1, [1, 2, 0]] * f[..., 2, [2, 0, 1]] - f[..., 1, [2, 0, 1]] * f[..., 2, [1, 2, 0]]
    return (f[..., 0, :] * minors).sum(axis=-1)
