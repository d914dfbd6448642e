"""Mesh of a slice: one layer of quadratic bricks, and the lines on which their corners lie."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from study_table import Study

Warp = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Moves places x and y, both (nodes,), mm."""
FEWEST = 3
"""Rows of elements in a layer, at least."""
FINE = 400
"""Parts of the map that makes rows finer towards base and indenter."""
SLICE = 0.3
"""Thickness of the slice over the mean width of an element."""


class Mesh:
    """Bricks C3D20R, one in the direction of the thickness; x to the right, y from the base upwards, z from 0 on.

    Parameters
    ----------
    columns, rows : ndarray (lines,)
        Places x of the lines between columns of elements, and y of those between rows, mm.
    warp : callable or None
        Moves the nodes.

    Attributes
    ----------
    thickness : float
        Of the slice, mm.
    nodes : ndarray (nodes, 3)
        Places, mm.
    numbers : dict
        Number of the node, from 1 on, at half column i, half row j and half thickness k.
    elements : list of list of int
        Numbers of the 20 nodes of each element, row by row from the base on.
    front : ndarray (front nodes,)
        Indices of the nodes with z = 0.
    quads : ndarray (elements, 8)
        Front nodes of each element (indices among these): corners, then middles of the sides, each from below on and
        against the clock.
    centres : ndarray (elements, 2)
        Mean of the corners, mm.
    """

    def __init__(self, columns: np.ndarray, rows: np.ndarray, warp: Warp | None = None) -> None:
        self.columns, self.rows = columns, rows
        self.across, self.up = len(columns) - 1, len(rows) - 1
        self.thickness = SLICE * (columns[-1] - columns[0]) / self.across
        x, y = _halved(columns), _halved(rows)
        places: list[tuple[int, int, int]] = []
        for j in range(2 * self.up + 1):
            for i in range(2 * self.across + 1):
                if i % 2 == 0 or j % 2 == 0:
                    places += [(i, j, k) for k in ((0, 1, 2) if i % 2 == j % 2 else (0, 2))]
        self.numbers = {place: number for number, place in enumerate(places, start=1)}
        i, j, k = np.array(places).T
        xy = (x[i], y[j]) if warp is None else warp(x[i], y[j])
        self.nodes = np.stack([*xy, k * self.thickness / 2], -1)
        self.front = np.flatnonzero(k == 0)
        self._position = {int(node) + 1: position for position, node in enumerate(self.front)}
        self.elements, quads = [], []
        for row in range(self.up):
            for column in range(self.across):
                a, b = 2 * column, 2 * row
                corners = [(a, b), (a + 2, b), (a + 2, b + 2), (a, b + 2)]
                middles = [(a + 1, b), (a + 2, b + 1), (a + 1, b + 2), (a, b + 1)]
                self.elements.append(
                    [self.numbers[*p, k] for some in (corners, middles) for k in (0, 2) for p in some]
                    + [self.numbers[*p, 1] for p in corners]
                )
                quads.append([self._position[self.numbers[*p, 0]] for p in corners + middles])
        self.quads = np.array(quads)
        self.centres = self.points[self.quads[:, :4]].mean(1)

    @property
    def points(self) -> np.ndarray:
        """Places of the front nodes (front nodes, 2), mm."""
        return self.nodes[self.front, :2]

    def level(self, j: int, i: int | None = None) -> list[int]:
        """Numbers of the nodes on half row j, or only of those of them on half column i."""
        return [number for (a, b, _), number in self.numbers.items() if b == j and i in (None, a)]

    def outline(self, below: int) -> np.ndarray:
        """Front nodes (indices among these) around the body, from the lower left corner on, against the clock.

        `below` is the number of rows of elements that are left out at the base.
        """
        first, last, right = 2 * below, 2 * self.up, 2 * self.across
        around = [(i, first) for i in range(right)] + [(right, j) for j in range(first, last)]
        around += [(i, last) for i in range(right, 0, -1)] + [(0, j) for j in range(last, first, -1)]
        return np.array([self._position[self.numbers[i, j, 0]] for i, j in around])


def _halved(lines: np.ndarray) -> np.ndarray:
    """The lines, and those in the middle between them."""
    count = len(lines)
    return np.interp(np.arange(2 * count - 1) / 2, np.arange(count), lines)


def graded(count: int, length: float, grading: float) -> np.ndarray:
    """Lines (count + 1,) from 0 to a length, finer towards both ends; mm."""
    middles = (np.arange(count) + 0.5) / count * 2 - 1
    sizes = 1 / (1 + (grading - 1) * middles**2)
    lines = np.r_[0, np.cumsum(sizes)]
    return lines / lines[-1] * length


def row_lines(study: Study) -> np.ndarray:
    """Lines between the rows, mm: each layer has whole rows, finer towards base and indenter."""
    fine = graded(FINE, study.height, study.grading)
    parts = np.arange(FINE + 1)
    lines, low = [0.0], 0.0
    for layer in study.layers[::-1]:
        count = max(FEWEST, round(layer.height / (study.width / study.elements)))
        begin, end = np.interp([low, low + layer.height], fine, parts)
        lines += np.interp(np.linspace(begin, end, count + 1)[1:], parts, fine).tolist()
        low += layer.height
    return np.array(lines)
