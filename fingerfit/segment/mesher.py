"""A mesh of a segmentation: netgen fills what lies between the borders of its labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fingerfit.anatomy.surface import load_netgen
from fingerfit.core.errors import InputError, SolverError
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.inside import size_of
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.tetrahedra import oriented
from fingerfit.segment.borders import Borders, borders_of
from fingerfit.segment.labels import cells_of
from fingerfit.segment.settle import curved, settled

ELEMENTS = {2: ("CPE6", "CPE6H", "CPE3", "CPE3H"), 3: ("C3D10", "C3D10H", "C3D4", "C3D4H")}
"""Elements in the plane and in space; the first one where none is wanted."""
SIDES = ("x-", "x+", "y-", "y+", "z-", "z+")
NEAR = 0.5
"""How far below the top of the body its nodes are still under an indenter, in elements. A choice."""
ON_IT = NEAR * 1e-3
"""The same for a flat side, on which nodes lie but for rounding."""
ROUNDING = 1e-6
"""Distance, in elements, within which nodes lie on one plane: the sums that place them are in double precision."""
LARGEST = 3
"""Largest element within the body, in elements at borders. A choice."""


def mesh_labels(
    picture: Picture,
    size: float,
    tissues: Mapping[int, str],
    holes: Mapping[int, str] | None = None,
    element: str = "",
    grading: float = 0.3,
    sides: Mapping[str, str] | None = None,
    where: Path | str = "segmentation",
) -> Mesh:
    """Mesh of the labels of a picture: an element set for each, sides of elements along their borders.

    Parameters
    ----------
    picture : Picture
        Whole numbers.
    size : float
        Of elements at borders, mm.
    tissues : mapping of int to str
        Element set of each label.
    holes : mapping of int to str, optional
        Labels that are left out, as pads are; the nodes on their border are a node set of this name.
    element : str
        One of `ELEMENTS`.
    grading : float
        How fast elements grow away from borders: 0 not at all, 1 fast.
    sides : mapping of str to str, optional
        Node sets of nodes at a side of the box around the body, as ``{"BOTTOM": "z-"}``.
    where : Path or str
        Named in errors.

    Raises
    ------
    InputError
        For labels that no name belongs to, names of labels that are not there, and sides or elements that are none.
    SolverError
        When netgen is not installed or cannot fill the body.
    """
    holes, sides = holes or {}, sides or {}
    dim = picture.dim
    element = element or ELEMENTS[dim][0]
    if element not in ELEMENTS[dim]:
        raise InputError(where, "element", element, "one of " + ", ".join(ELEMENTS[dim]))
    check_sides(sides, dim, where)
    there = set(np.unique(np.rint(picture.values)).astype(int).tolist()) - {0}
    for none in sorted({*tissues, *holes} - there):
        raise InputError(where, "labels", f"{none}, which no pixel has", "one of " + ", ".join(map(str, sorted(there))))
    if strange := sorted(there - {*tissues, *holes}):
        raise InputError(where, "labels", f"{strange[0]} without a name", f"{strange[0]}=NAME, or it as a hole")
    cells = cells_of(picture, size, tuple(holes), Path(where))
    borders = borders_of(cells)
    border = cells.to_points(borders.nodes)
    triangles, beside = _triangles(border, borders) if dim == 3 else (borders.sides, borders.labels)
    fill = filled if dim == 2 else _space
    points, nodes, label = fill(border, triangles, beside, size, grading)
    missing = sorted(set(tissues) - set(label.tolist()))
    if missing:
        expected = f"elements smaller than {size:g} mm, or labels with more pixels"
        raise InputError(where, "labels", f"{missing[0]}, which is too small for an element", expected)
    order = np.argsort(label, kind="stable")
    nodes, label = nodes[order], label[order]
    sets = {
        name: np.flatnonzero(np.isin(label, [k for k in tissues if tissues[k] == name])) for name in tissues.values()
    }
    hole_nodes = {name: np.unique(borders.sides[(borders.labels == -k).any(axis=1)]) for k, name in holes.items()}
    if empty := [name for name, nodes in hole_nodes.items() if not len(nodes)]:
        raise InputError(where, "holes", f"{empty[0]}, which touches no tissue", "a label beside one")
    outside = np.unique(borders.sides[(borders.labels <= 0).any(axis=1)])
    linear = "C3D4" if dim == 3 else "CPE3"
    mesh = Mesh(points, (Block(linear, nodes),), {}, sets)
    if dim == 3:
        mesh = settled(cells, borders, mesh, list(holes))
    mesh = replace(mesh, node_sets={**sides_of(mesh.points, outside, sides, size), **hole_nodes})
    if element.removesuffix("H") == linear:
        return replace(mesh, blocks=(Block(element, nodes),))
    found = six(mesh) if dim == 2 else curved(cells, borders, mesh, triangles, beside, list(holes))
    return Mesh(found.points, (Block(element, found.blocks[0].nodes),), found.node_sets, sets)


def check_sides(sides: Mapping[str, str], dim: int, where: Path | str) -> None:
    """Refuse what is no side of a body in so many dimensions."""
    for side in sides.values():
        if side not in SIDES[: 2 * dim]:
            raise InputError(where, "side", side, "one of " + ", ".join(SIDES[: 2 * dim]))


def sides_of(points: np.ndarray, outside: np.ndarray, sides: Mapping[str, str], size: float) -> dict[str, np.ndarray]:
    """Nodes at sides of the body, of those that are outside: all of a flat one, or half an element of a round one."""
    found = {}
    for name, side in sides.items():
        axis, sign = "xyz".index(side[0]), 1.0 if side[1] == "+" else -1.0
        height = sign * points[outside, axis]
        found[name] = outside[height > height.max() - size * (ON_IT if _flat(height, size) else NEAR)]
    return found


def _flat(height: np.ndarray, size: float) -> bool:
    """Whether a side is flat: three or more nodes lie on it."""
    return bool((height > height.max() - ROUNDING * size).sum() >= 3)


def filled(
    points: np.ndarray, sides: np.ndarray, labels: np.ndarray, size: float, grading: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles between sides in the plane.

    Parameters
    ----------
    points : ndarray, shape (points, 2)
        mm.
    sides, labels : ndarray of int, shape (sides, 2)
        Points of each side, and the label to its left and to its right; 0 and below are outside.
    size, grading : float
        As for `mesh_labels`.

    Returns
    -------
    points, triangles, label : ndarray
        Those given come first; corners of each triangle, and what it lies in.

    Raises
    ------
    SolverError
        When netgen is not installed or cannot fill what lies between the sides.
    """
    load_netgen()
    from netgen import geom2d

    shape = geom2d.SplineGeometry()
    for point in points:
        shape.AppendPoint(*map(float, point))
    for (a, b), (left, right) in zip(sides.tolist(), labels.tolist(), strict=True):
        shape.Append(["line", a, b], leftdomain=max(left, 0), rightdomain=max(right, 0), bc=1)
    return _made(lambda: shape.GenerateMesh(maxh=LARGEST * size, grading=grading, quad_dominated=False), 2, points)


