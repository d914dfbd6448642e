"""What the noise of pictures does to the displacements of patches that were registered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.registration import FLOOR, Registration
from fingerfit.imaging.warp import BackwardMap, spline_coefficients, warp
from fingerfit.study.data import Data

DRAWS = 40
"""Of the noise of pictures in the plane; a choice."""

Registrations = tuple[Registration, ...]


def noise_of(
    data: Data, maps: list[BackwardMap], fits: Registrations, owners: list[np.ndarray], scale: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of all patches of all pictures, and the noise floor of the pictures.

    The noise of each measured picture is its own; that of the first picture moves with the material into all
    synthesized ones. The registration's own error is part of the covariance.

    Parameters
    ----------
    data : Data
    maps : list of BackwardMap
        Of the synthesized pictures.
    fits : tuple of Registration
    owners : list of ndarray of int
        Patch of each pixel, by picture; -1 for none.
    scale : ndarray, shape (dim + 1,)
        Of a pixel, mm, and of brightness.
    seed : int

    Returns
    -------
    covariance : ndarray, shape (values, values)
        Values in the order pictures, patches, displacements (mm) and brightness.
    floor : ndarray, shape (pictures,)
        Root mean square difference of intensity that noise leaves inside the body.
    """
    if not fits:
        return np.zeros((0, 0)), np.zeros(0)
    count = len(fits[0].values)
    if data.before.ndim == 3:
        (own, floor), groups = _in_space(data, maps, fits, owners, scale, seed), [np.arange(count)]
        first = own
    else:
        own, first, floor = _in_the_plane(data, maps, fits, owners, scale, seed)
        groups = list(np.arange(count)[:, None])
    return _joined(own, first, groups, fits, scale), floor


