"""Internal forces and tangent stiffness of a body, total Lagrangian, all elements at once.

Everything is written in the principal directions N_a of C = F^T F: with f_a = F N_a and the shape gradients
g_Ia = grad N_I . N_a, the strains are dE_aa = f_a . du g_a and 2 dE_ab = f_a . du g_b + f_b . du g_a, and the
tangent needs no rotation. Its shear terms are divided differences of the principal stresses (Ogden,
Non-linear Elastic Deformations, section 6.1.4), with their limit where two stretches meet.
"""

from __future__ import annotations

import numpy as np

from fingerfit.fem.elements import ELEMENTS, rule, shape
from fingerfit.material.ogden import Ogden

_CLOSE = 1e-6
"""Relative difference of squared stretches below which the limit of the divided difference is used."""


class Body:
    """Elements of one type with their materials.

    Parameters
    ----------
    element : str
        Type, one of `fingerfit.fem.elements.ELEMENTS`.
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    connectivity : ndarray, shape (elements, nodes per element)
        Zero-based nodes.
    material : Ogden
        Constants of shape (elements * integration points,), elements first.
    thickness : ndarray, shape (elements,)
        mm; 1 in three dimensions.
    """

    def __init__(
        self,
        element: str,
        points: np.ndarray,
        connectivity: np.ndarray,
        material: Ogden,
        thickness: np.ndarray,
    ) -> None:
        xi, weights = rule(element)
        local = shape(element, xi)[1]
        corners = points[connectivity]
        jacobian = np.einsum("eni,gnj->egij", corners, local)
        determinant = np.linalg.det(jacobian)
        if determinant.min() <= 0:
            raise ValueError(f"element {int(determinant.min(axis=1).argmin())} is inverted in the reference state")
        self.dim = points.shape[1]
        self.material = material
        self.connectivity = connectivity
        self.gradient = np.einsum("gnj,egji->egni", local, np.linalg.inv(jacobian))
        self.weight = determinant * weights * thickness[:, None]
        self.pressure = _projection(element, xi, self.weight)
        self.dofs = (connectivity[:, :, None] * self.dim + np.arange(self.dim)).reshape(len(connectivity), -1)

    def _stretches(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Deformation gradient, squared principal stretches and directions (columns); None where J <= 0."""
        dim = self.dim
        local = u.reshape(-1, dim)[self.connectivity]
        f = np.swapaxes(local, 1, 2)[:, None] @ self.gradient
        f[..., range(dim), range(dim)] += 1.0
        if not np.isfinite(f).all() or np.linalg.det(f).min() <= 0:
            return None
        c = np.swapaxes(f, -1, -2) @ f
        if dim == 3:
            squared, directions = np.linalg.eigh(c)
            return f, squared, directions
        half, shear = (c[..., 0, 0] - c[..., 1, 1]) / 2, c[..., 0, 1]
        mean, radius = (c[..., 0, 0] + c[..., 1, 1]) / 2, np.hypot(half, shear)
        angle = np.arctan2(shear, half) / 2
        cos, sin = np.cos(angle), np.sin(angle)
        # the smaller one from the determinant: mean - radius loses digits
        large = mean + radius
        small = (c[..., 0, 0] * c[..., 1, 1] - shear**2) / large
        directions = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        return f, np.stack([large, small, np.ones_like(large)], -1), directions

    def energy(self, u: np.ndarray) -> float:
        """Strain energy in N mm; infinite where an element is inverted."""
        state = self._stretches(u)
        if state is None:
            return np.inf
        stretch = np.sqrt(state[1]).reshape(-1, 3)
        if self.pressure is None:
            density = self.material.energy(stretch)
        else:
            volume = self._project(stretch.prod(axis=-1))
            density = self.material.deviatoric_energy(stretch) + self.material.volumetric(volume)[0]
        return float((density * self.weight.ravel()).sum())

    def _project(self, values: np.ndarray) -> np.ndarray:
        """Values at the integration points, flat, replaced by the pressure field that is nearest to them."""
        if self.pressure is None:
            return values
        return (self.pressure @ values.reshape(self.weight.shape)[..., None]).ravel()

    def forces(self, u: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray] | None:
        """Element forces and stiffnesses.

        Parameters
        ----------
        u : ndarray, shape (nodes * dim,)
            Displacements, mm.
        tangent : bool
            Whether the stiffnesses are wanted; they are empty otherwise.

        Returns
        -------
        forces : ndarray, shape (elements, dofs), N
        stiffness : ndarray, shape (elements, dofs, dofs), N/mm
            None instead of both where an element is inverted.
        """
        state = self._stretches(u)
        if state is None:
            return None
        f, squared, directions = state
        dim, (count, gauss) = self.dim, f.shape[:2]
        stretch = np.sqrt(squared).reshape(-1, 3)
        bulk = None
        if self.pressure is None:
            first, second = self.material.derivatives(stretch)
        else:
            jacobian = stretch.prod(axis=-1)
            first, second = self.material.deviatoric_derivatives(stretch)
            _, pressure, bulk = self.material.volumetric(self._project(jacobian))
            pressure = self._project(pressure) * jacobian
            first += pressure[:, None]
            second += pressure[:, None, None]
        first, second = first.reshape(count, gauss, 3), second.reshape(count, gauss, 3, 3)
        stress = first / squared
        g = self.gradient @ directions
        fa = f @ directions
        normal = g[..., :, None, :] * fa[..., None, :, :]  # (elements, points, nodes, dim, a)
        weighted = stress[..., :dim] * self.weight[..., None]
        nodes = g.shape[2]
        force = np.einsum("epnia,epa->eni", normal, weighted).reshape(count, -1)
        if not tangent:
            return force, np.empty(0)
        pairs = [(a, b) for a in range(dim) for b in range(a + 1, dim)]
        shear = [g[..., :, None, b] * fa[..., None, :, a] + g[..., :, None, a] * fa[..., None, :, b] for a, b in pairs]
        rows = [*np.moveaxis(normal, -1, 0), *shear]
        b = np.stack(rows, axis=2).reshape(count, gauss, len(rows), nodes * dim)
        d = np.zeros((count, gauss, len(rows), len(rows)))
        block = second[..., :dim, :dim] / (squared[..., :dim, None] * squared[..., None, :dim])
        d[..., :dim, :dim] = block
        for a in range(dim):
            d[..., a, a] -= 2 * stress[..., a] / squared[..., a]
        for k, (i, j) in enumerate(pairs, dim):
            d[..., k, k] = _divided(stress, second, first, squared, i, j)
        d *= self.weight[..., None, None]
        db = d @ b
        flat = (count, gauss * len(rows), nodes * dim)
        stiffness = np.swapaxes(b.reshape(flat), 1, 2) @ db.reshape(flat)
        if bulk is not None:
            volume = (normal / squared[:, :, None, None, :dim]).sum(axis=-1).reshape(count, gauss, -1)
            volume = self.pressure @ (volume * stretch.prod(axis=-1).reshape(count, gauss, 1))
            stiffness += np.swapaxes(volume, 1, 2) @ (volume * (bulk.reshape(count, gauss) * self.weight)[..., None])
        scaled = (g * weighted[..., None, :]).swapaxes(1, 2).reshape(count, nodes, -1)
        geometric = scaled @ g.swapaxes(1, 2).reshape(count, nodes, -1).swapaxes(1, 2)
        view = stiffness.reshape(count, nodes, dim, nodes, dim)
        for axis in range(dim):
            view[:, :, axis, :, axis] += geometric
        return force, stiffness


def _projection(element: str, xi: np.ndarray, weight: np.ndarray) -> np.ndarray | None:
    """Least-squares projection of values at the points on a hybrid element's pressure field.

    Shape (elements, points, points); None for elements without a pressure of their own. The field is eliminated in
    each element (Simo, Taylor and Pister 1985): it takes the place of the volume ratio in the energy.
    """
    terms = ELEMENTS[element].pressure
    if not terms:
        return None
    basis = np.column_stack([np.ones(len(xi)), xi])[:, :terms]
    weighted = basis.T[None] * weight[:, None, :]
    return basis @ np.linalg.solve(weighted @ basis, weighted)


def _divided(
    stress: np.ndarray, second: np.ndarray, first: np.ndarray, squared: np.ndarray, i: int, j: int
) -> np.ndarray:
    """Divided difference (S_i - S_j) / (l_i^2 - l_j^2), or its limit where both are close."""
    gap = squared[..., i] - squared[..., j]
    close = np.abs(gap) < _CLOSE * squared[..., i]
    limit = (second[..., i, i] - 2 * first[..., i]) / squared[..., i] - second[..., i, j] / squared[..., j]
    safe = np.where(close, 1.0, gap)
    return np.where(close, limit / (2 * squared[..., i]), (stress[..., i] - stress[..., j]) / safe)
