"""Points inside elements, over which means are taken."""

from __future__ import annotations

import numpy as np

from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Mesh


def points_inside(mesh: Mesh) -> list[np.ndarray]:
    """Points of each element that its mean of a field is taken over: a quarter and three quarters out to its corners.

    Along each side of a quadrilateral or brick they lie as evenly as the midpoints of four equal parts.
    """
    found: list[np.ndarray] = []
    for block in mesh.blocks:
        corner = mesh.points[block.nodes[:, : ELEMENTS[block.element].corners]]
        centre = corner.mean(axis=1, keepdims=True)
        found += list(np.concatenate([centre + share * (corner - centre) for share in (0.25, 0.75)], axis=1))
    return found


def sizes(mesh: Mesh) -> np.ndarray:
    """Area or volume of each element by its corners, shape (elements,)."""
    return np.concatenate([size_of(mesh.points[b.nodes[:, : ELEMENTS[b.element].corners]]) for b in mesh.blocks])


def size_of(corner: np.ndarray) -> np.ndarray:
    """The same of corners, shape (elements, corners, dim); areas are below 0 where corners lie clockwise."""
    if corner.shape[2] == 2:
        x, y = np.moveaxis(corner, 2, 0)
        return (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2
    cut = TETRAHEDRA if corner.shape[1] == 8 else ((0, 1, 2, 3),)
    edges = [corner[:, list(one[1:])] - corner[:, [one[0]]] for one in cut]
    return np.abs(sum(np.linalg.det(edge) for edge in edges)) / 6


TETRAHEDRA = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
"""Of a brick, by its corners."""
