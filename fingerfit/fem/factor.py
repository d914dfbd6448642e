"""Direct solution of the linear systems: PARDISO where it is installed, else SuperLU with a good order.

Large systems in space are what costs: there PARDISO (package pypardiso) is several times faster than SuperLU. Without
it, unknowns are ordered by nested dissection of the nodes' positions (George 1973), which has less fill than minimum
degree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

LARGE = 3000
"""Unknowns from which PARDISO or nested dissection pay."""
_LEAF = 40
"""Nodes that are not divided further."""
_RESIDUAL = 1e-6
"""Residual of a solution, relative to the right side, beyond which the matrix counts as singular."""


class LinearSolver:
    """Solves systems with the same unknowns again and again.

    Parameters
    ----------
    positions : ndarray or None, shape (unknowns, dim)
        Where the unknowns are, mm; unknowns at the same place stay together.
    symmetric : bool
        Whether the matrices are.
    """

    def __init__(self, positions: np.ndarray | None, symmetric: bool) -> None:
        self.positions, self.symmetric = positions, symmetric
        self._order: np.ndarray | None = None
        self._pardiso: _Pardiso | None = None
        self._asked = False

    def solve(self, matrix: csc_matrix, right: np.ndarray) -> np.ndarray | None:
        """Solution, or None where the matrix is singular."""
        if not len(right):
            return right
        large = len(right) >= LARGE
        if large and not self._asked:
            self._asked, self._pardiso = True, _Pardiso.load(self.symmetric)
        if self._pardiso is not None:
            return self._pardiso.solve(matrix, right)
        if large and self.positions is not None and self.positions.shape[1] == 3:
            return self._ordered(matrix, right)
        options: dict[str, Any] = {}
        if self.symmetric:
            options = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.001, "options": {"SymmetricMode": True}}
        return _superlu(matrix, right, options)

    def _ordered(self, matrix: csc_matrix, right: np.ndarray) -> np.ndarray | None:
        assert self.positions is not None
        if self._order is None:
            self._order = dissect(self.positions, matrix)
        order = self._order
        options = {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.001, "options": {"SymmetricMode": True}}
        found = _superlu(matrix[order][:, order].tocsc(), right[order], options)
        if found is None:
            return None
        solution = np.empty_like(found)
        solution[order] = found
        return solution


def _superlu(matrix: csc_matrix, right: np.ndarray, options: dict[str, Any]) -> np.ndarray | None:
    from scipy.sparse.linalg import splu

    try:
        solution = splu(matrix, **options).solve(right)
    except RuntimeError:
        return None
    return solution if np.isfinite(solution).all() else None


def dissect(positions: np.ndarray, matrix: csc_matrix) -> np.ndarray:
    """Order of elimination by nested dissection: halves first, what separates them last.

    Parameters
    ----------
    positions : ndarray, shape (unknowns, dim)
        mm.
    matrix : sparse, shape (unknowns, unknowns)
        Its pattern says what is coupled.

    Returns
    -------
    order : ndarray of int, shape (unknowns,)
    """
    from scipy.sparse import csr_matrix

    places, at = np.unique(positions, axis=0, return_inverse=True)
    at = at.ravel()
    entries = matrix.tocoo()
    ones = np.ones(len(entries.row), dtype=bool)
    graph = csr_matrix((ones, (at[entries.row], at[entries.col])), shape=(len(places), len(places)))
    parts: list[np.ndarray] = []
    inside = np.zeros(len(places), dtype=bool)

    def divide(nodes: np.ndarray) -> None:
        x = places[nodes]
        axis = int(np.ptp(x, axis=0).argmax())
        low = x[:, axis] < np.median(x[:, axis])
        if len(nodes) <= _LEAF or not low.any():
            parts.append(nodes)
            return
        inside[nodes[low]] = True
        high = nodes[~low]
        separates = (graph[high] @ inside) > 0
        inside[nodes[low]] = False
        divide(nodes[low])
        if not separates.all():
            divide(high[~separates])
        parts.append(high[separates])

    divide(np.arange(len(places)))
    rank = np.empty(len(places), dtype=int)
    rank[np.concatenate(parts)] = np.arange(len(places))
    return np.argsort(rank[at], kind="stable")


class _Pardiso:
    """PARDISO through pypardiso; the analysis of a pattern is kept."""

    def __init__(self, solver: Any, symmetric: bool) -> None:
        self._solver, self._symmetric = solver, symmetric
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def load(cls, symmetric: bool) -> _Pardiso | None:
        """None where pypardiso or its library is not installed."""
        try:
            from pypardiso import PyPardisoSolver

            return cls(PyPardisoSolver(mtype=-2 if symmetric else 11), symmetric)
        except (ImportError, OSError):
            return None

    def solve(self, matrix: csc_matrix, right: np.ndarray) -> np.ndarray | None:
        from scipy.sparse import csr_matrix, tril

        if self._symmetric:
            # the lower triangle by columns is the upper one by rows
            lower = tril(matrix, format="csc")
            given = csr_matrix((lower.data, lower.indices, lower.indptr), shape=matrix.shape)
        else:
            given = matrix.tocsr()
        given.sort_indices()
        known = self._pattern is not None and all(
            np.array_equal(a, b) for a, b in zip(self._pattern, (given.indptr, given.indices), strict=True)
        )
        try:
            self._solver.set_phase(22 if known else 12)
            self._solver._call_pardiso(given, np.zeros((len(right), 1)))
            self._pattern = given.indptr, given.indices
            self._solver.set_phase(33)
            solution = self._solver._call_pardiso(given, np.ascontiguousarray(right[:, None])).ravel()
        except RuntimeError:  # pypardiso's error for what MKL reports
            self._pattern = None
            return None
        if not np.isfinite(solution).all():
            return None
        error = np.abs(matrix @ solution - right).max()
        return solution if error <= _RESIDUAL * np.abs(right).max() else None

    def __del__(self) -> None:
        self._solver.free_memory(everything=True)
