"""Points inside elements, over which means are taken."""

from __future__ import annotations

import numpy as np

from fingerfit.mesh.elements import ELEMENTS, rule, shape
from fingerfit.mesh.mesh import Block, Mesh


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
    """Area or volume of each element, with its curved sides, shape (elements,)."""
    return np.concatenate([portions(mesh.points, block).sum(axis=1) for block in mesh.blocks])


def portions(points: np.ndarray, block: Block) -> np.ndarray:
    """Area or volume that each integration point of elements stands for, shape (elements, points).

    It is not above 0 where an element is inside out.
    """
    xi, weights = rule(block.element)
    jacobian = np.einsum("eni,gnj->egij", points[block.nodes], shape(block.element, xi)[1])
    return np.asarray(np.linalg.det(jacobian) * weights)


def size_of(corner: np.ndarray) -> np.ndarray:
    """Areas of polygons with corners of shape (polygons, corners, 2): below 0 where they lie clockwise."""
    x, y = np.moveaxis(corner, 2, 0)
    return np.asarray((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2)
