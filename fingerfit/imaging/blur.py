"""The blur of a camera, which does not move with the body.

A camera (or scanner) blurs each picture as it is, by its point spread function. The picture before compression carries
its blur along when it is warped, so that it is blurred less across than along where the body is pressed together. What
that changes follows from the second derivatives of the warped picture: blurring by a Gaussian of covariance C is the
diffusion of the picture over that covariance, here to first order and by no more than the blur itself.
"""

from __future__ import annotations

import numpy as np

from fingerfit.imaging.warp import BackwardMap

REACH = 3.0
"""Standard deviations of the blur within which a border is soft: 0.3 % of a Gaussian lie beyond."""


def blurred_in_place(picture: np.ndarray, way: BackwardMap, spread: np.ndarray) -> np.ndarray:
    """A warped picture with the blur of its camera in place of the one that the warp has carried along.

    Parameters
    ----------
    picture : ndarray, shape (ny, nx) or (nz, ny, nx)
        Warped by the map.
    way : BackwardMap
    spread : ndarray, shape (dim,)
        Standard deviations of the blur along x, y[, z], pixels.
    """
    dim = picture.ndim
    covariance = np.diag(np.square(spread))
    deformation = np.linalg.inv(_gradient_of_map(way))
    change = covariance - deformation @ covariance @ np.swapaxes(deformation, -1, -2)
    # first order holds for small changes; at a singular corner the warp may have carried many times the blur along
    size, most = np.linalg.norm(change, axis=(1, 2)), np.linalg.norm(covariance)
    change *= (most / np.maximum(size, most))[:, None, None]
    found = np.zeros(len(way.pixel))
    for i in range(dim):
        for j in range(i + 1):
            share = 0.5 if i == j else 1.0  # each of two that are alike
            found += share * change[:, i, j] * _curved(picture, dim - 1 - i, dim - 1 - j).ravel()[way.pixel]
    result = picture.copy()
    result.ravel()[way.pixel] += found.astype(picture.dtype)
    return result


def _curved(picture: np.ndarray, first: int, second: int) -> np.ndarray:
    """Second derivative along two axes, per pixel and pixel."""
    if first != second:
        return np.asarray(np.gradient(np.gradient(picture, axis=first), axis=second))
    wide = np.pad(picture, [(int(axis == first),) * 2 for axis in range(picture.ndim)], mode="edge")
    return np.diff(wide, n=2, axis=first)


def _gradient_of_map(way: BackwardMap) -> np.ndarray:
    """Derivatives of where pixels come from by where they are, shape (covered, dim, dim).

    Differences to the neighbours that are covered; where a pixel has none along an axis, or the map folds, nothing is
    deformed.
    """
    dim = len(way.shape)
    known = np.zeros(way.shape, dtype=bool)
    known.ravel()[way.pixel] = True
    found = np.empty((len(way.pixel), dim, dim))
    for i in range(dim):
        source = np.zeros(way.shape)
        source.ravel()[way.pixel] = way.index[:, i]
        for j in range(dim):
            axis = dim - 1 - j
            total, count = np.zeros(way.shape), np.zeros(way.shape)
            ahead, behind = _along(axis, dim, 1), _along(axis, dim, 0)
            both = known[ahead] & known[behind]
            step = np.where(both, source[ahead] - source[behind], 0.0)
            for place in (ahead, behind):
                total[place] += step
                count[place] += both
            mean = np.divide(total, count, out=np.full(way.shape, float(i == j)), where=count > 0)
            found[:, i, j] = mean.ravel()[way.pixel]
    plain = np.linalg.det(found) > 0.0
    return np.where(plain[:, None, None], found, np.eye(dim))


def _along(axis: int, dim: int, begin: int) -> tuple[slice, ...]:
    """All pixels but the last along an axis, or but the first where it begins at 1."""
    return tuple(slice(begin, None if begin else -1) if n == axis else slice(None) for n in range(dim))
