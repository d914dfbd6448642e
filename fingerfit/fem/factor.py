"""Direct solution of the linear systems: PARDISO where it is installed, else SuperLU with a good order.

Large systems in space are what costs: there PARDISO (package pypardiso) is several times faster than SuperLU. Without
it, unknowns are ordered by METIS's nested dissection (Karypis and Kumar 1998), which has less fill than minimum
degree. A factorisation there costs as much as some tens of solutions with it, and in Newton's method the matrix changes
little, or in a few entries where nodes come into contact: the last factorisation preconditions conjugate gradients, and
a new one is made when they do not converge soon (docs/decisions/0006-large-systems.md).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

LARGE = 3000
"""Unknowns from which PARDISO or nested dissection pay: a job that a workflow starts a thousand times must not load MKL
(docs/decisions/0006-large-systems.md)."""
_RESIDUAL = 1e-6
"""Residual of a solution, relative to the right side, beyond which the matrix counts as singular: far above what
rounding leaves of a regular one. A choice."""
_GRADIENTS = 20
"""Solutions with an old factorisation that a system may take; a new one costs about as much: 0.35 s against 0.012 s by
PARDISO for 20 000 unknowns (docs/decisions/0006-large-systems.md)."""
CLOSE = 1e-6
"""Residual of conjugate gradients, relative to the right side in the norm of the preconditioner, where no other is
asked for: Newton's method asks for as much as it can use."""

Apply = Callable[[np.ndarray], np.ndarray]


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
        self._last: Apply | None = None
        self._factorised: tuple[csc_matrix, Apply] | None = None

    def beside(self) -> LinearSolver:
        """Another one for the same unknowns: what it factorises leaves the factors of this one as they are."""
        other = LinearSolver(self.positions, self.symmetric)
        other._order = self._order
        return other

    def solve(self, matrix: csc_matrix, right: np.ndarray, close: float = CLOSE) -> np.ndarray | None:
        """Solution, or None where the matrix is singular; the same matrix once more is not factorised again.

        Parameters
        ----------
        matrix : sparse, shape (n, n)
        right : ndarray, shape (n,)
        close : float
            Residual that is wanted where it is iterated.
        """
        if not len(right):
            return right
        large = len(right) >= LARGE
        again = self._factorised[1] if self._factorised is not None and self._factorised[0] is matrix else None
        if self._last is not None and again is None:
            found = conjugate_gradients(matrix, right, self._last, close)
            if found is not None:
                return found
            self._last = None
        apply = again or self.factor(matrix)
        if apply is None:
            return None
        solution = apply(right)
        if not np.isfinite(solution).all():
            return None
        if large:
            residual = matrix @ solution - right
            if np.abs(residual).max() > _RESIDUAL * np.abs(right).max():
                return None
        if large and self._in_space is not None and self.symmetric:
            self._last = apply
        return solution

    @property
    def _in_space(self) -> np.ndarray | None:
        return self.positions if self.positions is not None and self.positions.shape[1] == 3 else None

    def factor(self, matrix: csc_matrix) -> Apply | None:
        """From a right side to its solution, for as long as nothing else is factorised; None where it is singular."""
        self._factorised = None
        apply = self._factor(matrix)
        if apply is not None:
            self._factorised = matrix, apply
        return apply

    def _factor(self, matrix: csc_matrix) -> Apply | None:
        large, in_space = matrix.shape[0] >= LARGE, self._in_space
        if large and not self._asked:
            self._asked, self._pardiso = True, _Pardiso.load(self.symmetric)
        if self._pardiso is not None:
            return self._pardiso.factor(matrix)
        if large and in_space is not None:
            return self._ordered(matrix, in_space)
        options: dict[str, Any] = {}
        if self.symmetric:
            options = {**_SYMMETRIC, "permc_spec": "MMD_AT_PLUS_A"}
        return _superlu(matrix, options)

    def _ordered(self, matrix: csc_matrix, positions: np.ndarray) -> Apply | None:
        if self._order is None:
            self._order = dissect(positions, matrix)
        order = self._order
        inner = _superlu(matrix[order][:, order].tocsc(), {**_SYMMETRIC, "permc_spec": "NATURAL"})
        if inner is None:
            return None

        def apply(right: np.ndarray) -> np.ndarray:
            solution = np.empty_like(right)
            solution[order] = inner(right[order])
            return solution

        return apply


