"""Where the borders of the skin are in a volume: along its normals, to a fraction of a voxel.

A registration moves together what is near: a layer that is thicker by 0.1 mm is less than its splines can tell. So the
profile along each normal is compared with those of a layer between two tissues, of all depths and thicknesses, as the
voxels blur them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import sample, spline_coefficients

REACH = (-1.2, 2.4)
"""How far profiles go, outward and inward, mm."""
STEP = 0.06
DEPTHS = np.arange(-0.6, 0.6001, 0.03)
"""Of the skin's surface under the given points, mm."""
THICKNESS = np.arange(0.5, 1.6001, 0.04)
"""Of the layer, relative to the given one."""
CLEAR = 3.0
"""Difference between layer and tissue, in standard deviations of the profiles, from which the thickness is told."""


@dataclass(frozen=True)
class Layers:
    """What profiles tell.

    Parameters
    ----------
    depth : ndarray, shape (points,)
        Of the surface under the given points, mm; inward is positive.
    thickness : ndarray, shape (points,)
        Of the layer, mm.
    contrast : float
        Between layer and tissue, in standard deviations of what the profiles differ from their model.
    """

    depth: np.ndarray
    thickness: np.ndarray
    contrast: float


class Profiles:
    """Intensities of a volume along lines; its splines are made once.

    Parameters
    ----------
    picture : Picture
        A volume, dark outside of the body.
    """

    def __init__(self, picture: Picture) -> None:
        self.picture = picture
        self._coefficients = spline_coefficients(picture.values.astype(float))
        self._usual = np.median(picture.values)

    def along(self, points: np.ndarray, normal: np.ndarray, way: np.ndarray) -> np.ndarray:
        """At distances `way`, mm, along normals, shape (points, places); beyond the volume that of most of it."""
        places = points[:, None] + way[:, None] * normal[:, None]
        index = self.picture.to_index(places.reshape(-1, 3))
        size = np.array(self.picture.values.shape[::-1])
        inside = ((index >= 0) & (index <= size - 1)).all(axis=1)
        values = sample(self._coefficients, np.clip(index, 0, size - 1))
        values[~inside] = self._usual
        return values.reshape(len(points), -1)

    @property
    def blur(self) -> float:
        """Standard deviation by which voxels blur a border, mm."""
        return 0.45 * float(self.picture.spacing.mean())


def find_layers(subject: Profiles, points: np.ndarray, inward: np.ndarray, thickness: np.ndarray, near: Any) -> Layers:
    """Surface and thickness of a layer around given points.

    Parameters
    ----------
    subject : Profiles
    points, inward : ndarray, shape (points, 3)
        On the supposed surface, mm, and unit normals into the body.
    thickness : ndarray, shape (points,)
        Supposed, mm.
    near : sparse matrix, shape (points, points)
        Weights by which profiles of neighbours are averaged; rows sum to 1.
    """
    way = np.arange(REACH[0], REACH[1] + STEP / 2, STEP)
    values = subject.along(points, inward, way)
    profiles = near @ values
    usual = float(np.median(thickness))
    outside, layer, tissue = _levels(profiles, way, usual)
    # the thickness of a layer that is not seen stays as it was
    contrast = abs(layer - tissue) / max(1e-12, float(_noise(profiles, near, values)))
    shares = THICKNESS if contrast > CLEAR else np.ones(1)
    models = [(d, s) for d in DEPTHS for s in shares]
    curves = np.array([_curve(way, d, s * usual, subject.blur, (outside, layer, tissue)) for d, s in models])
    error = (curves**2).sum(axis=1)[None] - 2 * profiles @ curves.T
    chosen = error.argmin(axis=1)
    best = np.array(models)[chosen]
    depth, share = best[:, 0], best[:, 1]
    return Layers(depth, np.where(contrast > CLEAR, share * usual, thickness), contrast)


def find_border(subject: Profiles, points: np.ndarray, outward: np.ndarray, near: Any) -> np.ndarray:
    """How far the border of a body within another tissue is outside of given points, shape (points,), mm.

    Parameters
    ----------
    subject : Profiles
    points, outward : ndarray, shape (points, 3)
        On the supposed border, mm, and unit normals out of the body.
    near : sparse matrix, shape (points, points)
        Weights by which profiles of neighbours are averaged; rows sum to 1.
    """
    way = np.arange(-1.0, 1.0 + STEP / 2, STEP)
    profiles = near @ subject.along(points, outward, way)
    inside, outside = (float(np.median(profiles[:, part])) for part in (way < -0.7, way > 0.7))
    depths = np.arange(-0.8, 0.8001, 0.02)
    curves = np.array([_curve(way, d, 1e3, subject.blur, (inside, outside, outside)) for d in depths])
    return depths[((curves**2).sum(axis=1)[None] - 2 * profiles @ curves.T).argmin(axis=1)]


def _levels(profiles: np.ndarray, way: np.ndarray, thickness: float) -> tuple[float, float, float]:
    """Intensities outside, in the layer and under it, where they are farthest from the borders."""
    outside = float(np.median(profiles[:, way < -0.8]))
    tissue = float(np.median(profiles[:, (way > 1.3 * thickness + 0.5)]))
    middle = np.abs(way - thickness / 2) < 0.1
    return outside, float(np.median(profiles[:, middle])), tissue


def _noise(profiles: np.ndarray, near: Any, values: np.ndarray) -> float:
    """Standard deviation of a profile of a neighbourhood, from the differences of single ones."""
    single = values - profiles
    mean = float(np.asarray(near.multiply(near).sum(axis=1)).mean())
    return float(np.median(np.abs(single)) * 1.4826 * np.sqrt(mean))


def _curve(way: np.ndarray, depth: float, thickness: float, blur: float, levels: tuple[float, ...]) -> np.ndarray:
    from scipy.special import erf

    rise = [(1 + erf((way - border) / (np.sqrt(2) * blur))) / 2 for border in (depth, depth + thickness)]
    return levels[0] + (levels[1] - levels[0]) * rise[0] + (levels[2] - levels[1]) * rise[1]