def _space(
    points: np.ndarray, triangles: np.ndarray, labels: np.ndarray, size: float, grading: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    meshing = load_netgen().meshing
    mesh = meshing.Mesh(dim=3)
    numbers = [mesh.Add(meshing.MeshPoint(meshing.Pnt(*map(float, point)))) for point in points]
    pairs, which = np.unique(np.maximum(labels, 0), axis=0, return_inverse=True)
    faces = [
        mesh.Add(meshing.FaceDescriptor(surfnr=n, domin=int(a), domout=int(b), bc=n))
        for n, (a, b) in enumerate(pairs, 1)
    ]
    for triangle, pair in zip(triangles.tolist(), which.ravel(), strict=True):
        mesh.Add(meshing.Element2D(faces[pair], [numbers[n] for n in triangle]))
    for label in sorted(set(pairs.ravel().tolist()) - {0}):
        mesh.SetMaterial(label, str(label))
    return _made(
        lambda: (mesh.GenerateVolumeMesh(mp=meshing.MeshingParameters(maxh=LARGEST * size, grading=grading)), mesh)[1],
        3,
        points,
    )


def _triangles(points: np.ndarray, borders: Borders) -> tuple[np.ndarray, np.ndarray]:
    """Sides with four corners as two triangles each, cut along the shorter diagonal, and their labels."""
    return np.array([half for side in borders.sides for half in _halves(points, side)]), borders.labels.repeat(
        2, axis=0
    )


def _halves(points: np.ndarray, side: np.ndarray) -> list[list[int]]:
    a, b, c, d = side.tolist()
    if np.linalg.norm(points[a] - points[c]) <= np.linalg.norm(points[b] - points[d]):
        return [[a, b, c], [a, c, d]]
    return [[a, b, d], [b, c, d]]


def _made(work: Callable[[], Any], dim: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, corners of elements and their labels."""
    try:
        mesh = work()
    except Exception as error:
        raise SolverError(f"netgen could not fill the body: {error}; try another size") from error
    found = np.array(mesh.Coordinates(), dtype=float).reshape(-1, dim)
    elements = mesh.Elements2D() if dim == 2 else mesh.Elements3D()
    if not len(found) or not len(elements):
        raise SolverError("netgen made no elements; try another size")
    rows = [([v.nr - 1 for v in e.vertices], int(getattr(e.index, "nr", e.index))) for e in elements]
    apart, first = cKDTree(found).query(points)
    if apart.max() > 1e-9 * np.ptp(points):
        raise SolverError("netgen moved the borders between labels; try another size")
    order = np.concatenate([first, np.setdiff1d(np.arange(len(found)), first)])  # those of borders first
    number = np.argsort(order)
    found = found[order]
    nodes, label = number[[row[0] for row in rows]], np.array([row[1] for row in rows])
    if dim == 3:
        return found, oriented(found, nodes), label
    turned = size_of(found[nodes]) < 0
    nodes[turned] = nodes[turned][:, [0, 2, 1]]
    return found, nodes, label


def edges_of(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges of triangles, shape (edges, 2), which one each side is, and how many triangles have each."""
    ends = np.sort(np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0, return_inverse=True, return_counts=True)


def six(mesh: Mesh) -> Mesh:
    """Triangles with nodes in the middle of sides, which are in a node set where both ends of an outer side are."""
    corner = mesh.blocks[0].nodes
    edges, which, times = edges_of(corner)
    first = len(mesh.points)
    nodes = np.concatenate([corner, first + which.reshape(-1, 3)], axis=1)
    alone = times == 1
    sets = {
        name: np.concatenate([members, first + np.flatnonzero(alone & np.isin(edges, members).all(axis=1))])
        for name, members in mesh.node_sets.items()
    }
    points = np.concatenate([mesh.points, mesh.points[edges].mean(axis=1)])
    return Mesh(points, (Block("CPE6", nodes),), sets, mesh.element_sets)
