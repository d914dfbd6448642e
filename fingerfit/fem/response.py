"""Stress and tangent of a material at the integration points of a body, in the principal directions.

The isotropic part has no shear components there; fibres, the memory of a viscoelastic material and an initial stress
have. Where the volume is averaged over an element, its part of the tangent couples the points and is left to the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fingerfit.material.invariant import FIRST, SECOND, invariant_part, rotate

if TYPE_CHECKING:
    from fingerfit.material.prony import Increment

_CLOSE = 1e-6
"""Relative difference of squared stretches below which the limit of the divided difference is used: there the error of
the limit, of the order of the difference, and that of the difference's own rounding, 2e-16 over it, are below 1e-6 and
1e-9 of the tangent (`tests/unit/test_ogden.py` has double and triple stretches)."""


class Constitutive(Protocol):
    """What the elements ask of a material; see `fingerfit.material.isotropic`."""

    prony: Any

    def energy(self, stretch: np.ndarray) -> np.ndarray: ...
    def derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray: ...
    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...
    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...
    def tensors(self) -> tuple: ...


@dataclass(frozen=True)
class Directed:
    """Stress and tangent of the parts with directions, components 11, 22, 33, 12, 13, 23."""

    energy: np.ndarray
    stress: np.ndarray
    tangent: np.ndarray


class Points:
    """A material at the integration points of a body.

    Parameters
    ----------
    material : material
        Constants of shape (points,).
    volumetric : bool
        False where the volumetric part is added by the body or by the averaged volume of nodes.

    Attributes
    ----------
    swelling : float or ndarray, shape (points,)
        Stretch by which the material would swell if nothing held it. Energies are per volume before that.
    """

    def __init__(self, material: Constitutive, volumetric: bool = True) -> None:
        self.material, self.whole = material, volumetric
        self.tensors = material.tensors()
        self.increment: Increment | None = None
        self.initial: np.ndarray | None = None
        self.swelling: float | np.ndarray = 1.0

    @property
    def directed(self) -> bool:
        """Whether there is any part with directions."""
        return bool(self.tensors) or self.increment is not None or self.initial is not None

    def hardly_compressed(self, count: int) -> bool:
        """Whether any of `count` points has a Poisson's ratio above 0.475, at small strain."""
        second = self.isotropic(np.ones((count, 3)))[1]
        shear = (second[:, 0, 0] - second[:, 0, 1]) / 2
        return bool((second[:, 0, 1] + 2 * shear / 3 > 20 * shear).any())

    def energy(self, squared: np.ndarray, frame: np.ndarray | None) -> np.ndarray:
        """Energy density in MPa, shape (points,), for squared stretches (points, 3) with their directions."""
        stretch = self._elastic(np.sqrt(squared))
        if self.increment is None:
            part = self.material.energy if self.whole else self.material.deviatoric_energy
            total = part(stretch)
        else:
            total = self.increment.scale * self.material.deviatoric_energy(stretch)
            if self.whole:
                jacobian = stretch.prod(axis=-1)
                total = total + self._in_time(self.material.volumetric(jacobian), jacobian)[0]
        if self.directed and frame is not None:
            total = total + self.directions(squared, frame).energy
        return total

    def isotropic(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the isotropic part by the logarithms of the stretches."""
        stretch = self._elastic(stretch)
        if self.increment is None:
            return (self.material.derivatives if self.whole else self.material.deviatoric_derivatives)(stretch)
        first, second = self.material.deviatoric_derivatives(stretch)
        first = first * self.increment.scale[:, None]
        second = second * self.increment.scale[:, None, None]
        if self.whole:
            jacobian = stretch.prod(axis=-1)
            _, pressure, bulk = self._in_time(self.material.volumetric(jacobian), jacobian)
            first += (pressure * jacobian)[:, None]
            second += (pressure * jacobian + bulk * jacobian**2)[:, None, None]
        return first, second

    def _elastic(self, stretch: np.ndarray) -> np.ndarray:
        """Stretches less those by which the points swell: F = F_e s. Parts with directions see no volume."""
        return stretch / np.asarray(self.swelling)[..., None]

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy density U of the volumetric part in MPa with its derivatives by the volume ratio, all of (points,)."""
        return self._in_time(swollen(self.material, jacobian, np.asarray(self.swelling) ** 3), jacobian)

    def elastic_pressure(self, jacobian: np.ndarray) -> np.ndarray:
        """Derivative of the volumetric energy by the volume ratio without memory, shape (points,), MPa.

        By the ratio less that of swelling where the points have this part themselves.
        """
        volume = np.asarray(self.swelling) ** 3
        pressure = self.material.volumetric(jacobian / volume)[1]
        return np.asarray(pressure if self.whole else pressure / volume)

    def _in_time(
        self, volumetric: tuple[np.ndarray, np.ndarray, np.ndarray], jacobian: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        now = self.increment
        return volumetric if now is None else remembered(volumetric, jacobian, now.bulk, now.pressure)

    def directions(self, squared: np.ndarray, frame: np.ndarray) -> Directed:
        """Parts with directions; `frame` has the principal directions as columns, shape (points, 3, 3)."""
        scale = 1.0 if self.increment is None else self.increment.scale
        energy, stress, tangent = _fibres(self.tensors, squared, frame)
        energy, stress = scale * energy, np.atleast_1d(scale)[:, None] * stress
        tangent = np.atleast_1d(scale)[:, None, None] * tangent
        if self.increment is not None:
            value, first, second = invariant_part(rotate(self.increment.memory, frame), squared)
            energy, stress, tangent = energy + value / 2, stress + first / 2, tangent + second / 2
        if self.initial is not None:
            turned = rotate(self.initial, frame)
            stress = stress + turned[:, FIRST, SECOND]
            energy = energy + (turned[:, [0, 1, 2], [0, 1, 2]] * (squared - 1)).sum(axis=1) / 2
        return Directed(energy, stress, tangent)

    def elastic_deviator(self, squared: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """J^(2/3) times the elastic deviatoric second Piola-Kirchhoff stress, shape (points, 3, 3), fixed axes."""
        first, _ = self.material.deviatoric_derivatives(np.sqrt(squared))
        _, components, _ = _fibres(self.tensors, squared, frame)
        components = components.copy()
        components[:, :3] += first / squared
        stress = np.zeros((len(squared), 3, 3))
        stress[:, FIRST, SECOND] = components
        stress[:, SECOND, FIRST] = components
        return squared.prod(axis=1)[:, None, None] ** (1 / 3) * rotate(stress, np.swapaxes(frame, 1, 2))

    def thickness_stretch(self, squared: np.ndarray, frame: np.ndarray | None) -> np.ndarray | None:
        """Squared stretch out of the plane at which there is no stress in that direction, shape (points,).

        Newton's method in the logarithm; None where it does not arrive.
        """
        squared = squared.copy()
        logarithm = -0.25 * np.log(squared[:, 0] * squared[:, 1])
        for _ in range(60):
            squared[:, 2] = np.exp(2 * logarithm)
            first, second = self.isotropic(np.sqrt(squared))
            force, slope = first[:, 2].copy(), second[:, 2, 2].copy()
            if self.directed and frame is not None:
                part = self.directions(squared, frame)
                third = squared[:, 2]
                force += part.stress[:, 2] * third
                slope += part.tangent[:, 2, 2] * third**2 + 2 * part.stress[:, 2] * third
            step = np.where(slope > 0, -force / slope, -0.1 * np.sign(force))
            logarithm = logarithm + np.clip(step, -0.3, 0.3)
            if not np.isfinite(step).all():
                return None
            if np.abs(step).max() < 1e-14:
                break
        else:
            if np.abs(step).max() > 1e-10:
                return None
        return np.exp(2 * logarithm)


def remembered(
    volumetric: tuple[np.ndarray, np.ndarray, np.ndarray],
    jacobian: np.ndarray,
    bulk: np.ndarray | float,
    pressure: np.ndarray | float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Energy of the volumetric part and its derivatives in a time increment: as of `Increment`."""
    energy, first, second = volumetric
    return bulk * energy + pressure * jacobian, bulk * first + pressure, bulk * second


def swollen(
    material: Constitutive, jacobian: np.ndarray, volume: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The volumetric energy of material that swells by a volume ratio, and its derivatives by the whole ratio."""
    energy, pressure, bulk = material.volumetric(jacobian / volume)
    return energy, pressure / volume, bulk / volume**2


def _fibres(tensors: tuple, squared: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = len(squared)
    energy, stress, tangent = np.zeros(count), np.zeros((count, 6)), np.zeros((count, 6, 6))
    for tensor in tensors:
        structure = np.broadcast_to(tensor.structure, (count, 3, 3))
        value, first, second = invariant_part(rotate(structure, frame), squared)
        density, slope, curve = tensor.of(value)
        energy += density
        stress += slope[:, None] * first
        tangent += slope[:, None, None] * second + curve[:, None, None] * first[:, :, None] * first[:, None, :]
    return energy, stress, tangent


def divided(
    stress: np.ndarray, second: np.ndarray, first: np.ndarray, squared: np.ndarray, i: int, j: int
) -> np.ndarray:
    """Divided difference (S_i - S_j) / (l_i^2 - l_j^2), or its limit where both are close."""
    gap = squared[..., i] - squared[..., j]
    close = np.abs(gap) < _CLOSE * squared[..., i]
    limit = (second[..., i, i] - 2 * first[..., i]) / squared[..., i] - second[..., i, j] / squared[..., j]
    safe = np.where(close, 1.0, gap)
    return np.where(close, limit / (2 * squared[..., i]), (stress[..., i] - stress[..., j]) / safe)
