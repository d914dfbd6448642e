"""Direct solution of small systems by levels, with numpy alone.

Unknowns sorted by their distance from one end of the body - in steps from neighbour to neighbour, as Cuthill and McKee
(1969) do - make a matrix of dense blocks beside its diagonal. These are eliminated one after the other. For some
hundred unknowns in the plane that is as quick as SuperLU, and scipy need not be imported, which takes longer than all
the systems of a guess.
"""

from __future__ import annotations

import numpy as np

WIDEST = 60
"""Unknowns of a level: products of wider blocks are shared by several threads of BLAS where it has them, and their
digits then depend on how many there are. By then SuperLU is as quick, and its import no longer counts."""
_RESIDUAL = 1e-6
"""Residual of a solution, relative to the right side, beyond which it is given up: far above what rounding leaves of a
regular matrix. A choice, the same as in `factor`."""


class Levels:
    """Solves systems of one pattern.

    Parameters
    ----------
    row, pointers : ndarray of int, shape (entries,) and (unknowns + 1,)
        Pattern by columns, symmetric.
    positions : ndarray or None, shape (unknowns, dim)
        Where the unknowns are, mm: levels may then begin at a side of the body.
    """

    def __init__(self, row: np.ndarray, pointers: np.ndarray, positions: np.ndarray | None = None) -> None:
        count = len(pointers) - 1
        self._row, self._column = row, np.repeat(np.arange(count), np.diff(pointers))
        # from what is farthest from somewhere: the levels are many and narrow
        order = np.concatenate(_sorted(row, pointers, np.arange(count)))[::-1]
        self.parts = _sorted(row, pointers, order)
        for side in _sides(positions):
            if _widest(self.parts) <= WIDEST:
                break
            self.parts = min(self.parts, _sorted(row, pointers, order, side), key=_widest)
        level, inside = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
        for n, part in enumerate(self.parts):
            level[part], inside[part] = n, np.arange(len(part))
        width = np.array([len(part) for part in self.parts] + [0])
        self.widest = _widest(self.parts)
        # one after the other: all blocks on the diagonal, above, below
        sizes = np.concatenate([width[:-1] ** 2, width[:-1] * width[1:], width[:-1] * width[1:]])
        starts = np.concatenate([[0], np.cumsum(sizes)])
        many = len(self.parts)
        self._starts, self._width, self._size = starts, width, int(starts[-1])
        above, below = level[self._column] > level[self._row], level[self._column] < level[self._row]
        block = np.minimum(level[self._row], level[self._column]) + many * above + 2 * many * below
        self._place = starts[block] + inside[self._row] * width[level[self._column]] + inside[self._column]
        self._data: np.ndarray | None = None
        self._eliminated: list[tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None

    def solve(self, data: np.ndarray, right: np.ndarray) -> np.ndarray | None:
        """Solution for the entries of a matrix; None where it is singular, or so nearly that a block is.

        The same array of entries once more is not eliminated again.
        """
        if data is not self._data:
            self._data, self._eliminated = data, self._eliminate(data)
        if self._eliminated is None:
            return None
        ahead: list[np.ndarray] = []
        for part, (inverse, _, below) in zip(self.parts, self._eliminated, strict=True):
            carried = below @ ahead[-1] if ahead else 0.0
            ahead.append(inverse @ (right[part] - carried))
        solution, later = np.empty(len(right)), np.empty(0)
        for n in reversed(range(len(ahead))):
            later = ahead[n] - self._eliminated[n][1] @ later
            solution[self.parts[n]] = later
        there = np.bincount(self._row, weights=data * solution[self._column], minlength=len(right))
        # not so for NaN either
        return solution if np.abs(there - right).max() <= _RESIDUAL * np.abs(right).max() else None

    def _eliminate(self, data: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]] | None:
        """Of each level: inverse of its block, that times the block beside it, and the block before it; or None."""
        entries = np.zeros(self._size)
        entries[self._place] = data
        many, width = len(self.parts), self._width

        def block(kind: int, n: int, rows: int, columns: int) -> np.ndarray:
            start = self._starts[kind * many + n]
            return entries[start : start + rows * columns].reshape(rows, columns)

        found = list[tuple[np.ndarray, np.ndarray, np.ndarray]]()
        above, below = np.empty((0, int(width[0]))), np.empty((int(width[0]), 0))
        try:
            for n in range(many):
                now, then = int(width[n]), int(width[n + 1])
                inverse = np.linalg.inv(block(0, n, now, now) - below @ above)
                above = inverse @ block(1, n, now, then)
                found.append((inverse, above, below))
                below = block(2, n, then, now)
        except np.linalg.LinAlgError:
            return None
        return found


def _widest(parts: list[np.ndarray]) -> int:
    return max(map(len, parts))


def _sides(positions: np.ndarray | None) -> list[np.ndarray]:
    """Unknowns at the sides of the body."""
    if positions is None:
        return []
    near = 1e-6 * np.ptp(positions)
    ends = [(x, end) for x in positions.T for end in (x.min(), x.max())]
    return [np.flatnonzero(np.abs(x - end) <= near) for x, end in ends]


def _sorted(
    row: np.ndarray, pointers: np.ndarray, order: np.ndarray, front: np.ndarray | None = None
) -> list[np.ndarray]:
    """Unknowns by their distance from the front, else from the first one of `order`.

    What is not connected to it follows likewise.
    """
    new = np.ones(len(order), dtype=bool)
    parts: list[np.ndarray] = []
    front = order[:1] if front is None else front
    while new.any():
        if not len(front):
            front = order[new[order]][:1]
        new[front] = False
        parts.append(front)
        near = np.zeros(len(new), dtype=bool)
        near[np.concatenate([row[pointers[i] : pointers[i + 1]] for i in front])] = True
        front = np.flatnonzero(near & new)
    return parts
