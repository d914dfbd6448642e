"""Faces of elements and integration over them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from fingerfit.mesh.elements import ELEMENTS, rule, shape
from fingerfit.mesh.shapes import EDGES, QUAD, linear, serendipity, simplex

_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_QUADRILATERAL = ((0, 1), (1, 2), (2, 3), (3, 0))
_TETRAHEDRON = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_BRICK = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
_BRICK_EDGES = (*[(i, (i + 1) % 4) for i in range(4)], *[(4 + i, 4 + (i + 1) % 4) for i in range(4)],
                *[(i, i + 4) for i in range(4)])  # fmt: skip


@cache
def faces_of(element: str) -> tuple[tuple[int, ...], ...]:
    """Local nodes of the faces S1, S2, ... of an element type: corners in turn, then mid-side nodes."""
    kind = ELEMENTS[element]
    if kind.dim == 2:
        corners: tuple = _TRIANGLE if kind.is_simplex else _QUADRILATERAL
        edges = EDGES[2] if kind.is_simplex else _QUADRILATERAL
    else:
        corners = _TETRAHEDRON if kind.is_simplex else _BRICK
        edges = EDGES[3] if kind.is_simplex else _BRICK_EDGES
    if kind.nodes == kind.corners:
        return corners
    middle = {frozenset(edge): kind.corners + number for number, edge in enumerate(edges)}
    found = []
    for face in corners:
        around = [(face[0], face[1])] if kind.dim == 2 else list(zip(face, (*face[1:], face[0]), strict=True))
        found.append((*face, *(middle[frozenset(edge)] for edge in around)))
    return tuple(found)


@dataclass(frozen=True)
class Faces:
    """Faces with the same number of nodes.

    Parameters
    ----------
    nodes : ndarray, shape (faces, nodes)
        Zero-based nodes.
    outward : ndarray, shape (faces,)
        1 where the order of the nodes makes the normal point outward, else -1.
    thickness : ndarray, shape (faces,)
        mm; 0 stands for axisymmetric.
    """

    nodes: np.ndarray
    outward: np.ndarray
    thickness: np.ndarray


def cell_shape(nodes: int, dim: int, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of a face with `nodes` nodes in `dim` dimensions, as `fingerfit.mesh.shapes.linear`."""
    if dim == 2:
        if nodes == 2:
            return linear(np.array([[-1.0], [1.0]]), xi)
        r = xi[:, 0]
        values = np.column_stack([r * (r - 1) / 2, r * (r + 1) / 2, 1 - r**2])
        return values, np.column_stack([r - 0.5, r + 0.5, -2 * r])[..., None]
    if nodes in (3, 6):
        return simplex(xi, nodes == 6)
    return serendipity(xi) if nodes == 8 else linear(QUAD[:4], xi)


