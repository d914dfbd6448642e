"""Direct solution of small systems by levels, with numpy alone.

Unknowns sorted by their distance from one end of the body - in steps from neighbour to neighbour, as Cuthill and McKee
(1969) do - make a matrix of dense blocks beside its diagonal. These are eliminated one after the other. For some
hundred unknowns in the plane that is as quick as SuperLU, and scipy need not be imported, which takes longer than all
the systems of a guess.
"""

from __future__ import annotations

import numpy as np

WORK = 1e8
"""Operations of an elimination up to which it is worth it."""
_RESIDUAL = 1e-6
"""Residual of a solution, relative to the right side, beyond which it is given up."""


class Levels:
    """Solves systems of one pattern.

    Parameters
    ----------
    row, pointers : ndarray of int, shape (entries,) and (unknowns + 1,)
        Pattern by columns, symmetric.
    """

    def __init__(self, row: np.ndarray, pointers: np.ndarray) -> None:
        count = len(pointers) - 1
        self._row, self._column = row, np.repeat(np.arange(count), np.diff(pointers))
        # from what is farthest from somewhere: the levels are many and narrow
        anywhere = _sorted(row, pointers, np.arange(count))
        self.parts = _sorted(row, pointers, np.concatenate(anywhere)[::-1])
        level, inside = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
        for n, part in enumerate(self.parts):
            level[part], inside[part] = n, np.arange(len(part))
        width = np.array([len(part) for part in self.parts] + [0])
        self.work = float((8 / 3 * width.astype(float) ** 3).sum())
        # one after the other: all blocks on the diagonal, above, below
        sizes = np.concatenate([width[:-1] ** 2, width[:-1] * width[1:], width[:-1] * width[1:]])
        starts = np.concatenate([[0], np.cumsum(sizes)])
        many = len(self.parts)
        self._starts, self._width, self._size = starts, width, int(starts[-1])
        above, below = level[self._column] > level[self._row], level[self._column] < level[self._row]
        block = np.minimum(level[self._row], level[self._column]) + many * above + 2 * many * below
        self._place = starts[block] + inside[self._row] * width[level[self._column]] + inside[self._column]

    def solve(self, data: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """Solution for the entries of a matrix; None where it is singular, or so nearly that a block is."""
        entries = np.zeros(self._size)
        entries[self._place] = data
        many, width = len(self.parts), self._width

        def block(kind: int, n: int, rows: int, columns: int) -> np.ndarray:
            start = self._starts[kind * many + n]
            return entries[start : start + rows * columns].reshape(rows, columns)

        solved: list[np.ndarray] = []
        carried = np.empty((0, 0))
        try:
            for n, part in enumerate(self.parts):
                now, then = int(width[n]), int(width[n + 1])
                pivot = block(0, n, now, now)
                beside = np.empty((now, then + 1))
                beside[:, :then], beside[:, then] = block(1, n, now, then), right[part]
                if n:
                    pivot -= carried[:, :-1]
                    beside[:, then] -= carried[:, -1]
                solved.append(np.linalg.solve(pivot, beside))
                carried = block(2, n, then, now) @ solved[-1]
        except np.linalg.LinAlgError:
            return None
        solution = np.empty(len(right))
        later = np.empty(0)
        for part, found in zip(reversed(self.parts), reversed(solved), strict=True):
            later = found[:, -1] - found[:, :-1] @ later
            solution[part] = later
        there = np.bincount(self._row, weights=data * solution[self._column], minlength=len(right))
        # not so for NaN either
        return solution if np.abs(there - right).max() <= _RESIDUAL * np.abs(right).max() else None


def _sorted(row: np.ndarray, pointers: np.ndarray, order: np.ndarray) -> list[np.ndarray]:
    """Unknowns by their distance from the first one of `order`; what is not connected to it follows likewise."""
    new = np.ones(len(order), dtype=bool)
    parts: list[np.ndarray] = []
    front = order[:1]
    while new.any():
        if not len(front):
            front = order[new[order]][:1]
        new[front] = False
        parts.append(front)
        near = np.zeros(len(new), dtype=bool)
        near[np.concatenate([row[pointers[i] : pointers[i + 1]] for i in front])] = True
        front = np.flatnonzero(near & new)
    return parts
