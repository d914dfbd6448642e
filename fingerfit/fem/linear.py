"""Bodies at small strain: the stiffness of the reference state, once and for all."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from fingerfit.core.errors import SolverError
from fingerfit.fem.assembly import Body

T = TypeVar("T")


def _at_rest(found: T | None) -> T:
    """Forces of the reference state, which a mesh without inverted elements and faces has."""
    if found is None:
        raise SolverError("an element or a face is inverted before anything moves: a linear step starts from there")
    return found


class LinearBody:
    """A body in a step without NLGEOM.

    Parameters
    ----------
    body : Body
        An initial stress adds its forces, but no stiffness.
    """

    def __init__(self, body: Body) -> None:
        still = np.zeros((int(body.connectivity.max()) + 1) * body.dim)
        initial, body.points.initial = body.points.initial, None
        body.begin(0.0)
        found = _at_rest(body.forces(still))
        self.body, self.dim, self.dofs, self._stiffness, self._start = (
            body,
            body.dim,
            body.dofs,
            found[1],
            np.zeros(found[0].shape),
        )
        body.points.initial = initial
        body.begin(0.0)
        if initial is not None:
            self._start = _at_rest(body.forces(still, tangent=False))[0]

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Nothing: small strain has no history here."""

    def settle(self, u: np.ndarray) -> None:
        """Nothing: no pressure is foretold."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def forces(self, u: np.ndarray, tangent: bool = True, led: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Element forces and stiffnesses, as `Body.forces`."""
        return self._start + (self._stiffness @ u[self.dofs][..., None])[..., 0], self._stiffness

    def energy(self, u: np.ndarray) -> float:
        """Strain energy in N mm."""
        return float(((self._start + self.forces(u)[0]) * u[self.dofs]).sum()) / 2


class LinearTerm:
    """A term of `fingerfit.fem.system` in a step without NLGEOM: its forces continued from the reference state."""

    def __init__(self, term, size: int) -> None:  # type: ignore[no-untyped-def]
        found = _at_rest(term.forces(np.zeros(size)))
        self.start, self.dofs, self.symmetric = found, term.dofs, term.symmetric

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def forces(self, u: np.ndarray, tangent: bool = True):  # type: ignore[no-untyped-def]
        """Internal forces and stiffness."""
        from fingerfit.fem.system import Contribution

        s = self.start
        change = np.bincount(s.rows, weights=s.values * u[s.columns], minlength=len(s.force))
        return Contribution(s.force + change, s.rows, s.columns, s.values)

    def energy(self, u: np.ndarray) -> float:
        """Energy in N mm."""
        return float(((self.start.force + self.forces(u).force) @ u) / 2)
