"""What a model leaves unexplained: displacements and brightness by patch and step, forces, and their noise."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fingerfit.diagnosis.noise import Registrations, noise_of
from fingerfit.forward.patches import Patches, flat, owners_of, points_by_patch
from fingerfit.forward.score import Prediction
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.registration import means, register
from fingerfit.imaging.warp import BackwardMap
from fingerfit.study.data import Data

DISPLACEMENT, BRIGHTNESS, RESPONSE = "residual_displacement", "brightness", "response"
"""Parts of what a model leaves, and of what an effect explains: displacements and brightness of patches, and the
quantity of each step that is not prescribed."""
PLACES = 32
"""Points of a patch in space at which solutions are read, at most."""


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

    @property
    def whole(self) -> np.ndarray:
        """All values, shape (all,); NaN where not known."""
        return np.where(self.kept, flat(self.value, self.response), np.nan)

    def inside(self, pictures: np.ndarray) -> np.ndarray:
        """Root mean square of differences of pictures inside the body, shape (pictures,)."""
        both = zip(pictures, self.fits, strict=True)
        return np.array([np.sqrt(np.mean(picture.ravel()[way.pixel] ** 2)) for picture, way in both])

    def times(self, pictures: np.ndarray, left: np.ndarray) -> np.ndarray:
        """How many times each picture is in what is left of it inside the body, by least squares, shape (pictures,)."""
        found = []
        for picture, rest, way in zip(pictures, left, self.fits, strict=True):
            own = picture.ravel()[way.pixel]
            found.append(float(rest.ravel()[way.pixel] @ own) / max(float(own @ own), np.finfo(float).tiny))
        return np.array(found)


def of_fit(residual: Residual, data: Data, fitted: Data) -> np.ndarray:
    """Which values of all data are of `fitted`, those that a fit compares, bool, shape (all,).

    Where there are pictures, the response of every step is.
    """
    pictures = np.isin(data.picture_step, fitted.picture_step)
    points = np.isin(np.unique(data.points_step), fitted.points_step)
    fields = np.concatenate([pictures, points])[:, None, None]
    return np.concatenate([np.broadcast_to(fields, residual.value.shape).ravel(), np.isfinite(fitted.response[0])])


def common_modes(residual: Residual, data: Data, control: np.ndarray, kept: np.ndarray) -> np.ndarray:
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
    kept : ndarray of bool, shape (all,)
        The values that are asked for.
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
    modes = np.stack(columns, axis=1)[kept]
    return modes[:, np.abs(modes).max(axis=0, initial=0.0) > 0]


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
    frame = Picture.before(data)
    count, dim = len(patches.centre), data.before.ndim
    owners = [owners_of(data, frame, way, patches) for way in maps]
    pairs = list(zip(prediction.pictures, data.measured, owners, strict=True))
    fits = tuple(register(s, m, owner, count) for s, m, owner in pairs)
    value = np.full((len(maps), count, dim + 1), np.nan)
    for n, fit in enumerate(fits):
        value[n] = fit.values
    scale = np.concatenate([data.spacing, [1.0]])
    of_points = points_by_patch(data, data.points_displacement - prediction.points, patches)
    # without noise they cannot be weighed
    value = np.concatenate([value * scale, of_points if data.points_noise > 0 else np.full_like(of_points, np.nan)])
    measured, spread = data.response
    response = np.where(spread > 0, measured - prediction.response, np.nan)
    vector = flat(value, response)
    kept = np.isfinite(vector)
    covariance = np.zeros((len(vector), len(vector)))
    noise, floor = noise_of(data, maps, fits, owners, scale, seed)
    covariance[: len(noise), : len(noise)] = noise
    _add_points_noise(covariance, data, patches)
    last = np.arange(len(vector) - len(response), len(vector))
    shared = data.response_gain * np.nan_to_num(measured)
    covariance[np.ix_(last, last)] = np.diag(spread**2) + np.outer(shared, shared)
    error = [float(np.sqrt(np.mean((s - m)[o >= 0] ** 2))) for s, m, o in pairs]
    places = _places(frame, maps, owners, count) if dim == 3 and len(maps) else ()
    return Residual(value, response, covariance[np.ix_(kept, kept)], kept, np.array(error), floor, fits, *places)


def _places(
    frame: Picture, maps: list[BackwardMap], owners: list[np.ndarray], count: int
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
