"""What fingerfit asks of a solver."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import Deck, read_deck
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome
from fingerfit.solvers.needs import refuse_lacking
from smallfem.program import Program


class SmallFem:
    """Adapter; an object is made without arguments."""

    name = "smallfem"
    capabilities = Capabilities(frozenset({"CPE8"}), features=frozenset({"*EQUATION", "*HYPERELASTIC, OGDEN"}))

    def identity(self) -> dict[str, Any]:
        """Whatever changes the answer: simulations are found again by it."""
        return {"name": self.name, "version": version("fingerfit-smallfem")}

    def check(self, deck: Path) -> None:
        """Refuse what the program lacks, before anything runs."""
        self._read(deck)

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Displacements step by step; a guess without solution is an answer, not an error."""
        read = self._read(deck)
        mesh, steps = read.mesh, read.steps
        program = Program(mesh.points, np.vstack([block.nodes for block in mesh.blocks]), self._constants(read))
        indenter, moved, reaction = int(mesh.node_sets["INDENTER"][0]), [], []
        top = mesh.node_sets.get("TOP", [indenter])
        status, message = CONVERGED, f"{len(steps)} steps"
        for number, step in enumerate(steps, 1):
            given = {2 * node + axis: value for (node, axis), value in step.displacement.items()}
            force = {2 * node + axis: value for (node, axis), value in step.force.items()}
            ties = {2 * n + a: (2 * m + b, -g / f) for (n, a, f), (m, b, g) in read.equations}
            if not program.go_to(given, force, ties):
                status, message = DIVERGED, f"no equilibrium in step {number} of {len(steps)}"
                break
            moved.append(program.u.reshape(-1, 2).copy())
            reaction.append(program.internal.reshape(-1, 2)[top].sum(axis=0))
        displacement = np.array(moved).reshape(-1, len(mesh.points), 2)
        return Outcome(status, displacement, np.array(reaction).reshape(-1, 2), displacement[:, indenter], message)

    def _read(self, path: Path) -> Deck:
        """The deck in zero-based numbers; fingerfit's reader refuses unknown keywords with file and line."""
        deck = read_deck(path)
        refuse_lacking(deck, path, self.name, self.capabilities)
        if any(not deck.materials[section.material].d for section in deck.sections):
            raise InputError(path, "*HYPERELASTIC", "no D", "a compressible body")
        if any(len(terms) != 2 for terms in deck.equations):
            raise InputError(path, "*EQUATION", "more than two terms", "a slave and its master")
        return deck

    def _constants(self, deck: Deck) -> np.ndarray:
        """mu in MPa, alpha, D in 1/MPa and thickness in mm, shape (elements, 4)."""
        found = np.zeros((deck.mesh.element_count, 4))
        for section in deck.sections:
            m = deck.materials[section.material]
            found[deck.mesh.element_sets[section.elset]] = m.mu[0], m.alpha[0], m.d[0], section.thickness
        return found
