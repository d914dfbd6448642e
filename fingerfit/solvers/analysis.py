"""Going through the steps of a deck with the built-in solver."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Deck, DeckStep
from fingerfit.fem.newton import Load
from fingerfit.fem.path import Increments, LoadPath
from fingerfit.fem.system import System
from fingerfit.solvers.model import Model

_HARDLY = 1e-8
"""Strain whose square is lost in rounding."""


@dataclass(frozen=True)
class Watched:
    """Nodes whose displacements and forces are an answer.

    Parameters
    ----------
    indenter : int
        Reference node.
    top : ndarray of int
        Nodes that go with it.
    nodes : int
        Without what a deck adds to its mesh: nodes of walls.
    """

    indenter: int
    top: np.ndarray
    nodes: int

    @classmethod
    def of(cls, deck: Deck, path: Path) -> Watched:
        """Those of a deck; InputError where it has no indenter."""
        found = deck.mesh.node_sets.get("INDENTER")
        if found is None or len(found) != 1:
            raise InputError(path, "*NSET", "no node set INDENTER of one node", "the indenter's reference node")
        every = deck.mesh.node_sets.get("ALL")
        nodes = len(deck.mesh.points) if every is None else int(every.max()) + 1
        return cls(int(found[0]), deck.mesh.node_sets.get("TOP", found), nodes)

    def reaction(self, deck: Deck, internal: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Force of the indenter on the body, shape (dim,), N.

        Springs that hold its nodes sideways are how the body slips under it: what they hold, the body does not.

        Parameters
        ----------
        deck : Deck
        internal, moved : ndarray, shape (nodes, dim)
            Internal forces, N, and displacements, mm.
        """
        total, top = internal[self.top].sum(axis=0), set(self.top.tolist())
        for spring in deck.springs:
            for end, way in ((spring.first, 1), (spring.second, -1)):
                if end is not None and end[0] in top and end[1] < len(total) - 1:
                    other = 0.0 if spring.second is None else moved[spring.second]
                    total[end[1]] -= way * spring.force(moved[spring.first] - other)
        return np.asarray(total)


@dataclass(frozen=True)
class StepResult:
    """End of a step.

    Parameters
    ----------
    arrived : bool
        Whether it was reached; else the rest is of the last equilibrium.
    displacement, internal : ndarray, shape (nodes, dim)
        mm, and N: the reaction where something is prescribed.
    iterations : int
    """

    arrived: bool
    displacement: np.ndarray
    internal: np.ndarray
    iterations: int


@dataclass(frozen=True)
class IncrementEnd:
    """End of an increment, before it is taken into the history.

    Parameters
    ----------
    system : System
    step : int
        From 0.
    share : float
        Of the step.
    time : float
        Length in s; 0 where no time passes.
    load : Load
    u : ndarray, shape (size,)
        Displacements, mm.
    """

    system: System
    step: int
    share: float
    time: float
    load: Load
    u: np.ndarray


def model_of(deck: Deck, path: Path, averaged: bool = True) -> Model:
    """The model of a deck with its contacts; parameters and errors as of `Model`."""
    model = Model(deck, path, averaged)
    if deck.contacts:
        from fingerfit.solvers.contacts import add_contacts

        add_contacts(model)
    return model


def run_steps(
    deck: Deck,
    path: Path,
    averaged: bool = True,
    nearby: np.ndarray | None = None,
    watch: Callable[[IncrementEnd], None] | None = None,
) -> Iterator[StepResult]:
    """Solve a deck step by step, up to the first step that does not converge.

    Parameters
    ----------
    deck : Deck
    path : Path
        Of the deck, for messages.
    averaged : bool
        As of `fingerfit.solvers.builtin.BuiltinSolver`.
    nearby : ndarray, shape (steps, nodes, dim), optional
        Displacements at the end of each step of a deck with nearly the same numbers, mm. Each step then begins with
        these, moved by what was different one step before; where that finds no equilibrium, it is gone through as
        without them.
    watch : function, optional
        Called at the end of each increment of a step that is gone through.

    Raises
    ------
    InputError
        For what does not fit together, before the first step.
    """
    model = model_of(deck, path, averaged)
    loading: LoadPath | None = None
    if nearby is not None and not (len(nearby) == len(deck.steps) and _has_no_path(model)):
        nearby = None
    for number, step in enumerate(deck.steps):
        prescribed = prescribed_in(model, step)
        if loading is None:
            loading = _start(model, model.system(prescribed))
        elif not np.array_equal(prescribed, loading.system.prescribed):
            loading.change(model.system(prescribed))
        with np.errstate(all="ignore"):
            path_of_step, arrived, used = load_path(model, step, loading.load), False, 0
            if nearby is not None:
                arrived, used = loading.jump(path_of_step(1.0), _beside(loading, nearby, number), step.relaxed)
            if not arrived:
                told = _watched(loading, number, path_of_step, watch) if watch is not None else None
                arrived, more = loading.advance(path_of_step, _increments(deck, step), told)
                used += more
        shape, nodal = deck.mesh.points.shape, model.nodal
        state = loading.state
        yield StepResult(arrived, state.u[:nodal].reshape(shape), state.internal[:nodal].reshape(shape), used)
        if not arrived:
            return


