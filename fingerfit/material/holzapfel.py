"""Fibre-reinforced tissue of Holzapfel, Gasser and Ogden (J. R. Soc. Interface 3, 2006), as ABAQUS has it.

W = C10 (I1 - 3) + 1 / D ((J^2 - 1) / 2 - ln J) + k1 / (2 k2) sum_f (exp(k2 <E_f>^2) - 1) with
E_f = kappa (I1 - 3) + (1 - 3 kappa) (I4f - 1) of the deviatoric C; <E> is E where positive, else 0: fibres do not push
(ABAQUS, *ANISOTROPIC HYPERELASTIC, HOLZAPFEL). E_f + 1 is one invariant of the tensor kappa 1 + (1 - 3 kappa) a a.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, Tensor, column, deviatoric, power_sum

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class Fibres:
    """One family of fibres.

    Parameters
    ----------
    k1, k2 : float, or arrays of shape (points,)
        Stiffness in MPa and exponent.
    structure : ndarray, shape (3, 3) or (points, 3, 3)
        kappa 1 + (1 - 3 kappa) a a.
    """

    k1: float
    k2: float
    structure: np.ndarray

    def of(self, invariant: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy and its derivatives by the invariant."""
        strain = np.maximum(invariant - 1, 0.0)
        exponential = np.exp(self.k2 * strain**2)
        curve = self.k1 * (1 + 2 * self.k2 * strain**2) * exponential
        energy = self.k1 / (2 * np.asarray(self.k2)) * (exponential - 1)
        return energy, self.k1 * strain * exponential, np.where(strain > 0, curve, 0.0)


@dataclass(frozen=True)
class Holzapfel(Isotropic):
    """Constants of a fibre-reinforced material.

    Parameters
    ----------
    c10 : float, or array of shape (points,)
        MPa, of the matrix.
    d : float, or array of shape (points,)
        Compressibility, 1/MPa; the initial bulk modulus is 2 / d.
    k1, k2 : float, or arrays of shape (points,)
        MPa and dimensionless, of the fibres.
    kappa : float, or array of shape (points,)
        Dispersion, 0 (aligned) to 1/3 (isotropic).
    directions : tuple of (float, float, float), or of arrays of shape (points, 3)
        Unit vector of each family of fibres in the reference state.
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    c10: float
    d: float
    k1: float
    k2: float
    kappa: float
    directions: tuple[tuple[float, float, float], ...] = ((1.0, 0.0, 0.0),)
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        return self.c10 * (power_sum(deviatoric(stretch), 2.0)[0] - 3)

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        _, first, second = power_sum(deviatoric(stretch), 2.0)
        return column(self.c10) * first, column(self.c10)[..., None] * second

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        energy = ((jacobian**2 - 1) / 2 - np.log(jacobian)) / self.d
        return energy, (jacobian - 1 / jacobian) / self.d, (1 + jacobian**-2) / self.d

    def tensors(self) -> tuple[Tensor, ...]:
        kappa = np.asarray(self.kappa)[..., None, None]
        families = []
        for direction in self.directions:
            a = np.asarray(direction, dtype=float)
            structure = kappa * np.eye(3) + (1 - 3 * kappa) * a[..., :, None] * a[..., None, :]
            families.append(Fibres(self.k1, self.k2, structure))
        return tuple(families)
