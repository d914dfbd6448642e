"""The reduced system of equations: constraints eliminated, pattern and order made once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fingerfit.fem.constraints import resolve
from fingerfit.fem.factor import CLOSE, LARGE, Apply, LinearSolver
from fingerfit.fem.levels import WIDEST, Levels
from fingerfit.fem.pattern import Pattern

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from fingerfit.fem.rigid import RigidBody


@dataclass(frozen=True)
class Contribution:
    """What something that is not an element adds: nodal forces and stiffness as triplets.

    Parameters
    ----------
    force : ndarray, shape (size,)
        N.
    rows, columns, values : ndarray, shape (entries,)
        Stiffness in N/mm by degree of freedom; empty where it was not asked for.
    """

    force: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray


class Term(Protocol):
    """Springs, contact, averaged volumes, pressure: anything beside the elements."""

    symmetric: bool

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom that it may act on."""

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Get ready for a time increment."""

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Take the end of an increment into the history."""

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution | None:
        """Internal forces; None where the state is impossible."""

    def energy(self, u: np.ndarray) -> float:
        """Energy in N mm, of the current increment where it depends on the path."""


@dataclass(frozen=True)
class Evaluation:
    """Internal forces with the stiffnesses they came with; the largest force of any part alone, N."""

    internal: np.ndarray
    largest: float
    blocks: list[np.ndarray]
    extra: list[Contribution]


