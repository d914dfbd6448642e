"""Displacements of some nodes spread over a mesh of tetrahedra, and elements that became bad mended."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fingerfit.core.errors import SolverError
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.shapes import EDGES
from fingerfit.mesh.tetrahedra import corners, radius_ratio

FLAT = 0.1
"""Radius ratio below which no element is brought for the sake of a border; some are worse before. A choice."""
HALVES = 12
"""Times that the way of a border is halved where it would. A choice."""
WORST = 0.02
"""Radius ratio below which an element is mended."""
ROUNDS = 80
PATIENCE = 10
"""Rounds in which nodes of surfaces stay."""


def neighbours(mesh: Mesh) -> Any:
    """Which corner nodes have a common side, with the inverse square of its length: sparse, shape (nodes, nodes)."""
    from scipy.sparse import coo_matrix

    nodes, count = corners(mesh), len(mesh.points)
    pairs = np.unique(np.sort(nodes[:, [list(edge) for edge in EDGES[3]]].reshape(-1, 2), axis=1), axis=0)
    weight = 1 / ((mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]]) ** 2).sum(axis=1)
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return coo_matrix((np.tile(weight, 2), (both[:, 0], both[:, 1])), shape=(count, count)).tocsr()


def spread(mesh: Mesh, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The smoothest field with given values at some nodes.

    Parameters
    ----------
    mesh : Mesh
        Of tetrahedra.
    known : ndarray of int, shape (given,)
        Nodes.
    values : ndarray, shape (given, components)

    Returns
    -------
    ndarray, shape (nodes, components)
        0 at nodes that no element has as a corner.
    """
    from scipy.sparse import diags
    from scipy.sparse.linalg import splu

    graph = neighbours(mesh)
    degree = np.asarray(graph.sum(axis=1)).ravel()
    laplace = (diags(degree) - graph).tocsr()
    free = np.setdiff1d(np.flatnonzero(degree > 0), known)
    field = np.zeros((len(mesh.points), values.shape[1]))
    field[known] = values
    if len(free):
        field[free] = splu(laplace[free][:, free].tocsc()).solve(-laplace[free][:, known] @ values)
    return field


def moved(mesh: Mesh, points: np.ndarray, known: np.ndarray, shift: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Points of which known ones are shifted and the others follow; less far where elements would be too flat.

    Parameters
    ----------
    mesh : Mesh
        Of tetrahedra.
    points : ndarray, shape (nodes, 3)
        Where its nodes are, mm.
    known : ndarray of int, shape (known,)
        Corner nodes.
    shift : ndarray, shape (known, 3)
        mm.
    least : ndarray, shape (elements,)
        Radius ratio that each element keeps.
    """
    if not len(known):
        return points
    nodes = corners(mesh)
    share = np.ones(len(points))
    for _ in range(HALVES):
        way = spread(replace(mesh, points=points), known, share[known, None] * shift)
        bad = radius_ratio(points + way, nodes) < least
        if not bad.any():
            return np.asarray(points + way)
        share[np.unique(nodes[bad])] /= 2
    return points


def mend(mesh: Mesh, points: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move nodes of inverted or flat elements until none is left.

    Displacements around a bad element are replaced by the means of their neighbours', by which the map becomes a
    shift there. Held nodes, those of surfaces, move only when the others do not suffice.

    Parameters
    ----------
    mesh : Mesh
        Before; none of its elements may be worse than what is mended.
    points : ndarray, shape (nodes, 3)
        After, mm.
    held : ndarray of int
        Nodes that should stay.

    Returns
    -------
    points : ndarray, shape (nodes, 3)
    moved : ndarray of int
        Nodes that were moved.

    Raises
    ------
    SolverError
        When bad elements are left.
    """
    nodes = corners(mesh)
    graph = neighbours(mesh)
    mean = graph.multiply(1 / np.maximum(np.asarray(graph.sum(axis=1)), 1e-300)).tocsr()
    least = np.minimum(WORST, 0.5 * radius_ratio(mesh.points, nodes))
    u = np.array(points, dtype=float) - mesh.points
    moved = np.zeros(len(points), dtype=bool)
    stay = np.zeros(len(points), dtype=bool)
    stay[held] = True
    for count in range(ROUNDS):
        bad = radius_ratio(mesh.points + u, nodes) <= least
        if not bad.any():
            return mesh.points + u, np.flatnonzero(moved)
        chosen = np.zeros(len(points), dtype=bool)
        chosen[nodes[bad]] = True
        for _ in range(count // 20):
            chosen = chosen | (graph @ chosen.astype(float) > 0)
        if count < PATIENCE:
            chosen &= ~stay
        u[chosen] = (u[chosen] + (mean @ u)[chosen]) / 2
        moved |= chosen
    raise SolverError(f"morphing: {int(bad.sum())} elements stay inverted or flat: is the registration right?")
