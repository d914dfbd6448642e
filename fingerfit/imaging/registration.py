"""Residual displacements between a synthesized and a measured picture, patch by patch of material.

In each patch the measured picture is taken for the synthesized one moved by u and brighter by b:
M - S = -grad u + b in the least-squares sense (Lucas and Kanade 1981), grad being the mean gradient of both
pictures. The measured picture is pulled back by what was found (Baker and Matthews 2004), so that a displacement
belongs to the material of its patch; large displacements are found on smoothed pictures first. The last step is linear
in the pictures, so that noise can be sent through the same equations, and so can what varies inside a patch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.warp import sample, spline_coefficients

COARSE = (4.0, 1.0, 0.0, 0.0)
"""Extra smoothing of the passes, pixels. The last is made twice: on a textured block the second pass takes the error
from 0.028 to 0.020 pixels, a third one changes it by less than a tenth
(docs/decisions/0008-own-error-of-registration.md). The first two are choices."""
FLOOR = 0.01
"""Error of a displacement that is alike everywhere, pixels: 0.001 to 0.003 by interpolation (textures of a correlation
length of 1 and 2.5 pixels, five seeds of each), 0.012 in patches beside an outline that one picture cuts sharply."""
FARTHEST = 4.0
"""Longest move of a pass along an axis, pixels: the standard deviation of the first one's smoothing (`COARSE`). A
choice."""
FEWEST = 30
"""Pixels that a patch needs: ten for each of its unknowns in the plane, two displacements and the brightness. A
choice."""


@dataclass(frozen=True)
class Registration:
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
    own_error : ndarray, shape (patches, dim + 1, dim + 1)
        Covariance of the registration's own error, noise apart, pixels.
    """

    values: np.ndarray
    patch: np.ndarray
    pixel: np.ndarray
    design: np.ndarray
    normal: np.ndarray
    own_error: np.ndarray

    def solve(self, difference: np.ndarray, noise: float = 0.0) -> np.ndarray:
        """Solution for another difference picture, shape (patches, dim + 1); of noise with `noise` as for `through`."""
        through = self.through(noise) if noise else self.normal
        return _solve(self.patch, self.design, through, difference.ravel()[self.pixel])

    def through(self, noise: float) -> np.ndarray:
        """What noise goes through to what was found, in place of the inverse normal matrices, and of their shape.

        The gradients have noise themselves, so that the normal matrix of n pixels is too large by n G, G being its
        variance: a pass finds only the share 1 - n N G of a displacement that is left. The second pass at full
        resolution finds what the first one missed, and the noise of the pictures once more in that share
        (errors in variables: Fuller 1987). What comes out is N + n N G N in place of N.

        Parameters
        ----------
        noise : float
            Variance of the noise of the mean gradient along each axis.
        """
        moved = self.normal[:, :, :-1]
        pixels = np.bincount(self.patch, minlength=len(self.normal))[:, None, None]
        return self.normal + noise * pixels * (moved @ moved.transpose(0, 2, 1))


def register(synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int) -> Registration:
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


def _register(synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int) -> Registration:
    dim = synthesized.ndim
    shifts = np.zeros((count, dim))
    inside = patch.ravel() >= 0
    owner = patch.ravel()[inside]
    coefficients = spline_coefficients(measured)
    index = np.indices(synthesized.shape)[::-1].reshape(dim, -1).T.astype(float)
    field, aimed = np.zeros((len(owner), dim)), shifts
    for extra in COARSE:
        back = measured
        if np.any(shifts):
            # a field is smoother than its displacements: what it fell short by is aimed at in the next pass
            aimed = shifts + aimed - means(field, owner, count)
            whole = _spread(aimed, patch)
            back, field = sample(coefficients, index + whole).reshape(measured.shape), whole[inside]
            shifts = means(field, owner, count)
        pixel, design, normal, difference = _equations(smooth(synthesized, extra), smooth(back, extra), patch, count)
        step = _solve(owner, design, normal, difference)
        shifts = shifts + np.clip(np.nan_to_num(step[:, :dim]), -FARTHEST, FARTHEST)
    values = np.concatenate([np.where(np.isnan(step[:, :dim]), np.nan, shifts), step[:, dim:]], axis=1)
    own_error = _own_error(values, field, owner, index[inside], design, normal)
    return Registration(values, owner, pixel, design, normal, own_error)