def _in_the_plane(
    data: Data, maps: list[BackwardMap], fits: Registrations, owners: list[np.ndarray], scale: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariances of each patch by the noise of each measured picture and by that of the first one, and the floor.

    The former have shape (patches, pictures, dim + 1, dim + 1). Patches are taken to be independent of each other: each
    has some hundred pixels, and few of them at its edge.
    """
    rng = np.random.default_rng(seed)
    count, size, pictures = len(fits[0].values), len(scale), len(maps)
    own = np.zeros((DRAWS, pictures, count, size))
    first = np.zeros((DRAWS, pictures, count, size))
    power = np.zeros(pictures)
    for draw in range(DRAWS):
        before = spline_coefficients(rng.normal(0.0, data.picture_noise, data.before.shape))
        for n, (way, fit, owner) in enumerate(zip(maps, fits, owners, strict=True)):
            mine = smooth(rng.normal(0.0, data.picture_noise, data.before.shape), data.smooth)
            carried = smooth(warp(before, 0.0, way), data.smooth)
            own[draw, n], first[draw, n] = fit.solve(mine) * scale, fit.solve(-carried) * scale
            power[n] += np.mean((mine - carried)[owner >= 0] ** 2) / DRAWS
    found = np.zeros((2, count, pictures, size, size))
    for kind, drawn in enumerate((own, first)):
        for n in range(pictures):
            for patch in range(count):
                found[kind, patch, n] = np.cov(drawn[:, n, patch], rowvar=False)
    return found[0], found[1], np.sqrt(power)


def _in_space(
    data: Data, maps: list[BackwardMap], fits: Registrations, owners: list[np.ndarray], scale: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """The covariance of all patches together, shape (1, pictures, values, values), and the floor.

    Draws of volumes cost minutes: these are expected values. Noise that was smoothed by S goes through the equations of
    a patch, u = N D' S e, so that the covariance of two patches is N1 (S D1)' (S D2) N2: half of the voxels of a small
    patch are at its border, and smoothed noise is alike on both sides of that. What is carried into a
    synthesized volume is taken to be alike: interpolation and strain change it by a few per cent. Only how much of it
    there is, for the floor, is drawn: once, since a body has many voxels.
    """
    from scipy.ndimage import find_objects, gaussian_filter

    rng = np.random.default_rng(seed)
    count, size, reach = len(fits[0].values), len(scale), reach_of(data.smooth)
    found = np.zeros((len(maps), count, size, count, size))
    power = np.zeros(len(maps))
    # the taps of the Gaussian, from what it makes of a single voxel
    tap = np.zeros(2 * reach + 1)
    tap[reach] = 1.0
    taps = gaussian_filter(tap, data.smooth, mode="constant") if data.smooth > 0 else tap
    mine = data.picture_noise**2 * float((taps**2).sum()) ** (size - 1)
    first = spline_coefficients(rng.normal(0.0, data.picture_noise, data.before.shape)).astype(np.float32)
    for n, (way, fit, owner) in enumerate(zip(maps, fits, owners, strict=True)):
        power[n] = mine + np.mean(warp(first, 0.0, way, data.smooth)[owner >= 0] ** 2)
        columns = np.zeros((size, owner.size), dtype=np.float32)
        columns[:, fit.pixel] = fit.design.T
        columns = columns.reshape(size, *owner.shape)
        known = list[tuple[int, np.ndarray, np.ndarray]]()
        for patch, box in enumerate(find_objects(owner + 1, count)):
            if box is None or not np.isfinite(fit.normal[patch]).all():
                continue
            design = np.where(owner[box] == patch, columns[(slice(None), *box)], 0.0)
            design = np.pad(design, [(0, 0), *[(reach, reach)] * (size - 1)])
            if data.smooth > 0:
                design = gaussian_filter(design, (0, *[data.smooth] * (size - 1)), mode="constant")
            corner = np.array([part.start for part in box]) - reach
            known.append((patch, corner, design))
            root = data.picture_noise * scale[:, None] * fit.normal[patch]
            for other, there, its in known:
                shared = _shared(corner, design, there, its)
                if shared is not None:
                    part = root @ shared @ (data.picture_noise * scale[:, None] * fit.normal[other]).T
                    found[n, patch, :, other], found[n, other, :, patch] = part, part.T
    return found.reshape(1, len(maps), count * size, count * size), np.sqrt(power)


def _shared(corner: np.ndarray, one: np.ndarray, there: np.ndarray, other: np.ndarray) -> np.ndarray | None:
    """Products of the columns of two boxes, summed over the voxels in both; None where there are none.

    `corner` and `there` are their first voxels; the boxes have shape (columns, ...).
    """
    low = np.maximum(corner, there)
    high = np.minimum(corner + one.shape[1:], there + other.shape[1:])
    if (low >= high).any():
        return None
    parts = [
        box[(slice(None), *(slice(a, b) for a, b in zip(low - first, high - first, strict=True)))]
        for box, first in ((one, corner), (other, there))
    ]
    return np.asarray(parts[0].reshape(len(one), -1) @ parts[1].reshape(len(other), -1).T, dtype=float)


def _joined(
    own: np.ndarray, first: np.ndarray, groups: Sequence[np.ndarray], fits: Registrations, scale: np.ndarray
) -> np.ndarray:
    """Covariance of all values of all pictures, shape (values, values).

    The floor of the registration's own error, which interpolation and outlines make, has two parts of one size: one of
    each patch alone, and one that is alike in a whole picture (docs/decisions/0008-own-error-of-registration.md).

    Parameters
    ----------
    own : ndarray, shape (groups, pictures, values, values)
        Of each group of patches, by the noise of each measured picture.
    first : ndarray, like `own`
        By that of the first picture, which all synthesized ones have in common.
    groups : sequence of ndarray of int
        Patches that are independent of those of other groups.
    fits : tuple of Registration
        Registrations, by picture, with their own error.
    scale : ndarray, shape (dim + 1,)
        Of a pixel, mm, and of brightness.
    """
    size, count = len(scale), len(fits[0].values)
    order = np.arange(len(fits) * count * size).reshape(len(fits), count, size)
    found = np.zeros((order.size, order.size))
    for patches, mine, carried in zip(groups, own, first, strict=True):
        unit, roots = np.tile(scale, len(patches)), []
        for n, fit in enumerate(fits):
            rows = order[n, patches].ravel()
            found[np.ix_(rows, rows)] = mine[n]
            for patch in patches:
                here = order[n, patch]
                found[np.ix_(here, here)] += np.outer(scale, scale) * fit.own_error[patch]
            # in pixels: a root of millimetres beside brightness would depend on how large the body is
            values, vectors = np.linalg.eigh(np.nan_to_num(carried[n] / np.outer(unit, unit)))
            roots.append(unit[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
        rows, root = order[:, patches].ravel(), np.concatenate(roots)
        found[np.ix_(rows, rows)] += root @ root.T
    for rows in order[..., :-1].transpose(0, 2, 1).reshape(-1, count):
        axis = rows[0] % size
        found[np.ix_(rows, rows)] += (FLOOR * scale[axis]) ** 2
    return found
