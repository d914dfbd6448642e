"""Strain energy, stress and tangent at the quadrature points, as felupe asks for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


def bulk_modulus(mu: Array, nu: Array) -> Array:
    """Initial bulk modulus of the shear modulus and Poisson's ratio."""
    return 2 * mu * (1 + nu) / (3 * (1 - 2 * nu))


@dataclass
class Material:
    """Law of isotropic bodies in principal stretches; all numbers are arrays (points, cells).

    The deviatoric energy is 2 mu / alpha^2 (sum of stretch^alpha - 3), or mu / (2 b) (exp(b (I1 - 3)) - 1) where
    b > 0. The pressure is bulk (J - 1) + offset. The body grows by the factor `grown` in each direction before it
    strains. `weight` multiplies the energy (thickness out of the plane).
    """

    mu: Array
    alpha: Array
    bulk: Array
    b: Array
    offset: Array
    grown: Array
    weight: Array

    def __post_init__(self) -> None:
        """Name the shapes of stress and state, as felupe asks."""
        self.x = [np.zeros((3, 3)), np.zeros(0)]

    def energy(self, stretch: Array, j: Array) -> Array:
        """Energy per unit of unloaded volume; `stretch` (3, points, cells) and `j` without growth."""
        bar = stretch / j ** (1 / 3)
        ogden = 2 * self.mu / self.alpha**2 * ((bar**self.alpha).sum(0) - 3)
        b = np.where(self.b > 0, self.b, 1.0)
        exponential = self.mu / (2 * b) * (np.exp(b * ((bar**2).sum(0) - 3)) - 1)
        volume = self.bulk / 2 * (j - 1) ** 2 + self.offset * (j - 1)
        return (np.where(self.b > 0, exponential, ogden) + volume) * self.grown**3 * self.weight

    def total(self, f: Array) -> Array:
        """Energy of a deformation gradient (for the checks)."""
        _, stretch, _, j = self._principal(f)
        return self.energy(stretch, j)

    def _principal(self, f: Array) -> tuple[Array, Array, Array, Array]:
        """Elastic part of F (points, cells, 3, 3), stretches, axes and volume ratio."""
        elastic = np.moveaxis(f, (0, 1), (-2, -1)) / self.grown[..., None, None]
        squares, axes = np.linalg.eigh(np.swapaxes(elastic, -1, -2) @ elastic)
        stretch = np.moveaxis(np.sqrt(squares), -1, 0)
        j = np.linalg.det(elastic)
        if np.any(j <= 0):
            msg = "an element is turned inside out"
            raise FloatingPointError(msg)
        return elastic, stretch, axes, j

    def _slopes(self, stretch: Array, j: Array) -> tuple[Array, Array]:
        """First and second derivatives of the energy by the logarithms of the stretches."""
        bar = stretch / j ** (1 / 3)
        eye = np.eye(3)[:, :, None, None]
        power = 2 * self.mu / self.alpha * bar**self.alpha
        grow = self.mu * np.exp(self.b * ((bar**2).sum(0) - 3)) * bar**2
        on = self.b > 0
        first = np.where(on, grow, power)
        second = np.where(on, 2 * grow * eye + 2 * self.b * grow[:, None] * bar[None] ** 2, self.alpha * power * eye)
        pressure = self.bulk * (j - 1) + self.offset
        beta = first - first.sum(0) / 3 + pressure * j
        rows, columns = second.sum(1, keepdims=True) / 3, second.sum(0, keepdims=True) / 3
        slopes = second - rows - columns + second.sum((0, 1)) / 9
        return beta, slopes + j * (self.bulk * (2 * j - 1) + self.offset)

    def gradient(self, x: list) -> list:
        """First Piola-Kirchhoff stress."""
        elastic, stretch, axes, j = self._principal(x[0])
        beta, _ = self._slopes(stretch, j)
        second = np.einsum("aqc,qcia,qcja->qcij", beta / stretch**2, axes, axes)
        stress = np.moveaxis(elastic @ second, (-2, -1), (0, 1)) * self.grown**2 * self.weight
        return [stress, x[-1]]

    def hessian(self, x: list) -> list:
        """Derivative of that stress by the deformation gradient."""
        elastic, stretch, axes, j = self._principal(x[0])
        beta, slopes = self._slopes(stretch, j)
        square = stretch**2
        s = beta / square
        same = (slopes - 2 * beta[:, None] * np.eye(3)[:, :, None, None]) / (square[:, None] * square[None])
        pairs = np.einsum("qcia,qcja->aqcij", axes, axes)
        tangent = np.einsum("abqc,aqcij,bqckl->ijklqc", same, pairs, pairs, optimize=True)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            gap = square[b] - square[a]
            close = np.abs(gap) < 1e-6 * square[a]
            limit = 0.5 * (same[b, b] - same[a, b])  # where both stretches are alike
            ratio = np.where(close, limit, (s[b] - s[a]) / np.where(close, 1.0, gap))
            mixed = np.einsum("qci,qcj->qcij", axes[..., a], axes[..., b])
            mixed = mixed + np.swapaxes(mixed, -1, -2)
            tangent += np.einsum("qc,qcij,qckl->ijklqc", ratio, mixed, mixed, optimize=True)
        stress = np.einsum("aqc,aqcij->ijqc", s, pairs)
        turned = np.einsum("qciI,IJKLqc->iJKLqc", elastic, tangent, optimize=True)
        turned = np.einsum("qckK,iJKLqc->iJkLqc", elastic, turned, optimize=True)
        turned += np.einsum("ik,JLqc->iJkLqc", np.eye(3), stress)
        return [turned * self.grown * self.weight]