class System:
    """Scatters forces and stiffnesses to the unknowns and solves for them.

    Parameters
    ----------
    bodies : list of Body
        All elements.
    size : int
        Number of degrees of freedom.
    prescribed : ndarray of bool, shape (size,)
        Degrees of freedom with a given displacement.
    ties : mapping
        Slave to its masters with factors: u_slave = sum factor * u_master. Masters may be slaves of others.
    terms : sequence of Term
        What else has forces.
    rigid : sequence of RigidBody
        Bodies that turn; their nodes are slaves.
    points : ndarray or None, shape (nodes, dim)
        Reference positions in mm, for a good order of the unknowns.

    Raises
    ------
    ValueError
        When ties go round in a circle, or a slave is prescribed; the argument is the degree of freedom.
    """

    def __init__(
        self,
        bodies: list[Any],
        size: int,
        prescribed: np.ndarray,
        ties: Mapping[int, Sequence[tuple[int, float]]],
        terms: Sequence[Term] = (),
        rigid: Sequence[RigidBody] = (),
        points: np.ndarray | None = None,
    ) -> None:
        self.bodies, self.size, self.terms, self.rigid = bodies, size, list(terms), list(rigid)
        self.driven = any(getattr(term, "driven", False) for term in terms)
        self._contacts = [n for n, term in enumerate(terms) if hasattr(term, "law")]
        self.touches = bool(self._contacts)
        self.slides = any(getattr(term, "slides", False) for term in terms)
        self.remembers = any(not getattr(term, "slides", True) for term in terms)
        turning = [int(dof) for body in self.rigid for dof in body.dofs.ravel()]
        self._resolved = resolved = resolve(ties, prescribed, turning)
        free = self._touched() & ~prescribed
        free[turning] = False
        free[list(resolved)] = False
        self.prescribed = prescribed
        self.free = np.flatnonzero(free)
        number = np.full(size, -1)
        number[self.free] = np.arange(len(self.free))
        self.master, self.factor = np.arange(size), np.ones(size)
        self.simple = not self.rigid and all(len(masters) == 1 for masters in resolved.values())
        if self.simple:
            for slave, masters in resolved.items():
                self.master[slave], self.factor[slave] = masters[0]
        self.unknown = number[self.master]
        self._map: tuple[Any, Any] | None = None
        self._angles = np.zeros(size)
        positions = None
        if points is not None:
            # rotations go with the first node
            nodes = np.where(self.free < points.size, self.free // points.shape[1], 0)
            positions = points[nodes]
        self._linear = LinearSolver(positions, all(term.symmetric for term in self.terms))
        self._levels: Levels | None = None
        self._prepared = False

    def _touched(self) -> np.ndarray:
        """Degrees of freedom that something acts on, itself or by what is tied to them, bool."""
        touched = np.zeros(self.size, dtype=bool)
        for body in self.bodies:
            touched[body.dofs.ravel()] = True
        for term in self.terms:
            touched[term.dofs] = True
        for slave, masters in self._resolved.items():
            for master, _ in masters:
                touched[master] |= touched[slave]
        for body in self.rigid:
            touched[body.reference] = touched[body.rotation] = True
        return touched

    def _prepare(self) -> None:
        """Where each entry of the element stiffnesses goes in the matrix, by pairs of nodes, and what it counts."""
        self._prepared = True
        unknowns = self.unknown if self.simple else np.arange(self.size)
        count = len(self.free) if self.simple else self.size
        self._count = count
        if not self.bodies:
            self._row, self._pointers = np.empty(0, np.int32), np.zeros(count + 1, np.int32)
            self._pattern = Pattern(np.empty(0, np.int64), count)
            return
        dim = self.bodies[0].dim
        nodes = [body.dofs[:, ::dim] // dim for body in self.bodies]
        many = int(max(part.max() for part in nodes)) + 1
        pairs = [(part[:, :, None] * many + part[:, None, :]).astype(np.int64) for part in nodes]
        unique, at = np.unique(np.concatenate([part.ravel() for part in pairs]), return_inverse=True)
        # an element's stiffness has rows by node and axis, columns by node and axis
        axes = np.arange(dim)
        places, first = [], 0
        for part in pairs:
            here = at[first : first + part.size].reshape(part.shape) * dim**2
            first += part.size
            places.append((here[:, :, None, :, None] + axes[:, None, None] * dim + axes).ravel())
        shape = (len(unique), dim, dim)
        row = np.broadcast_to(((unique // many) * dim)[:, None, None] + axes[:, None], shape).ravel()
        column = np.broadcast_to(((unique % many) * dim)[:, None, None] + axes, shape).ravel()
        scale = self.factor[row] * self.factor[column]
        row, column = unknowns[row], unknowns[column]
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        keys = column[kept].astype(np.int64) * count + row[kept]
        final, position = np.unique(keys, return_inverse=True)
        # what is for no unknown comes behind all others
        target = np.full(len(row), len(final))
        target[kept] = position
        self._places = [target[part] for part in places]
        self._scales = [None] * len(places) if np.all(scale[kept] == 1.0) else [scale[part] for part in places]
        self._pattern = Pattern(final, count)
        self._row, self._pointers = self._pattern.rows, self._pattern.pointers
        if self.simple and 0 < count < LARGE:
            levels = Levels(self._row, self._pointers, self._linear.positions)
            self._levels = levels if levels.widest <= WIDEST else None
        for term in self.terms:
            if hasattr(term, "couples"):
                row, column = (unknowns[dofs] for dofs in term.couples)
                known = (row >= 0) & (column >= 0)
                self._pattern.grow(row[known], column[known])

    def _maps(self) -> tuple[Any, Any]:
        """Slopes of all displacements, by all independent ones, shape (size, size), and by the unknowns."""
        if self._map is None:
            from scipy.sparse import csc_matrix

            rows, columns, values = [], [], []
            turning = set()
            for body in self.rigid:
                turning |= set(body.dofs.ravel().tolist())
                slopes = body.slopes(self._angles[body.rotation])
                for node, by_rotation in zip(body.dofs, slopes, strict=True):
                    for dof, reference, slope in zip(node, body.reference, by_rotation, strict=True):
                        rows += [dof] * (1 + len(slope))
                        columns += [reference, *body.rotation]
                        values += [1.0, *slope]
            for dof in range(self.size):
                if dof in turning:
                    continue
                for master, factor in self._resolved.get(dof, ((dof, 1.0),)):
                    rows.append(dof)
                    columns.append(master)
                    values.append(factor)
            every = csc_matrix((values, (rows, columns)), shape=(self.size, self.size))
            self._map = every, every[:, self.free]
        return self._map

    def expand(self, q: np.ndarray, given: np.ndarray) -> np.ndarray:
        """All displacements from the unknowns and the given ones (zero elsewhere)."""
        full = given.copy()
        full[self.free] = q
        if self.simple:
            return self.factor * full[self.master]
        if not self.rigid:
            return self._maps()[0] @ full
        self._turn_to(full)
        for body in self.rigid:
            full[body.dofs] = body.place(full)
        for slave, masters in self._resolved.items():
            full[slave] = sum(factor * full[master] for master, factor in masters)
        return full

    def _turn_to(self, full: np.ndarray) -> None:
        """Let slopes be those at other rotations."""
        if self.rigid and not np.array_equal(self._angles, full):
            self._angles, self._map = full.copy(), None

    def along(self, u: np.ndarray, change: np.ndarray, step: np.ndarray | None = None) -> np.ndarray:
        """Change of all displacements, to first order, with a change of those given and a step of those unknown."""
        step = np.zeros(len(self.free)) if step is None else step
        if not self.rigid:
            return self.expand(step, change)
        self._turn_to(u)
        full = change.copy()
        full[self.free] = step
        return self._maps()[0] @ full

    def reduce(self, full: np.ndarray) -> np.ndarray:
        """Forces on all degrees of freedom to forces on the unknowns."""
        if not self.simple:
            return self._maps()[1].T @ full
        chosen = self.unknown >= 0
        return np.bincount(self.unknown[chosen], weights=(full * self.factor)[chosen], minlength=len(self.free))

    def begin(self, dt: float, relaxed: bool) -> None:
        """Get everything ready for a time increment."""
        for part in (*self.bodies, *self.terms):
            part.begin(dt, relaxed)

    def settle(self, u: np.ndarray) -> None:
        """Take the end of an increment as what the next one begins with."""
        for body in self.bodies:
            body.settle(u)

    def commit(self, u: np.ndarray, dt: float, relaxed: bool) -> None:
        """Take the end of an increment into the history of everything."""
        for part in (*self.bodies, *self.terms):
            part.commit(u, dt, relaxed)

    def evaluate(self, u: np.ndarray, tangent: bool = True, led: bool = False) -> Evaluation | None:
        """Internal forces of all parts; None where any of them is impossible. `led` as in `Body.forces`."""
        total, largest = np.zeros(self.size), 0.0
        blocks, extra = [], []
        for body in self.bodies:
            found = body.forces(u, tangent, led)
            if found is None:
                return None
            force = np.bincount(body.dofs.ravel(), weights=found[0].ravel(), minlength=self.size)
            largest = max(largest, float(np.abs(force).max()))
            total += force
            blocks.append(found[1])
        for term in self.terms:
            added = term.forces(u, tangent)
            if added is None:
                return None
            largest = max(largest, float(np.abs(added.force).max()))
            total += added.force
            extra.append(added)
        return Evaluation(total, largest, blocks, extra)

    def energy(self, u: np.ndarray) -> float:
        """Energy of all parts, N mm."""
        return sum(part.energy(u) for part in (*self.bodies, *self.terms))

    def matrix(self, evaluation: Evaluation) -> csc_matrix | np.ndarray:
        """Stiffness of the unknowns; of small systems of elements alone its entries, which are solved by levels."""
        if not self._prepared:
            self._prepare()
        data: np.ndarray = np.empty(0)
        if self.bodies:
            data = np.zeros(len(self._row) + 1)
            for block, place, scale in zip(evaluation.blocks, self._places, self._scales, strict=True):
                values = block.ravel() if scale is None else block.ravel() * scale
                data += np.bincount(place, weights=values, minlength=len(data))
            data = data[:-1]
        entries = [(e.values, e.rows, e.columns) for e in evaluation.extra if len(e.values)]
        if self._levels is not None and not entries:
            return data
        if entries:
            values, rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
            if self.simple:
                values = values * self.factor[rows] * self.factor[columns]
                rows, columns = self.unknown[rows], self.unknown[columns]
                kept = (rows >= 0) & (columns >= 0)
                values, rows, columns = values[kept], rows[kept], columns[kept]
            matrix = self._pattern.matrix(data, rows, columns, values)
        else:
            matrix = self._sparse(data)
        if not self.simple:
            from scipy.sparse import coo_matrix

            to_unknowns = self._maps()[1]
            for body in self.rigid:
                block = body.curvature(self._angles[body.rotation], evaluation.internal[body.dofs])
                rows, columns = (part.ravel() for part in np.meshgrid(body.rotation, body.rotation, indexing="ij"))
                matrix = matrix + coo_matrix((block.ravel(), (rows, columns)), shape=matrix.shape).tocsc()
            matrix = (to_unknowns.T @ matrix @ to_unknowns).tocsc()
        return matrix

    def _sparse(self, data: np.ndarray) -> csc_matrix:
        from scipy.sparse import csc_matrix

        return csc_matrix((data, self._row, self._pointers), shape=(self._count, self._count))

    def touching(self, u: np.ndarray, tangent: bool = True) -> list[Contribution]:
        """Forces of the contacts alone."""
        return [found for n in self._contacts if (found := self.terms[n].forces(u, tangent)) is not None]

    def none(self) -> list[Contribution]:
        """Contacts without any forces."""
        empty = np.empty(0, dtype=int)
        return [Contribution(np.zeros(self.size), empty, empty, np.empty(0)) for _ in self._contacts]

    def replaced(self, evaluation: Evaluation, touching: list[Contribution]) -> Evaluation:
        """An evaluation with other forces of the contacts."""
        internal, extra = evaluation.internal.copy(), list(evaluation.extra)
        for n, other in zip(self._contacts, touching, strict=True):
            internal += other.force - extra[n].force
            extra[n] = other
        return replace(evaluation, internal=internal, extra=extra)

    def product(self, matrix: csc_matrix | np.ndarray, step: np.ndarray) -> np.ndarray:
        """Forces on the unknowns by a step of theirs."""
        return np.asarray((self._sparse(matrix) if isinstance(matrix, np.ndarray) else matrix) @ step)

    def push(self, evaluation: Evaluation, move: np.ndarray) -> np.ndarray:
        """Internal forces continued along a displacement of all degrees of freedom, to first order."""
        total = evaluation.internal.copy()
        for body, block in zip(self.bodies, evaluation.blocks, strict=True):
            change = (block @ move[body.dofs][..., None])[..., 0]
            total += np.bincount(body.dofs.ravel(), weights=change.ravel(), minlength=self.size)
        for added in evaluation.extra:
            total += np.bincount(added.rows, weights=added.values * move[added.columns], minlength=self.size)
        return total

    def solver(self, evaluation: Evaluation, beside: bool = False) -> Apply | None:
        """Solutions for many right sides, by the tangent that came with an evaluation; None where it is singular.

        Those of the one before are no longer to be had, but where this one is made `beside` it.
        """
        matrix, linear = self.matrix(evaluation), self._linear.beside() if beside else self._linear
        return linear.factor(self._sparse(matrix) if isinstance(matrix, np.ndarray) else matrix)

    def solve(self, matrix: csc_matrix | np.ndarray, right: np.ndarray, close: float = CLOSE) -> np.ndarray | None:
        """Solution of the unknowns, see `fingerfit.fem.factor.LinearSolver.solve`; small systems by levels."""
        if self._levels is not None and isinstance(matrix, np.ndarray):
            found = self._levels.solve(matrix, right)
            if found is not None:
                return found
            # a block may be singular where the whole is not
            matrix = self._sparse(matrix)
        return self._linear.solve(matrix, right, close)
