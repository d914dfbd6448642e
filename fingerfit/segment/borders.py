"""Borders between labels: sides of cells, moved to where a label passes into the next one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from fingerfit.segment.labels import Cells

SETTLED = 4
"""Times that they are set on it at the end, without smoothing. A choice."""
ROUNDS = 12
"""Times that nodes are smoothed and set on their border. A choice."""
TAUBIN = (0.5, -0.52)
"""Shares of the way to the mean of the neighbours, in turn: smooth, but as large as before (Taubin 1995)."""
FAR = 0.45
"""Most that a node moves away from its corner of a cell, in cells: less than half, so that no two meet."""

WAY = 0.25
"""Longest way towards a border at once, and step of its slopes, in cells: within a cell depths are nearly linear."""
LEVEL = 1e-3
"""Square of a slope of depths, which is 4 between two labels, below which there is no border to go to."""

ALONG = 0.25
"""Least share of the square of a slope along which places are free. A choice."""


@dataclass(frozen=True)
class Borders:
    """Sides between cells of different labels.

    Parameters
    ----------
    nodes : ndarray, shape (nodes, dim)
        In cells from the origin.
    sides : ndarray of int, shape (sides, 2 or 4)
        Nodes of each side; in space in turn, anticlockwise as seen from the second label.
    labels : ndarray of int, shape (sides, 2)
        Label on each side of it; in the plane to the left and to the right, in space behind and before it. Those that
        are left out are below 0.
    free : ndarray of bool, shape (nodes, dim)
        Axes along which each node may move: not across a flat end of the body.
    pairs : dict of (int, int) to list of int
        Nodes of the border between two labels, the lower one first; none where more than three labels meet.
    """

    nodes: np.ndarray
    sides: np.ndarray
    labels: np.ndarray
    free: np.ndarray
    pairs: dict[tuple[int, int], list[int]]


def borders_of(cells: Cells) -> Borders:
    """Borders of the body and within it, smooth; flat ends of the body stay flat."""
    labels = cells.labels
    dim = labels.ndim
    sides, pairs, flat = [], [], []
    for axis in range(dim):
        moved = np.moveaxis(labels, axis, 0)
        here, beyond = moved[:-1], moved[1:]
        spots = np.argwhere((here != beyond) & ((here > 0) | (beyond > 0)))
        pair = np.stack([here[tuple(spots.T)], beyond[tuple(spots.T)]], axis=1)
        first = np.insert(np.delete(spots, 0, axis=1), axis, spots[:, 0] + 1, axis=1)
        across = [k for k in range(dim) if k != axis]
        steps = _around(dim, axis, across)
        sides.append(first[:, None] + steps)
        pairs.append(pair)
        flat.append(np.full(len(spots), axis))
    corners, which = np.unique(np.concatenate(sides).reshape(-1, dim), axis=0, return_inverse=True)
    side = which.reshape(-1, 2 ** (dim - 1))
    pair, axis_of = np.concatenate(pairs), np.concatenate(flat)
    return _smoothed(cells, corners.astype(float), side, pair, axis_of)


def _around(dim: int, axis: int, across: list[int]) -> np.ndarray:
    """Corners of a side across an axis: with the first label to the left, in space as seen from the second."""
    if dim == 2:
        ends = np.zeros((2, 2), int)
        ends[1, across[0]] = 1
        return ends if axis == 0 else ends[::-1]
    steps = np.zeros((4, 3), int)
    for corner, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        steps[corner, across[0]], steps[corner, across[1]] = u, v
    return steps[::-1] if axis == 1 else steps


def _smoothed(cells: Cells, start: np.ndarray, sides: np.ndarray, pairs: np.ndarray, axis_of: np.ndarray) -> Borders:
    count, dim = start.shape
    free = np.ones((count, dim), dtype=bool)
    low, high = np.ones(dim), np.array(cells.labels.shape) - 1.0  # of the box around the body
    for axis in range(dim):
        chosen = sides[axis_of == axis]
        for end in np.array([low[axis], high[axis]])[cells.flat[axis]]:
            there = chosen[start[chosen[:, 0], axis] == end]
            free[np.unique(there), axis] = False
    edges = np.concatenate(
        [np.stack([sides[:, n], sides[:, (n + 1) % sides.shape[1]]], axis=1) for n in range(sides.shape[1])]
    )
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    # a node of several borders moves along with those that have them, too
    kinds = _kinds(count, sides, pairs)
    borders = np.array([len(kind) for kind in kinds])
    both = [(a, b) for a, b in edges.tolist()]
    near: list[list[int]] = [[] for _ in range(count)]
    for a, b in both:
        if borders[b] >= borders[a]:
            near[a].append(b)
        if borders[a] >= borders[b]:
            near[b].append(a)
    rows = np.repeat(np.arange(count), [len(one) for one in near])
    columns = np.array([b for one in near for b in one], dtype=int)
    number = np.maximum(np.bincount(rows, minlength=count), 1)
    joined = (np.bincount(rows, minlength=count) > 0)[:, None]
    by_pair: dict[tuple[int, int], list[int]] = {}
    for node, kind in enumerate(kinds):
        if len(kind) <= 3:  # where three meet, on each of their borders in turn
            for a, b in combinations(sorted(map(abs, kind)), 2):
                by_pair.setdefault((a, b), []).append(node)
    place = start.copy()
    for round in range(ROUNDS + SETTLED):
        for step in TAUBIN if round < ROUNDS else ():
            mean = np.stack([np.bincount(rows, place[columns, k], count) / number for k in range(dim)], axis=1)
            place = np.where(free & joined, place + step * (mean - place), place)
        for (a, b), nodes in by_pair.items():
            place[nodes] += to_zero(partial(_difference, cells, a, b), place[nodes], WAY, WAY, free[nodes])
        place = np.clip(place, start - FAR, start + FAR)
    return Borders(place, sides, pairs, free, by_pair)


def _kinds(count: int, sides: np.ndarray, pairs: np.ndarray) -> list[set[int]]:
    """Labels that meet at each node."""
    kinds: list[set[int]] = [set() for _ in range(count)]
    for nodes, pair in zip(sides.tolist(), pairs.tolist(), strict=True):
        for node in nodes:
            kinds[node].update(pair)
    return kinds


def _difference(cells: Cells, a: int, b: int, at: np.ndarray) -> np.ndarray:
    return cells.depth(a, at) - cells.depth(b, at)


def to_zero(
    difference: Callable[[np.ndarray], np.ndarray],
    place: np.ndarray,
    step: float,
    most: float = np.inf,
    free: np.ndarray | None = None,
) -> np.ndarray:
    """Way to where a difference of two depths is zero, along its slope over a step; `most` long at most.

    Where places are not free to move along an axis they move along the others, but not where the border lies in them.

    >>> to_zero(lambda at: 2 * (at[:, 0] - 1.0), np.array([[0.8, 5.0], [3.0, 5.0]]), 0.5, 0.5)[:, 0].round(9).tolist()
    [0.2, -0.5]
    """
    steps = step * np.eye(place.shape[1])
    slope = np.stack([(difference(place + one) - difference(place - one)) / (2 * step) for one in steps], axis=1)
    along = slope if free is None else np.where(free, slope, 0.0)
    steep = (along**2).sum(axis=1)
    enough = steep >= np.maximum(LEVEL, ALONG * (slope**2).sum(axis=1))
    way = -np.where(enough, difference(place) / np.maximum(steep, LEVEL), 0.0)[:, None] * along
    length = np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(way * np.minimum(1.0, most / np.maximum(length, 1e-12)))
