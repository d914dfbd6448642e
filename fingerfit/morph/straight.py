"""A finger of quadratic tetrahedra as one of linear ones on all its nodes: each node of a surface is set on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.fem.shapes import EDGES, simplex
from fingerfit.mesh import Block, Mesh
from fingerfit.tetrahedra import corners, faces_on, oriented, outer_faces, volumes

_PIECES = np.array(
    [[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 8, 9], [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]]
)
"""Four tetrahedra at the corners and four round the line between the middles of the first and the last edge."""

_LEAST = 0.2
"""Smallest Jacobian of a curved element, relative to that of the one with straight edges."""
_TURNS = 12


def straightened(mesh: Mesh) -> Mesh:
    """Eight linear tetrahedra for each quadratic one, with the sets of the reference finger on all nodes.

    Parameters
    ----------
    mesh : Mesh
        C3D10; a mesh of linear tetrahedra is given back as it is.

    Returns
    -------
    Mesh
        The same points. EPIDERMIS_OUTER, EPIDERMIS_INNER (still in pairs), BONE_SURFACE and the surfaces SKIN and NAIL
        have the nodes in the middle of edges too.
    """
    if all(block.nodes.shape[1] == 4 for block in mesh.blocks):
        return mesh
    nodes = np.concatenate([block.nodes for block in mesh.blocks])
    pieces = oriented(mesh.points, nodes[:, _PIECES].reshape(-1, 4))
    middle = {
        pair: node
        for number, (a, b) in enumerate(EDGES[3], 4)
        for pair, node in zip(map(tuple, np.sort(nodes[:, [a, b]], axis=1).tolist()), nodes[:, number], strict=True)
    }
    pair = dict(zip(*_pairs(mesh), strict=True))
    skin = faces_on(mesh, mesh.surfaces["SKIN"])
    outer = [edge for edge in _edges(skin) if edge[0] in pair and edge[1] in pair]
    inner = [tuple(sorted((pair[a], pair[b]))) for a, b in outer]
    border = _edges(bone_faces(mesh))
    sets = {
        **mesh.node_sets,
        "EPIDERMIS_OUTER": np.array([*pair, *(middle[edge] for edge in outer)]),
        "EPIDERMIS_INNER": np.array([*pair.values(), *(middle[edge] for edge in inner)]),
        "BONE_SURFACE": np.union1d(
            np.intersect1d(mesh.node_sets["BONE_SURFACE"], corners(mesh)), [middle[edge] for edge in border]
        ),
    }
    elements = {
        name: (members[:, None] * len(_PIECES) + np.arange(len(_PIECES))).ravel()
        for name, members in mesh.element_sets.items()
    }
    fine = Mesh(mesh.points, (Block("C3D4", pieces),), sets, elements)
    outside = outer_faces(fine)
    on = faces_on(fine, outside)
    surfaces = {}
    for name in ("SKIN", "NAIL"):
        three = faces_on(mesh, mesh.surfaces[name])
        members = np.union1d(three, [middle[edge] for edge in _edges(three)])
        end = np.isin(on, mesh.node_sets["END"]).all(axis=1)
        surfaces[name] = outside[np.isin(on, members).all(axis=1) & ~end]
    return Mesh(mesh.points, fine.blocks, sets, elements, surfaces)


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
    straight = mesh.points.copy()
    for number, edge in enumerate(EDGES[3], 4):
        straight[nodes[:, number]] = mesh.points[nodes[:, list(edge)]].mean(axis=1)
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


def bone_faces(mesh: Mesh) -> np.ndarray:
    """Corners of the outer triangles of the bones between nodes of BONE_SURFACE, seen from the tissue."""
    bone = Mesh(mesh.points, (Block("C3D4", corners(mesh)[mesh.element_sets["BONE"]]),))
    faces = faces_on(bone, outer_faces(bone))
    return faces[np.isin(faces, mesh.node_sets["BONE_SURFACE"]).all(axis=1)]


def _pairs(mesh: Mesh) -> tuple[list[int], list[int]]:
    """Corner nodes of the skin and those under them."""
    corner = np.unique(corners(mesh))
    outer, inner = (mesh.node_sets[name] for name in ("EPIDERMIS_OUTER", "EPIDERMIS_INNER"))
    return outer[np.isin(outer, corner)].tolist(), inner[np.isin(inner, corner)].tolist()


def _edges(triangles: np.ndarray) -> list[tuple[int, int]]:
    found = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return [(int(a), int(b)) for a, b in found]