def prescribed_in(model: Model, step: DeckStep) -> np.ndarray:
    """Which degrees of freedom have a given displacement in a step, bool."""
    found = np.zeros(model.size, dtype=bool)
    for node, axis in step.displacement:
        dof = model.dof(node, axis)
        if dof >= 0:
            found[dof] = True
    return found


def load_at_end(model: Model, step: DeckStep) -> Load:
    """What a step with finite strain has reached at its end; the model gets its pressures and temperatures."""
    zero = np.zeros(model.size)
    return load_path(model, step, Load(zero, zero))(1.0)


def _has_no_path(model: Model) -> bool:
    """Whether an equilibrium depends on the load alone, and displacements of nodes say all: nothing sticks, relaxes or
    turns."""
    return not (model.sticks or model.rigid or any(step.viscous or step.fixed for step in model.deck.steps))


def _beside(loading: LoadPath, nearby: np.ndarray, number: int) -> np.ndarray:
    """Displacements to begin a step with, shape (size,), mm."""
    u = loading.state.u.copy()
    known = nearby[number].size
    u[:known] += nearby[number].ravel() - (nearby[number - 1].ravel() if number else 0.0)
    return u


def _start(model: Model, system: System) -> LoadPath:
    """At rest; residuals are measured by the forces of initial stresses, and by those that keep it from swelling.

    Where these come to nothing, and where nothing is done at first, by those of a strain that rounding hardly knows.
    """
    deck, begun, floor = model.deck, model.temperature, 0.0
    states = [begun] if deck.stress or deck.strain else []
    if model.expands:
        states += [model.temperature_in(step) for step in deck.steps]
    for state in [*states, begun]:
        model.warm(state)
        if evaluation := system.evaluate(np.zeros(system.size), tangent=False) if states else None:
            floor = max(floor, float(np.abs(evaluation.internal).max()))
    first = deck.steps[0]
    if states or not any((*first.displacement.values(), *first.force.values(), *first.pressure.values())):
        hardly = np.zeros(system.size)
        hardly[: model.nodal] = _HARDLY * deck.mesh.points.ravel()
        if evaluation := system.evaluate(hardly, tangent=False):
            floor = max(floor, float(np.abs(evaluation.internal).max()))
    return LoadPath(system, floor)


def _increments(deck: Deck, step: DeckStep) -> Increments:
    times = {time for name in step.curve.values() for time in deck.amplitudes[name][0]}
    stops = tuple(sorted(t / step.period for t in times if 0 < t < step.period))
    return Increments(step.increment, step.largest, step.fixed, step.period, step.viscous, step.relaxed, stops)


def _watched(
    loading: LoadPath, step: int, path: Callable[[float], Load], watch: Callable[[IncrementEnd], None]
) -> Callable[[float, float, np.ndarray], None]:
    return lambda share, time, u: watch(IncrementEnd(loading.system, step, share, time, path(share), u))


def load_path(model: Model, step: DeckStep, before: Load) -> Callable[[float], Load]:
    """Load as a function of the share of a step, from that before it; the model gets its pressures and temperatures."""
    start = Load(before.given.copy(), before.force.copy())
    amplitudes = model.deck.amplitudes
    dead = start.force if model.finite else np.zeros(model.size)
    ends = []
    for kind, values, begun in (("U", step.displacement, start.given), ("F", step.force, dead)):
        end, factors = np.zeros(model.size), []
        for (node, axis), value in values.items():
            dof = model.dof(node, axis)
            if dof < 0:
                continue
            end[dof] = begun[dof] if kind == "U" and (node, axis) in step.kept else value
            name = step.curve.get((kind, (node, axis)))
            if name is not None:
                factors.append((dof, *amplitudes[name]))
        ends.append((begun, end, factors))
    from_pressure = [term.value.copy() for term, _ in model.pressures]
    to_pressure = [np.array([step.pressure.get(key, 0.0) for key in keys]) for _, keys in model.pressures]
    from_warm, to_warm = model.temperature, model.temperature_in(step)
    ramp = not step.sudden

    def load(share: float) -> Load:
        part = share if ramp else 1.0
        if model.expands or model.warms:
            warm = from_warm + part * (to_warm - from_warm)
            for (kind, (node, _)), curve in step.curve.items():
                if kind == "T":
                    warm[node] = to_warm[node] * np.interp(share * step.period, *amplitudes[curve])
            model.warm(warm)
        found = []
        for begun, end, factors in ends:
            now = begun + part * (end - begun) if part < 1.0 else end.copy()
            for dof, times, values in factors:
                now[dof] = end[dof] * np.interp(share * step.period, times, values)
            found.append(now)
        for (term, keys), first, last in zip(model.pressures, from_pressure, to_pressure, strict=True):
            term.value = first + part * (last - first)
            for n, key in enumerate(keys):
                name = step.curve.get(("P", key))
                if name is not None:
                    term.value[n] = last[n] * np.interp(share * step.period, *amplitudes[name])
            if not model.finite:
                found[1] = found[1] - term.forces(np.zeros(model.size)).force
        return Load(found[0], found[1])

    return load
