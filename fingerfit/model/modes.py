"""Smooth modes over a body of any shape: cosines over the box around it, the longest waves first.

They are the eigenfunctions of the Laplacian on that box, as in reduced-rank Gaussian processes (Solin and Särkkä,
Statistics and Computing 30, 2020). They are the same on all meshes of a body; eigenvectors of a mesh have signs, and in
a square directions, that its elements choose.
"""

from __future__ import annotations

from functools import cache

import numpy as np

NAME = "mode_"
"""Beginning of their names in formulas: mode_1, mode_2, ..."""


@cache
def _waves(size: tuple[float, ...], count: int) -> np.ndarray:
    every = np.indices((count + 1,) * len(size)).reshape(len(size), -1).T[1:]
    # rounded: in a square, sums in another order must not change the order of modes that are equally long
    length = np.round(np.square(every / np.array(size)).sum(axis=1) * max(size) ** 2, 6)
    return np.asarray(every[np.lexsort((*every.T, length))[:count]])


def waves(size: np.ndarray, count: int) -> np.ndarray:
    """Half waves of the smoothest modes along each axis, shape (count, dim); the constant is none of them.

    >>> waves(np.array([12.0, 8.0]), 3).tolist()
    [[1, 0], [0, 1], [1, 1]]
    """
    return _waves(tuple(np.round(size, 9).tolist()), count)


def modes(places: np.ndarray, low: np.ndarray, high: np.ndarray, count: int) -> np.ndarray:
    """Values of the smoothest modes, from -1 to 1, shape (places, count).

    Parameters
    ----------
    places : ndarray, shape (places, dim)
        mm.
    low, high : ndarray, shape (dim,)
        Corners of the box around the undeformed body, mm.
    count : int
    """
    share = (places - low) / (high - low)
    return np.asarray(np.cos(np.pi * share[:, None] * waves(high - low, count)).prod(axis=2))
