"""Mooney-Rivlin: W = C10 (I1 - 3) + C01 (I2 - 3) + 1 / D (J - 1)^2, deviatoric invariants (ABAQUS, *HYPERELASTIC)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, column, deviatoric, polynomial, power_sum

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class MooneyRivlin(Isotropic):
    """Constants of a Mooney-Rivlin material.

    Parameters
    ----------
    c10, c01 : float, or arrays of shape (points,)
        MPa; twice their sum is the initial shear modulus.
    d : tuple of one float
        Compressibility, 1/MPa; the initial bulk modulus is 2 / d[0].
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    c10: float
    c01: float
    d: tuple[float, ...]
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        logarithm = deviatoric(stretch)
        one, two = power_sum(logarithm, 2.0)[0], power_sum(logarithm, -2.0)[0]
        return self.c10 * (one - 3) + self.c01 * (two - 3)

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        logarithm = deviatoric(stretch)
        first, second = np.zeros(stretch.shape), np.zeros((*stretch.shape, 3))
        for constant, alpha in ((self.c10, 2.0), (self.c01, -2.0)):
            _, by, twice = power_sum(logarithm, alpha)
            first += column(constant) * by
            second += column(constant)[..., None] * twice
        return first, second

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return polynomial(jacobian, self.d)
