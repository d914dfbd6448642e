"""What all isotropic materials share: energy and its derivatives by the logarithms of the principal stretches.

A material is a frozen dataclass of constants with three methods for its deviatoric and its volumetric part. Elements
need nothing else: `derivatives` gives the principal Kirchhoff stresses and the consistent tangent (Ogden, Non-linear
Elastic Deformations, section 6.1.4), the same way for every material.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


class Isotropic:
    """Material that is the sum of a deviatoric and a volumetric part."""

    prony: Prony | None
    """Relaxation of the deviatoric part."""

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        """Energy density of the deviatoric part in MPa, shape (...), for principal stretches of shape (..., 3)."""
        raise NotImplementedError

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the deviatoric part alone, as `derivatives`."""
        raise NotImplementedError

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy density U(J) of the volumetric part with its first and second derivative, MPa."""
        raise NotImplementedError

    def energy(self, stretch: np.ndarray) -> np.ndarray:
        """Strain energy density in MPa for principal stretches of shape (..., 3)."""
        return self.deviatoric_energy(stretch) + self.volumetric(stretch.prod(axis=-1))[0]

    def derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the energy by the logarithms e of the principal stretches.

        Parameters
        ----------
        stretch : ndarray, shape (..., 3)

        Returns
        -------
        first : ndarray, shape (..., 3)
            dW/de_a, the principal Kirchhoff stresses in MPa.
        second : ndarray, shape (..., 3, 3)
            d2W/de_a de_b in MPa.
        """
        first, second = self.deviatoric_derivatives(stretch)
        jacobian = stretch.prod(axis=-1)
        _, pressure, bulk = self.volumetric(jacobian)
        first += (pressure * jacobian)[..., None]
        second += (pressure * jacobian + bulk * jacobian**2)[..., None, None]
        return first, second

    def tensors(self) -> tuple[Tensor, ...]:
        """Parts of the energy that have directions, as functions of M : C with a tensor M; none here."""
        return ()


class Tensor(Protocol):
    """A part f(I) of the energy, I = M : J^(-2/3) C; see `fingerfit.material.invariant`."""

    @property
    def structure(self) -> np.ndarray:
        """M, shape (3, 3) or (points, 3, 3)."""

    def of(self, invariant: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f in MPa with its first and second derivative by the invariant, shape (points,)."""


def deviatoric(stretch: np.ndarray) -> np.ndarray:
    """Logarithms of the deviatoric stretches J^(-1/3) lambda, shape (..., 3)."""
    logarithm = np.log(stretch)
    logarithm -= mean(logarithm)
    return logarithm


def mean(values: np.ndarray) -> np.ndarray:
    """Mean over the last axis, of three, which stays; `numpy.mean` takes six times as long for so few."""
    return (values[..., :1] + values[..., 1:2] + values[..., 2:]) / 3


def diagonal(matrices: np.ndarray) -> np.ndarray:
    """The diagonals of matrices as a view."""
    return np.einsum("...ii->...i", matrices)


def power_sum(logarithm: np.ndarray, alpha: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum P of the deviatoric stretches to the power alpha, with its derivatives by the logarithms of the stretches.

    P(2) and P(-2) are the first and the second invariant of the deviatoric C.

    Returns
    -------
    value : ndarray, shape (...)
    first : ndarray, shape (..., 3)
    second : ndarray, shape (..., 3, 3)
    """
    power = np.exp(alpha * logarithm)
    middle = mean(power)
    second = (alpha**2 / 3) * (middle[..., None] - power[..., :, None] - power[..., None, :])
    diagonal(second)[...] += alpha**2 * power
    return 3 * middle[..., 0], alpha * (power - middle), second


def by_first_invariant(
    first: np.ndarray, second: np.ndarray, slope: np.ndarray, curve: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of f(I1) by the logarithms of the stretches, from those of I1 and f' and f'' of shape (...)."""
    outer = first[..., :, None] * first[..., None, :]
    return column(slope) * first, column(slope)[..., None] * second + column(curve)[..., None] * outer


def polynomial(jacobian: np.ndarray, d: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """U = sum_i 1 / D_i (J - 1)^(2 i) with its first and second derivative, MPa; D in 1/MPa."""
    gap = jacobian - 1
    pressure = 2 / d[0] * gap
    energy, bulk = pressure * gap / 2, np.broadcast_to(2 / d[0], gap.shape)
    for order, constant in enumerate(d[1:], 2):
        n = 2 * order
        energy += gap**n / constant
        pressure += n / constant * gap ** (n - 1)
        bulk = bulk + n * (n - 1) / constant * gap ** (n - 2)
    return energy, pressure, bulk


def column(constant: float | np.ndarray) -> np.ndarray:
    """A constant, or one for each point, that multiplies values of shape (points, 3)."""
    return np.asarray(constant)[..., None]
