"""Stress and tangent of the layers at the quadrature points (plane strain, large deformation)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray


@dataclass
class Material:
    """Constants at the quadrature points; every array is flat, one value a point.

    Attributes
    ----------
    mu, alpha, nu
        Constants of the one-term Ogden law.
    fibre_k, fibre_b, fibre_angle
        Fibres that bear tension only: energy k / (2 b) (exp(b (I4 - 1)^2) - 1) along the angle; None without.
    prony
        Pairs (share, time constant) of over-stress that relaxes (Simo); mu is then that of slow loading.
    share_at
        Factor of these shares at each point.
    """

    mu: Array
    alpha: Array
    nu: Array
    fibre_k: Array | None = None
    fibre_b: float = 1.0
    fibre_angle: Array | None = None
    prony: tuple[tuple[float, float], ...] = ()
    share_at: Array | None = None
    last_iso: Array | None = field(default=None, repr=False)
    branches: list[Array] = field(default_factory=list, repr=False)

    def bulk(self) -> Array:
        """2 / D, the bulk modulus at small strain."""
        return 2 * self.mu * (1 + self.nu) / (3 * (1 - 2 * self.nu))

    def energy(self, grad: Array) -> Array:
        """Strain energy of deformation gradients (n, 2, 2), without over-stress."""
        _, _, e = _principal(grad)
        mean = e.sum(axis=0) / 3
        a = self.alpha
        total = np.exp(a * (e[0] - mean)) + np.exp(a * (e[1] - mean)) + np.exp(-a * mean)
        w = 2 * self.mu / a**2 * (total - 3) + self.bulk() / 2 * (np.exp(3 * mean) - 1) ** 2
        if self.fibre_k is not None:
            stretch = self._fibre_strain(grad)[0]
            w = w + self.fibre_k / (2 * self.fibre_b) * (np.exp(self.fibre_b * stretch**2) - 1)
        return w

    def _fibre_strain(self, grad: Array) -> tuple[Array, Array]:
        direction = np.stack([np.cos(self.fibre_angle), np.sin(self.fibre_angle)], axis=-1)
        image = np.einsum("nij,nj->ni", grad, direction)
        return np.maximum((image**2).sum(axis=1) - 1, 0), direction

    def stress(self, grad: Array, dt: float = 0.0) -> tuple[Array, Array]:
        """First Piola-Kirchhoff stress (n, 2, 2) and tangent (n, 4, 4) of deformation gradients (n, 2, 2)."""
        c, angle, e = _principal(grad)
        factor = 1 + self.share_at * sum(g * np.exp(-dt / (2 * tau)) for g, tau in self.prony) if self.prony else 1.0
        s, h = _in_stretch(c, *self._isochoric(e))
        s_vol, h_vol = _in_stretch(c, *self._volumetric(e))
        s, h = factor * s + s_vol, factor * h + h_vol

        n1 = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        n2 = np.stack([-n1[:, 1], n1[:, 0]], axis=-1)
        m1, m2 = np.einsum("ni,nj->nij", n1, n1), np.einsum("ni,nj->nij", n2, n2)
        m12 = np.einsum("ni,nj->nij", n1, n2)
        m12 = m12 + m12.transpose(0, 2, 1)
        gap = c[0] - c[1]
        near = gap < 1e-5
        shear = np.where(near, (h[0, 0] + h[1, 1]) / 4 - h[0, 1] / 2, (s[0] - s[1]) / np.where(near, 1, gap))

        second = s[0][:, None, None] * m1 + s[1][:, None, None] * m2  # second Piola-Kirchhoff stress
        bases, k = [m1, m2, m12], np.zeros((len(gap), 4, 4))
        k[:, :2, :2] = h.transpose(2, 0, 1)
        k[:, 2, 2] = shear
        if self.prony:
            second = second + self._history(dt)
        if self.fibre_k is not None:
            strain, direction = self._fibre_strain(grad)
            growth = self.fibre_k * np.exp(self.fibre_b * strain**2)
            m4 = np.einsum("ni,nj->nij", direction, direction)
            second = second + (2 * growth * strain)[:, None, None] * m4
            bases.append(m4)
            k[:, 3, 3] = 4 * growth * (1 + 2 * self.fibre_b * strain**2) * (strain > 0)
        t = np.stack([(grad @ m).reshape(-1, 4) for m in bases], axis=1)
        tangent = t.transpose(0, 2, 1) @ k[:, : len(bases), : len(bases)] @ t
        tangent[:, :2, :2] += second
        tangent[:, 2:, 2:] += second
        return grad @ second, tangent

    def _isochoric(self, e: Array) -> tuple[Array, Array]:
        """First and second derivatives of the isochoric energy by the logarithmic stretches."""
        a, mean = self.alpha, e.sum(axis=0) / 3
        m = np.stack([np.exp(a * (e[0] - mean)), np.exp(a * (e[1] - mean)), np.exp(-a * mean)])
        total = m.sum(axis=0)
        first = 2 * self.mu / a * np.stack([m[0] - total / 3, m[1] - total / 3])
        second = np.zeros((2, 2, len(a)))
        for i in range(2):
            for j in range(2):
                second[i, j] = 2 * self.mu * ((i == j) * m[i] - m[i] / 3 - m[j] / 3 + total / 9)
        return first, second

    def _volumetric(self, e: Array) -> tuple[Array, Array]:
        j, k = np.exp(e.sum(axis=0)), self.bulk()
        first, second = k * (j - 1) * j, k * (2 * j - 1) * j
        return np.stack([first, first]), np.broadcast_to(second, (2, 2, len(j)))

    def _isochoric_stress(self, grad: Array) -> Array:
        c, angle, e = _principal(grad)
        s = _in_stretch(c, *self._isochoric(e))[0]
        n1 = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        m1 = np.einsum("ni,nj->nij", n1, n1)
        return s[1][:, None, None] * np.eye(2) + (s[0] - s[1])[:, None, None] * m1

    def _history(self, dt: float) -> Array:
        total = np.zeros((len(self.mu), 2, 2))
        if self.last_iso is None:
            return total
        for (share, tau), over in zip(self.prony, self.branches, strict=True):
            part = (share * self.share_at)[:, None, None]
            total += np.exp(-dt / tau) * over - part * np.exp(-dt / (2 * tau)) * self.last_iso
        return total

    def commit(self, grad: Array, dt: float) -> None:
        """Advance the over-stress to the end of a converged increment."""
        if not self.prony:
            return
        now = self._isochoric_stress(grad)
        before = np.zeros_like(now) if self.last_iso is None else self.last_iso
        old = self.branches or [np.zeros_like(now) for _ in self.prony]
        self.branches = [
            np.exp(-dt / tau) * over + (share * self.share_at)[:, None, None] * np.exp(-dt / (2 * tau)) * (now - before)
            for (share, tau), over in zip(self.prony, old, strict=True)
        ]
        self.last_iso = now


def _principal(grad: Array) -> tuple[Array, Array, Array]:
    """Squared stretches (2, n), angle of the first one, logarithmic stretches (2, n)."""
    c = grad.transpose(0, 2, 1) @ grad
    mean, half = (c[:, 0, 0] + c[:, 1, 1]) / 2, (c[:, 0, 0] - c[:, 1, 1]) / 2
    radius = np.hypot(half, c[:, 0, 1])
    det = np.linalg.det(grad) ** 2
    first = mean + radius
    squares = np.stack([first, det / first])
    return squares, 0.5 * np.arctan2(c[:, 0, 1], half), 0.5 * np.log(squares)


def _in_stretch(c: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """Principal stresses 2 W_i and moduli 4 W_ij by squared stretches, from derivatives by logarithms."""
    stress = first / c
    moduli = second / (c[:, None] * c[None, :])
    for i in range(2):
        moduli[i, i] = moduli[i, i] - 2 * first[i] / c[i] ** 2
    return stress, moduli
