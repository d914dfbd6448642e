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

    def holds(self, points: np.ndarray, normal: np.ndarray, reach: float) -> np.ndarray:
        """Whether the volume holds lines along normals to both sides of points, shape (points,)."""
        last = np.array(self.picture.values.shape[::-1]) - 1
        ends = [self.picture.to_index(points + way * normal) for way in (-reach, reach)]
        return np.all([((index >= 0) & (index <= last)).all(axis=1) for index in ends], axis=0)

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


def find_border(
    subject: Profiles, points: np.ndarray, outward: np.ndarray, near: Any, reach: float = 1.0
) -> tuple[np.ndarray, float]:
    """How far the border of a body within another tissue is outside of given points, mm, and how clear it is.

    Parameters
    ----------
    subject : Profiles
    points, outward : ndarray, shape (points, 3)
        On the supposed border, mm, and unit normals out of the body.
    near : sparse matrix, shape (points, points)
        Weights by which profiles of neighbours are averaged; rows sum to 1.
    reach : float
        How far profiles go to both sides, mm; the border is looked for within 0.8 of it.

    Returns
    -------
    depth : ndarray, shape (points,)
    contrast : float
        Between both sides, in standard deviations of what the profiles differ from each other.
    """
    way = np.arange(-reach, reach * (1 + STEP / 2), STEP * reach)
    values = subject.along(points, outward, way)
    profiles = near @ values
    inside, outside = (float(np.median(profiles[:, part])) for part in (way < -0.7 * reach, way > 0.7 * reach))
    depths = np.arange(-0.8, 0.8001, 0.02) * reach
    curves = np.array([_curve(way, d, 1e3, subject.blur, (inside, outside, outside)) for d in depths])
    found = depths[((curves**2).sum(axis=1)[None] - 2 * profiles @ curves.T).argmin(axis=1)]
    return found, abs(inside - outside) / max(1e-12, _noise(profiles, near, values))


def averages(points: np.ndarray, seen: np.ndarray, normals: np.ndarray, length: float) -> Any:
    """Weights of points for each other, from those that are seen and look the same way; rows sum to 1.

    Parameters
    ----------
    points, normals : ndarray, shape (points, 3)
    seen : ndarray of int
        Points that count.
    length : float
        Over which neighbours decide together, mm.
    """
    from scipy.sparse import csr_matrix
    from scipy.spatial import cKDTree

    tree = cKDTree(points[seen])
    pairs = cKDTree(points).sparse_distance_matrix(tree, 2 * length, output_type="coo_matrix")
    column = seen[pairs.col]
    alike = np.clip((normals[pairs.row] * normals[column]).sum(axis=1), 0, None)
    weight = np.exp(-0.5 * (2 * pairs.data / length) ** 2) * alike**2
    near = csr_matrix((weight, (pairs.row, column)), shape=(len(points), len(points)))
    # where nothing near is seen, as in the middle of the nail, the nearest one stands for it
    lonely = np.flatnonzero(np.asarray(near.sum(axis=1)).ravel() < 1e-3)
    nearest = seen[tree.query(points[lonely])[1]]
    near = near + csr_matrix((np.ones(len(lonely)), (lonely, nearest)), shape=near.shape)
    return csr_matrix(near.multiply(1 / np.asarray(near.sum(axis=1))))


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
