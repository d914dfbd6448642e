"""Errors of which the size is known, patch by patch and step by step, and the pattern only roughly."""

from __future__ import annotations

import numpy as np

SMOOTH = 0.25
"""Length over which such an error is alike, as a share of the body's height."""
ALIKE = 0.9
"""Correlation of such an error between steps."""


def rough_covariance(
    shape: tuple[int, ...], centre: np.ndarray, height: float, signal: np.ndarray, kept: np.ndarray
) -> np.ndarray:
    """An error as a random field, shape (kept, kept).

    It is taken to be smooth over `SMOOTH` of the body's height and much alike at all steps. So is that of the response.

    Parameters
    ----------
    shape : tuple of int
        (fields, patches, dim + 1), as of `fingerfit.diagnosis.residual.Residual.value` of one test.
    centre : ndarray, shape (patches, dim)
        Of the patches, mm.
    height : float
        Of the body, mm.
    signal : ndarray, shape (all,)
        What is as large as the error: displacements and brightness of the patches, and the response. How a displacement
        is directed is not known either.
    kept : ndarray of bool, shape (all,)
        The values that are asked for.
    """
    dim, size = shape[2] - 1, int(np.prod(shape))
    field = signal[:size].reshape(shape)
    moved = np.linalg.norm(field[..., :dim], axis=2) / np.sqrt(dim)
    apart = ((centre[:, None] - centre[None]) ** 2).sum(axis=2)
    near = np.exp(-apart / (2 * (SMOOTH * height) ** 2))
    steps = _alike(len(field))
    total = np.zeros((*shape, *shape))
    for axis, large in enumerate((*[moved] * dim, np.abs(field[..., dim]))):
        total[:, :, axis, :, :, axis] = np.einsum("np,pq,nm,mq->npmq", large, near, steps, large, optimize=True)
    whole = np.zeros((len(kept), len(kept)))
    whole[:size, :size] = total.reshape(size, size)
    response = signal[size:]
    whole[size:, size:] = _alike(len(response)) * np.outer(response, response)
    return np.nan_to_num(whole[np.ix_(kept, kept)])


def _alike(steps: int) -> np.ndarray:
    """Correlations of steps, shape (steps, steps)."""
    return np.where(np.eye(steps, dtype=bool), 1.0, ALIKE)
