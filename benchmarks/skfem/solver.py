"""Finite elements of the compressed block: quadratic quadrilaterals of scikit-fem, Newton, steps that halve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from material import Material
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuadS2, ElementVector, MeshQuad

Array = np.ndarray
EDGE = 3.0  # largest over smallest element over the width; half of it over the height of a layer


def graded(start: float, stop: float, cells: int, ratio: float = 4.0) -> Array:
    """Cell borders that shrink towards both ends; `ratio` is the largest over the smallest cell."""
    middle = np.abs(np.arange(cells) + 0.5 - cells / 2) / (cells / 2)
    sizes = ratio ** (1 - middle)
    return start + (stop - start) * np.concatenate([[0], np.cumsum(sizes)]) / sizes.sum()


@dataclass
class Boundary:
    """What plates and surroundings do.

    Attributes
    ----------
    base_held, top_glued
        No motion along the plates.
    base_shear
        Strength and slip length of a bond at the base that yields: traction strength * tanh(slip / length).
    wall
        Position and stiffness (MPa/mm) of a wall to the right of the body.
    rock
        Offset of the load line from the middle and stiffness of the joint (N mm per mm of thickness), or None.
    """

    base_held: bool
    top_glued: bool
    base_shear: tuple[float, float] | None = None
    wall: tuple[float, float] | None = None
    rock: tuple[float, float] | None = None


class Block:
    """A block on its base under a rigid plate; everything per mm of thickness."""

    def __init__(
        self,
        width: float,
        heights: list[float],
        across: int,
        per_layer: list[int],
        boundary: Boundary,
        bend: Callable[[Array, Array], Array] | None = None,
    ) -> None:
        """Heights from the base up; `bend` moves mesh heights y at given x (curved interfaces)."""
        levels = np.concatenate([[0], np.cumsum(heights)])
        ys = [graded(a, b, n, EDGE / 2) for a, b, n in zip(levels[:-1], levels[1:], per_layer, strict=True)]
        self.xs = graded(0, width, across, EDGE)
        self.ys = np.concatenate([ys[0][:1]] + [y[1:] for y in ys])
        mesh = MeshQuad.init_tensor(self.xs, self.ys)
        middle = mesh.p[1][mesh.t].mean(axis=0)
        self.layer = np.searchsorted(levels[1:-1], middle)
        points = mesh.p.copy()
        if bend is not None:
            points[1] = bend(points[0], points[1])
        self.mesh = MeshQuad(points, mesh.t)
        self.boundary, self.width, self.height = boundary, width, levels[-1]
        self.basis = Basis(self.mesh, ElementVector(ElementQuadS2()), intorder=3)
        n_e, n_q = self.basis.dx.shape
        grads = np.stack([b[0].grad + np.zeros((2, 2, n_e, n_q)) for b in self.basis.basis])
        self.grads = np.ascontiguousarray(grads.transpose(3, 4, 1, 2, 0)).reshape(n_e, n_q * 4, -1)
        self.dofs = self.basis.element_dofs
        self.where = np.asarray(self.basis.global_coordinates()).reshape(2, -1)  # material points, flat
        self.layer_at = np.repeat(self.layer, n_q)
        self._constrain()

    def _constrain(self) -> None:
        x, y = self.basis.doflocs
        n = self.basis.N
        vertical = np.zeros(n, bool)
        for table in (self.basis.nodal_dofs, self.basis.facet_dofs):
            vertical[table[1::2].ravel()] = True
        tol = 1e-8 * self.height
        base, top = y < tol, y > self.height - tol
        self.base_x, self.top_y = np.flatnonzero(base & ~vertical), np.flatnonzero(top & vertical)
        self.side_x = np.flatnonzero((x > self.width - 1e-8 * self.width) & ~vertical)
        self.vertical = vertical
        bound = (base | top) & vertical
        if self.boundary.base_held and self.boundary.base_shear is None:
            bound[self.base_x] = True
        if self.boundary.top_glued:
            bound |= top & ~vertical
        if not bound[~vertical].any() and self.boundary.base_shear is None:
            bound[self.base_x[np.argmin(np.abs(x[self.base_x] - self.width / 2))]] = True
        free = np.flatnonzero(~bound)
        top_x = np.flatnonzero(top & ~vertical) if self.boundary.top_glued else np.array([], int)
        rows = np.concatenate([free, top_x, self.top_y, self.top_y])
        plate = np.repeat(np.arange(3), [len(top_x), len(self.top_y), len(self.top_y)])  # sideways, down, turn
        cols = np.concatenate([np.arange(len(free)), len(free) + plate])
        lever = x[self.top_y] - self.width / 2
        vals = np.concatenate([np.ones(len(free) + len(top_x)), -np.ones(len(self.top_y)), -lever])
        self.into = coo_matrix((vals, (rows, cols)), shape=(n, len(free) + 3)).tocsr()
        self.base_weight = _edge_weights(x[self.base_x])
        self.side_weight = _edge_weights(y[self.side_x])

    def gradients(self, u: Array) -> Array:
        """Deformation gradients at the material points (n, 2, 2)."""
        local = u[self.dofs].T[:, :, None]
        return (self.grads @ local).reshape(-1, 2, 2) + np.eye(2)

    def forces(self, u: Array, material: Material, dt: float) -> tuple[Array, csr_matrix]:
        """Sum the forces of body and surroundings on all degrees of freedom, with their derivative."""
        n_e, n_q = self.basis.dx.shape
        stress, tangent = material.stress(self.gradients(u), dt)
        dx = self.basis.dx.reshape(-1)
        weighted = (stress.reshape(-1, 4) * dx[:, None]).reshape(n_e, 1, n_q * 4)
        local = (weighted @ self.grads)[:, 0].T
        moved = (tangent * dx[:, None, None]) @ self.grads.reshape(n_e * n_q, 4, -1)
        stiff = self.grads.transpose(0, 2, 1) @ moved.reshape(n_e, n_q * 4, -1)
        total = np.bincount(self.dofs.ravel(), local.ravel(), self.basis.N)
        rows = np.repeat(self.dofs.T[:, :, None], len(self.dofs), axis=2)
        cols = rows.transpose(0, 2, 1)
        diagonal = np.zeros(self.basis.N)
        if self.boundary.base_shear is not None:
            strength, length = self.boundary.base_shear
            slip = np.tanh(u[self.base_x] / length)
            total[self.base_x] += strength * slip * self.base_weight
            diagonal[self.base_x] += strength / length * (1 - slip**2) * self.base_weight
        if self.boundary.wall is not None:
            place, stiffness = self.boundary.wall
            deep = np.maximum(u[self.side_x] + self.width - place, 0)
            total[self.side_x] += stiffness * deep**2 * self.side_weight
            diagonal[self.side_x] += 2 * stiffness * deep * self.side_weight
        every = np.arange(self.basis.N)
        entries = np.concatenate([stiff.ravel(), diagonal])
        place = (np.concatenate([rows.ravel(), every]), np.concatenate([cols.ravel(), every]))
        return total, coo_matrix((entries, place), shape=(self.basis.N,) * 2).tocsr()

    def _newton(self, q: Array, material: Material, target: float, forced: bool, dt: float) -> Array | None:
        n = len(q)
        rock = self.boundary.rock
        active = np.ones(n, bool)
        active[-1] = rock is not None
        active[-2] = forced
        active[-3] = False
        keep = np.flatnonzero(active)
        q = q.copy()
        if not forced:
            q[-2] = target
        scale = None
        for _ in range(16):
            u = self.into @ q
            if np.linalg.det(self.gradients(u)).min() < 0.05:
                return None
            total, tangent = self.forces(u, material, dt)
            rest = self.into.T @ total
            stiff = (self.into.T @ tangent @ self.into).tolil() if rock else self.into.T @ tangent @ self.into
            if forced:
                rest[-2] -= target
            if rock:
                rest[-1] += rock[1] * q[-1] - rock[0] * target
                stiff[n - 1, n - 1] += rock[1]
            size = np.abs(rest[keep]).max()
            scale = max(np.abs(total).max(), 1e-12)
            if size < 1e-9 * scale:
                return q
            step = splu(
                stiff.tocsc()[keep][:, keep],
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=1e-3,
                options={"SymmetricMode": True},
            ).solve(-rest[keep])
            if not np.isfinite(step).all() or np.abs(step[:-2]).max() > self.height:
                return None
            q[keep] += step
            if np.abs(step).max() < 1e-11 * self.height:
                return q
        return None

    def solve(
        self,
        path: list[tuple[float, float]],
        material: Material,
        forced: bool,
        start: Array | None = None,
        value: float = 0.0,
        time: float = 0.0,
    ) -> list[tuple[Array, float, float]]:
        """Follow a path of (time, value of force or displacement).

        Returns
        -------
        list
            For each point of the path: reduced unknowns, displacement and force of the plate.
        """
        q = np.zeros(self.into.shape[1]) if start is None else start.copy()
        rate = np.zeros_like(q)
        answers = []
        for goal_time, goal in path:
            part, step = 0.0, 1.0
            first, first_time = value, time
            while part < 1 - 1e-12:
                part_new = min(1.0, part + step)
                target = first + part_new * (goal - first)
                dt = (part_new - part) * (goal_time - first_time)
                guess = q + rate * (target - value)
                found = self._newton(guess, material, target, forced, dt)
                if found is None and rate.any():
                    found = self._newton(q, material, target, forced, dt)
                if found is None:
                    step /= 2
                    if step < 1e-3:
                        raise RuntimeError("no convergence")
                    continue
                rate = (found - q) / (target - value) if abs(target - value) > 1e-12 else np.zeros_like(q)
                q, value, part = found, target, part_new
                if not forced:
                    force = float((self.into.T @ self.forces(self.into @ q, material, dt)[0])[-2])
                material.commit(self.gradients(self.into @ q), dt)
            time = goal_time
            answers.append((q, float(q[-2]), value if forced else force))
        return answers

    def sample(self, q: Array, parts: int = 4) -> tuple[Array, Array, Array]:
        """Positions before and after on a fine net of triangles: X (n, 2), x (n, 2), triangles (m, 3)."""
        side = np.linspace(0, 1, parts + 1)
        a, b = (v.ravel() for v in np.meshgrid(side, side, indexing="ij"))
        local = np.stack([a, b])
        u = self.into @ q
        element = ElementVector(ElementQuadS2())
        before = self.mesh.mapping().F(local)  # (2, elements, points)
        after = before.copy()
        for i in range(len(self.dofs)):
            shape = element.gbasis(self.mesh.mapping(), local, i)[0].value
            after += np.asarray(shape) * u[self.dofs[i]][None, :, None]
        n = parts + 1
        i, j = np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij")
        k = (i * n + j).ravel()
        one = np.concatenate([np.stack([k, k + n, k + n + 1], 1), np.stack([k, k + n + 1, k + 1], 1)])
        triangles = (one[None] + np.arange(before.shape[1])[:, None, None] * n * n).reshape(-1, 3)
        flat = before.reshape(2, -1).T
        _, first, number = np.unique(np.round(flat / self.height, 9), axis=0, return_index=True, return_inverse=True)
        return flat[first], after.reshape(2, -1).T[first], number.ravel()[triangles]


def _edge_weights(along: Array) -> Array:
    """Weights of Simpson's rule of nodes on an edge with quadratic elements, in the order given."""
    order = np.argsort(along)
    sizes = np.diff(along[order][::2])
    weights = np.zeros(len(along))
    weights[order[1::2]] = sizes * 4 / 6
    weights[order[:-1:2]] += sizes / 6
    weights[order[2::2]] += sizes / 6
    return weights
