"""Meshes of quadratic elements (8 nodes in the plane, 20 in space) of layered bodies, and files of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

Array = np.ndarray
PLANE = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
SPACE = [(*p, 0) for p in PLANE[:4]] + [(*p, 2) for p in PLANE[:4]]
SPACE += [(*p, 0) for p in PLANE[4:]] + [(*p, 2) for p in PLANE[4:]] + [(*p, 1) for p in PLANE[:4]]


def graded(count: int, ratio: float) -> Array:
    """Borders of elements from 0 to 1: the middle ones are `ratio` times as large as those at the ends."""
    middle = np.abs(2 * (np.arange(count) + 0.5) / count - 1)
    sizes = ratio ** (1 - middle)
    return np.concatenate([[0], np.cumsum(sizes)]) / sizes.sum()


@dataclass
class Body:
    """Nodes, elements, the layer of each element (from the base up), and node sets."""

    points: Array
    cells: Array
    layer: Array
    bottom: Array
    top: Array
    levels: Array

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.points.shape[1]


def layered(
    sides: tuple[float, ...],
    heights: list[float],
    across: int,
    rows: list[int],
    shape: Callable[[Array], Array] | None = None,
    ratio: float = 4.0,
) -> Body:
    """Mesh a block with `heights` from the base up; `shape` moves its points to where they are."""
    levels = np.concatenate([[0], np.cumsum(heights)])
    up = np.concatenate([levels[k] + heights[k] * graded(n, 2.5)[:-1] for k, n in enumerate(rows)] + [levels[-1:]])
    axes = [side * graded(across, ratio) for side in sides] + [up]
    axes = [np.interp(np.arange(2 * len(a) - 1) / 2, np.arange(len(a)), a) for a in axes]
    counts = [len(a) for a in axes]
    lattice = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], 1)
    corner = np.array(list(product(*[range(0, n - 2, 2) for n in counts])))
    order = np.array(PLANE if len(sides) == 1 else SPACE)
    index = corner[:, None, :] + order[None]
    cells = np.ravel_multi_index(np.moveaxis(index, -1, 0), counts)
    used, cells = np.unique(cells, return_inverse=True)
    cells = cells.reshape(index.shape[:2])
    points = lattice[used]
    centre = points[cells].mean(1)[:, -1]
    layer = np.searchsorted(levels, centre) - 1
    bottom = np.flatnonzero(points[:, -1] < 1e-9)
    top = np.flatnonzero(points[:, -1] > levels[-1] - 1e-9)
    if shape is not None:
        points = shape(points)
    return Body(points, cells, layer, bottom, top, levels)


def shapes_at(local: Array) -> Array:
    """Shape functions (places, nodes) of the serendipity element at places in -1 to 1."""
    dim = local.shape[1]
    nodes = np.array(PLANE if dim == 2 else SPACE) - 1.0
    values = np.empty((len(local), len(nodes)))
    for k, node in enumerate(nodes):
        zero = node == 0
        if zero.any():
            axis = int(np.flatnonzero(zero)[0])
            others = [i for i in range(dim) if i != axis]
            line = np.prod((1 + node[others] * local[:, others]) / 2, axis=1)
            values[:, k] = (1 - local[:, axis] ** 2) * line
        else:
            corner = np.prod((1 + node * local) / 2, axis=1)
            values[:, k] = corner * ((node * local).sum(1) - (dim - 1))
    return values


def simplices(body: Body, parts: int) -> tuple[Array, Array]:
    """Cut each element into parts^dim pieces and these into triangles or tetrahedra.

    Return the shape functions at the corners of the pieces (places, nodes) and the corners (simplices, dim + 1) of
    one element.
    """
    dim, n = body.dim, parts + 1
    ticks = np.linspace(-1, 1, n)
    local = np.stack([g.ravel() for g in np.meshgrid(*[ticks] * dim, indexing="ij")], 1)
    found = []
    for base in product(range(parts), repeat=dim):
        for path in _paths(dim):
            corners = np.array(base)[None] + path
            found.append(np.ravel_multi_index(corners.T, [n] * dim))
    return shapes_at(local), np.array(found)


def _paths(dim: int) -> list[Array]:
    """Corners of the simplices of a unit cube (Kuhn): ways along its edges from one corner to the far one."""
    if dim == 2:
        return [np.array([[0, 0], [1, 0], [1, 1]]), np.array([[0, 0], [1, 1], [0, 1]])]
    ways = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    paths = []
    for way in ways:
        corners = [np.zeros(3, int)]
        for axis in way:
            corners.append(corners[-1] + np.eye(3, dtype=int)[axis])
        paths.append(np.array(corners))
    return paths


def write_inp(body: Body, names: list[str], origin: Array, file: Path) -> None:
    """Write a plane mesh with CPE8H elements and the sets TOP, BOTTOM and those of the layers (from the base up)."""
    lines = ["*HEADING", "mesh of the body", "*NODE"]
    lines += [f"{k + 1}, {x:.9g}, {y:.9g}" for k, (x, y) in enumerate(body.points + origin)]
    for number, name in enumerate(names):
        lines.append(f"*ELEMENT, TYPE=CPE8H, ELSET={name.upper()}")
        cells = np.flatnonzero(body.layer == number)
        lines += [f"{c + 1}, " + ", ".join(str(n + 1) for n in body.cells[c]) for c in cells]
    for name, nodes in (("BOTTOM", body.bottom), ("TOP", body.top)):
        lines.append(f"*NSET, NSET={name}")
        lines += [", ".join(str(n + 1) for n in nodes[k : k + 12]) for k in range(0, len(nodes), 12)]
    file.write_text("\n".join(lines) + "\n")
