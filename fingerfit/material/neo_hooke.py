"""Neo-Hooke: W = C10 (I1 - 3) + 1 / D (J - 1)^2 with the deviatoric invariant I1 (ABAQUS, *HYPERELASTIC, NEO HOOKE)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, column, deviatoric, polynomial, power_sum

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class NeoHooke(Isotropic):
    """Constants of a neo-Hookean material.

    Parameters
    ----------
    c10 : float, or array of shape (points,)
        MPa; half of the initial shear modulus.
    d : tuple of one float
        Compressibility, 1/MPa; the initial bulk modulus is 2 / d[0].
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    c10: float
    d: tuple[float, ...]
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        return self.c10 * (power_sum(deviatoric(stretch), 2.0)[0] - 3)

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, first, second = power_sum(deviatoric(stretch), 2.0)
        return column(self.c10) * first, column(self.c10)[..., None] * second

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return polynomial(jacobian, self.d)