def conjugate_gradients(
    matrix: csc_matrix, right: np.ndarray, precondition: Apply, close: float = CLOSE
) -> np.ndarray | None:
    """Solution of a symmetric system by preconditioned conjugate gradients; None where they do not converge soon.

    Parameters
    ----------
    matrix : sparse, shape (n, n)
    right : ndarray, shape (n,)
    precondition : function
        Solves nearly the same system.
    close : float
        Residual that is wanted, relative to the right side in the norm of the preconditioner.
    """
    solution = np.zeros_like(right)
    residual = right.copy()
    better = precondition(residual)
    way, size = better, inner(residual, better)
    first = size
    for count in range(1, _GRADIENTS + 1):
        along = matrix @ way
        curvature = inner(way, along)
        if not (size > 0 and curvature > 0):
            return None
        solution += size / curvature * way
        residual -= size / curvature * along
        better = precondition(residual)
        before, size = size, inner(residual, better)
        if not size > close**2 * first:
            return solution if np.isfinite(solution).all() else None
        # at this rate it would take too long
        if count > 2 and size > first * close ** (2 * count / _GRADIENTS):
            return None
        way = better + size / before * way
    return None


def inner(a: np.ndarray, b: np.ndarray) -> float:
    """Scalar product that does not depend on the number of threads, as that of BLAS does."""
    return float(np.einsum("i,i->", a, b))


_SYMMETRIC: dict[str, Any] = {"diag_pivot_thresh": 0.001, "options": {"SymmetricMode": True}}
"""SuperLU for symmetric matrices: a pivot beside the diagonal only where that is below a thousandth of its column. A
choice."""


def _superlu(matrix: csc_matrix, options: dict[str, Any]) -> Apply | None:
    from scipy.sparse.linalg import splu

    try:
        return splu(matrix, **options).solve
    except RuntimeError:
        return None


def dissect(positions: np.ndarray, matrix: csc_matrix) -> np.ndarray:
    """Order of elimination by nested dissection: parts first, what separates them last (METIS).

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
    from pymetis import CSRAdjacency, nested_dissection
    from scipy.sparse import csr_matrix

    places, at = np.unique(positions, axis=0, return_inverse=True)
    at = at.ravel()
    entries = matrix.tocoo()
    row, column = at[entries.row], at[entries.col]
    between = row != column  # METIS takes neither loops nor ways in one direction
    ones = np.ones(int(between.sum()), dtype=bool)
    graph = csr_matrix((ones, (row[between], column[between])), shape=(len(places), len(places)))
    graph = graph + graph.T
    _, rank = nested_dissection(CSRAdjacency(graph.indptr, graph.indices))
    return np.argsort(np.asarray(rank)[at], kind="stable")


class _Pardiso:
    """PARDISO through pypardiso; the analysis of a pattern is kept."""

    def __init__(self, solver: Any, symmetric: bool) -> None:
        self._solver, self._symmetric = solver, symmetric
        self._pattern: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def load(cls, symmetric: bool) -> _Pardiso | None:
        """None where pypardiso or its library is not installed."""
        # else pypardiso looks through all folders of the environment for it
        library = next(Path(sys.prefix, "lib").glob("libmkl_rt.so.*"), None)
        # threads that wait for work would take the processor from others
        os.environ.setdefault("KMP_BLOCKTIME", "0")
        # the same digits with any number of threads, for a twentieth of the time
        os.environ.setdefault("MKL_CBWR", "AUTO")
        if library is not None:
            os.environ.setdefault("PYPARDISO_MKL_RT", str(library))
        try:
            from pypardiso import PyPardisoSolver

            solver = PyPardisoSolver(mtype=-2 if symmetric else 11)
        except (ImportError, OSError):
            return None
        if symmetric:
            # MKL's defaults refine every solution twice, which takes three times as long; `solve` checks the residual
            for number, value in {1: 1, 2: 2, 10: 8, 21: 1}.items():
                solver.set_iparm(number, value)
        return cls(solver, symmetric)

    def factor(self, matrix: csc_matrix) -> Apply | None:
        """Factorise; the last factorisation goes."""
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
        self._pattern = None
        try:
            self._solver.set_phase(22 if known else 12)
            self._solver._call_pardiso(given, np.zeros((matrix.shape[0], 1)))
        except RuntimeError:  # pypardiso's error for what MKL reports
            return None
        self._pattern = given.indptr, given.indices

        def apply(right: np.ndarray) -> np.ndarray:
            self._solver.set_phase(33)
            return self._solver._call_pardiso(given, np.ascontiguousarray(right[:, None])).ravel()

        return apply

    def __del__(self) -> None:
        self._solver.free_memory(everything=True)
