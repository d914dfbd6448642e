"""The built-in solver: finite strain, Ogden, numpy and scipy only."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit import __version__
from fingerfit.deck.reader import Deck, DeckStep, read_deck
from fingerfit.errors import InputError
from fingerfit.fem.assembly import Body
from fingerfit.fem.elements import ELEMENTS, rule
from fingerfit.fem.newton import Load, Newton
from fingerfit.fem.system import System
from fingerfit.files import digest
from fingerfit.material.spread import spread
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome

_PACKAGE = Path(__file__).resolve().parent.parent
_SOURCES = ("fem", "material", "deck/reader.py", "mesh.py", "solvers/builtin.py", "solvers/contract.py")


@cache
def _fingerprint() -> str:
    parts: list[str | bytes] = []
    for name in _SOURCES:
        path = _PACKAGE / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            parts += [file.relative_to(_PACKAGE).as_posix(), file.read_bytes()]
    return digest(*parts)


class BuiltinSolver:
    """Adapter of the built-in solver.

    Parameters
    ----------
    averaged : bool
        Whether linear quadrilaterals and bricks average the change of volume, as in ABAQUS; CalculiX does not.
    """

    name = "builtin"
    capabilities = Capabilities(elements=frozenset(ELEMENTS))

    def __init__(self, averaged: bool = True) -> None:
        self.averaged = averaged

    def identity(self) -> dict[str, Any]:
        """Name, version and a hash of the sources that make the answer."""
        identity: dict[str, Any] = {"name": self.name, "version": __version__, "fingerprint": _fingerprint()}
        return identity if self.averaged else {**identity, "averaged": False}

    def check(self, deck: Path) -> None:
        """Read the deck; InputError for what is not understood."""
        _build(read_deck(deck), deck, self.averaged)

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Solve a deck; nothing is written to `workdir`, one thread is used.

        Raises
        ------
        InputError
            For a deck that is not understood.
        """
        read = read_deck(deck)
        system, indenter = _build(read, deck, self.averaged)
        dim = read.mesh.dim
        newton = Newton(system)
        displacement, reaction, moved, iterations = [], [], [], []
        message, status = f"{len(read.steps)} steps", CONVERGED
        top = read.mesh.node_sets.get("TOP", indenter[:1] // dim)
        with np.errstate(all="ignore"):
            for number, step in enumerate(read.steps, 1):
                arrived, used = newton.advance(_load(step, read, dim), step.increment)
                if not arrived:
                    status, message = DIVERGED, f"no equilibrium in step {number} of {len(read.steps)}"
                    break
                state = newton.state
                displacement.append(state.u.reshape(-1, dim))
                reaction.append(state.internal.reshape(-1, dim)[top].sum(axis=0))
                moved.append(state.u[indenter])
                iterations.append(used)
        return Outcome(
            status,
            np.array(displacement).reshape(-1, len(read.mesh.points), dim),
            np.array(reaction).reshape(-1, dim),
            np.array(moved).reshape(-1, dim),
            message,
            tuple(iterations),
        )


def _load(step: DeckStep, deck: Deck, dim: int) -> Load:
    load = Load(np.zeros(deck.mesh.points.size), np.zeros(deck.mesh.points.size))
    for target, values in ((load.given, step.displacement), (load.force, step.force)):
        for (node, axis), value in values.items():
            if axis < dim:
                target[node * dim + axis] = value
    return load


def _build(deck: Deck, path: Path, averaged: bool) -> tuple[System, np.ndarray]:
    mesh, dim = deck.mesh, deck.mesh.dim
    section_of = np.full(mesh.element_count, -1)
    for number, section in enumerate(deck.sections):
        section_of[mesh.element_sets[section.elset]] = number
    if section_of.min() < 0:
        raise InputError(path, "*SOLID SECTION", "elements without section", "a section for every element")
    bodies, first = [], 0
    for block in mesh.blocks:
        chosen = section_of[first : first + len(block.nodes)]
        first += len(block.nodes)
        gauss = len(rule(block.element)[1])
        materials = [deck.materials[deck.sections[s].material] for s in chosen]
        thickness = np.array([deck.sections[s].thickness if dim == 2 else 1.0 for s in chosen])
        material = spread(materials, [gauss] * len(chosen))
        try:
            bodies.append(Body(block.element, mesh.points, block.nodes, material, thickness, averaged=averaged))
        except ValueError as error:
            raise InputError(path, "*ELEMENT", error, "elements with positive Jacobian") from error
    prescribed = np.zeros(mesh.points.size, dtype=bool)
    for step in deck.steps:
        for node, axis in step.displacement:
            if axis < dim:
                prescribed[node * dim + axis] = True
    ties = {}
    for terms in deck.equations:
        if len(terms) != 2:
            raise InputError(path, "*EQUATION", f"{len(terms)} terms", "two terms")
        (slave, i, a), (master, j, b) = terms
        ties[slave * dim + i] = [(master * dim + j, -b / a)]
    indenter = mesh.node_sets.get("INDENTER")
    if indenter is None or len(indenter) != 1:
        raise InputError(path, "*NSET", "no node set INDENTER of one node", "the indenter's reference node")
    chained = [slave for slave, [(master, _)] in ties.items() if master in ties or prescribed[slave]]
    if chained:
        raise InputError(path, "*EQUATION", f"node {chained[0] // dim + 1} is tied twice or prescribed",
                         "slaves that are free")  # fmt: skip
    dofs = indenter[0] * dim + np.arange(dim)
    return System(bodies, mesh.points.size, prescribed, ties), dofs
