"""Linear elasticity, and what it becomes at finite strain.

In a step without NLGEOM the stress is linear in the small strain. With NLGEOM, CalculiX makes the second
Piola-Kirchhoff stress linear in Green's strain (St.Venant-Kirchhoff), which is what is done here. ABAQUS makes the
stress linear in the logarithmic strain (Hencky); so do elements here that average the volume, because only that law
splits into a deviatoric and a volumetric part. Up to a few per cent of strain they are the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, column, deviatoric, diagonal

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class Elastic(Isotropic):
    """Constants of an isotropic linear elastic material (ABAQUS, *ELASTIC).

    Parameters
    ----------
    young : float, or array of shape (points,)
        Young's modulus, MPa.
    poisson : float, or array of shape (points,)
        Poisson's ratio.
    prony : Prony or None
        Relaxation of the deviatoric part; the law is Hencky's then.
    """

    young: float
    poisson: float
    prony: Prony | None = None

    @property
    def shear(self) -> np.ndarray:
        """Shear modulus, MPa."""
        return np.asarray(self.young / (2 * (1 + self.poisson)))

    @property
    def bulk(self) -> np.ndarray:
        """Bulk modulus, MPa."""
        return np.asarray(self.young / (3 * (1 - 2 * self.poisson)))

    def energy(self, stretch: np.ndarray) -> np.ndarray:
        if self.prony is not None:
            return super().energy(stretch)
        green = (stretch**2 - 1) / 2
        lame = self.bulk - 2 * self.shear / 3
        return lame / 2 * green.sum(axis=-1) ** 2 + self.shear * (green**2).sum(axis=-1)

    def derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if self.prony is not None:
            return super().derivatives(stretch)
        squared = stretch**2
        green = (squared - 1) / 2
        lame, shear = column(self.bulk - 2 * self.shear / 3), column(self.shear)
        stress = lame * green.sum(axis=-1, keepdims=True) + 2 * shear * green
        second = lame[..., None] * squared[..., :, None] * squared[..., None, :]
        diagonal(second)[...] += 2 * shear * squared**2 + 2 * stress * squared
        return stress * squared, second

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        logarithm = deviatoric(stretch)
        return self.shear * (logarithm**2).sum(axis=-1)

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        logarithm = deviatoric(stretch)
        twice = 2 * column(self.shear)
        projector = np.broadcast_to(np.eye(3) - 1 / 3, (*stretch.shape, 3))
        return twice * logarithm, twice[..., None] * projector

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        logarithm, bulk = np.log(jacobian), self.bulk
        return bulk / 2 * logarithm**2, bulk * logarithm / jacobian, bulk * (1 - logarithm) / jacobian**2
