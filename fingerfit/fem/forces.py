"""Springs to ground or between two degrees of freedom, and pressure that follows its surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fingerfit.fem.system import Contribution, Evaluation
from fingerfit.mesh.faces import Faces, area_vectors, cell_rule, cell_shape


class _Ends:
    """What springs have in common: the degrees of freedom at their ends, and where their stiffness goes."""

    symmetric = True

    def __init__(self, first: np.ndarray, second: np.ndarray) -> None:
        self.first, self.second = first, second
        self._linked = second >= 0
        a, b = first[self._linked], second[self._linked]
        self._rows = np.concatenate([first, b, a, b])
        self._columns = np.concatenate([first, b, b, a])

    def _entries(self, stiffness: np.ndarray) -> np.ndarray:
        """Entries of the stiffness matrix, at `_rows` and `_columns`, of springs of a stiffness, shape (springs,)."""
        k = stiffness[self._linked]
        return np.concatenate([stiffness, k, -k, -k])

    def between(self, other: _Ends) -> bool:
        """Whether others are between the same degrees of freedom."""
        return np.array_equal(self.first, other.first) and np.array_equal(self.second, other.second)

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom at their ends."""
        return np.unique(self._rows)

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Nothing."""


class Springs(_Ends):
    """Linear springs.

    Parameters
    ----------
    first, second : ndarray of int, shape (springs,)
        Degrees of freedom; a second one of -1 is the ground.
    stiffness : ndarray, shape (springs,)
        N/mm.
    """

    def __init__(self, first: np.ndarray, second: np.ndarray, stiffness: np.ndarray) -> None:
        super().__init__(first, second)
        self.stiffness, self._values = stiffness, self._entries(stiffness)

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution:
        """Forces and stiffness."""
        force = np.bincount(self._rows, weights=self._values * u[self._columns], minlength=len(u))
        return Contribution(force, self._rows, self._columns, self._values)

    def energy(self, u: np.ndarray) -> float:
        """Energy in N mm."""
        return float(self.forces(u).force @ u) / 2


class NonlinearSprings(_Ends):
    """Springs whose force follows a table: straight lines between its points, constant beyond its ends.

    Parameters
    ----------
    first, second : ndarray of int, shape (springs,)
        Degrees of freedom; a second one of -1 is the ground.
    tables : sequence of sequence of (float, float)
        For each spring force in N and relative displacement in mm (first end less second end), displacements ascending.
    """

    def __init__(self, first: np.ndarray, second: np.ndarray, tables: Sequence[Sequence[tuple[float, float]]]) -> None:
        super().__init__(first, second)
        # shorter tables go on with the force of their end, as all do
        longest = max(map(len, tables))
        force, at = np.empty((len(tables), longest)), np.empty((len(tables), longest))
        for n, table in enumerate(tables):
            own = np.array(table, dtype=float)
            more = longest - len(own)
            force[n] = np.append(own[:, 0], np.full(more, own[-1, 0]))
            at[n] = np.append(own[:, 1], own[-1, 1] + np.ptp(own[:, 1]) * np.arange(1, more + 1))
        wide = np.diff(at)
        none = np.zeros((len(tables), 1))
        self._slope = np.hstack([none, np.diff(force) / wide, none])
        work = np.hstack([none, np.cumsum(wide * (force[:, 1:] + force[:, :-1]) / 2, axis=1)])
        # of each stretch, in its order: one before the table, those within, one behind it
        self._at, self._from = at, np.hstack([at[:, :1], at])
        self._force, self._work = np.hstack([force[:, :1], force]), np.hstack([none, work])
        self._rest = self._energies(np.zeros(len(tables)))

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution:
        """Forces and stiffness; at a point of the table the stiffness behind it."""
        chosen, along = self._stretch(self._moved(u))
        slope = self._slope[chosen]
        own = self._force[chosen] + slope * along
        total = np.bincount(self.first, weights=own, minlength=len(u))
        total -= np.bincount(self.second[self._linked], weights=own[self._linked], minlength=len(u))
        return Contribution(total, self._rows, self._columns, self._entries(slope))

    def energy(self, u: np.ndarray) -> float:
        """Energy in N mm, 0 at rest."""
        return float((self._energies(self._moved(u)) - self._rest).sum())

    def _moved(self, u: np.ndarray) -> np.ndarray:
        """Relative displacements, mm."""
        return u[self.first] - np.where(self._linked, u[self.second], 0.0)

    def _stretch(self, moved: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
        """Which stretch of its table each spring is on, and how far on it, mm."""
        chosen = np.arange(len(moved)), (moved[:, None] >= self._at).sum(axis=1)
        return chosen, moved - self._from[chosen]

    def _energies(self, moved: np.ndarray) -> np.ndarray:
        chosen, along = self._stretch(moved)
        return self._work[chosen] + (self._force[chosen] + self._slope[chosen] * along / 2) * along


def stiffened(
    evaluation: Evaluation, own: Sequence[object], others: Sequence[object], u: np.ndarray, least: float
) -> Evaluation | None:
    """An evaluation with the stiffness that other springs between the same ends have at displacements `u`, in mm.

    None where all are as stiff, but for a share `least`.

    Parameters
    ----------
    evaluation : Evaluation
    own, others : sequence of Term
        What the evaluated system has beside its elements, and what another one has.
    u : ndarray, shape (size,)
    least : float
    """
    kinds, extra = (Springs, NonlinearSprings), list(evaluation.extra)
    for n, (here, there) in enumerate(zip(own, others, strict=False)):
        if isinstance(here, kinds) and isinstance(there, kinds) and here.between(there):
            before, found = extra[n], there.forces(u)
            if not np.allclose(found.values, before.values, rtol=least, atol=0.0):
                extra[n] = replace(before, values=found.values)
    changed = any(one is not before for one, before in zip(extra, evaluation.extra, strict=True))
    return replace(evaluation, extra=extra) if changed else None


class Pressure:
    """Pressure on faces, normal to them as they deform (ABAQUS, *DSLOAD, P).

    Parameters
    ----------
    faces : Faces
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    size : int
        Number of degrees of freedom.

    Notes
    -----
    `value` in MPa, shape (faces,), is set before each increment.
    """

    symmetric = False

    def __init__(self, faces: Faces, points: np.ndarray, size: int) -> None:
        self.faces, self.points, self.size = faces, points, size
        self.value = np.zeros(len(faces.nodes))
        dim = points.shape[1]
        self.dim = dim
        xi, self.weights = cell_rule(faces.nodes.shape[1], dim)
        self.values, self.gradients = cell_shape(faces.nodes.shape[1], dim, xi)
        self._dofs = (faces.nodes[:, :, None] * dim + np.arange(dim)).reshape(len(faces.nodes), -1)

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom of the faces."""
        return np.unique(self._dofs)

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Nothing."""

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution:
        """Forces with the sign of internal forces, and load stiffness."""
        dim, nodes = self.dim, self.faces.nodes
        x = (self.points + u[: self.points.size].reshape(-1, dim))[nodes]
        slopes = np.einsum("fni,gnj->fgij", x, self.gradients)
        normal = area_vectors(slopes)
        axisymmetric = self.faces.thickness == 0
        scale = (self.value * self.faces.outward)[:, None] * self.weights
        radius = x[..., 0] @ self.values.T
        depth = np.ones_like(radius)
        if dim == 2:
            depth = np.where(axisymmetric[:, None], 2 * np.pi * radius, self.faces.thickness[:, None])
        force = np.einsum("gn,fgi,fg->fni", self.values, normal, scale * depth).reshape(len(nodes), -1)
        total = np.bincount(self._dofs.ravel(), weights=force.ravel(), minlength=self.size)
        empty = np.empty(0, dtype=int)
        if not tangent:
            return Contribution(total, empty, empty, np.empty(0))
        # d normal / d x of each node: cross products with the slopes of its shape function
        change = np.zeros((*normal.shape[:2], dim, nodes.shape[1], dim))
        if dim == 2:
            change[..., 0, :, 1] = self.gradients[None, ..., 0]
            change[..., 1, :, 0] = -self.gradients[None, ..., 0]
        else:
            for axis in range(3):
                unit = np.eye(3)[axis]
                first, second = np.cross(unit, slopes[..., 1]), np.cross(slopes[..., 0], unit)
                change[..., axis] = (
                    first[..., None] * self.gradients[None, :, None, :, 0]
                    + second[..., None] * self.gradients[None, :, None, :, 1]
                )
        local = np.einsum("gn,fgimj,fg->fnimj", self.values, change, scale * depth)
        if axisymmetric.any():
            wider = np.where(axisymmetric[:, None], 2 * np.pi, 0.0) * scale
            local[..., 0] += np.einsum("gn,fgi,gm,fg->fnim", self.values, normal, self.values, wider)
        shape = (len(nodes), self._dofs.shape[1], self._dofs.shape[1])
        rows = np.broadcast_to(self._dofs[:, :, None], shape).ravel()
        columns = np.broadcast_to(self._dofs[:, None, :], shape).ravel()
        return Contribution(total, rows, columns, local.ravel())

    def energy(self, u: np.ndarray) -> float:
        """Energy for the line search: exact for a pressure that does not turn."""
        return float(self.forces(u, tangent=False).force @ u)
