"""Tetrahedra with nodes in the middle of edges: where these are, and bent edges that leave elements sound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.shapes import EDGES, simplex
from fingerfit.mesh.tetrahedra import volumes

_LEAST = 0.2
"""Smallest Jacobian of a curved element, relative to that of the one with straight edges."""
_TURNS = 12
BENT = 0.2
"""Farthest that the middle of an edge is set beside the straight one, in lengths of the edge: an arc of 87 degrees."""


def middles(nodes: np.ndarray) -> dict[tuple[int, int], int]:
    """Node in the middle of each edge of C3D10, shape (elements, 10), by the corners it lies between, sorted."""
    return {
        (a, b): node
        for number, edge in enumerate(EDGES[3], 4)
        for (a, b), node in zip(np.sort(nodes[:, list(edge)], axis=1).tolist(), nodes[:, number].tolist(), strict=True)
    }


def with_straight_edges(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Points with those in the middle of the edges of C3D10, shape (elements, 10), between their corners.

    Those of C3D4, shape (elements, 4), stay as they are.
    """
    straight = points.copy()
    for number, edge in enumerate(EDGES[3][: nodes.shape[1] - 4], 4):
        straight[nodes[:, number]] = points[nodes[:, list(edge)]].mean(axis=1)
    return straight


def clipped(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Points of which those in the middle of edges of C3D10, shape (elements, 10), are not too far beside it."""
    straight = with_straight_edges(points, nodes)
    edge = np.full(len(points), np.inf)
    for number, (a, b) in enumerate(EDGES[3][: nodes.shape[1] - 4], 4):
        edge[nodes[:, number]] = np.linalg.norm(points[nodes[:, a]] - points[nodes[:, b]], axis=1)
    far = np.linalg.norm(points - straight, axis=1)
    return np.asarray(straight + (points - straight) * np.minimum(1, BENT * edge / np.maximum(far, 1e-300))[:, None])


def ease(mesh: Mesh) -> tuple[Mesh, int]:
    """Curved edges made straighter where an element would be turned inside out at one of its nodes.

    Returns
    -------
    mesh : Mesh
        Its straight-sided elements must not be inverted; now none is anywhere.
    count : int
        Nodes in the middle of edges that were moved.
    """
    nodes = np.concatenate([block.nodes for block in mesh.blocks])
    if nodes.shape[1] == 4:
        return mesh, 0
    straight = with_straight_edges(mesh.points, nodes)
    corner = np.vstack([np.zeros(3), np.eye(3)])
    _, slopes = simplex(np.vstack([corner, corner[np.array(EDGES[3])].mean(axis=1)]), True)
    whole = volumes(mesh.points, nodes[:, :4])
    share = np.ones(len(mesh.points))
    for turn in range(_TURNS + 1):
        points = straight + share[:, None] * (mesh.points - straight)
        sides = np.einsum("qnd,enk->eqkd", slopes, points[nodes])
        bad = (np.linalg.det(sides) < _LEAST * 6 * whole[:, None]).any(axis=1)
        if not bad.any():
            break
        share[nodes[bad, 4:]] *= 0.6 if turn < _TURNS - 1 else 0.0
    return replace(mesh, points=points), int((share < 1).sum())
