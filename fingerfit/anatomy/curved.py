"""Quadratic tetrahedra whose edges follow the curved surfaces of a finger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.anatomy.surface import vertex_normals
from fingerfit.mesh.bent import ease, middles
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.tetrahedra import corners, faces_on, outer_faces


def curved(mesh: Mesh, triangles: np.ndarray, shells: int) -> Mesh:
    """A finger of C3D10 with the nodes in the middle of edges on skin, layers and bones moved onto them.

    Parameters
    ----------
    mesh : Mesh
        With straight edges. Its first nodes are those of the skin, then of each shell below it in the same order.
    triangles : ndarray, shape (triangles, 3)
        Of the skin.
    shells : int
        Number of shells, the skin included.
    """
    points, count = mesh.points, int(triangles.max()) + 1
    middle = middles(np.concatenate([block.nodes for block in mesh.blocks]))
    shift = np.zeros_like(points)
    normals = vertex_normals(points[:count], triangles)
    edges = np.array(edges_of(triangles))
    bends = [_bend(points[edges + shell * count], normals[edges]) for shell in range(shells)]
    for shell, bend in enumerate(bends):
        here = edges + shell * count
        shift[[middle[a, b] for a, b in here.tolist()]] = bend
        if shell + 1 < shells:  # prisms are cut from the smaller number above to the larger one below
            cut = [middle[a, b + count] for a, b in here.tolist()]
            shift[cut] = (bend + bends[shell + 1]) / 2
    bones = bone_faces(mesh)
    edges = np.array(edges_of(bones))
    around = [middle[a, b] for a, b in edges.tolist()]
    shift[around] = _bend(points[edges], vertex_normals(points, bones)[edges])
    shift[mesh.node_sets["END"], 0] = 0.0
    sets = {**mesh.node_sets, "BONE_SURFACE": bone_nodes(mesh, around)}
    return ease(replace(mesh, points=points + shift, node_sets=sets))[0]


def _bend(ends: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """How far the middle of a cubic between points, perpendicular to their normals, is from the straight line.

    Parameters
    ----------
    ends, normals : ndarray, shape (edges, 2, 3)
    """
    along = (ends[:, 1] - ends[:, 0])[:, None]
    rise = (along * normals).sum(axis=2)[..., None] * normals
    return np.asarray((rise[:, 1] - rise[:, 0]) / 8)


def edges_of(triangles: np.ndarray) -> list[tuple[int, int]]:
    """Edges of triangles by their sorted corners, each once."""
    found = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    return [(int(a), int(b)) for a, b in found]


def bone_nodes(mesh: Mesh, between: list[int]) -> np.ndarray:
    """Corners of BONE_SURFACE and the nodes `between` them: an edge between two corners may go through the bone."""
    return np.union1d(np.intersect1d(mesh.node_sets["BONE_SURFACE"], corners(mesh)), between)


def bone_faces(mesh: Mesh) -> np.ndarray:
    """Corners of the outer triangles of the bones between nodes of BONE_SURFACE, seen from the tissue."""
    bone = Mesh(mesh.points, (Block("C3D4", corners(mesh)[mesh.element_sets["BONE"]]),))
    faces = faces_on(bone, outer_faces(bone))
    return faces[np.isin(faces, mesh.node_sets["BONE_SURFACE"]).all(axis=1)]
