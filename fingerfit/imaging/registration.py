"""Displacements that are left between a synthesized and a measured picture, patch by patch of material.

In each patch the measured picture is taken for the synthesized one moved by u and brighter by b:
M - S = -grad u + b in the least-squares sense (Lucas and Kanade 1981), grad being the mean gradient of both
pictures; large moves are found on smoothed pictures first. The last step is linear in the pictures, so that noise
can be sent through the same equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.warp import sample, spline_coefficients

COARSE = (4.0, 1.0, 0.0)
"""Extra smoothing of the passes, pixels."""
FARTHEST = 4.0
"""Longest move of a pass along an axis, pixels."""
FEWEST = 30
"""Pixels that a patch needs."""


@dataclass(frozen=True)
class Fit:
    """Least-squares equations of one picture.

    Parameters
    ----------
    values : ndarray, shape (patches, 1 + dim)
        Displacement in pixels along each axis (x first), then brightness; NaN for patches without enough pixels.
    patch : ndarray of int, shape (pixels,)
        Patch of the pixels that are used.
    pixel : ndarray of int, shape (pixels,)
        Their flat indices.
    design : ndarray, shape (pixels, dim + 1)
        Columns of the equations.
    normal : ndarray, shape (patches, dim + 1, dim + 1)
        Inverse normal matrices.
    """

    values: np.ndarray
    patch: np.ndarray
    pixel: np.ndarray
    design: np.ndarray
    normal: np.ndarray

    def solve(self, difference: np.ndarray) -> np.ndarray:
        """Solution for another difference picture, shape (patches, dim + 1)."""
        right = self.design * difference.ravel()[self.pixel, None]
        count = len(self.values)
        sums = np.stack([np.bincount(self.patch, column, minlength=count) for column in right.T], axis=1)
        return np.einsum("pij,pj->pi", self.normal, sums)


def register(synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int) -> Fit:
    """Register a synthesized picture to the measured one.

    Parameters
    ----------
    synthesized, measured : ndarray, shape (ny, nx) or (nz, ny, nx)
    patch : ndarray of int, like the pictures
        Patch of each pixel; -1 where none.
    count : int
        Number of patches.
    """
    if synthesized.ndim == 3 and (patch >= 0).any():
        # what is far from all patches takes no part
        window = _window(patch >= 0, int(2 * FARTHEST))
        found = _register(synthesized[window], measured[window], patch[window], count)
        place = np.unravel_index(found.pixel, patch[window].shape)
        place = tuple(index + part.start for index, part in zip(place, window, strict=True))
        return replace(found, pixel=np.ravel_multi_index(place, patch.shape))
    return _register(synthesized, measured, patch, count)


def _window(inside: np.ndarray, margin: int) -> tuple[slice, ...]:
    """The box around pixels, wider by a margin as far as the picture goes."""
    found = []
    for axis in range(inside.ndim):
        used = np.flatnonzero(inside.any(axis=tuple(k for k in range(inside.ndim) if k != axis)))
        found.append(slice(max(0, int(used[0]) - margin), min(inside.shape[axis], int(used[-1]) + margin + 1)))
    return tuple(found)


def _register(synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int) -> Fit:
    dim = synthesized.ndim
    moves = np.zeros((count, dim))
    inside = patch.ravel() >= 0
    owner = patch.ravel()[inside]
    pixels = np.maximum(np.bincount(owner, minlength=count), 1)
    coefficients = spline_coefficients(synthesized)
    index = np.indices(synthesized.shape)[::-1].reshape(dim, -1).T.astype(float)

    def closer(moves: np.ndarray, extra: float) -> tuple[np.ndarray, Fit]:
        """Moves after one more look, at pictures that are smoothed further, and its equations."""
        moved = synthesized
        if np.any(moves):
            # the field is smoother than the moves of the patches: what it really moved them by counts
            field = _spread(moves, patch)
            moved = sample(coefficients, index - field).reshape(synthesized.shape)
            sums = [np.bincount(owner, column[inside], minlength=count) for column in field.T]
            moves = np.stack(sums, axis=1) / pixels[:, None]
        fit = _equations(smooth(moved, extra), smooth(measured, extra), patch, count)
        step = np.clip(np.nan_to_num(fit.values[:, :dim]), -FARTHEST, FARTHEST)
        return moves + step, fit

    *coarse, last = COARSE
    for extra in coarse:
        moves, _ = closer(moves, extra)
    moves, fit = closer(moves, last)
    values = fit.values.copy()
    values[:, :dim] = np.where(np.isnan(values[:, :dim]), np.nan, moves)
    return Fit(values, fit.patch, fit.pixel, fit.design, fit.normal)


def _equations(synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int) -> Fit:
    gradients = [
        (a + b).ravel() / 2 for a, b in zip(_gradient(synthesized), _gradient(measured), strict=True)
    ]  # x first
    pixel = np.flatnonzero(patch.ravel() >= 0)
    owner = patch.ravel()[pixel]
    design = np.stack([*(-g[pixel] for g in gradients), np.ones(len(pixel))], axis=1)
    size = design.shape[1]
    normal = np.zeros((count, size, size))
    for i in range(size):
        for j in range(i + 1):
            normal[:, i, j] = normal[:, j, i] = np.bincount(owner, design[:, i] * design[:, j], minlength=count)
    enough = np.bincount(owner, minlength=count) >= FEWEST
    inverse = np.full_like(normal, np.nan)
    inverse[enough] = np.linalg.pinv(normal[enough], hermitian=True)
    fit = Fit(np.empty((count, size)), owner, pixel, design, inverse)
    return Fit(fit.solve(measured - synthesized), owner, pixel, design, inverse)


def _gradient(picture: np.ndarray) -> list[np.ndarray]:
    found = np.gradient(picture)
    return list(found[::-1])


def _spread(moves: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """Moves of the patches as a smooth field, shape (pixels, dim)."""
    inside = patch >= 0
    width = 0.5 * (inside.sum() / max(1, len(np.unique(patch[inside])))) ** (1 / patch.ndim)
    if patch.ndim == 3 and width >= 2 * _BLOCK:
        return _spread_coarsely(moves, patch, width)
    weight = smooth(inside.astype(float), width) + 1e-6
    values = np.where(inside[..., None], moves[patch], 0.0)
    columns = [smooth(values[..., axis], width) / weight for axis in range(moves.shape[1])]
    return np.stack([column.ravel() for column in columns], axis=1)


_BLOCK = 2
"""Voxels along each side of a block in which a field that is much smoother is made."""


def _spread_coarsely(moves: np.ndarray, patch: np.ndarray, width: float) -> np.ndarray:
    """The same in space, where such wide Gaussians cost most: on blocks of voxels, then linear between them."""
    from scipy.ndimage import map_coordinates

    shape = patch.shape
    coarse = tuple(-(-n // _BLOCK) for n in shape)
    place: np.ndarray = np.indices(shape, dtype=np.int32).reshape(3, -1)
    block = np.ravel_multi_index(tuple(place // _BLOCK), coarse)
    inside = patch.ravel() >= 0
    owner, block = patch.ravel()[inside], block[inside]
    size = int(np.prod(coarse))
    sigma = width / _BLOCK
    weight = smooth(np.bincount(block, minlength=size).reshape(coarse).astype(float), sigma) + 1e-6
    at = (place - (_BLOCK - 1) / 2) / _BLOCK
    found = np.empty((patch.size, moves.shape[1]))
    for axis, column in enumerate(moves.T):
        total = np.bincount(block, column[owner], minlength=size).reshape(coarse)
        found[:, axis] = map_coordinates(smooth(total, sigma) / weight, at, order=1, mode="nearest")
    return found
