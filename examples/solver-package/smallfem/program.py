"""Plane strain at finite strain, eight-node quadrilaterals: stress by singular values of F, tangent by differences."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
TOLERANCE = 1e-9
"""Residual force over the largest internal one."""
STEP = 1e-6
"""Of the differences of the deformation gradient."""


def slopes(x: np.ndarray) -> np.ndarray:
    """Slopes of the eight shape functions by the local coordinates at x, shape (8, 2)."""
    # the shape functions are spanned by these monomials: solve for their coefficients, then differentiate
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (2, 1), (1, 2)]
    values = np.array([[a**i * b**j for i, j in powers] for a, b in CORNERS])
    a, b = x
    by_a = [i * a ** max(i - 1, 0) * b**j for i, j in powers]
    by_b = [j * a**i * b ** max(j - 1, 0) for i, j in powers]
    return np.linalg.solve(values.T, np.array([by_a, by_b]).T)


def stress(f: np.ndarray, mu: np.ndarray, alpha: np.ndarray, d: np.ndarray) -> np.ndarray:
    """First Piola-Kirchhoff stress in MPa of W = 2 mu / alpha^2 (sum l^alpha - 3) + (J - 1)^2 / D; f (..., 2, 2)."""
    left, stretch, right = np.linalg.svd(f)
    volume = stretch.prod(axis=-1)
    power = (np.concatenate([stretch, np.ones_like(volume)[..., None]], -1) * volume[..., None] ** (-1 / 3)) ** alpha
    kirchhoff = 2 * mu / alpha * (power - power.mean(axis=-1, keepdims=True))[..., :2]
    kirchhoff = kirchhoff + (2 / d[..., 0] * (volume - 1) * volume)[..., None]
    return (left * (kirchhoff / stretch)[..., None, :]) @ right


class Program:
    """A body and where it is.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        mm.
    elements : ndarray of int, shape (elements, 8)
    constants : ndarray, shape (elements, 4)
        mu in MPa, alpha, D in 1/MPa, thickness in mm.
    """

    def __init__(self, points: np.ndarray, elements: np.ndarray, constants: np.ndarray) -> None:
        places, weights = np.polynomial.legendre.leggauss(3)
        local = np.array([slopes(np.array([a, b])) for a in places for b in places])
        jacobian = np.einsum("eni,gnj->egij", points[elements], local)
        self.gradient = np.einsum("gnj,egji->egni", local, np.linalg.inv(jacobian))
        self.volume = np.linalg.det(jacobian) * np.outer(weights, weights).ravel() * constants[:, 3:]
        self.constants = [constants[:, None, k, None] for k in range(3)]
        self.dofs = (2 * elements[..., None] + np.arange(2)).reshape(len(elements), 16)
        self.u = np.zeros(points.size)
        self.internal = np.zeros(points.size)
        self._given: dict[int, float] = {}
        self._force = np.zeros(points.size)

    def go_to(self, given: dict[int, float], force: dict[int, float], ties: dict[int, tuple[int, float]]) -> bool:
        """Follow the load to displacements in mm and forces in N; False, and back, where there is no equilibrium."""
        pushed = np.zeros(self.u.size)
        pushed[list(force)] = list(force.values())
        before, start, share, size = self._given, self._force, 0.0, 1.0
        back = self.u.copy(), self.internal.copy()
        while share < 1:
            end = min(1.0, share + size)
            held = {dof: before.get(dof, 0.0) + end * (value - before.get(dof, 0.0)) for dof, value in given.items()}
            if self._equilibrium(held, start + end * (pushed - start), ties):
                share, size = end, 2 * size
            elif size < 0.02:
                self.u, self.internal = back
                return False
            else:
                size /= 2
        self._given, self._force = dict(given), pushed
        return True

    def _equilibrium(self, held: dict[int, float], force: np.ndarray, ties: dict[int, tuple[int, float]]) -> bool:
        slaves = [dof for dof in ties if dof not in held]
        free = np.setdiff1d(np.arange(self.u.size), [*held, *slaves])
        masters, factors = zip(*(ties[dof] for dof in slaves), strict=True) if slaves else ((), ())
        entries = (np.r_[np.ones(len(free)), factors], (np.r_[free, slaves], np.r_[free, masters]))
        reach = csc_matrix(entries, shape=(self.u.size, self.u.size))[:, free]
        u = self.u.copy()
        u[list(held)] = list(held.values())
        for slave in slaves:
            u[slave] = ties[slave][1] * u[ties[slave][0]]
        for _ in range(20):
            found = self._forces(u)
            if found is None:
                return False
            internal, stiffness = found
            residual = reach.T @ (internal - force)
            scale = max(np.abs(internal).max(), np.abs(force).max(), 1e-12)
            if np.abs(residual).max() < TOLERANCE * scale:
                self.u, self.internal = u, internal
                return True
            try:
                u = u - reach @ splu((reach.T @ stiffness @ reach).tocsc()).solve(residual)
            except RuntimeError:  # singular
                return False
        return False

    def _forces(self, u: np.ndarray) -> tuple[np.ndarray, csc_matrix] | None:
        """Internal forces in N and stiffness in N/mm; None where an element is inverted."""
        local = u[self.dofs].reshape(len(self.dofs), 1, 8, 2)
        f = np.eye(2) + np.swapaxes(local, 2, 3) @ self.gradient
        if not np.isfinite(f).all() or np.linalg.det(f).min() <= 0:
            return None
        p = stress(f, *self.constants)
        moduli = np.empty((*f.shape, 2, 2))
        for i in range(2):
            for j in range(2):
                change = np.zeros((2, 2))
                change[i, j] = STEP
                ahead, behind = (stress(f + sign * change, *self.constants) for sign in (1, -1))
                moduli[..., i, j] = (ahead - behind) / (2 * STEP)
        g, v = self.gradient, self.volume
        force = np.einsum("egij,egnj,eg->eni", p, g, v).reshape(-1)
        stiffness = np.einsum("egijkl,egnj,egml,eg->enimk", moduli, g, g, v, optimize=True)
        rows = np.repeat(self.dofs, 16, axis=1).ravel()
        columns = np.tile(self.dofs, 16).ravel()
        matrix = coo_matrix((stiffness.ravel(), (rows, columns)), shape=(u.size, u.size)).tocsc()
        return np.bincount(self.dofs.ravel(), weights=force, minlength=u.size), matrix
