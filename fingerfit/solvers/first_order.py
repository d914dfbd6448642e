"""Answers of the built-in solver to decks that differ little from one whose answer is known: to first order.

The equations of a deck are T (f(u) - F) = 0, with the internal forces f at the displacements u, the loads F and the
map T of forces on all degrees of freedom to those on the unknowns. At the known displacements the forces of a deck
that was moved are evaluated, and followed with the tangent of the known one: a single step of Newton's method, with
one factorisation for all moved decks (and one for each whose materials are others, or whose springs are of another
stiffness), and no way from rest. Where materials relax, the known deck is solved again, and the others are followed at
the end of each increment, each with the history of its own answer. Where bodies touch, and where nodes lie elsewhere or
materials are others, a second step with the same tangent tells what the first one left out, and whether that is little.
What moves with a deck may be anything: constants, places of nodes, prescribed displacements, factors of ties, springs,
temperatures, stresses. Divided by the size of its change, it is a derivative up to that size, as a difference of two
answers is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import DeckStep
from fingerfit.deck.reader import read_deck
from fingerfit.fem.factor import Apply
from fingerfit.fem.forces import stiffened
from fingerfit.fem.newton import TOLERANCE, Load
from fingerfit.fem.system import Evaluation, System
from fingerfit.solvers.analysis import IncrementEnd, Watched, load_at_end, load_path, model_of, prescribed_in, run_steps
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.solvers.model import Model

_STILL = 100 * TOLERANCE
"""Residual force, relative to the largest internal force, above which an answer is none of its deck. A choice."""

_SAME = 1e-6
"""Relative difference of displacements up to which an answer that is found again is the same, and a second step is
none, however short the first one was: well above what `TOLERANCE` leaves, far below what another deck has. A choice."""

_BESIDE = 5e-3
"""Share of the body's size by which nodes may lie elsewhere: a row of elements that is much flatter is no small change
(docs/decisions/0045-borders-in-the-mesh.md). A choice."""

_AS_STIFF = 0.1
"""Relative difference of the stiffness of springs from which a tangent with the others is made. A choice: what is left
out is the product of it and the change of the displacements."""

_FOLLOWED = 0.2
"""Share of the change above which what the first step left out is too much: whole patches have come to touch.
A choice: in a fingertip constants left out 0.01 to 0.05 (one point 0.11), a tool set down elsewhere 0.5 to 1.0. Under a
force a soft band (contrast -2.5, 4 x 6 CPE8H) may turn by 2 degrees, and by 3 to one side only."""

_OTHER_NODES = 1.0
"""The same where nodes lie elsewhere. They have the displacements of the places where they were, so that the first step
leaves out products of both changes, and may overshoot by as much as is there; the second one takes that back (where 0.8
was left out, of a border with many waves on small elements, 0.006 are). Steps that grow come no nearer."""


def answers(
    folder: Path, deck: str, known: Outcome, moved: Sequence[str], averaged: bool = True
) -> list[Outcome | None]:
    """Answers to moved decks, to first order.

    Parameters
    ----------
    folder : Path
        Where the decks are, or would be: what they include is looked up from there.
    deck : str
        Text of the one that is known.
    known : Outcome
        Its answer.
    moved : sequence of str
        Texts of the others.
    averaged : bool
        As of `fingerfit.solvers.builtin.BuiltinSolver`.

    Returns
    -------
    list
        None where that cannot be: where the answer depends on the way to it (friction), where another part of the body
        would touch, where the second step is no small one, where nodes have displacements that neither the deck
        prescribes nor the answer tells (of rigid bodies that turn), where the moved deck has other unknowns, and where
        its nodes lie elsewhere by more than a little.
    """
    here = _read(folder / "deck.inp", deck, averaged)
    found: list[_Moved | None] = [None] * len(moved)
    if here is None or known.status != CONVERGED or known.steps != len(here.steps):
        return [None] * len(moved)
    with np.errstate(all="ignore"):
        others = (_read(folder / "deck.inp", text, averaged) for text in moved)
        found = [one.compared(here) if one and here.is_like(one) else None for one in others]
        if here.relaxes:
            return _by_increments(here, folder / "deck.inp", known, found, averaged)
        for n, displacement in enumerate(known.displacement):
            place = _Place.of(here, n, displacement.ravel())
            found = [one if one and place and one.follow(place, n) else None for one in found]
    return [one.outcome() if one else None for one in found]


def _by_increments(
    here: _Moved, path: Path, known: Outcome, moved: Sequence[_Moved | None], averaged: bool
) -> list[Outcome | None]:
    """As `answers`, where materials relax: the known deck is solved again, since its answer tells no histories."""
    found = list(moved)

    def follow(end: IncrementEnd) -> None:
        place = _Place.at(end.system, end.load, end.u)
        found[:] = [one if one and place and one.follow_in(place, end) else None for one in found]

    nothing: list[Outcome | None] = [None] * len(found)
    steps = run_steps(here.model.deck, path, averaged, watch=follow)
    for step, told in zip(steps, known.displacement, strict=True):
        end = step.displacement[: len(told)]
        # the answer of another deck is none
        if not step.arrived or not np.abs(end - told).max() <= _SAME * np.abs(end).max() or not any(found):
            return nothing
    return [one.outcome() if one else None for one in found]


@dataclass
class _Moved:
    """A deck, and what was found of its answer so far."""

    model: Model
    watched: Watched
    other_materials: bool = False
    other_elements: bool = False
    other_nodes: bool = False
    displacement: list[np.ndarray] = field(default_factory=list)
    internal: list[np.ndarray] = field(default_factory=list)
    _system: System | None = None
    _step: int = -1
    _path: Callable[[float], Load] | None = None
    _ended: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def steps(self) -> list[DeckStep]:
        return self.model.deck.steps

    def is_like(self, other: _Moved) -> bool:
        """Whether it has as many steps and nodes, near the same places, and relaxes or does not as the other one."""
        own, others = self.model.deck.mesh.points, other.model.deck.mesh.points
        same = len(self.steps) == len(other.steps) and self.model.size == other.model.size and own.shape == others.shape
        return same and self.relaxes == other.relaxes and bool(np.abs(own - others).max() <= _BESIDE * np.ptp(own))

    def compared(self, known: _Moved) -> _Moved:
        """The same, which knows whether its nodes lie elsewhere than those of a known one.

        Where they do not, whether it has other elements on them, or these of other materials.
        """
        own, others = self.model, known.model
        if not np.array_equal(own.deck.mesh.points, others.deck.mesh.points):
            return replace(self, other_nodes=True)
        pairs = zip(own.bodies, others.bodies, strict=False)
        same = len(own.bodies) == len(others.bodies)
        same = same and all(np.array_equal(one.connectivity, other.connectivity) for one, other in pairs)
        return replace(self, other_elements=not same, other_materials=same and own.materials != others.materials)

    def system(self, step: int) -> System:
        """Its equations in a step."""
        prescribed = prescribed_in(self.model, self.steps[step])
        if self._system is None or not np.array_equal(prescribed, self._system.prescribed):
            self._system = self.model.system(prescribed)
        return self._system

    @property
    def relaxes(self) -> bool:
        """Whether the answer depends on the time that it took."""
        return any(body.history is not None for body in self.model.bodies)

    def follow(self, place: _Place, step: int) -> bool:
        """Find the answer of a step from the known one; whether there is one."""
        found = self._beside(place, self.system(step), load_at_end(self.model, self.steps[step]))
        return found is not None and self._keep(*found)

    def follow_in(self, place: _Place, end: IncrementEnd) -> bool:
        """Find the answer of an increment from the known one, and take it into the history; whether there is one."""
        system, relaxed = self.system(end.step), self.steps[end.step].relaxed
        load = self._loading(end.step)(end.share)
        system.begin(end.time, relaxed)
        found = self._beside(place, system, load)
        if found is None:
            return False
        u, internal = found
        try:
            system.commit(u, end.time, relaxed)
        except ValueError:  # an inverted element
            return False
        self._ended = u, load.force
        return end.share < 1.0 or self._keep(u, internal)

    def _loading(self, step: int) -> Callable[[float], Load]:
        """Load as a function of the share of a step, from where the one before it ended."""
        if self._path is None or step != self._step:
            u, force = self._ended or (np.zeros(self.model.size), np.zeros(self.model.size))
            before = Load(np.where(self.system(step).prescribed, u, 0.0), force)
            self._step, self._path = step, load_path(self.model, self.steps[step], before)
        return self._path

    def _beside(self, place: _Place, system: System, load: Load) -> tuple[np.ndarray, np.ndarray] | None:
        """Displacements, mm, and internal forces, N, under a load from what is known of a place."""
        own = self.other_materials or self.other_elements
        evaluation = system.evaluate(place.u, tangent=own)
        if evaluation is None or not np.array_equal(system.free, place.system.free):
            return None
        if self.other_elements:
            place = replace(place, system=system)
        found = place.with_tangent(evaluation) if own else place.with_springs(system)
        if found is None:
            return None
        place = found
        # other products of two changes are left out: nodes that are moved alone meet the bulk modulus
        moved = system.expand(place.q, load.given) - place.u
        forces = system.reduce(evaluation.internal - load.force) + place.system.reduce(place.along(moved))
        still = np.zeros(len(moved))
        change = moved + place.system.expand(place.solve(place.left - forces), still)
        internal = evaluation.internal + place.along(change)
        if system.touches or own or self.other_nodes:
            # what touches or lifts off on the way is not in the tangent; pressures change by more than is linear
            evaluation = system.evaluate(place.u + change, tangent=False)
            if evaluation is None:
                return None
            more = place.system.expand(place.solve(place.left - system.reduce(evaluation.internal - load.force)), still)
            share = _FOLLOWED if system.touches or own else _OTHER_NODES
            little = max(share * np.linalg.norm(change), _SAME * np.linalg.norm(place.u))
            if not np.linalg.norm(more) <= little:
                return None
            change, internal = change + more, evaluation.internal + place.along(more)
        return place.u + change, internal

    def _keep(self, u: np.ndarray, internal: np.ndarray) -> bool:
        """Keep the answer of a step; whether it is one."""
        self.displacement.append(u)
        self.internal.append(internal)
        return bool(np.isfinite(u).all() and np.isfinite(internal).all())

    def outcome(self) -> Outcome:
        shape = (len(self.displacement), -1, self.model.dim)
        displacement, internal = (np.array(part).reshape(shape) for part in (self.displacement, self.internal))
        steps = zip(internal, displacement, strict=True)
        reaction = np.array([self.watched.reaction(self.model.deck, *step) for step in steps])
        displacement = displacement[:, : self.watched.nodes]
        return Outcome(CONVERGED, displacement, reaction, displacement[:, self.watched.indenter], "to first order")


@dataclass(frozen=True)
class _Place:
    """The known answer of a step, with its tangent: unknowns and all displacements in mm, and its residual in N."""

    system: System
    evaluation: Evaluation
    solve: Apply
    q: np.ndarray
    u: np.ndarray
    left: np.ndarray

    @classmethod
    def of(cls, known: _Moved, step: int, told: np.ndarray) -> _Place | None:
        """That of a step from what the answer tells of it; all other displacements must be prescribed."""
        system, load = known.system(step), load_at_end(known.model, known.steps[step])
        if not system.prescribed[len(told) :].all():
            return None
        u = np.append(told, load.given[len(told) :])
        alike = np.allclose(system.expand(u[system.free], load.given), u, rtol=0, atol=1e-9)
        return cls.at(system, load, u) if alike else None

    @classmethod
    def at(cls, system: System, load: Load, u: np.ndarray) -> _Place | None:
        """That under a load, displacements `u` in mm; None where it is no equilibrium."""
        evaluation = system.evaluate(u)
        if evaluation is None or not len(system.free):
            return None
        left = system.reduce(evaluation.internal - load.force)
        if not np.abs(left).max() <= _STILL * max(evaluation.largest, np.abs(load.force).max()):
            return None
        solve = system.solver(evaluation)
        return None if solve is None else cls(system, evaluation, solve, u[system.free], u, left)

    def with_springs(self, system: System) -> _Place | None:
        """The same, with the tangent of another system's springs where these are much softer or stiffer.

        A plate that comes loose changes springs by a factor of a thousand, and displacements by little.
        """
        evaluation = stiffened(self.evaluation, self.system.terms, system.terms, self.u, _AS_STIFF)
        return self if evaluation is None else self.with_tangent(evaluation)

    def with_tangent(self, evaluation: Evaluation) -> _Place | None:
        """The same, with another tangent of its system at the same displacements; None where that is singular."""
        solve = self.system.solver(evaluation, beside=True)
        return None if solve is None else replace(self, evaluation=evaluation, solve=solve)

    def along(self, move: np.ndarray) -> np.ndarray:
        """Change of the internal forces with a change of all displacements, N."""
        return self.system.push(self.evaluation, move) - self.evaluation.internal


def _read(path: Path, text: str, averaged: bool) -> _Moved | None:
    """A deck whose answer follows from its loads, and from time."""
    try:
        deck = read_deck(path, text)
        if not all(step.finite for step in deck.steps):
            return None
        if any(step.printed for step in deck.steps) and not all(step.printed for step in deck.steps):
            return None
        model, watched = model_of(deck, path, averaged), Watched.of(deck, path)
    except InputError:
        return None  # the simulation says why
    return None if model.sticks or model.rigid else _Moved(model, watched)
