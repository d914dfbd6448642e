"""Eigenvalues and eigenvectors of many symmetric matrices of 3 x 3 at once."""

from __future__ import annotations

import numpy as np

_PAIRS = ((0, 1), (0, 2), (1, 2))
_TOGETHER = 4096
"""Matrices that are worked on at once: what the processor keeps near it."""
_SWEEPS = 12
"""Four are enough, as the error is squared in each."""
_LARGEST, _LEAST = 1e100, 1e-100
"""Numbers whose squares are numbers, too."""
_DIAGONAL = 1e-32
"""Square of what is left beside the diagonal, relative to that on it: rounding."""


def eigen(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues and orthonormal eigenvectors, by Jacobi's rotations of all matrices together.

    LAPACK takes them one by one, which takes three to four times as long (docs/decisions/0002-numpy-kernels.md).
    Golub and Van Loan (Matrix Computations, 2013, section 8.5) have the rotations.

    Parameters
    ----------
    matrices : ndarray, shape (..., 3, 3)
        Symmetric.

    Returns
    -------
    values : ndarray, shape (..., 3)
        In no order.
    vectors : ndarray, shape (..., 3, 3)
        As columns, in the order of the values.
    """
    given = matrices.reshape(-1, 3, 3)
    values, vectors = np.empty(given.shape[:2]), np.empty(given.shape)
    for start in range(0, len(given), _TOGETHER):
        part = slice(start, start + _TOGETHER)
        values[part], vectors[part] = _turned(given[part])
    return values.reshape(matrices.shape[:-1]), vectors.reshape(matrices.shape)


def _turned(given: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    sweeps = _SWEEPS if _LEAST < np.abs(given).max() < _LARGEST else 0
    on = [given[:, k, k].copy() for k in range(3)]
    beside = {pair: given[:, pair[0], pair[1]].copy() for pair in _PAIRS}
    columns = [[np.full(len(given), float(i == k)) for i in range(3)] for k in range(3)]
    for _ in range(sweeps):
        left = sum(one**2 for one in beside.values())
        if np.all(left <= _DIAGONAL * sum(one**2 for one in on)):
            return np.stack(on, axis=-1), np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)
        for p, q in _PAIRS:
            r = 3 - p - q
            away, apart = beside[p, q], on[q] - on[p]
            # tangent of the smaller angle that makes this entry zero
            longest = apart + np.copysign(np.sqrt(apart**2 + 4.0 * away**2), apart)
            tangent = np.divide(2.0 * away, longest, out=np.zeros(len(given)), where=longest != 0.0)
            cos = 1.0 / np.sqrt(1.0 + tangent**2)
            sin = tangent * cos
            on[p] -= tangent * away
            on[q] += tangent * away
            beside[p, q] = np.zeros(len(given))
            first, second = (min(p, r), max(p, r)), (min(q, r), max(q, r))
            beside[first], beside[second] = (
                cos * beside[first] - sin * beside[second],
                sin * beside[first] + cos * beside[second],
            )
            for i in range(3):
                columns[p][i], columns[q][i] = (
                    cos * columns[p][i] - sin * columns[q][i],
                    sin * columns[p][i] + cos * columns[q][i],
                )
    found = np.linalg.eigh(given)
    return found[0], found[1]
