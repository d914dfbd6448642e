"""Equilibrium of a body between base and plate: felupe assembles, Newton's method finds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import felupe as fem
import numpy as np
from body import Body
from material import Material
from pypardiso import spsolve
from scipy import sparse

Array = np.ndarray


@dataclass
class Contact:
    """What base and plate do. Functions take the unloaded places of nodes."""

    base: str = "held"  # held or slides
    plate: str = "glued"  # glued, slides, or contact with a rigid surface
    loose: Callable[[Array], Array] | None = None  # base nodes that slide although the base is held
    base_bend: tuple[Callable[[Array], Array], float] | None = None  # shape of 1 and stiffness, N/mm
    crown: Callable[[Array], tuple[Array, Array, Array]] | None = None  # height of the plate: value, slope, bend at x
    stiff: float = 0.0  # of that contact, N/mm for each mm


@dataclass
class Load:
    """One state that is asked for: time, plate (displacement or force), sideways shift."""

    time: float
    value: float
    shift: float = 0.0
    step: bool = True


@dataclass
class Drain:
    """Pressure that relaxes: at long times only `share` of the bulk modulus is left, after `tau` (points, cells)."""

    share: float
    tau: Array


@dataclass
class State:
    """Displacements of the nodes (nodes, dim), and displacement and force of the plate."""

    u: Array
    displacement: float
    force: float
    q: Array = field(repr=False)


class Problem:
    """A body with its material, boundary conditions and thickness (of a body in the plane)."""

    def __init__(self, body: Body, contact: Contact, thickness: float = 1.0) -> None:
        """Prepare felupe's region and field and the map from unknowns to displacements."""
        self.body, self.contact, self.thickness = body, contact, thickness
        if body.dim == 2:
            mesh = fem.Mesh(body.points, body.cells, "quad8")
            self.region = fem.RegionQuadraticQuad(mesh, quadrature=fem.GaussLegendre(order=1, dim=2))
            self.field = fem.FieldContainer([fem.FieldPlaneStrain(self.region, dim=2)])
        else:
            mesh = fem.Mesh(body.points, body.cells, "hexahedron20")
            self.region = fem.RegionQuadraticHexahedron(mesh, quadrature=fem.GaussLegendre(order=1, dim=3))
            self.field = fem.FieldContainer([fem.Field(self.region, dim=3)])
        self.where = fem.Field(self.region, dim=body.dim, values=body.points.copy()).interpolate()
        self.layer_at = np.broadcast_to(body.layer, self.where.shape[1:])
        self._unknowns()

    def material(self, mu: Array, alpha: Array, bulk: Array) -> Material:
        """Material without anything hidden, from arrays (points, cells)."""
        zero, one = np.zeros(mu.shape), np.ones(mu.shape)
        return Material(mu, alpha, bulk, zero, zero, one, one * self.thickness)

    def _unknowns(self) -> None:
        """Build u = T q. The last unknowns: plate down, plate sideways, bending of the base."""
        body, dim, count = self.body, self.body.dim, self.body.points.size
        number = np.arange(count).reshape(-1, dim)
        rows, columns, values, tied = [], [], [], set()
        kind = self.contact
        down, side, bend = count, count + 1, count + 2

        def tie(dof: int, pairs: list[tuple[int, float]]) -> None:
            tied.add(dof)
            for column, value in pairs:
                rows.append(dof)
                columns.append(column)
                values.append(value)

        loose = np.zeros(len(body.bottom), bool)
        if kind.loose is not None:
            loose = kind.loose(body.points[body.bottom])
        deflection = np.zeros(len(body.bottom))
        if kind.base_bend is not None:
            deflection = kind.base_bend[0](body.points[body.bottom])
        middle = np.argmin(((body.points[body.bottom, :-1] - body.points[:, :-1].mean(0)) ** 2).sum(1))
        for k, node in enumerate(body.bottom):
            tie(number[node, -1], [(bend, -deflection[k])])
            if (kind.base == "held" and not loose[k]) or (k == middle and kind.plate != "glued"):
                for dof in number[node, :-1]:
                    tie(dof, [])
        if kind.plate != "contact":
            for node in body.top:
                tie(number[node, -1], [(down, -1.0)])
                if kind.plate == "glued":
                    tie(number[node, 0], [(side, 1.0)])
                    if dim == 3:
                        tie(number[node, 1], [])
        free = np.array([dof for dof in range(count) if dof not in tied])
        rows += list(free)
        columns += list(free)
        values += [1.0] * len(free)
        keep = np.concatenate([free, [down, side, bend]])
        new = np.full(count + 3, -1)
        new[keep] = np.arange(len(keep))
        self.into = sparse.csr_matrix((values, (rows, new[columns])), shape=(count, len(keep)))
        self.size = len(keep)
        self.weights = np.zeros(len(body.points))
        if dim == 2 and kind.plate == "contact":
            on = np.isin(body.cells[:, [3, 6, 2]], body.top).all(1)
            for a, b, c in body.cells[on][:, [3, 6, 2]]:
                length = np.linalg.norm(body.points[c] - body.points[a]) / 6
                self.weights[[a, c]] += length
                self.weights[b] += 4 * length

    def _pressed(self, q: Array, k: sparse.csr_matrix | None) -> tuple[Array, sparse.csr_matrix | None]:
        """Forces (and stiffness) of the contact with a rigid surface of the plate, in the unknowns."""
        body, top = self.body, self.body.top
        u = (self.into @ q).reshape(-1, 2)
        x, y = (body.points + u)[top].T
        height, slope, bend = self.contact.crown(x)
        gap = y - (body.levels[-1] - q[-3] + height)
        on = gap > 0
        stiff = self.contact.stiff * self.weights[top] * on
        normal = np.stack([-slope, np.ones_like(x), np.ones_like(x)])  # of x, y and the plate's way down
        force = np.zeros(self.size)
        places = np.concatenate([top * 2, top * 2 + 1])
        full = np.zeros(body.points.size)
        full[places] = np.concatenate([stiff * gap * normal[0], stiff * gap * normal[1]])
        force += self.into.T @ full
        force[-3] += (stiff * gap).sum()
        if k is None:
            return force, None
        pick = sparse.csr_matrix((np.ones(len(top)), (np.arange(len(top)), top * 2)), shape=(len(top), len(full)))
        pick_y = sparse.csr_matrix((np.ones(len(top)), (np.arange(len(top)), top * 2 + 1)), shape=pick.shape)
        plate = sparse.csr_matrix(
            (np.ones(len(top)), (np.arange(len(top)), np.full(len(top), self.size - 3))), shape=(len(top), self.size)
        )
        across = pick @ self.into
        rise = sparse.diags(normal[0]) @ across + pick_y @ self.into + plate
        return force, k + rise.T @ sparse.diags(stiff) @ rise - across.T @ sparse.diags(stiff * gap * bend) @ across

    def balance(self, material: Material, load: Load, forced: bool, q: Array, weight: Array | None = None) -> State:
        """Newton's method from `q`; `weight` is the force of gravity on the nodes."""
        prescribed = [self.size - 2] if forced else [self.size - 3, self.size - 2]
        if self.contact.base_bend is None:
            prescribed.append(self.size - 1)
        q = q.copy()
        jump = np.zeros(self.size)  # of what is prescribed: it enters by the tangent of the state before
        jump[-2] = load.shift - q[-2]
        if not forced:
            jump[-3] = load.value - q[-3]
        free = np.setdiff1d(np.arange(self.size), prescribed)
        outside = np.zeros(self.size) if weight is None else self.into.T @ weight
        if forced:
            outside[-3] = load.value
        solid = fem.SolidBody(material, self.field)
        for turn in range(20):
            self.field[0].values[:] = (self.into @ q).reshape(-1, self.body.dim)
            inner = self.into.T @ np.asarray(solid.assemble.vector(self.field).todense()).ravel()
            if self.contact.plate == "contact":
                inner = inner + self._pressed(q, None)[0]
            if self.contact.base_bend is not None:
                inner[-1] += self.contact.base_bend[1] * q[-1]
            rest = inner - outside
            scale = abs(inner[-3]) + np.abs(outside).max() + 1e-9
            if turn > 0 and np.abs(rest[free]).max() < 1e-8 * scale + 1e-12:
                break
            k = (self.into.T @ sparse.csr_matrix(solid.assemble.matrix(self.field)) @ self.into).tocsr()
            if self.contact.plate == "contact":
                k = self._pressed(q, k)[1].tocsr()
            if self.contact.base_bend is not None:
                k = (k + sparse.csr_matrix(([self.contact.base_bend[1]], ([self.size - 1],) * 2), k.shape)).tocsr()
            step = spsolve(k[free][:, free].tocsr(), rest[free] + (k @ jump)[free])
            if not np.isfinite(step).all() or np.abs(step).max() > 10 * self.body.levels[-1]:
                msg = "no equilibrium"
                raise FloatingPointError(msg)
            q += jump
            jump[:] = 0.0
            q[free] -= step
        else:
            msg = "no equilibrium after 20 turns"
            raise FloatingPointError(msg)
        return State((self.into @ q).reshape(-1, self.body.dim), float(q[-3]), float(inner[-3]), q)

    def solve(
        self,
        material: Material,
        loads: list[Load],
        forced: bool,
        start: State | None = None,
        weight: Array | None = None,
        drain: Drain | None = None,
    ) -> list[State]:
        """States under the loads, one after the other; a step without an answer is halved."""
        q = np.zeros(self.size) if start is None else start.q
        before = Load(0.0, 0.0 if start is None else (start.force if forced else start.displacement), 0.0)
        old_j = np.ones(self.where.shape[1:])
        held = np.zeros_like(old_j)
        found = []
        for load in loads:
            law = material
            if drain is not None:
                span = max(load.time - before.time, 1e-9)
                fade = np.exp(-span / drain.tau)
                part = (1 - fade) * drain.tau / span * (1 - drain.share) * material.bulk
                offset = fade * held - part * (old_j - 1)
                law = replace(material, bulk=drain.share * material.bulk + part, offset=offset)
            state = self._halved(law, before, load, forced, q, weight, 0)
            if drain is not None:
                j = np.linalg.det(np.moveaxis(self.field.extract()[0], (0, 1), (-2, -1)))
                held = offset + part * (j - 1)
                old_j = j
            q, before = state.q, load
            found.append(state)
        return [state for state, load in zip(found, loads, strict=True) if load.step]

    def _halved(
        self, law: Material, before: Load, load: Load, forced: bool, q: Array, weight: Array | None, depth: int
    ) -> State:
        """Go to a load, in halves where Newton's method fails."""
        try:
            return self.balance(law, load, forced, q, weight)
        except FloatingPointError:
            if depth > 5:
                raise
        mid = replace(load, value=(before.value + load.value) / 2, shift=(before.shift + load.shift) / 2)
        state = self._halved(law, before, mid, forced, q, weight, depth + 1)
        return self._halved(law, mid, load, forced, state.q, weight, depth + 1)

    def gravity(self, density: float) -> Array:
        """Forces of the nodes under their weight; density in N/mm3 (rho g)."""
        shape = self.region.h[..., None] if self.region.h.ndim == 2 else self.region.h
        volume = self.region.dV * self.thickness
        local = np.einsum("aqc,qc->ca", np.broadcast_to(shape, (*shape.shape[:2], volume.shape[1])), volume)
        force = np.zeros_like(self.body.points)
        np.add.at(force[:, -1], self.body.cells, -density * local)
        return force.ravel()
