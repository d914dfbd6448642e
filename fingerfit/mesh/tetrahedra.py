"""Meshes of tetrahedra: faces, mid-side nodes, quality."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.mesh.faces import faces_of
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.shapes import EDGES


def corners(mesh: Mesh) -> np.ndarray:
    """Corner nodes of all elements, shape (elements, 4)."""
    return np.concatenate([block.nodes[:, :4] for block in mesh.blocks])


def outer_faces(mesh: Mesh) -> np.ndarray:
    """Faces that belong to one element only, shape (faces, 2): element, face counted from 0."""
    nodes = corners(mesh)
    four = np.stack([nodes[:, list(face)] for face in faces_of("C3D4")], axis=1)
    _, which, count = np.unique(np.sort(four.reshape(-1, 3), axis=1), axis=0, return_inverse=True, return_counts=True)
    alone = np.flatnonzero(count[which] == 1)
    return np.stack([alone // 4, alone % 4], axis=1)


def faces_on(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    """Corner nodes of faces (element, face), anticlockwise from outside, shape (faces, 3)."""
    nodes = corners(mesh)
    local = np.array(faces_of("C3D4"))
    found = nodes[faces[:, 0][:, None], local[faces[:, 1]]]
    inner = mesh.points[nodes[faces[:, 0]]].mean(axis=1)
    a, b, c = (mesh.points[found[:, n]] for n in range(3))
    inward = (np.cross(b - a, c - a) * (a - inner)).sum(axis=1) < 0
    found[inward] = found[inward][:, [0, 2, 1]]
    return found


def nodes_on(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    """Nodes of faces (element, face), those in the middle of sides too, in order."""
    if mesh.blocks[0].nodes.shape[1] == 4:
        return np.unique(faces_on(mesh, faces))
    nodes = np.concatenate([block.nodes for block in mesh.blocks])
    return np.unique(nodes[faces[:, 0][:, None], np.array(faces_of("C3D10"))[faces[:, 1]]])


def resting(mesh: Mesh, nodes: np.ndarray, at: Sequence[float], radius: float) -> float:
    """Height z of the centre of a sphere above `at` (x, y) that touches nodes from above, mm.

    Raises
    ------
    InputError
        When no node is below it.
    """
    aside = np.hypot(*(mesh.points[nodes, :2] - np.asarray(at)).T)
    below = aside < radius
    if not below.any():
        raise InputError("finger", "indenter", f"x, y = {at[0]:g}, {at[1]:g} mm", "a place above the skin")
    return float((mesh.points[nodes[below], 2] + np.sqrt(radius**2 - aside[below] ** 2)).max())


def to_quadratic(mesh: Mesh) -> Mesh:
    """C3D4 to C3D10 with straight edges; a mid-side node is in a set where both its neighbours are."""
    nodes = corners(mesh)
    pairs = np.sort(nodes[:, [list(edge) for edge in EDGES[3]]], axis=2)
    unique, at = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(mesh.points) + at.reshape(-1, 6)
    sets = {}
    for name, members in mesh.node_sets.items():
        inside = np.isin(unique, members).all(axis=1)
        sets[name] = np.concatenate([members, len(mesh.points) + np.flatnonzero(inside)])
    points = np.vstack([mesh.points, mesh.points[unique].mean(axis=1)])
    first, blocks = 0, []
    for block in mesh.blocks:
        last = first + len(block.nodes)
        name = block.element.replace("C3D4", "C3D10")
        blocks.append(Block(name, np.hstack([block.nodes, middle[first:last]])))
        first = last
    return Mesh(points, tuple(blocks), sets, mesh.element_sets, mesh.surfaces)


@dataclass(frozen=True)
class Quality:
    """Shape of tetrahedra, by their corners.

    Parameters
    ----------
    nodes, elements, inverted : int
        Numbers of; inverted ones have no positive volume.
    dihedral : tuple of float
        Smallest, its first percentile, the largest one's 99th percentile, largest angle between two faces, degrees.
    ratio : tuple of float
        Smallest, first percentile, median of `radius_ratio`.
    volume : mapping of str to float
        Of the element sets, mm^3.
    """

    nodes: int
    elements: int
    inverted: int
    dihedral: tuple[float, float, float, float]
    ratio: tuple[float, float, float]
    volume: Mapping[str, float]

    def __str__(self) -> str:
        low, few, many, high = self.dihedral
        return (
            f"{self.elements} tetrahedra, {self.nodes} nodes, {self.inverted} inverted; dihedral angles"
            f" {low:.1f} to {high:.1f} degrees (1 % below {few:.1f}, 1 % above {many:.1f}); radius ratio"
            f" {self.ratio[0]:.3f}, 1 % below {self.ratio[1]:.3f}, median {self.ratio[2]:.3f}"
        )


def volumes(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Signed volumes of tetrahedra, mm^3.

    >>> volumes(np.eye(4)[:, 1:], np.array([[0, 1, 2, 3]])).tolist()
    [0.16666666666666666]
    """
    return np.linalg.det(points[nodes[:, 1:4]] - points[nodes[:, :1]]) / 6


