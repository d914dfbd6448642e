"""Internal forces and tangent stiffness of a body, total Lagrangian, all elements at once.

Everything is written in the principal directions N_a of C = F^T F: with f_a = F N_a and the shape gradients
g_Ia = grad N_I . N_a, the strains are dE_aa = f_a . du g_a and 2 dE_ab = f_a . du g_b + f_b . du g_a, and the
tangent needs no rotation. Its shear terms are divided differences of the principal stresses (Ogden,
Non-linear Elastic Deformations, section 6.1.4), with their limit where two stretches meet. In axisymmetric bodies
the third direction is the hoop's, with dE_33 = l_3 du_r / R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.pressure import Lead, projection
from fingerfit.fem.response import Points, divided
from fingerfit.fem.strain import Strain, principal
from fingerfit.material.prony import History, Increment, history_of_pressure
from fingerfit.mesh.elements import AXISYMMETRIC, ELEMENTS, STRESS, rule, shape


@dataclass(frozen=True)
class Response:
    """Forces at some displacements, and what the tangent needs of the way to them.

    Parameters
    ----------
    strain : Strain
    first, second, stress : ndarray, shape (elements, points, 3), (elements, points, 3, 3) and (elements, points, 3)
        Derivatives of the isotropic energy by the logarithms, and principal second Piola-Kirchhoff stresses.
    weighted : ndarray, shape (elements, points, axes)
        All normal stresses times the volume.
    volume, bulk : ndarray or None
        Volume ratio in the pressure field and bulk modulus, flat, of elements with a pressure of their own; the
        volume ratio alone of others that are nearly incompressible.
    directed : Directed or None
    g, fa : ndarray, shape (elements, points, nodes, dim) and (elements, points, dim, dim)
        Shape gradients and deformation gradient, in the principal directions.
    force : ndarray, shape (elements, dofs)
        N.
    """

    strain: Strain
    first: np.ndarray
    second: np.ndarray
    stress: np.ndarray
    weighted: np.ndarray
    volume: np.ndarray | None
    bulk: np.ndarray | None
    directed: Any
    g: np.ndarray
    fa: np.ndarray
    force: np.ndarray


class Body:
    """Elements of one type with their materials.

    Parameters
    ----------
    element : str
        Type, one of `fingerfit.mesh.elements.ELEMENTS`.
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    connectivity : ndarray, shape (elements, nodes per element)
        Zero-based nodes.
    material : material
        Constants of shape (elements * integration points,), elements first; see `fingerfit.material.spread`.
    thickness : ndarray, shape (elements,)
        mm; of plane elements.
    initial : ndarray or None, shape (elements, 3, 3)
        Stress in the reference state, MPa.
    averaged : bool
        False for linear quadrilaterals and bricks that are integrated fully, as in CalculiX.
    stretched : ndarray or None, shape (elements, 3, 3)
        How the material is stretched in the reference state, F_e = F F_0: symmetric, with the determinant 1; in the
        plane the third direction is a principal one. `gradient` and `hoop` are those of F_e.
    """

    def __init__(
        self,
        element: str,
        points: np.ndarray,
        connectivity: np.ndarray,
        material: Any,
        thickness: np.ndarray,
        initial: np.ndarray | None = None,
        averaged: bool = True,
        stretched: np.ndarray | None = None,
    ) -> None:
        kind = ELEMENTS[element]
        xi, weights = rule(element)
        values, local = shape(element, xi)
        corners = points[connectivity]
        jacobian = np.einsum("eni,gnj->egij", corners, local)
        determinant = np.linalg.det(jacobian)
        if determinant.min() <= 0:
            raise ValueError(f"element {int(determinant.min(axis=1).argmin())} is inverted in the reference state")
        self.kind, self.dim = kind, points.shape[1]
        self.connectivity = connectivity
        self.gradient = np.einsum("gnj,egji->egni", local, np.linalg.inv(jacobian))
        self.weight = determinant * weights
        self.hoop: np.ndarray | None = None
        if kind.state == AXISYMMETRIC:
            radius = corners[:, :, 0] @ values.T
            if radius.min() <= 0:
                raise ValueError(f"element {int(radius.min(axis=1).argmin())} lies beyond the axis x = 0")
            self.hoop = values / radius[..., None]
            self.weight = self.weight * 2 * np.pi * radius
        elif self.dim == 2:
            self.weight = self.weight * thickness[:, None]
        self.pressure = projection(element, xi, self.weight) if averaged or element.endswith("H") else None
        self.dofs = (connectivity[:, :, None] * self.dim + np.arange(self.dim)).reshape(len(connectivity), -1)
        self.mesh_gradient, self.mesh_hoop = self.gradient, self.hoop
        self.stretched = np.broadcast_to(np.eye(3), (len(corners), 3, 3)) if stretched is None else stretched
        if stretched is not None:
            self.gradient = self.gradient @ stretched[:, None, : self.dim, : self.dim]
            if self.hoop is not None:
                self.hoop = self.hoop * stretched[:, None, None, 2, 2]
        self.points = Points(material, self.pressure is None and not kind.nodal)
        if initial is not None:
            self.points.initial = np.repeat(initial, len(xi), axis=0)
        alone = self.pressure is None and not kind.nodal and kind.state != STRESS
        self._stiff = alone and self.points.hardly_compressed(self.weight.size)
        self._states: list[tuple[np.ndarray, Strain | None]] = []
        self._responses: list[Response] = []
        self._lead: Lead | None = None
        self._settled: Lead | None = None
        self.history = self._pressures = None
        if material.prony is not None:
            self.history = History(material.prony, (self.weight.size, 3, 3))
            self._pressures = None if kind.nodal else history_of_pressure(material.prony, self.weight.size)
        self.begin(0.0)

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Get ready for a time increment of `dt` s; with `relaxed`, for an infinitely slow one."""
        self._states, self._responses = [], []
        self._lead = self._settled
        if self.history is not None:
            volume = () if self._pressures is None else self._pressures.begin(dt, relaxed)
            self.points.increment = Increment(*self.history.begin(dt, relaxed), *volume)

    def swell(self, stretch: np.ndarray) -> None:
        """Let the points swell by a stretch, shape (elements * points,)."""
        self.points.swelling = stretch
        self._states, self._responses = [], []

    def warm(self, material: Any) -> None:
        """Let the points have the constants that they have at other temperatures."""
        self.points.material = material
        self._states, self._responses = [], []

    def settle(self, u: np.ndarray) -> None:
        """Take the end of an increment as what the pressure of the next one is foretold from."""
        found = self._response(u)
        if found is not None and found.volume is not None:
            self._settled = Lead(u[self.dofs], found.volume)

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Take the end of an increment into the history.

        Raises
        ------
        ValueError
            For an inverted element of a material that relaxes.
        """
        if self.history is not None:
            strain = self._strain(u)
            if strain is None or strain.frame is None:
                raise ValueError("an increment cannot end with an inverted element")
            squared = strain.squared.reshape(-1, 3)
            self.history.commit(self.points.elastic_deviator(squared, strain.frame), dt, relaxed)
            if self._pressures is not None:
                volume = self._project(np.sqrt(squared.prod(axis=-1)))
                self._pressures.commit(self.points.elastic_pressure(volume), dt, relaxed)

    def _strain(self, u: np.ndarray) -> Strain | None:
        """Deformation; None where J <= 0. The last two are kept: a line search compares its start with a trial."""
        found = next((state for state in self._states if np.array_equal(state[0], u)), None)
        if found is None:
            found = u.copy(), self._deformation(u)
        self._states = [found, *(state for state in self._states if state is not found)][:2]
        return found[1]

    def deformation(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deformation gradient of the material from its unstressed state, F_e = F F_0.

        Parameters
        ----------
        u : ndarray, shape (nodes * dim,)
            Displacements, mm.

        Returns
        -------
        ndarray, shape (elements, points, dim, dim)
        ndarray, shape (elements, points)
            Stretch out of the plane, around the axis of axisymmetric elements; with plane stress and in space that of
            the reference state.
        """
        dim = self.dim
        local = u[self.dofs].reshape(*self.connectivity.shape, dim)
        f = np.swapaxes(local, 1, 2)[:, None] @ self.gradient
        f += self.stretched[:, None, :dim, :dim]
        across = np.broadcast_to(self.stretched[:, None, 2, 2], f.shape[:2])
        if self.hoop is not None:
            across = across + (self.hoop @ local[:, :, :1])[..., 0]
        return f, across

    def _deformation(self, u: np.ndarray) -> Strain | None:
        f, across = self.deformation(u)
        found = principal(f, self.points.directed)
        if found is None or across.min() <= 0:
            return None
        if self.kind.state == STRESS:
            third = self.points.thickness_stretch(found.squared.reshape(-1, 3), found.frame)
            if third is None:
                return None
            found.squared[..., 2] = third.reshape(f.shape[:2])
        elif self.dim == 2:
            found.squared[..., 2] = across**2
        return found

    def energy(self, u: np.ndarray) -> float:
        """Strain energy in N mm; infinite where an element is inverted."""
        strain = self._strain(u)
        if strain is None:
            return np.inf
        squared = strain.squared.reshape(-1, 3)
        density = self.points.energy(squared, strain.frame)
        if self.pressure is not None:
            volume = self._project(np.sqrt(squared.prod(axis=-1)))
            density = density + self.points.volumetric(volume)[0]
        return float((density * self.weight.ravel()).sum())

    def _project(self, values: np.ndarray) -> np.ndarray:
        """Values at the integration points, flat, replaced by the pressure field that is nearest to them."""
        if self.pressure is None:
            return values
        return (self.pressure @ values.reshape(self.weight.shape)[..., None]).ravel()

    def forces(self, u: np.ndarray, tangent: bool = True, led: bool = False) -> tuple[np.ndarray, np.ndarray] | None:
        """Element forces and stiffnesses.

        Parameters
        ----------
        u : ndarray, shape (nodes * dim,)
            Displacements, mm.
        tangent : bool
            Whether the stiffnesses are wanted; they are empty otherwise.
        led : bool
            Whether these are made with the pressure that the last ones foretold; see `fingerfit.fem.pressure`.

        Returns
        -------
        forces : ndarray, shape (elements, dofs), N
        stiffness : ndarray, shape (elements, dofs, dofs), N/mm
            None instead of both where an element is inverted.
        """
        found = self._response(u)
        if found is None:
            return None
        return (found.force, self._stiffness(found, led)) if tangent else (found.force, np.empty(0))

    def _response(self, u: np.ndarray) -> Response | None:
        """Stresses and forces; the last are kept, because the line search asks first and the tangent afterwards."""
        strain = self._strain(u)
        if strain is None:
            return None
        for kept in self._responses:
            if kept.strain is strain:
                return kept
        f, squared, directions = strain.f, strain.squared, strain.directions
        count, gauss = f.shape[:2]
        stretch = np.sqrt(squared).reshape(-1, 3)
        volume = bulk = None
        first, second = self.points.isotropic(stretch)
        if self.pressure is not None:
            jacobian = stretch.prod(axis=-1)
            volume = self._project(jacobian)
            _, pressure, bulk = self.points.volumetric(volume)
            pressure = self._project(pressure) * jacobian
            first += pressure[:, None]
            second += pressure[:, None, None]
        elif self._stiff:
            volume = stretch.prod(axis=-1)
        first, second = first.reshape(count, gauss, 3), second.reshape(count, gauss, 3, 3)
        stress = full = first / squared
        directed = None
        if strain.frame is not None:
            directed = self.points.directions(squared.reshape(-1, 3), strain.frame)
            full = stress + directed.stress.reshape(count, gauss, 6)[..., :3]
        g = self.gradient @ directions
        fa = f @ directions
        axes = self.dim if self.hoop is None else 3
        weighted = full[..., :axes] * self.weight[..., None]
        # sum over the directions of g_a S_a f_a
        by_point = (g * weighted[..., None, : self.dim]) @ np.swapaxes(fa, -1, -2)
        if self.hoop is not None:
            by_point[..., 0] += self.hoop * (weighted[..., 2] * np.sqrt(squared[..., 2]))[..., None]
        if directed:
            for k, (i, j) in enumerate(_pairs(self.dim)):
                tau = (directed.stress.reshape(count, gauss, 6)[..., 3 + k] * self.weight)[..., None, None]
                by_point += tau * (g[..., None, j] * fa[..., None, :, i] + g[..., None, i] * fa[..., None, :, j])
        force = by_point.sum(axis=1).reshape(count, -1)
        kept = Response(strain, first, second, stress, weighted, volume, bulk, directed, g, fa, force)
        self._responses = [kept, *self._responses][:1]
        return kept

    def _stiffness(self, found: Response, led: bool) -> np.ndarray:
        """Tangent stiffnesses, shape (elements, dofs, dofs), N/mm."""
        squared, weighted, g, fa = found.strain.squared, found.weighted, found.g, found.fa
        first, second, stress = found.first, found.second, found.stress
        dim, directed, pairs = self.dim, found.directed, _pairs(self.dim)
        count, gauss, nodes = g.shape[:3]
        axes = weighted.shape[-1]
        b = np.zeros((count, gauss, axes + len(pairs), nodes, dim))
        for a in range(dim):
            np.multiply(g[..., a, None], fa[..., None, :, a], out=b[:, :, a])
        if self.hoop is not None:
            b[:, :, 2, :, 0] = self.hoop * np.sqrt(squared[..., None, 2])
        for k, (i, j) in enumerate(pairs, axes):
            np.multiply(g[..., j, None], fa[..., None, :, i], out=b[:, :, k])
            b[:, :, k] += g[..., i, None] * fa[..., None, :, j]
        if found.volume is not None:
            jacobian = np.sqrt(squared.prod(axis=-1))
            slope = (b[:, :, :axes] / squared[:, :, :axes, None, None]).sum(axis=2).reshape(count, gauss, -1)
            slope = slope * jacobian[..., None]
            slope = slope if self.pressure is None else self.pressure @ slope
            ahead = self._foretell(found.volume, slope)
            if led and ahead is not None:
                ahead = (ahead * jacobian)[..., None]
                first, second = first + ahead, second + ahead[..., None]
                stress = stress + ahead / squared
                weighted = weighted + (ahead / squared * self.weight[..., None])[..., :axes]
        d = self._tangent(first, second, stress, squared, axes, pairs, directed)
        d *= self.weight[..., None, None]
        flat = (count, gauss * b.shape[2], nodes * dim)
        db = d @ b.reshape(count, gauss, b.shape[2], nodes * dim)
        stiffness = np.swapaxes(b.reshape(flat), 1, 2) @ db.reshape(flat)
        if found.bulk is not None:
            bulk = found.bulk.reshape(count, gauss) * self.weight
            stiffness += np.swapaxes(slope, 1, 2) @ (slope * bulk[..., None])
        by_stress = g * weighted[..., None, :dim]
        if directed:
            for k, (i, j) in enumerate(pairs):
                tau = (directed.stress.reshape(count, gauss, 6)[..., 3 + k] * self.weight)[..., None]
                by_stress[..., i] += g[..., j] * tau
                by_stress[..., j] += g[..., i] * tau
        scaled = by_stress.swapaxes(1, 2).reshape(count, nodes, -1)
        geometric = scaled @ g.swapaxes(1, 2).reshape(count, nodes, -1).swapaxes(1, 2)
        view = stiffness.reshape(count, nodes, dim, nodes, dim)
        for axis in range(dim):
            view[:, :, axis, :, axis] += geometric
        if self.hoop is not None:
            view[:, :, 0, :, 0] += np.swapaxes(self.hoop, 1, 2) @ (self.hoop * weighted[..., None, 2])
        return stiffness

    def _foretell(self, volume: np.ndarray, slope: np.ndarray) -> np.ndarray | None:
        """Pressure foretold less the one that is there, (elements, points), MPa; None without a volume above 0."""
        local = self._states[0][0][self.dofs]
        lead, self._lead = self._lead, Lead(local, volume, slope)
        if lead is None or not (foretold := lead.at(local)).min() > 0:
            return None
        pressure = self.points.volumetric(foretold)[1] - self.points.volumetric(volume)[1]
        return self._project(pressure).reshape(self.weight.shape)

    def _tangent(
        self,
        first: np.ndarray,
        second: np.ndarray,
        stress: np.ndarray,
        squared: np.ndarray,
        axes: int,
        pairs: list[tuple[int, int]],
        directed: Any,
    ) -> np.ndarray:
        """Material tangent dS/dE in the principal directions: normal components first, then shear."""
        plane_stress = self.kind.state == STRESS
        n = 3 if plane_stress else axes
        d = np.zeros((*first.shape[:2], n + len(pairs), n + len(pairs)))
        d[..., :n, :n] = second[..., :n, :n] / (squared[..., :n, None] * squared[..., None, :n])
        for a in range(n):
            d[..., a, a] -= 2 * stress[..., a] / squared[..., a]
        for k, (i, j) in enumerate(pairs, n):
            d[..., k, k] = divided(stress, second, first, squared, i, j)
        if directed:
            chosen = [*range(n), *range(3, 3 + len(pairs))]
            d += directed.tangent.reshape(*first.shape[:2], 6, 6)[..., chosen, :][..., chosen]
        if plane_stress:
            kept = [0, 1, 3]
            column = d[..., kept, 2]
            d = d[..., kept, :][..., kept] - column[..., :, None] * column[..., None, :] / d[..., None, None, 2, 2]
        return d


def _pairs(dim: int) -> list[tuple[int, int]]:
    return [(a, b) for a in range(dim) for b in range(a + 1, dim)]
