"""Borders of a filled body set where the labels have them, as far as its elements allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fingerfit.mesh.bent import clipped, ease, middles
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.repair import FLAT, moved
from fingerfit.mesh.tetrahedra import corners, radius_ratio, to_quadratic
from fingerfit.segment.borders import WAY, Borders, to_zero
from fingerfit.segment.labels import Cells

ROUNDS = 8
"""Times that nodes are set on their border. A choice."""
FAR = 1.0
"""Longest way at once, in cells. A choice."""


def settled(cells: Cells, borders: Borders, mesh: Mesh, left_out: Sequence[int]) -> Mesh:
    """Tetrahedra whose corners on borders are set where labels meet; the others follow, and no element becomes flat.

    Parameters
    ----------
    cells : Cells
    borders : Borders
    mesh : Mesh
        C3D4; the nodes of borders come first.
    left_out : sequence of int
        Labels that are no part of the body.
    """
    count, points = len(borders.nodes), mesh.points
    ledge = _ledge(borders)
    least = np.minimum(FLAT, 0.9 * radius_ratio(points, corners(mesh)))
    for _ in range(ROUNDS):
        place = _on_borders(cells, cells.to_places(points[:count]), borders.pairs, borders.free, ledge, left_out)
        points = moved(mesh, points, np.arange(count), cells.to_points(place) - points[:count], least)
    return replace(mesh, points=points)


def curved(
    cells: Cells, borders: Borders, mesh: Mesh, triangles: np.ndarray, labels: np.ndarray, left_out: Sequence[int]
) -> Mesh:
    """C3D10 of C3D4 with the nodes in the middle of edges on borders, as far as elements allow.

    Parameters
    ----------
    cells, borders, mesh, left_out
        As for `settled`.
    triangles : ndarray of int, shape (triangles, 3)
        Of all borders.
    labels : ndarray of int, shape (triangles, 2)
        On both sides of each.
    """
    found = to_quadratic(mesh)
    nodes = found.blocks[0].nodes
    between = middles(nodes)
    number: dict[int, int] = {}
    pairs: dict[tuple[int, int], list[int]] = {}
    free, ledge, wide = [], [], _ledge(borders)
    for (a, b, c), two in zip(triangles.tolist(), np.sort(np.abs(labels), axis=1).tolist(), strict=True):
        for ends in ((a, b), (b, c), (a, c)):
            node = between[min(ends), max(ends)]
            if node not in number:
                number[node] = len(number)
                free.append(borders.free[list(ends)].any(axis=0))
                ledge.append(bool(wide[list(ends)].all()))
            pairs.setdefault((two[0], two[1]), []).append(number[node])
    chosen, points = np.array(list(number)), found.points.copy()
    for _ in range(ROUNDS):
        place = _on_borders(cells, cells.to_places(points[chosen]), pairs, np.array(free), np.array(ledge), left_out)
        points[chosen] = cells.to_points(place)
        points = clipped(points, nodes)
    return ease(replace(found, points=points))[0]


def _on_borders(
    cells: Cells,
    place: np.ndarray,
    pairs: Mapping[tuple[int, int], list[int]],
    free: np.ndarray,
    ledge: np.ndarray,
    left_out: Sequence[int],
) -> np.ndarray:
    """Places moved to each of their borders in turn: those within the body, then its surface.

    Where labels meet that do not touch in the picture, the surface of the body comes first, then the smaller label. On
    a flat end nodes are on a pad already: its rim is that of the end; where the end is wider (`ledge`) its footprint.
    """
    size = {label: int((depth > 0).sum()) for label, depth in cells.depths.items()}
    order = [0, *left_out, *sorted(set(size) - {0, *left_out}, key=size.__getitem__)]
    outside = 1 + len(left_out)
    first = {pair: min(pair, key=order.index) for pair in pairs}
    for pair in sorted(pairs, key=lambda pair: -order.index(first[pair])):
        if max(map(order.index, pair)) >= outside:
            nodes = np.unique(pairs[pair])
            if first[pair] in left_out:
                flat = nodes[ledge[nodes]]
                depth = partial(_footprint, cells, first[pair], _beyond(cells, place[flat], free[flat]))
                place[flat] += to_zero(depth, place[flat], WAY, FAR, free[flat])
                nodes = nodes[free[nodes].all(axis=1)]
            place[nodes] += to_zero(partial(cells.ahead, first[pair]), place[nodes], WAY, FAR, free[nodes])
    return place


def _ledge(borders: Borders) -> np.ndarray:
    """Nodes of flat ends that nothing lies on, shape (nodes,)."""
    found = np.zeros(len(borders.nodes), dtype=bool)
    on = (~borders.free[borders.sides]).all(axis=1).any(axis=1) & (borders.labels == 0).any(axis=1)
    found[borders.sides[on]] = True
    return found


def _beyond(cells: Cells, place: np.ndarray, free: np.ndarray) -> np.ndarray:
    """From places on flat ends of the body to the first pixels beyond, in cells."""
    outward = np.where(place > np.array(cells.labels.shape) / 2, 1.0, -1.0)
    return np.where(free, 0.0, outward / cells.spacing)


def _footprint(cells: Cells, label: int, beyond: np.ndarray, at: np.ndarray) -> np.ndarray:
    """How much deeper a pad is than what is beside it, where it lies on a flat end: the end itself is a border, too."""
    return cells.depth(label, at + beyond) - cells.depth(0, at + beyond)
