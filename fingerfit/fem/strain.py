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
    if not np.isfinite(f).all() or (jacobian := _determinants(f)).min() <= 0:
        return None
    if f.shape[-1] == 3:
        squared, directions = eigen(np.swapaxes(f, -1, -2) @ f)
        return Strain(f, squared, directions, directions.reshape(-1, 3, 3) if framed else None)
    first, second = f[..., 0, 0] ** 2 + f[..., 1, 0] ** 2, f[..., 0, 1] ** 2 + f[..., 1, 1] ** 2
    half, shear = (first - second) / 2, f[..., 0, 0] * f[..., 0, 1] + f[..., 1, 0] * f[..., 1, 1]
    angle = np.arctan2(shear, half) / 2
    squared = np.ones((*jacobian.shape, 3))
    squared[..., 0] = large = (first + second) / 2 + np.hypot(half, shear)
    # from the determinant: a difference loses digits
    squared[..., 1] = jacobian**2 / large
    directions = np.empty(f.shape)
    directions[..., 0, 0] = directions[..., 1, 1] = np.cos(angle)
    directions[..., 1, 0] = np.sin(angle)
    directions[..., 0, 1] = -directions[..., 1, 0]
    frame = None
    if framed:
        frame = np.zeros((large.size, 3, 3))
        frame[:, :2, :2] = directions.reshape(-1, 2, 2)
        frame[:, 2, 2] = 1.0
    return Strain(f, squared, directions, frame)


def _determinants(f: np.ndarray) -> np.ndarray:
    """Determinants of many small matrices, shape (..., dim, dim)."""
    if f.shape[-1] == 2:
        return f[..., 0, 0] * f[..., 1, 1] - f[..., 0, 1] * f[..., 1, 0]
    minors = f[..., 1, [1, 2, 0]] * f[..., 2, [2, 0, 1]] - f[..., 1, [2, 0, 1]] * f[..., 2, [1, 2, 0]]
    return (f[..., 0, :] * minors).sum(axis=-1)
