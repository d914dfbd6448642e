"""The reduced system of equations: constraints eliminated, pattern and order made once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fingerfit.fem.assembly import Body

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix


class System:
    """Scatters element forces and stiffnesses to the unknowns and solves for them.

    Parameters
    ----------
    bodies : list of Body
        All elements.
    size : int
        Number of degrees of freedom.
    prescribed : ndarray of bool, shape (size,)
        Degrees of freedom with a given displacement.
    ties : dict
        Slave to (master, factor): u_slave = factor * u_master.
    """

    def __init__(
        self, bodies: list[Body], size: int, prescribed: np.ndarray, ties: dict[int, tuple[int, float]]
    ) -> None:
        self.bodies, self.size = bodies, size
        self.master, self.factor = np.arange(size), np.ones(size)
        for slave, (master, factor) in ties.items():
            self.master[slave], self.factor[slave] = master, factor
        free = ~prescribed
        free[list(ties)] = False
        touched = np.zeros(size, dtype=bool)
        for body in bodies:
            touched[self.master[body.dofs].ravel()] = True
        free &= touched
        self.free = np.flatnonzero(free)
        number = np.full(size, -1)
        number[self.free] = np.arange(len(self.free))
        self.unknown = number[self.master]
        self._prepare()

    def _prepare(self) -> None:
        keys, self._kept, self._factors = [], [], []
        count = len(self.free)
        for body in self.bodies:
            unknown, factor = self.unknown[body.dofs], self.factor[body.dofs]
            row = np.broadcast_to(unknown[:, :, None], (*unknown.shape, unknown.shape[1])).ravel()
            column = np.broadcast_to(unknown[:, None, :], (*unknown.shape, unknown.shape[1])).ravel()
            kept = np.flatnonzero((row >= 0) & (column >= 0))
            keys.append(column[kept].astype(np.int64) * count + row[kept])
            self._kept.append(kept)
            both = (factor[:, :, None] * factor[:, None, :]).ravel()[kept]
            self._factors.append(None if np.all(both == 1.0) else both)
        unique, self._position = np.unique(np.concatenate(keys), return_inverse=True)
        self._rows = (unique % count).astype(np.int32)
        self._pointers = np.searchsorted(unique // count, np.arange(count + 1)).astype(np.int32)

    def expand(self, q: np.ndarray, given: np.ndarray) -> np.ndarray:
        """All displacements from the unknowns and the given ones (zero elsewhere)."""
        full = given.copy()
        full[self.free] = q
        return self.factor * full[self.master]

    def reduce(self, full: np.ndarray) -> np.ndarray:
        """Forces on all degrees of freedom to forces on the unknowns."""
        chosen = self.unknown >= 0
        return np.bincount(self.unknown[chosen], weights=(full * self.factor)[chosen], minlength=len(self.free))

    def gather(self, forces: list[np.ndarray]) -> np.ndarray:
        """Element forces to nodal forces, shape (size,)."""
        total = np.zeros(self.size)
        for body, force in zip(self.bodies, forces, strict=True):
            total += np.bincount(body.dofs.ravel(), weights=force.ravel(), minlength=self.size)
        return total

    def matrix(self, stiffness: list[np.ndarray]) -> csc_matrix:
        """Stiffness of the unknowns from element stiffnesses."""
        from scipy.sparse import csc_matrix

        values = []
        for block, kept, factors in zip(stiffness, self._kept, self._factors, strict=True):
            chosen = block.ravel()[kept]
            values.append(chosen if factors is None else chosen * factors)
        data = np.bincount(self._position, weights=np.concatenate(values), minlength=len(self._rows))
        count = len(self.free)
        return csc_matrix((data, self._rows, self._pointers), shape=(count, count))

    def solve(self, matrix: csc_matrix, right: np.ndarray) -> np.ndarray | None:
        """Solution of the unknowns, or None where the matrix is singular."""
        from scipy.sparse.linalg import splu

        try:
            factor = splu(
                matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.001,
                options={"SymmetricMode": True},
            )
        except RuntimeError:
            return None
        solution = factor.solve(right)
        return solution if np.isfinite(solution).all() else None