@cache
def cell_rule(nodes: int, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights of a face: shapes (points, dim - 1) and (points,)."""
    if dim == 3 and nodes in (3, 6):
        return np.array([[1, 1], [4, 1], [1, 4]]) / 6, np.full(3, 1 / 6)
    quadratic = nodes > (2 if dim == 2 else 4)
    x, w = np.polynomial.legendre.leggauss(3 if quadratic else 2)
    if dim == 2:
        return x[:, None], w
    grid, weights = np.meshgrid(x, x, indexing="ij"), np.meshgrid(w, w, indexing="ij")
    return np.column_stack([g.ravel() for g in grid]), (weights[0] * weights[1]).ravel()


def area_vectors(slopes: np.ndarray) -> np.ndarray:
    """Normals times area per local area, shape (..., dim), from tangents of shape (..., dim, dim - 1)."""
    if slopes.shape[-2] == 2:
        t = slopes[..., 0]
        return np.stack([t[..., 1], -t[..., 0]], axis=-1)
    return np.cross(slopes[..., 0], slopes[..., 1])


def collect_faces(points: np.ndarray, chosen: list[tuple[str, np.ndarray, int, float]]) -> tuple[Faces, ...]:
    """Faces of elements, grouped by their number of nodes.

    Parameters
    ----------
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    chosen : list of (element type, nodes of the element, face from 0, thickness)
        Thickness in mm, 0 for axisymmetric ones.
    """
    dim = points.shape[1]
    groups: dict[int, list[tuple[np.ndarray, float, float]]] = {}
    for element, connectivity, face, thickness in chosen:
        nodes = connectivity[list(faces_of(element)[face])]
        corners = points[nodes[: dim if dim == 2 or len(nodes) in (3, 6) else 4]]
        slopes = np.column_stack([corners[1] - corners[0], corners[-1] - corners[0]][: dim - 1])
        outward = area_vectors(slopes) @ (corners.mean(axis=0) - points[connectivity].mean(axis=0))
        groups.setdefault(len(nodes), []).append((nodes, np.sign(outward), thickness))
    return tuple(Faces(*(np.array(part) for part in zip(*rows, strict=True))) for _, rows in sorted(groups.items()))


def depth_behind(points: np.ndarray, element: str, connectivity: np.ndarray, face: int) -> float:
    """Mean depth of an element behind one of its faces, mm: its volume over the face's area, in the plane too."""
    dim = points.shape[1]
    xi, weights = rule(element)
    jacobian = np.einsum("ni,gnj->gij", points[connectivity], shape(element, xi)[1])
    nodes = connectivity[list(faces_of(element)[face])]
    xi_face, weights_face = cell_rule(len(nodes), dim)
    slopes = np.einsum("ni,gnj->gij", points[nodes], cell_shape(len(nodes), dim, xi_face)[1])
    area = np.linalg.norm(area_vectors(slopes), axis=-1) @ weights_face
    return float(np.linalg.det(jacobian) @ weights / area)


def sample_faces(faces: tuple[Faces, ...], points: np.ndarray, at_nodes: bool) -> tuple[Any, np.ndarray]:
    """Points on faces, as weights of nodes, with their areas.

    Parameters
    ----------
    faces : tuple of Faces
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    at_nodes : bool
        The nodes with the areas around them; else the Gauss points.

    Returns
    -------
    interpolation : sparse array, shape (samples, nodes)
    areas : ndarray, shape (samples,), mm^2
    """
    from scipy.sparse import coo_matrix, vstack

    dim, parts, areas = points.shape[1], list[Any](), []
    for group in faces:
        count = group.nodes.shape[1]
        xi, weights = cell_rule(count, dim)
        values, gradients = cell_shape(count, dim, xi)
        corners = points[group.nodes]
        area = np.linalg.norm(area_vectors(np.einsum("fni,gnj->fgij", corners, gradients)), axis=-1) * weights
        if dim == 2:
            radius = corners[..., 0] @ values.T
            area = area * np.where(group.thickness[:, None] > 0, group.thickness[:, None], 2 * np.pi * radius)
        if at_nodes:
            # lumped: row sums, for 8 nodes in proportion to the diagonal (Hinton, Rock and Zienkiewicz 1976)
            share = area @ values if count != 8 else area @ values**2
            share = share / share.sum(axis=1, keepdims=True) * area.sum(axis=1, keepdims=True)
            parts.append((group.nodes.ravel(), share.ravel()))
        else:
            rows = np.repeat(np.arange(area.size), count)
            columns = np.repeat(group.nodes, len(xi), axis=0).ravel()
            shape = (area.size, len(points))
            parts.append(coo_matrix((np.tile(values.ravel(), len(corners)), (rows, columns)), shape=shape))
            areas.append(area.ravel())
    if not at_nodes:
        return vstack(parts).tocsr(), np.concatenate(areas)
    total = np.zeros(len(points))
    for nodes, share in parts:
        np.add.at(total, nodes, share)
    chosen = np.flatnonzero(total > 1e-9 * total.max())
    shape = (len(chosen), len(points))
    return coo_matrix((np.ones(len(chosen)), (np.arange(len(chosen)), chosen)), shape=shape).tocsr(), total[chosen]