def _equations(
    synthesized: np.ndarray, measured: np.ndarray, patch: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels, design, inverse normal matrices and right-hand side."""
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
    return pixel, design, inverse, (measured - synthesized).ravel()[pixel]


def _solve(owner: np.ndarray, design: np.ndarray, normal: np.ndarray, difference: np.ndarray) -> np.ndarray:
    """Solution of the equations of each patch for the differences of their pixels, shape (patches, dim + 1)."""
    return np.einsum("pij,pj->pi", normal, _sums(design * difference[:, None], owner, len(normal)))


def _own_error(
    values: np.ndarray,
    field: np.ndarray,
    owner: np.ndarray,
    place: np.ndarray,
    design: np.ndarray,
    normal: np.ndarray,
) -> np.ndarray:
    """Covariance of the registration's own error, shape (patches, dim + 1, dim + 1), pixels.

    What varies inside a patch and was not followed by the field of the last pass, v, is weighed by the texture: the
    patch gives u + N D' D v, not the plain mean u. With v from the gradients of what was found, the mean square of
    N D' D v over all patches is what each of them is said to be wrong by, beside `FLOOR`.

    Parameters
    ----------
    values : ndarray, shape (patches, dim + 1)
        What was found.
    field : ndarray, shape (pixels, dim)
        What the measured picture was pulled back by in the last pass.
    owner : ndarray of int, shape (pixels,)
    place : ndarray, shape (pixels, dim)
        Indices of the pixels, x first.
    design, normal : ndarray
        As of a `Registration`.
    """
    count, dim = len(values), place.shape[1]
    known = np.isfinite(values).all(axis=1)
    centre = means(place, owner, count)
    gradient = np.zeros((count, dim, dim))
    gradient[known] = _gradients(values[known, :dim], centre[known], np.bincount(owner, minlength=count)[known])
    varies = np.einsum("nij,nj->ni", gradient[owner], place - centre[owner])
    varies -= field - means(field, owner, count)[owner]
    off = _solve(owner, design, normal, (design[:, :dim] * varies).sum(axis=1))[known]
    spread = off.T @ off / max(len(off), 1)
    return np.broadcast_to(spread + np.diag([FLOOR**2] * dim + [0.0]), normal.shape)


def _gradients(shifts: np.ndarray, centre: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Gradients of displacements from patch to patch, by local linear regression, shape (patches, dim, dim)."""
    if len(shifts) == 0:
        return np.zeros((0, shifts.shape[1], shifts.shape[1]))
    away = centre[None] - centre[:, None]
    # neighbours count by how near they are, in units of a patch's edge
    weight = np.exp(-(away**2).sum(axis=2) / (2 * pixels.mean() ** (2 / shifts.shape[1]))) * pixels
    columns = np.concatenate([np.ones((*away.shape[:2], 1)), away], axis=2)
    normal = np.einsum("pq,pqi,pqj->pij", weight, columns, columns, optimize=True)
    right = np.einsum("pq,pqi,qj->pij", weight, columns, shifts, optimize=True)
    return np.einsum("pij,pjk->pik", np.linalg.pinv(normal, hermitian=True), right)[:, 1:].transpose(0, 2, 1)


def _sums(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Sums of values, shape (values, ...), by their owners, shape (count, ...)."""
    columns = values.reshape(len(values), -1).T
    found = np.stack([np.bincount(owner, column, minlength=count) for column in columns], axis=1)
    return found.reshape(count, *values.shape[1:])


def means(values: np.ndarray, owner: np.ndarray, count: int) -> np.ndarray:
    """Means of values, shape (values, components), by their owners, shape (count, components); NaN for none."""
    number = np.bincount(owner, minlength=count)[:, None]
    return np.where(number > 0, _sums(values, owner, count) / np.maximum(number, 1), np.nan)


def _gradient(picture: np.ndarray) -> list[np.ndarray]:
    found = np.gradient(picture)
    return list(found[::-1])


def _spread(shifts: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """Displacements of the patches as a smooth field, shape (pixels, dim)."""
    inside = patch >= 0
    width = 0.5 * (inside.sum() / max(1, len(np.unique(patch[inside])))) ** (1 / patch.ndim)
    if patch.ndim == 3 and width >= 2 * _BLOCK:
        return _spread_coarsely(shifts, patch, width)
    weight = smooth(inside.astype(float), width) + 1e-6
    values = np.where(inside[..., None], shifts[patch], 0.0)
    columns = [smooth(values[..., axis], width) / weight for axis in range(shifts.shape[1])]
    return np.stack([column.ravel() for column in columns], axis=1)


_BLOCK = 2
"""Voxels along each side of a block in which a field that is much smoother, over two sides or more, is made:
an eighth as many. A choice."""


def _spread_coarsely(shifts: np.ndarray, patch: np.ndarray, width: float) -> np.ndarray:
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
    found = np.empty((patch.size, shifts.shape[1]))
    for axis, column in enumerate(shifts.T):
        total = np.bincount(block, column[owner], minlength=size).reshape(coarse)
        found[:, axis] = map_coordinates(smooth(total, sigma) / weight, at, order=1, mode="nearest")
    return found
