"""Contact of a body with an analytical rigid surface by penalty: free of friction, Coulomb's, or glued.

The pressure grows linearly with the overclosure (CalculiX and ABAQUS, *SURFACE BEHAVIOR, PRESSURE-
OVERCLOSURE=LINEAR). Friction is an elastic stick with a slope, and slips at mu times the pressure (Wriggers,
Computational Contact Mechanics, section 5.2): the traction at the end of the last increment is turned into the
tangent plane and the slip added. What is glued is held by springs at the place where it touched. Points are nodes
with the areas around them, or the integration points of the faces; areas are the reference's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fem.surfaces import RigidSurface
from fingerfit.fem.system import Contribution

_TOUCHING = 1e-9
"""Gap, as a share of the body's size, below which a point touches: more than rounding makes of positions, and far below
any length of a mesh."""

_GROWTH = 3.0
"""Force of a point over the largest at the last equilibrium beyond which the tangent leaves its turning out: deep
overclosures made it indefinite (docs/decisions/0006-large-systems.md)."""


@dataclass(frozen=True)
class Interaction:
    """Law of a contact.

    Parameters
    ----------
    stiffness : float
        Slope of pressure over overclosure, MPa/mm.
    friction : float
        Coulomb's coefficient; 0 for none.
    stick : float
        Slope of shear traction over slip while sticking, MPa/mm.
    glued : bool
        Whether what touches once never slips or lifts off again.
    """

    stiffness: float
    friction: float = 0.0
    stick: float = 0.0
    glued: bool = False


@dataclass(frozen=True)
class _Local:
    """State of the points at some displacements."""

    position: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    active: np.ndarray


class RigidContact:
    """Points of a body against a rigid surface.

    Parameters
    ----------
    sampling : sparse array, shape (contact points, nodes)
        Interpolation from the nodes.
    areas : ndarray, shape (contact points,)
        mm^2.
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    surface : RigidSurface
    reference : int or None
        Node that carries the surface; None for one at rest.
    law : Interaction
    driven : bool
        Whether the reference node is pushed by a force: then the nearest point is held while none touches.
    """

    def __init__(
        self,
        sampling: Any,
        areas: np.ndarray,
        points: np.ndarray,
        surface: RigidSurface,
        reference: int | None,
        law: Interaction,
        driven: bool = False,
    ) -> None:
        from scipy.sparse import csr_matrix, eye_array, hstack, kron

        dim = points.shape[1]
        self.areas, self.surface, self.law, self.driven, self.dim = areas, surface, law, driven, dim
        self.symmetric = law.friction == 0 or law.glued
        self.slides = law.friction == 0 and not law.glued
        self.start = sampling @ points
        nodes = np.unique(sampling.indices)
        columns = [(nodes[:, None] * dim + np.arange(dim)).ravel()]
        relative = kron(sampling[:, nodes], eye_array(dim))
        if reference is not None:
            columns.append(reference * dim + np.arange(dim))
            relative = hstack([relative, kron(-np.ones((len(areas), 1)), eye_array(dim))])
        self._columns = np.concatenate(columns)
        self._relative = csr_matrix(relative)
        self._tolerance = _TOUCHING * np.ptp(points, axis=0).max()
        gap = surface.gap(self.start)[0]
        self._before = self.start
        self._open = np.maximum(gap, 0.0)
        self._most = 0.0
        self._traction = np.zeros((len(areas), dim))
        self._held = np.zeros(len(areas), dtype=bool)
        self._rest, self._spring = np.zeros((len(areas), dim)), np.zeros((len(areas), dim, dim))
        if law.glued:
            self._hold(self._local(np.zeros(points.size)))

    @property
    def couples(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns, by degree of freedom, of all stiffness that there may be: where every point touches."""
        from scipy.sparse import eye_array, kron

        every = kron(eye_array(len(self.areas)), np.ones((self.dim, self.dim)))
        found = (abs(self._relative).T @ every @ abs(self._relative)).tocoo()
        return self._columns[found.row], self._columns[found.col]

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom of the surface's nodes and of the reference node."""
        return self._columns

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Nothing: friction here does not depend on the rate."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Take slip and traction into the history."""
        local = self._local(u)
        self._most = float((-self.law.stiffness * self.areas * local.gap)[local.active].max(initial=0.0))
        if self.law.glued:
            self._hold(local)
            return
        self._traction = self._tangential(local)[0]
        self._before = local.position
        self._open = np.where(local.active, 0.0, np.maximum(local.gap, 0.0))

    def _hold(self, local: _Local) -> None:
        """Glue the points that touch now: springs that start with the present pressure."""
        new = (local.gap <= self._tolerance) & ~self._held
        n = local.normal[new]
        outer = n[:, :, None] * n[:, None, :]
        across = np.eye(self.dim) - outer
        self._spring[new] = self.areas[new, None, None] * (self.law.stiffness * outer + self.law.stick * across)
        self._rest[new] = local.position[new] - local.gap[new, None] * n
        self._held |= new

    def _local(self, u: np.ndarray) -> _Local:
        position = self.start + (self._relative @ u[self._columns]).reshape(-1, self.dim)
        gap, normal, curvature = self.surface.gap(position)
        active = (gap <= self._tolerance) & ~self._held
        if self.driven and not active.any() and not self._held.any():
            active[int(gap.argmin())] = True
        return _Local(position, gap, normal, curvature, active)

    def _share(self, local: _Local) -> tuple[np.ndarray, np.ndarray]:
        """Part of the way of each point since the surface was met, and its slope by the overclosure."""
        depth = np.maximum(-local.gap, 0.0)
        opened = self._open > self._tolerance
        whole = np.where(opened, depth + self._open, 1.0)
        return np.where(opened, depth / whole, 1.0), np.where(opened, self._open / whole**2, 0.0)

    def _tangential(self, local: _Local) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Friction forces (points, dim) in N, their elastic trial values, and where points slip."""
        law, normal = self.law, local.normal
        zero = np.zeros_like(self._traction)
        if law.stick == 0 or law.glued:
            return zero, zero, np.zeros(len(zero), dtype=bool)
        depth = np.maximum(-local.gap, 0.0)
        slip = (local.position - self._before) * self._share(local)[0][:, None]
        trial = self._traction + law.stick * self.areas[:, None] * slip
        trial = trial - (trial * normal).sum(axis=1)[:, None] * normal
        trial = np.where(local.active[:, None], trial, 0.0)
        limit = law.friction * law.stiffness * self.areas * depth
        size = np.linalg.norm(trial, axis=1)
        slips = local.active & (size > limit)
        force = np.where(slips[:, None], trial * (limit / np.maximum(size, 1e-300))[:, None], trial)
        return force, trial, slips

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution:
        """Forces and stiffness of the contact."""
        local, law = self._local(u), self.law
        normal_stiffness = np.where(local.active, law.stiffness * self.areas, 0.0)
        push = normal_stiffness * local.gap
        friction, trial, slips = self._tangential(local)
        at_points = push[:, None] * local.normal + friction
        if law.glued:
            at_points += (self._spring @ (local.position - self._rest)[..., None])[..., 0]
        reduced = self._relative.T @ at_points.ravel()
        force = np.bincount(self._columns, weights=reduced, minlength=len(u))
        empty = np.empty(0, dtype=int)
        if not tangent:
            return Contribution(force, empty, empty, np.empty(0))
        n = local.normal
        outer = n[:, :, None] * n[:, None, :]
        # far from equilibrium, where overclosures are deep, the surface's curvature makes the tangent indefinite
        turning = np.clip(push, -_GROWTH * self._most, None) if self._most > 0 else push
        block = normal_stiffness[:, None, None] * outer + turning[:, None, None] * local.curvature
        if law.glued:
            block = block + self._spring
        elif law.stick:
            across = np.eye(self.dim) - outer
            share, slope = self._share(local)
            moved = (across @ (local.position - self._before)[..., None])[..., 0]
            stick = share[:, None, None] * across - slope[:, None, None] * moved[:, :, None] * n[:, None, :]
            stick *= np.where(local.active, law.stick * self.areas, 0.0)[:, None, None]
            size = np.maximum(np.linalg.norm(trial, axis=1), 1e-300)
            way = trial / size[:, None]
            limit = -law.friction * push
            slip_block = (limit / size)[:, None, None] * (stick - way[:, :, None] * (way[:, None, :] @ stick))
            slip_block -= (law.friction * normal_stiffness)[:, None, None] * way[:, :, None] * n[:, None, :]
            block = block + np.where(slips[:, None, None], slip_block, stick)
        from scipy.sparse import bsr_array

        count = len(self.areas)
        diagonal = bsr_array((block, np.arange(count), np.arange(count + 1)), shape=(count * self.dim,) * 2)
        found = (self._relative.T @ diagonal.tocsr() @ self._relative).tocoo()
        return Contribution(force, self._columns[found.row], self._columns[found.col], found.data)

    def energy(self, u: np.ndarray) -> float:
        """Energy of the overclosure, and of friction in this increment: for the line search."""
        local = self._local(u)
        total = 0.5 * (self.law.stiffness * self.areas * local.gap**2)[local.active].sum()
        if self.law.glued:
            away = local.position - self._rest
            total += 0.5 * np.einsum("pi,pij,pj->", away, self._spring, away)
        elif self.law.stick:
            friction = self._tangential(local)[0]
            slip = local.position - self._before
            total += (0.5 * (friction + self._traction) * slip)[local.active].sum()
        return float(total)
