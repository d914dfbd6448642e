"""How little pixels of partial volume at a body's outline tell of it (docs/decisions/0044-partial-volumes.md).

A pixel that the outline crosses shows a part of the body and a part of what is beyond. Where the outline lies within it
is known from its intensity alone, and that only as well as the camera's or scanner's pixels are true means; no spline
follows such an edge to another place in the grid. The error is alike along a whole side, and the contrast there is many
times the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.similarity import share_alone
from fingerfit.imaging.warp import BackwardMap
from fingerfit.study.data import Data

REACH = 1.5
"""Standard deviation of the Gaussian that tells pixels near the outline, in those of the smoothing, which is a pixel at
least: they lie up to 3 of these from it, as far as a spline and the smoothing carry an edge."""
UNKNOWN = 1.0
"""Pixels by which the place of an edge in a pixel is unknown, as an error of each pixel by itself. A tenth of a pixel
that is alike in the hundred pixels of a side counts as much."""
_WITHIN = 0.48
"""Difference from one half, which it is on the outline, up to which the smoothed body is near it."""
_LITTLE = 0.01
"""Share of the noise's variance below which this error is left out."""


@dataclass(frozen=True)
class PartialVolume:
    """The pixels of all pictures whose values are less sure than their noise says.

    Parameters
    ----------
    pixel : ndarray of int, shape (pixels,)
        Flat indices in the pictures of all steps together, rising.
    weight : ndarray, shape (pixels,)
        Share that each counts, of what noise alone would make it count: above 0 and below 1.
    """

    pixel: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, pictures: np.ndarray, maps: list[BackwardMap], data: Data) -> PartialVolume:
        """Those of synthesized pictures, shape (pictures, [nz,] ny, nx), whose noise is known."""
        found = [
            _near_outline(picture, way, max(data.smooth, 1.0) * REACH, data.picture_noise)
            for picture, way in zip(pictures, maps, strict=True)
        ]
        pixel = [place + number * pictures[0].size for number, (place, _) in enumerate(found)]
        # every guess keeps its own: half the memory
        short = np.int32 if pictures.size <= np.iinfo(np.int32).max else np.int64
        return cls(
            np.concatenate([np.zeros(0, int), *pixel]).astype(short),
            np.concatenate([np.zeros(0), *(own for _, own in found)]).astype(np.float32),
        )

    def read(self, pictures: np.ndarray) -> np.ndarray:
        """Values of these pixels, shape (pixels,)."""
        return pictures.reshape(-1)[self.pixel].astype(float)

    def missing(self, one: np.ndarray, other: np.ndarray) -> Any:
        """By how much sums of products are less than without the weights, of shapes ([many,] pixels[, many])."""
        return (one * (1.0 - self.weight)) @ other

    def lacks(self, own: np.ndarray, data: Data) -> float:
        """By how much the sum of squares of a difference, shape (pixels,), is less than without the weights.

        What noise gives on average is put back, so that a guess gains nothing by more of such pixels.
        """
        alone = share_alone(data.smooth, data.measured.ndim - 1)
        return float(self.missing(own, own) - 2.0 * data.picture_noise**2 * alone * np.sum(1.0 - self.weight))

    def sure(self, shape: tuple[int, ...]) -> np.ndarray:
        """Share of a difference that counts at each pixel of pictures of a shape: roots of the weights, else 1."""
        share = np.ones(shape, dtype=np.float32)
        share.reshape(-1)[self.pixel] = np.sqrt(self.weight)
        return share

    def noise(self, noise: float, rng: np.random.Generator) -> np.ndarray:
        """A draw of what makes them count less, beside a noise of both pictures, shape (pixels,)."""
        return np.asarray(rng.normal(size=len(self.pixel)) * noise * np.sqrt(2.0 / self.weight - 2.0))

    def cut(self, shape: tuple[int, ...], window: tuple[slice, ...]) -> PartialVolume:
        """Those in a window of each picture, where pictures of all steps have a shape."""
        number, *place = np.unravel_index(self.pixel, shape)
        inside = np.all([(at >= own.start) & (at < own.stop) for at, own in zip(place, window, strict=True)], axis=0)
        moved = [at[inside] - own.start for at, own in zip(place, window, strict=True)]
        new = (shape[0], *(own.stop - own.start for own in window))
        return PartialVolume(np.ravel_multi_index((number[inside], *moved), new), self.weight[inside])


def _near_outline(picture: np.ndarray, way: BackwardMap, sigma: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of such pixels of a picture, and what they count."""
    if not len(way.pixel):
        return np.zeros(0, int), np.zeros(0)
    window = way.window(2 * reach_of(sigma))
    body = np.zeros(way.shape, dtype=np.float32)
    body.ravel()[way.pixel[~way.beside]] = 1.0
    near = np.abs(smooth(body[window], sigma) - 0.5) < _WITHIN
    steep: np.ndarray = sum(np.square(slope) for slope in np.gradient(picture[window]))
    # as far as a spline carries an edge, whose line is about a pixel wide
    steep = smooth(steep, sigma) * np.sqrt(2 * np.pi) * sigma
    unsure = steep * UNKNOWN**2 / (2.0 * noise**2)
    chosen = np.nonzero(near & (unsure > _LITTLE))
    whole = tuple(at + own.start for at, own in zip(chosen, window, strict=True))
    return np.ravel_multi_index(whole, way.shape), 1.0 / (1.0 + unsure[chosen])
