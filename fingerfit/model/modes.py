"""Smooth modes over a body of any shape: cosines over the box around it, the longest waves first.

They are the eigenfunctions of the Laplacian on that box, as in reduced-rank Gaussian processes (Solin and Särkkä,
Statistics and Computing 30, 2020). They are the same on all meshes of a body; eigenvectors of a mesh have signs, and in
a square directions, that its elements choose. In a layer with a modulus of its own they have no mean: the modulus is a
geometric mean, and they say how it changes inside.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
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


def centred(values: np.ndarray, weights: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """Modes less their mean in each group of places: what a constant of the group does is none of them.

    Parameters
    ----------
    values : ndarray, shape (places, count)
    weights : ndarray, shape (places,)
        Area or volume that a place stands for.
    groups : ndarray, shape (places,), int
        Number of the group that a place belongs to, from 0.

    >>> centred(np.array([[0.0], [3.0], [5.0]]), np.array([2.0, 1.0, 1.0]), np.array([0, 0, 1])).ravel().tolist()
    [-1.0, 2.0, 0.0]
    """
    whole = np.bincount(groups, weights)
    sums = np.stack([np.bincount(groups, weights * mode, len(whole)) for mode in values.T], axis=1)
    return np.asarray(values - (sums / np.maximum(whole, 1e-300)[:, None])[groups])


def sharing(parts: Mapping[str, np.ndarray], constants: Collection[str], count: int) -> np.ndarray:
    """Groups of elements, shape (count,): each part with a modulus of its own, and all others together, as 0.

    Parameters
    ----------
    parts : mapping
        Elements by part.
    constants : collection of str
        Names of what a model fits: ``mu_top`` is the modulus of part ``TOP``.
    count : int
        Elements.
    """
    own, found = {name.lower() for name in constants}, np.zeros(count, dtype=int)
    for number, (name, members) in enumerate(parts.items(), 1):
        if f"mu_{name.lower()}" in own:
            found[members] = number
    return found
