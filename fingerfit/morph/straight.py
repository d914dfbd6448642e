"""A finger of quadratic tetrahedra as one of linear ones on all its nodes: each node of a surface is set on it."""

from __future__ import annotations

import numpy as np

from fingerfit.anatomy.curved import bone_faces, edges_of, middles
from fingerfit.mesh import Block, Mesh
from fingerfit.tetrahedra import corners, faces_on, oriented, outer_faces

_PIECES = np.array(
    [[0, 4, 6, 7], [1, 5, 4, 8], [2, 6, 5, 9], [3, 7, 8, 9], [4, 9, 5, 6], [4, 9, 6, 7], [4, 9, 7, 8], [4, 9, 8, 5]]
)
"""Four tetrahedra at the corners and four round the line between the middles of the first and the last edge."""


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
        members = np.union1d(three, [middle[edge] for edge in edges_of(three)])
        end = np.isin(on, mesh.node_sets["END"]).all(axis=1)
        surfaces[name] = outside[np.isin(on, members).all(axis=1) & ~end]
    return Mesh(mesh.points, fine.blocks, sets, elements, surfaces)


def _pairs(mesh: Mesh) -> tuple[list[int], list[int]]:
    """Corner nodes of the skin and those under them."""
    corner = np.unique(corners(mesh))
    outer, inner = (mesh.node_sets[name] for name in ("EPIDERMIS_OUTER", "EPIDERMIS_INNER"))
    return outer[np.isin(outer, corner)].tolist(), inner[np.isin(inner, corner)].tolist()
