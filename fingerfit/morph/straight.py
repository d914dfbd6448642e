"""A finger of quadratic tetrahedra as one of linear ones on all its nodes: each node of a surface is set on it."""

from __future__ import annotations

import numpy as np

from fingerfit.anatomy.curved import bone_faces, bone_nodes, edges_of
from fingerfit.mesh.bent import middles, with_straight_edges
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.tetrahedra import corners, faces_on, oriented, outer_faces, radius_ratio

_CORNERS = ((0, 4, 6, 7), (1, 5, 4, 8), (2, 6, 5, 9), (3, 7, 8, 9))
_AROUND = {(4, 9): (5, 6, 7, 8), (5, 7): (4, 6, 9, 8), (6, 8): (4, 5, 9, 7)}
"""Nodes around each of the three lines between the middles of opposite edges."""
_PIECES = np.array(
    [[*_CORNERS, *((*line, ring[n], ring[(n + 1) % 4]) for n in range(4))] for line, ring in _AROUND.items()]
)
"""Eight tetrahedra, shape (lines, pieces, 4): four at the corners and four round a line."""


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
    pieces = _pieces(mesh.points, nodes)
    middle = middles(nodes)
    pair = dict(zip(*_pairs(mesh), strict=True))
    skin = faces_on(mesh, mesh.surfaces["SKIN"])
    outer = [edge for edge in edges_of(skin) if edge[0] in pair and edge[1] in pair]
    inner = [(min(pair[a], pair[b]), max(pair[a], pair[b])) for a, b in outer]
    border = edges_of(bone_faces(mesh))
    sets = {
        **mesh.node_sets,
        "EPIDERMIS_OUTER": np.array([*pair, *(middle[edge] for edge in outer)]),
        "EPIDERMIS_INNER": np.array([*pair.values(), *(middle[edge] for edge in inner)]),
        "BONE_SURFACE": bone_nodes(mesh, [middle[edge] for edge in border]),
    }
    elements = {name: (members[:, None] * 8 + np.arange(8)).ravel() for name, members in mesh.element_sets.items()}
    fine = Mesh(mesh.points, (Block("C3D4", pieces),), sets, elements)
    outside = outer_faces(fine)
    on = faces_on(fine, outside)
    surfaces = {}
    for name in ("SKIN", "NAIL"):
        three = faces_on(mesh, mesh.surfaces[name])
        members = np.union1d(three, [middle[edge] for edge in edges_of(three)])
        end = np.isin(on, mesh.node_sets["END"]).all(axis=1)
        surfaces[name] = outside[np.isin(on, members).all(axis=1) & ~end]
    return Mesh(mesh.points, fine.blocks, sets, elements, surfaces)


def _pieces(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Linear tetrahedra, eight for each quadratic one, round the line that leaves none too flat."""
    straight = with_straight_edges(points, nodes)
    # which way round they are is told by straight edges: where these are bent a piece may be inside out
    every = np.stack([oriented(straight, nodes[:, pieces].reshape(-1, 4)) for pieces in _PIECES])
    worst = [radius_ratio(points, pieces).reshape(len(nodes), -1).min(axis=1) for pieces in every]
    every = every.reshape(len(_PIECES), len(nodes), -1, 4)
    return every[np.argmax(worst, axis=0), np.arange(len(nodes))].reshape(-1, 4)


def _pairs(mesh: Mesh) -> tuple[list[int], list[int]]:
    """Corner nodes of the skin and those under them."""
    corner = np.unique(corners(mesh))
    outer, inner = (mesh.node_sets[name] for name in ("EPIDERMIS_OUTER", "EPIDERMIS_INNER"))
    return outer[np.isin(outer, corner)].tolist(), inner[np.isin(inner, corner)].tolist()
