"""Internal forces and tangent stiffness of a body, total Lagrangian, all elements at once.

Stresses and the material tangent are known in the principal directions N_a of C = F^T F. Forces follow from the
stresses in fixed axes. The stiffness follows from the strains in the principal directions, dE_aa = f_a . du N_a and
2 dE_ab = f_a . du N_b + f_b . du N_a with the gradient du of a displacement and f_a = F N_a, so that the tangent needs
no rotation. Its shear terms are divided differences of the principal stresses (Ogden, Non-linear Elastic
Deformations, section 6.1.4), with their limit where two stretches meet. In axisymmetric bodies
the third direction is the hoop's, with dE_33 = l_3 du_r / R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.pressure import Lead, projection
from fingerfit.fem.response import Points
from fingerfit.fem.strain import Strain, principal
from fingerfit.fem.tensors import material_tangent, pairs, principal_tensors, product, shear_tensors, strain_modes
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
    volume, bulk : ndarray or None
        Volume ratio in the pressure field and bulk modulus, flat, of elements with a pressure of their own; the
        volume ratio alone of others that are nearly incompressible.
    directed : Directed or None
    weighted : ndarray, shape (elements, points, dim, dim)
        All stresses times the volume, in fixed axes.
    around : ndarray or None, shape (elements, points)
        Those of the hoop, where there is one.
    force : ndarray, shape (elements, dofs)
        N.
    """

    strain: Strain
    first: np.ndarray
    second: np.ndarray
    stress: np.ndarray
    volume: np.ndarray | None
    bulk: np.ndarray | None
    directed: Any
    weighted: np.ndarray
    around: np.ndarray | None
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
        # shape gradients of a point by nodes, and of a node by points: one product for an element, not for a point
        self._by_point = np.ascontiguousarray(np.swapaxes(self.gradient, -1, -2))
        self._slopes = np.swapaxes(self.gradient, 1, 2).reshape(*connectivity.shape, -1)
        self._by_direction = np.swapaxes(self.dofs.reshape(*connectivity.shape, -1), 1, 2).reshape(self.dofs.shape)
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
            self._settled = Lead(u[self._by_direction], found.volume)

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
        local = u[self._by_direction]
        by_element = (local.reshape(len(local), dim, -1) @ self._slopes).reshape(len(local), dim, -1, dim)
        f = np.empty((*self.weight.shape, dim, dim))
        np.add(by_element.swapaxes(1, 2), self.stretched[:, None, :dim, :dim], out=f)
        across = np.broadcast_to(self.stretched[:, None, 2, 2], f.shape[:2])
        if self.hoop is not None:
            across = across + (self.hoop @ local[:, : self.hoop.shape[2], None])[..., 0]
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
            parts = directed.stress.reshape(count, gauss, 6)
            full = stress + parts[..., :3]
        full = full * self.weight[..., None]
        weighted = principal_tensors(directions, full)
        if directed:
            for k, (i, j) in enumerate(pairs(self.dim)):
                weighted += shear_tensors(directions, i, j, parts[..., 3 + k] * self.weight)
        # sum of grad N . S F^T over the points
        force = self._slopes @ product(weighted, np.swapaxes(f, -1, -2)).reshape(count, -1, self.dim)
        around = None
        if self.hoop is not None:
            around = full[..., 2]
            force[..., 0] += ((around * np.sqrt(squared[..., 2]))[:, None] @ self.hoop)[:, 0]
        force = force.reshape(count, -1)
        kept = Response(strain, first, second, stress, volume, bulk, directed, weighted, around, force)
        self._responses = [kept, *self._responses][:1]
        return kept

    def _stiffness(self, found: Response, led: bool) -> np.ndarray:
        """Tangent stiffnesses, shape (elements, dofs, dofs), N/mm."""
        squared, directions = found.strain.squared, found.strain.directions
        first, second, stress, weighted, around = found.first, found.second, found.stress, found.weighted, found.around
        dim, (count, gauss), nodes = self.dim, self.weight.shape, self.connectivity.shape[1]
        axes = dim if around is None else 3
        modes = strain_modes(found.strain.f, directions, axes)
        strains = modes.shape[2]
        # strains by the dofs, those of one direction after those of another
        b = (modes.reshape(count, gauss, -1, dim) @ self._by_point).reshape(count, gauss, strains, -1)
        if self.hoop is not None:
            b[:, :, 2, :nodes] = self.hoop * np.sqrt(squared[..., 2, None])
        if found.volume is not None:
            jacobian = np.sqrt(squared.prod(axis=-1))
            slope = ((jacobian[..., None] / squared[..., :axes])[..., None, :] @ b[:, :, :axes])[:, :, 0]
            slope = slope if self.pressure is None else self.pressure @ slope
            ahead = self._foretell(found.volume, slope)
            if led and ahead is not None:
                kirchhoff = (ahead * jacobian)[..., None]
                first, second = first + kirchhoff, second + kirchhoff[..., None]
                more = kirchhoff / squared
                stress, more = stress + more, more * self.weight[..., None]
                weighted = weighted + principal_tensors(directions, more)
                around = None if around is None else around + more[..., 2]
        d = material_tangent(first, second, stress, squared, dim, axes, found.directed, self.kind.state == STRESS)
        d *= self.weight[..., None, None]
        flat = (count, gauss * strains, nodes * dim)
        stiffness = np.swapaxes(b.reshape(flat), 1, 2) @ (d @ b).reshape(flat)
        if found.bulk is not None:
            bulk = found.bulk.reshape(count, gauss) * self.weight
            stiffness += np.swapaxes(slope, 1, 2) @ (slope * bulk[..., None])
        view = stiffness.reshape(count, dim, nodes, dim, nodes)
        geometric = self._slopes @ (weighted @ self._by_point).reshape(count, -1, nodes)
        for axis in range(dim):
            view[:, axis, :, axis] += geometric
        if self.hoop is not None and around is not None:
            view[:, 0, :, 0] += np.swapaxes(self.hoop, 1, 2) @ (self.hoop * around[..., None])
        return view.transpose(0, 2, 1, 4, 3).reshape(count, nodes * dim, -1)

    def _foretell(self, volume: np.ndarray, slope: np.ndarray) -> np.ndarray | None:
        """Pressure foretold less the one that is there, (elements, points), MPa; None without a volume above 0."""
        local = self._states[0][0][self._by_direction]
        lead, self._lead = self._lead, Lead(local, volume, slope)
        if lead is None or not (foretold := lead.at(local)).min() > 0:
            return None
        pressure = self.points.volumetric(foretold)[1] - self.points.volumetric(volume)[1]
        return self._project(pressure).reshape(self.weight.shape)
