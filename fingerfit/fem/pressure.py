"""The pressure field of an element's own, and what foretells it in Newton's method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.mesh.elements import ELEMENTS


def projection(element: str, xi: np.ndarray, weight: np.ndarray) -> np.ndarray | None:
    """Least-squares projection of values at the points on a hybrid element's pressure field.

    Shape (elements, points, points); None for elements without a pressure of their own. The field is eliminated in
    each element (Simo, Taylor and Pister 1985): it takes the place of the volume ratio in the energy.
    """
    terms = ELEMENTS[element].pressure
    if not terms:
        return None
    basis = np.column_stack([np.ones(len(xi)), xi])[:, :terms]
    weighted = basis.T[None] * weight[:, None, :]
    return basis @ np.linalg.solve(weighted @ basis, weighted)


@dataclass(frozen=True)
class Lead:
    """Volume ratio to first order from where it is known.

    On the way to equilibrium the volume of a nearly incompressible element is wrong by what its last move left out at
    second order; times the bulk modulus that is a large pressure, and a tangent with it points elsewhere. So the
    tangent is made with the pressure that the last one foretold, as if pressure were an unknown, and equilibrium takes
    half the iterations (Magisano, Leonetti and Garcea, Int. J. Numer. Meth. Engng 2017, do so with all stresses).
    Forces, and so the equilibrium, are not touched. Elements without a pressure field have it at their points.

    Parameters
    ----------
    local : ndarray, shape (elements, dofs)
        Displacements, mm.
    volume : ndarray, shape (elements * points,)
        Volume ratio there.
    slope : ndarray or None, shape (elements, points, dofs)
        Its derivative; None at the beginning of an increment, where it is taken to stay.
    """

    local: np.ndarray
    volume: np.ndarray
    slope: np.ndarray | None = None

    def at(self, local: np.ndarray) -> np.ndarray:
        """Volume ratio at other displacements, flat."""
        if self.slope is None:
            return self.volume
        return self.volume + (self.slope @ (local - self.local)[..., None]).ravel()
