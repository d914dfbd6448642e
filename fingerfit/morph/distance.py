"""Distance of points to a triangulated surface."""

from __future__ import annotations

import numpy as np

NEAREST = 40
"""Triangles that are tried for each point: those whose centres are nearest."""


def surface_distance(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of points to the nearest of triangles of about one size.

    Parameters
    ----------
    points : ndarray, shape (points, 3)
        mm.
    corners : ndarray, shape (triangles, 3, 3)
        mm.

    Returns
    -------
    ndarray, shape (points,)
        mm.

    >>> triangle = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]]])
    >>> surface_distance(np.array([[0.5, 0.5, 3.0], [-1.0, 0.0, 0.0], [3.0, 3.0, 0.0]]), triangle).round(4).tolist()
    [3.0, 1.0, 2.8284]
    """
    from scipy.spatial import cKDTree

    count = min(NEAREST, len(corners))
    near = cKDTree(corners.mean(axis=1)).query(points, count)[1].reshape(len(points), count)
    best = np.full(len(points), np.inf)
    for column in near.T:
        best = np.minimum(best, _to_triangles(points, corners[column]))
    return best


def _to_triangles(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Each point to its own triangle."""
    a, b, c = (corners[:, n] for n in range(3))
    found = np.minimum(np.minimum(_to_edges(points, a, b), _to_edges(points, b, c)), _to_edges(points, c, a))
    normal = np.cross(b - a, c - a)
    square = np.maximum((normal**2).sum(axis=1), 1e-300)
    # barycentric coordinates of the foot in the plane
    first = (np.cross(c - b, points - b) * normal).sum(axis=1) / square
    second = (np.cross(a - c, points - c) * normal).sum(axis=1) / square
    within = (first >= 0) & (second >= 0) & (first + second <= 1)
    height = np.abs(((points - a) * normal).sum(axis=1)) / np.sqrt(square)
    return np.where(within, height, found)


def _to_edges(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    way = end - start
    share = ((points - start) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300)
    return np.linalg.norm(points - start - np.clip(share, 0, 1)[:, None] * way, axis=1)
