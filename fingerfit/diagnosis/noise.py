"""What the noise of pictures does to the displacements of patches that were registered."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.registration import FLOOR, Registration
from fingerfit.imaging.warp import BackwardMap, spline_coefficients, warp
from fingerfit.study.data import Data

SAMPLES = 2400
"""Values of patches that the draws of the first picture's noise have together: they tell its variance to 3 %. A
choice."""

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
    dim, taps = len(scale) - 1, _taps(data.smooth)
    left, slope = float((taps**2).sum()), float((np.convolve(taps, [0.5, 0.0, -0.5]) ** 2).sum())
    mine = data.picture_noise**2 * left**dim
    # of the mean gradient of two pictures, which have noise of their own
    in_gradients = data.picture_noise**2 * slope * left ** (dim - 1) / 2
    own = [_of_picture(data, fit, owner, scale, in_gradients) for fit, owner in zip(fits, owners, strict=True)]
    expected = [np.diag(one).reshape(-1, dim + 1) / scale**2 for one in own]
    power, square = _carried(data, maps, fits, owners, in_gradients, seed)
    known = [one > 0 for one in expected]
    share = [
        float(np.mean(found[of] / one[of])) if of.any() else 0.0
        for found, one, of in zip(square, expected, known, strict=True)
    ]
    return _joined(own, share, fits, scale), np.sqrt(mine + power)


def _taps(sigma: float) -> np.ndarray:
    """What smoothing makes of a single pixel, along an axis."""
    line = np.zeros(2 * reach_of(sigma) + 1)
    line[len(line) // 2] = 1.0
    return smooth(line, sigma)


def _carried(
    data: Data,
    maps: list[BackwardMap],
    fits: Registrations,
    owners: list[np.ndarray],
    in_gradients: float,
    seed: int,
) -> tuple[np.ndarray, np.ndarray]:
    """What the synthesized pictures have of the noise of the first one: mean squares of draws.

    Of the pictures, shape (pictures,), and of what is found in patches by it, shape (pictures, patches, dim + 1),
    pixels.
    """
    values = sum(np.isfinite(fit.values).sum() for fit in fits) / len(fits)
    rng, draws = np.random.default_rng(seed), math.ceil(SAMPLES / max(values, 1))
    power, found = np.zeros(len(maps)), np.zeros((len(maps), *fits[0].values.shape))
    for _ in range(draws):
        first = spline_coefficients(rng.normal(0.0, data.picture_noise, data.before.shape)).astype(np.float32)
        for n, (way, fit, owner) in enumerate(zip(maps, fits, owners, strict=True)):
            noise = warp(first, 0.0, way, data.smooth)
            power[n] += np.mean(noise[owner >= 0] ** 2) / draws
            found[n] += fit.solve(noise, in_gradients) ** 2 / draws
    return power, found


def _of_picture(data: Data, fit: Registration, owner: np.ndarray, scale: np.ndarray, in_gradients: float) -> np.ndarray:
    """The covariance of all patches by the noise of a measured picture, shape (values, values).

    Noise that was smoothed by S goes through the equations of a patch, u = N D' S e, so that the covariance of two
    patches is N1 (S D1)' (S D2) N2: many pixels of a small patch are at its border, and smoothed noise is alike on both
    sides of that. `in_gradients` is the variance of the noise that the gradients in D have (`Registration.through`).
    """
    from scipy.ndimage import find_objects, gaussian_filter

    count, size, reach = len(fit.values), len(scale), reach_of(data.smooth)
    through = fit.through(in_gradients)
    found = np.zeros((count, size, count, size))
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
        root = data.picture_noise * scale[:, None] * through[patch]
        for other, there, its in known:
            shared = _shared(corner, design, there, its)
            if shared is not None:
                part = root @ shared @ (data.picture_noise * scale[:, None] * through[other]).T
                found[patch, :, other], found[other, :, patch] = part, part.T
    return found.reshape(count * size, count * size)


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


def _joined(own: Sequence[np.ndarray], share: Sequence[float], fits: Registrations, scale: np.ndarray) -> np.ndarray:
    """Covariance of all values of all pictures, shape (values, values).

    The floor of the registration's own error, which interpolation and outlines make, has two parts of one size: one of
    each patch alone, and one that is alike in a whole picture (docs/decisions/0008-own-error-of-registration.md).

    Parameters
    ----------
    own : sequence of ndarray, shape (values of a picture,) twice
        By the noise of each measured picture.
    share : sequence of float
        How much of that the noise of the first picture makes in each synthesized one, by variance: it is taken to have
        the same pattern, and is one for all.
    fits : tuple of Registration
        Registrations, by picture, with their own error.
    scale : ndarray, shape (dim + 1,)
        Of a pixel, mm, and of brightness.
    """
    size, count = len(scale), len(fits[0].values)
    order = np.arange(len(fits) * count * size).reshape(len(fits), count, size)
    found, unit, roots = np.zeros((order.size, order.size)), np.tile(scale, count), []
    for n, (mine, large, fit) in enumerate(zip(own, share, fits, strict=True)):
        rows = order[n].ravel()
        found[np.ix_(rows, rows)] = mine
        for patch in range(count):
            here = order[n, patch]
            found[np.ix_(here, here)] += np.outer(scale, scale) * fit.own_error[patch]
        # in pixels: a root of millimetres beside brightness would depend on how large the body is
        values, vectors = np.linalg.eigh(large * mine / np.outer(unit, unit))
        roots.append(unit[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
    root = np.concatenate(roots)
    found += root @ root.T
    for rows in order[..., :-1].transpose(0, 2, 1).reshape(-1, count):
        axis = rows[0] % size
        found[np.ix_(rows, rows)] += (FLOOR * scale[axis]) ** 2
    return found
