"""Finding solvers: our own, and those that other packages register."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast

from fingerfit.core.errors import FingerfitError
from fingerfit.deck.cards import read_text
from fingerfit.solvers.contract import Outcome, Solver, SolverNearby, SolverToFirstOrder

if TYPE_CHECKING:
    from importlib.metadata import EntryPoints

GROUP = "fingerfit.solvers"


def _registered() -> EntryPoints:
    # imported late: most runs name a solver of ours
    from importlib.metadata import entry_points

    return entry_points(group=GROUP)


def solver_names() -> list[str]:
    """Names that `get_solver` knows."""
    return sorted({"abaqus", "builtin", "calculix", *(entry.name for entry in _registered())})


def get_solver(name: str, time_limit: float | None = None) -> Solver:
    """Adapter of a name.

    Parameters
    ----------
    name : str
    time_limit : float, optional
        Seconds for one deck, for adapters that have such a limit; they have one of their own.

    Raises
    ------
    FingerfitError
        For an unknown name, with the nearest known one.
    """
    solver = _made(name)
    if time_limit is not None and hasattr(solver, "time_limit"):
        solver.time_limit = time_limit
    return solver


def solve_deck(
    solver: Solver, deck: Path, threads: int, nearby: Path | None = None, first_order: bool = False
) -> Outcome:
    """Run a deck in its folder, from rest or from the solution in the folder of another one.

    Parameters
    ----------
    solver : Solver
    deck : Path
    threads : int
    nearby : Path, optional
        The other folder.
    first_order : bool
        Whether to answer to first order beside that solution, where this can be.

    Raises
    ------
    StateError
        When that solution, or its deck, is missing or damaged.
    """
    if nearby is None:
        return solver.solve(deck, deck.parent, threads)
    if first_order and (found := answers_beside(solver, nearby, [deck])[0]) is not None:
        return found
    return cast(SolverNearby, solver).solve(deck, deck.parent, threads, Outcome.load(nearby / "solution.npz"))


def answers_beside(solver: Solver, nearby: Path, decks: Sequence[Path]) -> list[Outcome | None]:
    """Answers to decks to first order beside the solution in a folder; None where that cannot be.

    Raises
    ------
    StateError
        When that solution, or its deck, is missing or damaged.
    """
    known, texts = Outcome.load(nearby / "solution.npz"), [read_text(deck) for deck in decks]
    return cast(SolverToFirstOrder, solver).first_order(nearby, read_text(nearby / "deck.inp"), known, texts)


def _made(name: str) -> Solver:
    if name == "builtin":
        from fingerfit.solvers.builtin import BuiltinSolver

        return BuiltinSolver()
    if name == "calculix":
        from fingerfit.solvers.calculix import CalculixSolver

        return CalculixSolver()
    if name == "abaqus":
        from fingerfit.solvers.abaqus import AbaqusSolver

        return AbaqusSolver()
    for entry in _registered():
        if entry.name == name:
            return entry.load()()
    near = difflib.get_close_matches(name, solver_names(), 1)
    hint = f"; did you mean {near[0]}?" if near else ""
    raise FingerfitError(f"solver: found {name}; expected one of {', '.join(solver_names())}{hint}")
