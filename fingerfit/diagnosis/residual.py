"""What a model leaves unexplained: displacements and brightness by patch and step, forces, and their noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fingerfit.forward.patches import Patches, flat, owners_of, points_by_patch
from fingerfit.forward.score import Prediction
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.registration import Registration, means, register
from fingerfit.imaging.warp import BackwardMap, spline_coefficients, warp
from fingerfit.study.data import Data

DISPLACEMENT, BRIGHTNESS, RESPONSE = "residual_displacement", "brightness", "response"
"""Parts of what a model leaves, and of what an effect would leave: displacements and brightness of patches, and the
quantity of each step that is not prescribed."""
DRAWS = 40
PLACES = 32
"""Points of a patch in space at which solutions are read, at most."""

Registrations = tuple[Registration, ...]


@dataclass(frozen=True)
class Residual:
    """The residual as one vector with its covariance.

    The vector has, for each picture and patch, a displacement (mm) and a brightness, then the same for each step with
    measured points (mean of those of a patch, without a brightness), then the response of each step (N or
    mm), and lateral forces (N). `kept` says which of them are known.

    Parameters
    ----------
    value : ndarray, shape (pictures + steps with points, patches, dim + 1)
        Measured minus predicted.
    response : ndarray, shape (responses,)
    covariance : ndarray, shape (kept, kept)
        Of the noise of pictures and of the response.
    kept : ndarray of bool, shape (all,)
    error, floor : ndarray, shape (pictures,)
        Root mean square difference of intensity inside the body, and what noise alone leaves of it.
    fits : tuple of Registration
        Registrations, by picture.
    places, place_patch : ndarray, shapes (places, dim) and (places,)
        Material points of the pixels that were registered, some of each patch, mm, and their patches; in space, where
        bodies fill their patches in part only.
    """

    value: np.ndarray
    response: np.ndarray
    covariance: np.ndarray
    kept: np.ndarray
    error: np.ndarray
    floor: np.ndarray
    fits: Registrations
    places: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    place_patch: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))

    @property
    def vector(self) -> np.ndarray:
        """All known values, shape (kept,)."""
        return flat(self.value, self.response)[self.kept]


def common_modes(residual: Residual, data: Data, control: np.ndarray) -> np.ndarray:
    """What all values of a step have in common, shape (kept, modes).

    Of each step the slope by the prescribed quantity, a displacement of everything along each axis, and the
    response. Not the brightness: tens of thousands of pixels tell a change of it that moves no constant.

    Parameters
    ----------
    residual : Residual
    data : Data
        Tells which values are of which step.
    control : ndarray, shape (all,)
        Slope by the prescribed quantity.
    """
    columns, entries = [], residual.value.shape
    for step in range(len(data.step)):
        here, response = (data.entry_step == step)[:, None, None], data.response_step == step
        columns += [flat(np.zeros(entries), one) for one in np.diag(response.astype(float))[response]]
        columns.append(control * flat(here & np.ones(entries, bool), response.astype(float)))
        if here.any():
            columns += [
                flat(here * np.ones((*entries[:2], 1)) * one, 0.0 * response) for one in np.eye(entries[2])[:-1]
            ]
    kept = np.stack(columns, axis=1)[residual.kept]
    return kept[:, np.abs(kept).max(axis=0, initial=0.0) > 0]


def residual_of(
    data: Data, prediction: Prediction, maps: list[BackwardMap], patches: Patches, seed: int = 1
) -> Residual:
    """Residual of a prediction.

    Parameters
    ----------
    data : Data
    prediction : Prediction
    maps : list of BackwardMap
        Of its pictures.
    patches : Patches
    seed : int
        Of the noise that is sent through the registration.
    """
    frame = Picture(data.before, data.spacing, data.origin, data.direction)
    count, dim = len(patches.centre), data.before.ndim
    owners = [owners_of(data, frame, way, patches) for way in maps]
    pairs = list(zip(prediction.pictures, data.measured, owners, strict=True))
    fits = tuple(register(s, m, owner, count) for s, m, owner in pairs)
    value = np.full((len(maps), count, dim + 1), np.nan)
    for n, fit in enumerate(fits):
        value[n] = fit.values
    scale = np.concatenate([data.spacing, [1.0]])
    value = np.concatenate(
        [value * scale, points_by_patch(data, data.points_displacement - prediction.points, patches)]
    )
    measured, spread = data.response
    response = np.where(spread > 0, measured - prediction.response, np.nan)
    vector = flat(value, response)
    kept = np.isfinite(vector)
    noise, floor = _noise(data, maps, fits, owners, scale, seed)
    covariance = np.zeros((len(vector), len(vector)))
    size = dim + 1
    for patch in range(count):
        rows = np.ravel([[(n * count + patch) * size + c for c in range(size)] for n in range(len(maps))]).astype(int)
        if len(rows):
            covariance[np.ix_(rows, rows)] = noise[patch]
    _add_points_noise(covariance, data, patches)
    last = np.arange(len(vector) - len(response), len(vector))
    shared = data.response_gain * np.nan_to_num(measured)
    covariance[np.ix_(last, last)] = np.diag(spread**2) + np.outer(shared, shared)
    error = [float(np.sqrt(np.mean((s - m)[o >= 0] ** 2))) for s, m, o in pairs]
    places = _places(data, frame, maps, owners, count) if dim == 3 and len(maps) else ()
    return Residual(value, response, covariance[np.ix_(kept, kept)], kept, np.array(error), floor, fits, *places)


def _places(
    data: Data, frame: Picture, maps: list[BackwardMap], owners: list[np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Material points of registered pixels, evenly spread over those of each patch, and their patches."""
    own = [owner.ravel()[way.pixel] for way, owner in zip(maps, owners, strict=True)]
    patch = np.concatenate(own)
    order = np.argsort(patch, kind="stable")
    order = order[patch[order] >= 0]
    number = np.bincount(patch[order], minlength=count)
    rank = np.arange(len(order)) - np.repeat(np.cumsum(number) - number, number)
    every = np.maximum(1, -(-number // PLACES))[patch[order]]
    # one of each run, another one from run to run by the golden ratio: no rhythm with the rows of a picture
    chosen = order[rank % every == (rank // every * 0.6180339887 % 1.0 * every).astype(int)]
    index, owner = np.concatenate([way.index for way in maps]), patch[chosen]
    # together they stand for all pixels of their patch: a displacement that grows evenly has the same mean at both
    off = means(index[patch >= 0], patch[patch >= 0], count) - means(index[chosen], owner, count)
    return frame.to_points(index[chosen] + off[owner]), owner


def _add_points_noise(covariance: np.ndarray, data: Data, patches: Patches) -> None:
    """Put the noise of points into the covariance: their own at all steps, and the shift of all points of a step."""
    steps, dim = np.unique(data.points_step), data.points.shape[1]
    count, owner, first = len(patches.centre), patches.of(data.points), len(data.picture_step)
    own, between = [data.points_step == step for step in steps], data.between_steps
    number = [np.bincount(owner[part & (owner >= 0)], minlength=count) for part in own]
    rows = np.arange((first + len(steps)) * count * (dim + 1)).reshape(-1, count, dim + 1)[first:]
    for n, step in enumerate(steps):
        for axis in range(dim):
            here = rows[n, :, axis]
            covariance[np.ix_(here, here)] += data.frame_noise**2
            for m, other in enumerate(steps):
                share = between[step, other] / np.sqrt(np.maximum(number[n] * number[m], 1))
                covariance[here, rows[m, :, axis]] += share


def _noise(
    data: Data, maps: list[BackwardMap], fits: Registrations, owners: list[np.ndarray], scale: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of each patch over all pictures, and the noise floor of the pictures.

    The noise of each measured picture is its own; that of the first picture moves with the material into all
    synthesized ones.
    """
    if data.before.ndim == 3 and fits:
        return _noise_in_space(data, maps, fits, owners, scale, seed)
    rng = np.random.default_rng(seed)
    count = len(fits[0].values) if fits else 0
    size, pictures = len(scale), len(maps)
    own = np.zeros((DRAWS, pictures, count, size))
    first = np.zeros((DRAWS, pictures, count, size))
    power = np.zeros(pictures)
    for draw in range(DRAWS if pictures else 0):
        before = spline_coefficients(rng.normal(0.0, data.picture_noise, data.before.shape))
        for n, (way, fit, owner) in enumerate(zip(maps, fits, owners, strict=True)):
            mine = smooth(rng.normal(0.0, data.picture_noise, data.before.shape), data.smooth)
            carried = smooth(warp(before, 0.0, way), data.smooth)
            own[draw, n], first[draw, n] = fit.solve(mine) * scale, fit.solve(-carried) * scale
            power[n] += np.mean((mine - carried)[owner >= 0] ** 2) / DRAWS
    covariance = np.zeros((2, pictures, count, size, size))
    for n in range(pictures):
        for patch in range(count):
            covariance[0, n, patch] = np.cov(own[:, n, patch], rowvar=False)
            covariance[1, n, patch] = np.cov(first[:, n, patch], rowvar=False)
    return _joined(covariance[0], covariance[1], fits, scale), np.sqrt(power)


def _noise_in_space(
    data: Data, maps: list[BackwardMap], fits: Registrations, owners: list[np.ndarray], scale: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same for volumes, where draws cost minutes: expected values in place of their means.

    Noise that was smoothed by S goes through the equations of a patch, u = N D' S e, so that its covariance is
    N (S D)' (S D) N. What is carried into a synthesized volume is taken to be alike: interpolation and strain change it
    by a few per cent. Only how much of it there is, for the floor, is drawn: once, since a body has many voxels.
    """
    from scipy.ndimage import find_objects, gaussian_filter

    rng = np.random.default_rng(seed)
    count, size, reach = len(fits[0].values), len(scale), reach_of(data.smooth)
    found = np.full((len(maps), count, size, size), np.nan)
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
        for patch, box in enumerate(find_objects(owner + 1, count)):
            if box is None or not np.isfinite(fit.normal[patch]).all():
                continue
            design = np.where(owner[box] == patch, columns[(slice(None), *box)], 0.0)
            if data.smooth > 0:
                design = np.pad(design, [(0, 0), *[(reach, reach)] * (size - 1)])
                design = gaussian_filter(design, (0, *[data.smooth] * (size - 1)), mode="constant")
            flat_design = design.reshape(size, -1)
            root = scale[:, None] * fit.normal[patch] @ flat_design * data.picture_noise
            found[n, patch] = root @ root.T
    return _joined(found, found, fits, scale), np.sqrt(power)


def _joined(own: np.ndarray, first: np.ndarray, fits: Registrations, scale: np.ndarray) -> np.ndarray:
    """Covariance of each patch over all pictures, shape (patches, pictures * size, pictures * size).

    Parameters
    ----------
    own : ndarray, shape (pictures, patches, size, size)
        By the noise of each measured picture.
    first : ndarray, like `own`
        By that of the first picture, which all synthesized ones have in common.
    fits : tuple of Registration
        Registrations, by picture, with their own error.
    scale : ndarray, shape (size,)
        Of a pixel, mm, and of brightness.
    """
    pictures, count, size, _ = own.shape
    found = np.zeros((count, pictures * size, pictures * size))
    for patch in range(count):
        block = np.zeros((pictures, size, pictures, size))
        root = []
        for n in range(pictures):
            block[n, :, n] = own[n, patch] + np.outer(scale, scale) * fits[n].own_error[patch]
            # in pixels: a root of millimetres beside brightness would depend on how large the body is
            values, vectors = np.linalg.eigh(np.nan_to_num(first[n, patch] / np.outer(scale, scale)))
            root.append(scale[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
        for n in range(pictures):
            for m in range(pictures):
                block[n, :, m] += root[n] @ root[m].T
        found[patch] = block.reshape(pictures * size, -1)
    return found
