"""Meshes of simple bodies: a block of layers in the plane, a brick."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.shapes import EDGES, HEX, QUAD


def graded(count: int, grading: float) -> np.ndarray:
    """Positions 0 to 1 of `count` intervals that shrink geometrically from the middle to both ends.

    Parameters
    ----------
    count : int
        Number of intervals.
    grading : float
        Largest over smallest interval.

    >>> graded(4, 1.0).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    from_end = np.minimum(np.arange(count), np.arange(count)[::-1])
    sizes = np.power(float(grading), from_end / max(1, from_end.max()))
    return np.concatenate([[0.0], np.cumsum(sizes) / sizes.sum()])


def layered_block(
    width: float,
    layers: Sequence[tuple[str, float]],
    across: int,
    per_layer: int,
    element: str = "CPE8",
    grading: float = 1.0,
    origin: Sequence[float] = (0.0, 0.0),
) -> Mesh:
    """Rectangular block of horizontal layers for plane strain.

    Parameters
    ----------
    width : float
        mm.
    layers : sequence of (name, height in mm)
        From the indenter, on top, down.
    across, per_layer : int
        Elements over the width and over each layer.
    element : str
        Any in the plane; triangles come from quadrilaterals cut in two.
    grading : float
        Largest over smallest element, towards both sides, and towards base and indenter.
    origin : (float, float)
        Lower left corner, mm.

    Returns
    -------
    Mesh
        Node sets BOTTOM, TOP, INDENTER (one node of TOP); an element set for each layer.
    """
    upward = list(reversed(layers))
    x = origin[0] + width * graded(across, grading)
    stack = graded(per_layer * len(upward), grading)
    y, base = [origin[1]], origin[1]
    for number, (_, height) in enumerate(upward):
        part = stack[number * per_layer : (number + 1) * per_layer + 1]
        y += list(base + height * (part[1:] - part[0]) / (part[-1] - part[0]))
        base += height
    mesh = _grid([x, np.array(y)], element)
    rows = np.repeat(np.arange(per_layer * len(upward)), mesh.element_count // (per_layer * len(upward)))
    names = [name.upper() for name, _ in upward]
    sets = {name: np.flatnonzero(rows // per_layer == number) for number, name in enumerate(names)}
    return Mesh(mesh.points, mesh.blocks, mesh.node_sets, sets)


def brick(
    size: Sequence[float],
    elements: Sequence[int],
    name: str = "body",
    element: str = "C3D8",
    layers: Sequence[tuple[str, float]] | None = None,
) -> Mesh:
    """Brick with a corner at the origin; the indenter pushes along -z.

    Parameters
    ----------
    size : (float, float, float)
        mm.
    elements : (int, int, int)
        Along each axis; with layers, the last one over each of them.
    name : str
        Of its only layer.
    element : str
        Any solid one; tetrahedra come from bricks cut in six.
    layers : sequence of (name, height in mm), optional
        From the indenter, on top, down; their heights are those of `size` in place of its last number.

    Returns
    -------
    Mesh
        Node sets BOTTOM, TOP, INDENTER (one node of TOP), X0 and Y0 (planes of symmetry); an element set for
        each layer.
    """
    upward = list(reversed(layers or [(name, size[2])]))
    x, y = (s * graded(n, 1.0) for s, n in zip(size[:2], elements[:2], strict=True))
    base, z = 0.0, [0.0]
    for _, height in upward:
        z += list(base + height * graded(elements[2], 1.0)[1:])
        base += height
    mesh = _grid([x, y, np.array(z)], element)
    sheets = elements[2] * len(upward)
    layer = np.repeat(np.arange(sheets), mesh.element_count // sheets) // elements[2]
    sets = {part.upper(): np.flatnonzero(layer == number) for number, (part, _) in enumerate(upward)}
    return Mesh(mesh.points, mesh.blocks, mesh.node_sets, sets)


def _grid(axes: list[np.ndarray], element: str) -> Mesh:
    """Structured mesh; nodes are numbered along the first axis first."""
    dim = len(axes)
    kind = ELEMENTS[element]
    quadratic = kind.nodes > kind.corners
    if quadratic:
        axes = [np.insert(a, np.arange(1, len(a)), (a[1:] + a[:-1]) / 2) for a in axes]
    shape = tuple(len(a) for a in reversed(axes))
    index = np.indices(shape)[::-1]
    used = np.ones(shape, dtype=bool)
    if quadratic and not kind.is_simplex:
        used = sum(i % 2 for i in index) <= 1
    number = np.full(shape, -1)
    number[used] = np.arange(used.sum())
    points = np.stack([axis[i[used]] for axis, i in zip(axes, index, strict=True)], axis=1)
    step = 2 if quadratic else 1
    cells = [np.arange(0, n - 1, step) for n in shape]
    corner = np.stack([c.ravel() for c in np.meshgrid(*cells, indexing="ij")], axis=1)
    cell = _cell(element)
    offsets = np.broadcast_to(cell, (len(corner), *cell.shape)).copy()
    if kind.is_simplex and dim == 2:
        # the cut runs into the corners of the block, where a lone triangle would be held on two sides
        other = (corner + step / 2 < (np.array(shape) - 1) / 2).sum(axis=1) == 1
        offsets[other] = np.stack([1 - cell[..., 1], cell[..., 0]], axis=-1)
    places = corner[:, None, None] + (step * offsets[..., ::-1]).astype(int)
    nodes = number[tuple(np.moveaxis(places, -1, 0))].reshape(-1, kind.nodes)
    top = number[-1][used[-1]].ravel()
    sets = {"BOTTOM": number[0][used[0]].ravel(), "TOP": top, "INDENTER": top[len(top) // 2 :][:1]}
    if dim == 2:
        sets["MIDDLE"] = sets["BOTTOM"][len(sets["BOTTOM"]) // 2 :][:1]
    else:
        sets |= {"X0": number[:, :, 0][used[:, :, 0]], "Y0": number[:, 0, :][used[:, 0, :]]}
    return Mesh(points, (Block(element, nodes),), sets)


def _cell(element: str) -> np.ndarray:
    """Nodes of the elements that fill a unit cell, shape (elements, nodes, dim)."""
    kind = ELEMENTS[element]
    if not kind.is_simplex:
        return ((HEX if kind.dim == 3 else QUAD)[None, : kind.nodes] + 1) / 2
    found = []
    # Kuhn's division: one simplex for each way from the corner at zero to the one opposite, axis by axis
    for order in permutations(range(kind.dim)):
        path = np.vstack([np.zeros(kind.dim), np.cumsum(np.eye(kind.dim)[list(order)], axis=0)])
        if np.linalg.det(path[1:]) < 0:
            path[[1, 2]] = path[[2, 1]]
        mids = [(path[i] + path[j]) / 2 for i, j in EDGES[kind.dim]]
        found.append(np.vstack([path, *mids])[: kind.nodes])
    return np.array(found)
