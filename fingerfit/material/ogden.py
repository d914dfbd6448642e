"""Ogden's hyperelastic material, split into a deviatoric and a volumetric part.

W = sum_i 2 mu_i / alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3) + sum_i 1 / D_i (J - 1)^(2 i) with the
deviatoric stretches l = J^(-1/3) lambda, as ABAQUS and CalculiX define it (CalculiX manual, *HYPERELASTIC).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, deviatoric, diagonal, mean, polynomial

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class Ogden(Isotropic):
    """Constants of an Ogden material of any order.

    Parameters
    ----------
    mu : tuple of float, or of arrays of shape (points,)
        Shear constants, MPa; their sum is the initial shear modulus.
    alpha : tuple of float
        Exponents.
    d : tuple of float
        Compressibilities, 1/MPa; the initial bulk modulus is 2 / d[0].
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    mu: tuple[float, ...]
    alpha: tuple[float, ...]
    d: tuple[float, ...]
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        """Energy density of the deviatoric part alone, as `energy`."""
        logarithm = deviatoric(stretch)
        total = np.zeros(stretch.shape[:-1])
        for mu, alpha in zip(self.mu, self.alpha, strict=True):
            power = np.exp(np.asarray(alpha)[..., None] * logarithm)
            total += 2 * mu / np.square(alpha) * (power.sum(axis=-1) - 3)
        return total

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the deviatoric part alone, as `derivatives`."""
        logarithm = deviatoric(stretch)
        first = np.zeros(stretch.shape)
        second = np.zeros((*stretch.shape, 3))
        for mu_i, alpha_i in zip(self.mu, self.alpha, strict=True):
            mu, alpha = np.asarray(mu_i)[..., None], np.asarray(alpha_i)[..., None]
            power = np.exp(alpha * logarithm)
            middle = mean(power)
            first += 2 * mu / alpha * (power - middle)
            power *= 2 * mu / 3
            second += (2 * mu / 3 * middle)[..., None] - power[..., :, None] - power[..., None, :]
            diagonal(second)[...] += 3 * power
        return first, second

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy density U(J) of the volumetric part with its first and second derivative, MPa."""
        return polynomial(jacobian, self.d)
