"""Errors of which the size is known, patch by patch and step by step, and the pattern only roughly."""

from __future__ import annotations

import numpy as np

from fingerfit.diagnosis.residual import Residual

SMOOTH = 0.25
"""Length over which such an error is alike, as a share of the body's height."""
ALIKE = 0.9
"""Correlation of such an error between steps."""


def rough_covariance(residual: Residual, centre: np.ndarray, height: float, signal: np.ndarray) -> np.ndarray:
    """An error as a random field, shape (kept, kept).

    It is taken to be smooth over `SMOOTH` of the body's height and much alike at all steps. So is that of the response.

    Parameters
    ----------
    residual : Residual
        Of one test.
    centre : ndarray, shape (patches, dim)
        Of the patches, mm.
    height : float
        Of the body, mm.
    signal : ndarray, shape (all,)
        What is as large as the error: displacements and brightness of the patches, and the response. How a displacement
        is directed is not known either.
    """
    value = residual.value
    dim = value.shape[2] - 1
    field = signal[: value.size].reshape(value.shape)
    moved = np.linalg.norm(field[..., :dim], axis=2) / np.sqrt(dim)
    apart = ((centre[:, None] - centre[None]) ** 2).sum(axis=2)
    near = np.exp(-apart / (2 * (SMOOTH * height) ** 2))
    steps = _alike(len(field))
    total = np.zeros((*value.shape, *value.shape))
    for axis, size in enumerate((*[moved] * dim, np.abs(field[..., dim]))):
        total[:, :, axis, :, :, axis] = np.einsum("np,pq,nm,mq->npmq", size, near, steps, size, optimize=True)
    count = len(residual.kept)
    whole = np.zeros((count, count))
    whole[: value.size, : value.size] = total.reshape(value.size, value.size)
    response = signal[value.size :]
    whole[value.size :, value.size :] = _alike(len(response)) * np.outer(response, response)
    return np.nan_to_num(whole[np.ix_(residual.kept, residual.kept)])


def _alike(steps: int) -> np.ndarray:
    """Correlations of steps, shape (steps, steps)."""
    return np.where(np.eye(steps, dtype=bool), 1.0, ALIKE)
