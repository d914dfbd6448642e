"""Rigid surfaces as patches of bricks, for solvers without analytical ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def ball(centre: Sequence[float], radius: float, count: int, first: int) -> dict[str, list]:
    """A cap of 150 degrees around the lowest point of a sphere.

    Parameters
    ----------
    centre : (float, float, float)
        mm.
    radius : float
        mm.
    count : int
        Bricks along each side.
    first : int
        Number of its first node, and of its first brick.

    Returns
    -------
    dict
        ``nodes`` (number, x, y, z), ``elements`` (number, eight nodes); faces S1 are those that touch.
    """
    angle = np.linspace(-1, 1, count + 1) * np.deg2rad(75)
    a, b = np.meshgrid(angle, angle, indexing="ij")
    # the way from the lowest point has the length of an arc: even squares to the rim
    arc = np.hypot(a, b)
    scale = np.divide(np.sin(arc), arc, out=np.ones_like(arc), where=arc > 0)
    way = np.stack([a * scale, b * scale, -np.cos(arc)], axis=-1)
    return _bricks(np.asarray(centre) + radius * way, np.asarray(centre) + 0.8 * radius * way, first)


def half_tube(axis: Sequence[float], radius: float, length: float, count: int, first: int) -> dict[str, list]:
    """The lower half of a tube along x, seen from within.

    Parameters
    ----------
    axis : (float, float, float)
        Its middle, mm.
    radius, length : float
        mm.
    count : int
        Bricks around.
    first : int
        Number of its first node, and of its first brick.
    """
    angle = np.linspace(-1, 1, count + 1) * np.deg2rad(85)
    x, turn = np.meshgrid(np.array([-0.5, 0.5]) * length, angle, indexing="ij")
    inner, outer = (
        np.asarray(axis) + np.stack([x, r * np.sin(turn), -r * np.cos(turn)], axis=-1) for r in (radius, 1.1 * radius)
    )
    return _bricks(inner, outer, first)


def _bricks(surface: np.ndarray, back: np.ndarray, first: int) -> dict[str, list]:
    rows, columns = surface.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = np.concatenate([surface.reshape(-1, 3), back.reshape(-1, 3)])
    bricks = np.hstack([quads, quads + rows * columns])
    corner = points[bricks[0]]
    if np.linalg.det(corner[[1, 3, 4]] - corner[0]) < 0:
        bricks = bricks[:, [0, 3, 2, 1, 4, 7, 6, 5]]
    return {
        "nodes": [[number, *map(float, point)] for number, point in enumerate(points, first)],
        "elements": [[number, *(first + int(node) for node in row)] for number, row in enumerate(bricks, first)],
    }
