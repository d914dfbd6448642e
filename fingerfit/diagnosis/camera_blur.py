"""The blur of a camera, found in what a fitted model leaves of its pictures.

The picture before compression carries its blur along when it is warped. What that makes wrong is proportional to the
variance of the blur (`fingerfit.imaging.blur`), so that the variance follows by linear least squares from what is left
once patches are registered, whatever the model has moved wrongly.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fingerfit.forward.patches import Patches, owners_of
from fingerfit.forward.predict import Synthesis
from fingerfit.imaging.blur import blurred_in_place
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.registration import Registration, register
from fingerfit.imaging.warp import BackwardMap, sample, spline_coefficients, warp
from fingerfit.study.data import Data

SURELY = 3.0
"""Standard errors from which on there is a blur."""
OF_PIXEL = 1.0 / 12.0
"""Variance of a pixel's own extent, pixels squared: pictures that are means over pixels have it without optics."""
_TOLD = 2.0
"""Times that variance from which on a blur is told: to first order it is found to a fifth or so. A choice."""
_DRAWS = 4
"""Of the noise, of which only two sums over all pixels are needed; a choice."""


@dataclass(frozen=True)
class CameraBlur:
    """What pictures tell of their blur.

    Parameters
    ----------
    variance, error : float
        Of the blur, and its standard error from patch to patch, mm^2.
    pixel : float
        Smallest side of a pixel, mm.
    """

    variance: float
    error: float
    pixel: float

    @property
    def sure(self) -> bool:
        """Whether there surely is one."""
        return self.variance > SURELY * self.error

    @property
    def by_optics(self) -> bool:
        """Whether it surely is larger than that of a mean over each pixel."""
        return self.variance - SURELY * self.error > _TOLD * OF_PIXEL * self.pixel**2

    @property
    def size(self) -> float:
        """Standard deviation, mm; 0 where there surely is none."""
        return float(np.sqrt(self.variance)) if self.sure else 0.0

    def __str__(self) -> str:
        return f"{self.size / self.pixel:.2f} pixels ({self.size:.2g} mm)"


def camera_blur(
    data: Data, made: Synthesis, patches: Patches, steps: np.ndarray | None = None, seed: int = 1
) -> CameraBlur:
    """Estimate the blur of pictures in the plane.

    Parameters
    ----------
    data : Data
    made : Synthesis
        Of the fitted model, without any blur.
    patches : Patches
    steps : ndarray of int, optional
        Indices of the steps whose pictures tell, as those that the fit used; all when left out.
    seed : int
        Of the noise whose part in the estimate is taken off: the second derivatives of a picture go with its noise.

    Returns
    -------
    CameraBlur
        Without pictures a variance of 0.
    """
    frame = Picture.before(data)
    count, rng = len(patches.centre), np.random.default_rng(seed)
    along, square = np.zeros(count), np.zeros(count)
    told = np.ones(len(data.picture_step), dtype=bool) if steps is None else np.isin(data.picture_step, steps)
    for n in np.flatnonzero(told):
        way, synthesized, measured = made.maps[n], made.prediction.pictures[n], data.measured[n]
        fit = register(synthesized, measured, owners_of(data, frame, way, patches), count)
        left = _moved_back(measured, fit) - synthesized
        for share, difference, picture in [(1.0, left, synthesized), *_noise(data, way, rng)]:
            changed, rest = (_beyond(fit, one) for one in (_per_variance(data, way, picture), difference))
            along += share * np.bincount(fit.patch, changed * rest, minlength=count)
            square += share * np.bincount(fit.patch, changed**2, minlength=count)
    pixel = float(data.spacing.min())
    if not square.sum() > 0:
        return CameraBlur(0.0, 0.0, pixel)
    variance = along.sum() / square.sum()
    error = np.sqrt(((along - variance * square) ** 2).sum()) / square.sum()
    return CameraBlur(float(variance), float(error), pixel)


def _noise(data: Data, way: BackwardMap, rng: np.random.Generator) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Draws of the noise that a difference and a synthesized picture have, and by which share they are taken off."""
    size = data.before.shape
    for _ in range(_DRAWS):
        carried = warp(spline_coefficients(rng.normal(0.0, data.picture_noise, size)), 0.0, way, data.smooth)
        own = smooth(rng.normal(0.0, data.picture_noise, size), data.smooth)
        yield -1.0 / _DRAWS, own - carried, carried


def _per_variance(data: Data, way: BackwardMap, picture: np.ndarray) -> np.ndarray:
    """What a blur of the camera changes of a warped picture, per variance in mm^2."""
    return blurred_in_place(picture, way, 1.0 / data.spacing) - picture


def _moved_back(measured: np.ndarray, fit: Registration) -> np.ndarray:
    """A measured picture, moved back patch by patch by what was registered."""
    index = np.indices(measured.shape)[::-1].reshape(measured.ndim, -1).T.astype(float)
    index[fit.pixel] += np.nan_to_num(fit.values[:, :-1])[fit.patch]
    return sample(spline_coefficients(measured), index).reshape(measured.shape)


def _beyond(fit: Registration, difference: np.ndarray) -> np.ndarray:
    """A difference but for what displacements and brightness of the patches explain, shape (pixels,).

    Of patches that could not be registered nothing.
    """
    found = fit.solve(difference)[fit.patch]
    left = difference.ravel()[fit.pixel] - (fit.design * found).sum(axis=1)
    return np.nan_to_num(left)
