"""Yeoh: W = sum_i C_i0 (I1 - 3)^i + sum_i 1 / D_i (J - 1)^(2 i) (ABAQUS, *HYPERELASTIC, YEOH or REDUCED POLYNOMIAL)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, by_first_invariant, deviatoric, polynomial, power_sum

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class Yeoh(Isotropic):
    """Constants of a Yeoh material.

    Parameters
    ----------
    c : tuple of floats, or of arrays of shape (points,)
        C10, C20 and so on in MPa, three in Yeoh's own law; twice the first is the initial shear modulus.
    d : tuple of float
        Compressibilities, 1/MPa; the initial bulk modulus is 2 / d[0].
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    c: tuple[float, ...]
    d: tuple[float, ...]
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        gap = power_sum(deviatoric(stretch), 2.0)[0] - 3
        return sum((c * gap**n for n, c in enumerate(self.c, 1)), np.zeros(gap.shape))

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, first, second = power_sum(deviatoric(stretch), 2.0)
        gap = value - 3
        slope, curve = np.zeros(gap.shape), np.zeros(gap.shape)
        for n, c in enumerate(self.c, 1):
            slope += n * c * gap ** (n - 1)
            if n > 1:
                curve += n * (n - 1) * c * gap ** (n - 2)
        return by_first_invariant(first, second, slope, curve)

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return polynomial(jacobian, self.d)
