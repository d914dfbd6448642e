"""The built-in solver: finite strain, contact, numpy and scipy only."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fingerfit import __version__
from fingerfit.core.files import digest
from fingerfit.core.folders import PACKAGE
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome
from fingerfit.solvers.needs import FEATURES

if TYPE_CHECKING:
    from fingerfit.deck.content import Deck

# all that `solve` can reach, and this file; held against the imports by a test, because to follow them takes longer
# than many a solve
_SOURCES = (
    *(f"{name}__init__.py" for name in ("", "core/", "deck/", "mesh/", "solvers/")),
    *(f"core/{name}.py" for name in ("checksums", "errors", "files")),
    *(f"mesh/{name}.py" for name in ("elements", "faces", "mesh", "shapes")),
    "fem",
    "material",
    *(f"deck/{name}.py" for name in ("cards", "content", "state", "reader")),
    *(f"deck/{name}_keywords.py" for name in ("mesh", "material", "model", "step")),
    *(
        f"solvers/{name}.py"
        for name in ("builtin", "analysis", "contacts", "contract", "first_order", "initial", "model")
    ),
)


@cache
def _fingerprint() -> str:
    parts: list[str | bytes] = []
    for name in _SOURCES:
        path = PACKAGE / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            parts += [file.relative_to(PACKAGE).as_posix(), file.read_bytes()]
    return digest(*parts)


class BuiltinSolver:
    """Adapter of the built-in solver.

    Parameters
    ----------
    averaged : bool
        Whether linear quadrilaterals and bricks average the change of volume, as in ABAQUS; CalculiX does not.
    """

    name = "builtin"
    capabilities = Capabilities(elements=frozenset(ELEMENTS), features=FEATURES, nearby=True, first_order=True)

    def __init__(self, averaged: bool = True) -> None:
        self.averaged = averaged

    def identity(self) -> dict[str, Any]:
        """Name, version and a hash of the sources that make the answer."""
        identity: dict[str, Any] = {"name": self.name, "version": __version__, "fingerprint": _fingerprint()}
        return identity if self.averaged else {**identity, "averaged": False}

    def check(self, deck: Path) -> None:
        """Read the deck; InputError for what is not understood."""
        from fingerfit.deck.reader import read_deck
        from fingerfit.solvers.analysis import Watched, model_of, prescribed_in

        read = read_deck(deck)
        Watched.of(read, deck)
        model = model_of(read, deck, self.averaged)
        model.system(prescribed_in(model, read.steps[0]))

    def first_order(self, folder: Path, deck: str, known: Outcome, moved: Sequence[str]) -> list[Outcome | None]:
        """Answers beside a known one: see `fingerfit.solvers.first_order.answers`."""
        from fingerfit.solvers.first_order import answers

        return answers(folder, deck, known, moved, self.averaged)

    def solve(self, deck: Path, workdir: Path, threads: int = 1, nearby: Outcome | None = None) -> Outcome:
        """Solve a deck; nothing is written to `workdir`. Large systems are factorised by as many threads (PARDISO).

        Where the path does not matter each step begins at that of the outcome of a deck with nearly the same numbers.

        Raises
        ------
        InputError
            For a deck that is not understood.
        """
        # imported here, because every round asks for the identity alone
        from fingerfit.deck.reader import read_deck
        from fingerfit.solvers.analysis import Watched, run_steps

        # read when MKL is loaded; else it takes all processors
        os.environ.setdefault("MKL_NUM_THREADS", str(threads))
        read = read_deck(deck)
        dim = read.mesh.dim
        watched = Watched.of(read, deck)
        displacement, reaction, moved, iterations = [], [], [], []
        message, status = f"{len(read.steps)} steps", CONVERGED
        silent = not any(step.printed for step in read.steps)
        begun = _every_node(nearby, read, watched.indenter) if nearby is not None else None
        steps = run_steps(read, deck, self.averaged, begun)
        for number, (asked, step) in enumerate(zip(read.steps, steps, strict=False), 1):
            if not step.arrived:
                status, message = DIVERGED, f"no equilibrium in step {number} of {len(read.steps)}"
                break
            if not (silent or asked.printed):
                continue
            displacement.append(step.displacement[: watched.nodes])
            reaction.append(watched.reaction(read, step.internal, step.displacement))
            moved.append(step.displacement[watched.indenter])
            iterations.append(step.iterations)
        return Outcome(
            status,
            np.array(displacement).reshape(-1, watched.nodes, dim),
            np.array(reaction).reshape(-1, dim),
            np.array(moved).reshape(-1, dim),
            message,
            tuple(iterations),
        )


def _every_node(outcome: Outcome, deck: Deck, indenter: int) -> np.ndarray:
    """Displacements of an outcome at all nodes of a deck, shape (steps, nodes, dim), mm; nodes of walls rest."""
    found = np.zeros((outcome.steps, *deck.mesh.points.shape))
    found[:, : outcome.displacement.shape[1]] = outcome.displacement
    found[:, indenter] = outcome.indenter
    return found
