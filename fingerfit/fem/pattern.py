"""Pattern of a sparse matrix that grows but never shrinks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix


class Pattern:
    """Entries of a square matrix by columns, zeros among them: the analysis of a factorisation holds while it stays.

    Parameters
    ----------
    keys : ndarray of int64
        Column times `count` plus row, increasing.
    count : int
        Columns.
    """

    def __init__(self, keys: np.ndarray, count: int) -> None:
        self.count = count
        self._set(keys)
        self._first = np.arange(len(keys))
        # what was added last, and where: mostly the same again
        self._added = self._at = np.empty(0, dtype=np.int64)

    def _set(self, keys: np.ndarray) -> None:
        self.keys = keys
        self.rows = (keys % max(self.count, 1)).astype(np.int32)
        self.pointers = np.searchsorted(keys // max(self.count, 1), np.arange(self.count + 1)).astype(np.int32)

    def matrix(self, first: np.ndarray, rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> csc_matrix:
        """The matrix of the values of the first keys and of others by row and column, which are added.

        Parameters
        ----------
        first : ndarray
            One for each key that the pattern began with.
        rows, columns, values : ndarray, shape (entries,)
            Those that are new make it grow.
        """
        from scipy.sparse import csc_matrix

        keys = columns.astype(np.int64) * self.count + rows
        if not np.array_equal(keys, self._added):
            self.grow(rows, columns)
            self._added, self._at = keys, self._place(keys)
        data = np.bincount(self._at, weights=values, minlength=len(self.keys)).astype(float, copy=False)
        data[self._first] += first
        return csc_matrix((data, self.rows, self.pointers), shape=(self.count,) * 2)

    def grow(self, rows: np.ndarray, columns: np.ndarray) -> None:
        """Have entries at these places too."""
        keys = columns.astype(np.int64) * self.count + rows
        known = self.keys[self._place(keys)] == keys if len(self.keys) else np.zeros(len(keys), dtype=bool)
        new = np.array(sorted(set(keys[~known].tolist())), dtype=np.int64)
        if len(new):
            # each of the first moves by the new ones before it
            self._first = self._first + np.searchsorted(new, self.keys[self._first])
            self._set(np.insert(self.keys, np.searchsorted(self.keys, new), new))
            self._added = np.empty(0, dtype=np.int64)

    def _place(self, keys: np.ndarray) -> np.ndarray:
        return np.minimum(np.searchsorted(self.keys, keys), max(len(self.keys) - 1, 0))
