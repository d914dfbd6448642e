"""Rigid surfaces as patches of bricks, for solvers without analytical ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np


def ball(
    centre: Sequence[float], radius: float, count: int, nodes: Iterator[int], elements: Iterator[int]
) -> dict[str, list]:
    """A cap of 150 degrees around the lowest point of a sphere.

    Parameters
    ----------
    centre : (float, float, float)
        mm.
    radius : float
        mm.
    count : int
        Bricks along each side.
    nodes, elements : iterator of int
        Numbers for them, those of the mesh left out.

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
    return _bricks(np.asarray(centre) + radius * way, np.asarray(centre) + 0.8 * radius * way, nodes, elements)


def half_tube(
    axis: Sequence[float], radius: float, length: float, count: int, nodes: Iterator[int], elements: Iterator[int]
) -> dict[str, list]:
    """The lower half of a tube along x, seen from within.

    Parameters
    ----------
    axis : (float, float, float)
        Its middle, mm.
    radius, length : float
        mm.
    count : int
        Bricks around.
    nodes, elements : iterator of int
        Numbers for them, those of the mesh left out.
    """
    angle = np.linspace(-1, 1, count + 1) * np.deg2rad(85)
    x, turn = np.meshgrid(np.array([-0.5, 0.5]) * length, angle, indexing="ij")
    inner, outer = (
        np.asarray(axis) + np.stack([x, r * np.sin(turn), -r * np.cos(turn)], axis=-1) for r in (radius, 1.1 * radius)
    )
    return _bricks(inner, outer, nodes, elements)


def _bricks(surface: np.ndarray, back: np.ndarray, nodes: Iterator[int], elements: Iterator[int]) -> dict[str, list]:
    rows, columns = surface.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = np.concatenate([surface.reshape(-1, 3), back.reshape(-1, 3)])
    bricks = np.hstack([quads, quads + rows * columns])
    corner = points[bricks[0]]
    if np.linalg.det(corner[[1, 3, 4]] - corner[0]) < 0:
        bricks = bricks[:, [0, 3, 2, 1, 4, 7, 6, 5]]
    numbers = [next(nodes) for _ in points]
    return {
        "nodes": [[number, *map(float, point)] for number, point in zip(numbers, points, strict=True)],
        "elements": [[next(elements), *(numbers[node] for node in row)] for row in bricks],
    }
