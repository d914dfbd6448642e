"""What a solver adapter must offer, and what it answers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.files import read_npz, write_npz

CONVERGED = "converged"
DIVERGED = "diverged"
BY_PATH = re.compile(r"^\*FRICTION", re.MULTILINE)
"""Keyword of decks that nobody answers to first order: the answer depends on the way to it. There may be others; a
solver then gives no such answer."""
IN_TIME = re.compile(r"^\*VISCOELASTIC", re.MULTILINE)
"""Keyword of decks beside which answers to first order cost another simulation of theirs, since time counts."""


@dataclass(frozen=True)
class Outcome:
    """Answer of a solver to one deck.

    Parameters
    ----------
    status : str
        ``converged``, or ``diverged``: a guess without solution is an answer, not an error.
    displacement : ndarray, shape (steps, nodes, dim)
        In mm, at the end of each step that prints the nodes ALL (of each, where none does); nodes in the deck's order.
        Of a diverged guess those steps that were reached.
    reaction : ndarray, shape (steps, dim)
        Force of the indenter on the body in N (negative along the second axis in compression).
    indenter : ndarray, shape (steps, dim)
        Displacement of the indenter in mm.
    message : str
        Why it stopped, in one line.
    iterations : tuple of int
        Equilibrium iterations of each step.
    begun : ndarray, shape (nodes, dim), optional
        Where displacements count from a state in which the nodes lie elsewhere than in the mesh: how far from there,
        mm. No solver answers it.

    Raises
    ------
    StateError
        For another status, numbers that are not finite and shapes that do not belong together: never an answer.
    """

    status: str
    displacement: np.ndarray
    reaction: np.ndarray
    indenter: np.ndarray
    message: str = ""
    iterations: tuple[int, ...] = ()
    begun: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.status not in (CONVERGED, DIVERGED):
            raise StateError(f"a solution of status {self.status}, which is neither {CONVERGED} nor {DIVERGED}")
        shape = self.displacement.shape
        if len(shape) != 3 or not self.reaction.shape == self.indenter.shape == (shape[0], shape[2]):
            found = ", ".join(str(part.shape) for part in (self.displacement, self.reaction, self.indenter))
            raise StateError(f"a solution of shapes {found}, which do not belong together")
        if self.status == CONVERGED and not shape[0]:
            raise StateError("a converged solution without steps")
        for name in ("displacement", "reaction", "indenter"):
            if not np.isfinite(getattr(self, name)).all():
                raise StateError(f"a solution whose {name} is not finite")

    @property
    def steps(self) -> int:
        """Number of steps that were reached."""
        return len(self.displacement)

    def save(self, path: Path) -> None:
        """Write to an .npz file, whole or not at all."""
        write_npz(
            path,
            {
                "status": np.array(self.status),
                "displacement": self.displacement,
                "reaction": self.reaction,
                "indenter": self.indenter,
                "message": np.array(self.message),
                "iterations": np.array(self.iterations, dtype=int),
            },
        )

    @classmethod
    def load(cls, path: Path) -> Outcome:
        """Read what `save` wrote.

        Raises
        ------
        StateError
            When the file is missing, damaged or something else.
        """
        data = read_npz(path)
        try:
            return cls(
                str(data["status"]),
                data["displacement"],
                data["reaction"],
                data["indenter"],
                str(data["message"]),
                tuple(int(i) for i in data["iterations"]),
            )
        except KeyError as error:
            raise StateError(f"{path}: is not a solution: {error} is missing") from error
        except StateError as error:
            raise StateError(f"{path}: is {error}") from error


@dataclass(frozen=True)
class Capabilities:
    """What an adapter can do; `fingerfit.solvers.needs.refuse_lacking` refuses anything else before a run.

    Parameters
    ----------
    elements : frozenset of str
    control : frozenset of str
        ``force``, ``displacement`` or both.
    features : frozenset of str
        Some of `fingerfit.solvers.needs.FEATURES`: materials, constraints, contact and loads beside these.
    nearby : bool
        Whether `Solver.solve` takes the outcome of a deck with nearly the same numbers and begins there
        (`SolverNearby`).
    first_order : bool
        Whether it answers decks beside a known one to first order (`SolverToFirstOrder`).
    """

    elements: frozenset[str]
    control: frozenset[str] = field(default_factory=lambda: frozenset({"force", "displacement"}))
    features: frozenset[str] = frozenset()
    nearby: bool = False
    first_order: bool = False


class Solver(Protocol):
    """Contract of an adapter; found through the entry point group ``fingerfit.solvers``."""

    name: str
    capabilities: Capabilities

    def identity(self) -> dict[str, Any]:
        """Name, version and whatever else changes the answer (JSON), but not the number of threads.

        Raises SolverError when the solver is not installed.
        """

    def check(self, deck: Path) -> None:
        """Look at a deck before anything runs: once for each fit, and once for each effect that is tried.

        Raises InputError for what the solver lacks, SolverError when it is not there.
        """

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Run the deck in a folder of its own.

        Raises NoSolverError when no deck could be run, as without a licence; SolverError when this one was stopped, was
        refused, or left a damaged answer (`fingerfit.solvers.answer` helps to tell). An adapter that runs a program has
        an attribute `time_limit`, in s.
        """


class SolverNearby(Solver, Protocol):
    """What is more of an adapter whose capabilities have `nearby`."""

    def solve(self, deck: Path, workdir: Path, threads: int = 1, nearby: Outcome | None = None) -> Outcome:
        """As of `Solver`; begins at the outcome of a deck with nearly the same numbers.

        The answer is the one from rest but for the tolerance of the equilibrium. Where it cannot begin there, it begins
        at rest.
        """


class SolverToFirstOrder(SolverNearby, Protocol):
    """What is more of an adapter whose capabilities have `first_order`."""

    def first_order(self, folder: Path, deck: str, known: Outcome, moved: Sequence[str]) -> list[Outcome | None]:
        """Answers to the texts of decks that differ little from one whose answer is known, to first order.

        What they include is looked up from `folder`. None where that cannot be, as where the path to an answer matters.
        """