def oriented(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Tetrahedra with positive volume, shape (elements, 4): those that are inside out are turned."""
    turned = volumes(points, nodes) < 0
    nodes = nodes.copy()
    nodes[turned] = nodes[turned][:, [0, 2, 1, 3]]
    return nodes


def radius_ratio(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Three times the inscribed over the circumscribed radius, shape (elements,): 1 is regular, 0 flat or inverted."""
    p = points[nodes[:, :4]]
    a, b, c = (p[:, n] - p[:, 0] for n in (1, 2, 3))
    volume = (np.cross(a, b) * c).sum(axis=1) / 6
    area = np.zeros(len(p))
    for i, j, k in faces_of("C3D4"):
        area += np.linalg.norm(np.cross(p[:, j] - p[:, i], p[:, k] - p[:, i]), axis=1) / 2
    lengths = [np.linalg.norm(x, axis=1) for x in (a, b, c, b - c, a - c, a - b)]
    # the products of opposite edges are the sides of a triangle whose area gives the circumscribed radius
    u, v, w = (lengths[n] * lengths[n + 3] for n in range(3))
    product = np.clip((u + v + w) * (-u + v + w) * (u - v + w) * (u + v - w), 0, None)
    with np.errstate(divide="ignore", invalid="ignore"):
        circum = np.sqrt(product) / 24 / np.abs(volume)
        ratio = 9 * volume / area / circum
    return np.where(volume > 0, np.nan_to_num(ratio), 0.0)


def dihedral_angles(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Angles between the faces at the six edges, degrees, shape (elements, 6)."""
    p = points[nodes[:, :4]]
    found = []
    for i, j in EDGES[3]:
        k, m = sorted({0, 1, 2, 3} - {i, j})
        axis = p[:, j] - p[:, i]
        axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        one, other = ((p[:, n] - p[:, i]) for n in (k, m))
        one, other = (v - (v * axis).sum(axis=1, keepdims=True) * axis for v in (one, other))
        cosine = (one * other).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
        found.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(found, axis=1)


def quality(mesh: Mesh) -> Quality:
    """Shape of all tetrahedra of a mesh."""
    nodes = corners(mesh)
    angles, ratio, volume = (
        dihedral_angles(mesh.points, nodes),
        radius_ratio(mesh.points, nodes),
        volumes(mesh.points, nodes),
    )
    low, high = angles.min(axis=1), angles.max(axis=1)
    return Quality(
        len(mesh.points),
        len(nodes),
        int((volume <= 0).sum()),
        (float(low.min()), float(np.percentile(low, 1)), float(np.percentile(high, 99)), float(high.max())),
        (float(ratio.min()), float(np.percentile(ratio, 1)), float(np.median(ratio))),
        {name: float(volume[members].sum()) for name, members in mesh.element_sets.items()},
    )
