"""Simulations that one job asks for itself: solved beside each other, kept under the same names as all others."""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fingerfit.core.errors import NoSolverError, SolverError
from fingerfit.core.processes import side_by_side
from fingerfit.fit.course import next_round
from fingerfit.fit.lost import Lost
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked, Round, simulations, write_folders
from fingerfit.fit.took import Took
from fingerfit.solvers.cost import BUILTIN, SHORT, expected_seconds
from fingerfit.solvers.registry import answers_beside, get_solver, solve_deck

ITERATIONS = 10
"""Iterations of a search that one job makes at most: a line is told every few seconds, and not much is lost when it is
ended. A choice."""


def solve_missing(
    problem: InverseProblem, asked: Sequence[Asked], threads: int, needed: bool = False, took: Took | None = None
) -> int:
    """Solve what has no solution yet; returns how many that were, and adds how long they took to `took`.

    Raises
    ------
    SolverError
        When the solver ends one without an answer, unless the problem notes what is lost and nobody needs it.
    """
    every = simulations(asked)
    problem.asked.update(a.sim for a in every)
    missing = list({a.sim: a for a in every if not problem.is_solved(a)}.values())
    write_folders(problem.sims.parent, missing, problem.solver, problem.mesh_paths)
    took = Took() if took is None else took
    lost = problem.lost if problem.lost.noted and not needed else None
    solve = functools.partial(_solve, problem.sims, problem.settings.solver, problem.settings.time_limit, lost)
    # first those that others begin at
    for begins in (False, True):
        first = [a for a in missing if not a.first_order and bool(a.nearby) is begins]
        took.add(sum(side_by_side(solve, first, threads)), len(first))
    beside: dict[str, list[Asked]] = {}
    for a in missing:
        if a.first_order and lost is not None and lost.why(a.nearby):
            solve(a)
        elif a.first_order:
            beside.setdefault(a.nearby, []).append(a)
    shares = [share for group in beside.values() for n in range(threads) if (share := group[n::threads])]
    answer = functools.partial(_solve_beside, problem.sims, problem.settings.solver)
    left = list[Asked]()
    for share, (seconds, unanswered) in zip(shares, side_by_side(answer, shares, threads), strict=True):
        took.add(seconds, len(share) - len(unanswered))
        left += unanswered
    took.add(sum(side_by_side(solve, left, threads)), len(left))
    return len(missing)


def solved(problem: InverseProblem) -> set[str]:
    """Names of all simulations with a solution, whoever asked for them."""
    return {path.parent.name for path in problem.sims.glob("*/solution.npz")}


def solved_since(problem: InverseProblem, before: set[str]) -> int:
    """How many solutions a fit has asked for that were not there `before`, whatever came of its models.

    Two processes may ask for the same one at the same time: solutions are counted, not who asked for them.
    """
    return len((solved(problem) - before) & problem.asked)


def _solve(sims: Path, solver: str, limit: int | None, lost: Lost | None, asked: Asked) -> float:
    """Solve one; returns the seconds that it took."""
    folder, began = sims / asked.sim, time.monotonic()
    nearby = sims / asked.nearby if asked.nearby else None
    if lost is not None and asked.nearby and (why := lost.why(asked.nearby)):
        lost.note(asked.sim, why)
        return time.monotonic() - began
    try:
        solve_deck(get_solver(solver, limit), folder / "deck.inp", 1, nearby).save(folder / "solution.npz")
    except NoSolverError:
        raise
    except SolverError as error:
        if lost is None:
            raise
        lost.note(asked.sim, str(error))
    return time.monotonic() - began


def _solve_beside(sims: Path, solver: str, asked: Sequence[Asked]) -> tuple[float, list[Asked]]:
    """Answer guesses to first order beside the same one; returns the seconds, and those that have no such answer."""
    began = time.monotonic()
    folders = [sims / a.sim for a in asked]
    found = answers_beside(get_solver(solver), sims / asked[0].nearby, [folder / "deck.inp" for folder in folders])
    for folder, outcome in zip(folders, found, strict=True):
        if outcome is not None:
            outcome.save(folder / "solution.npz")
    left = [a for a, outcome in zip(asked, found, strict=True) if outcome is None]
    return time.monotonic() - began, left


def next_job(
    problem: InverseProblem, last: Round | None, threads: int, solve: bool = True, took: Took | None = None
) -> Round:
    """The next round, and where simulations are short as many iterations of its stage as one job makes.

    A simulation of a tenth of a second would take three times as long as a job of its own: start of Python, imports.
    So those that a round asks for are solved here, and the next round is made at once, until the search goes to another
    stage; what follows a search is one. What the last of these rounds asks for is solved here, too, and scored by the
    next job.

    Parameters
    ----------
    problem : InverseProblem
    last : Round or None
        The round before; None for the first.
    threads : int
        Simulations, and scores, beside each other.
    solve : bool
        Whether anything is solved here at all.
    took : Took, optional
        What is solved here is added to it.
    """
    current = next_round(problem, last, threads)
    if not solve or not is_short(problem):
        return current
    number, solved = current.number, list[Asked]()
    for _ in range(ITERATIONS - 1):
        another = last is None or (current.stage != last.stage and not current.reason)
        if another or current.stop or not all(is_short(problem, asked) for asked in current.batch):
            break
        solve_missing(problem, current.batch, threads, took=took)
        solved, following = solved + current.batch, next_round(problem, current, threads)
        # the rounds that follow a search repeat the batch of the one before
        solved = [asked for asked in solved if not following.reason or asked not in following.batch]
        current = replace(following, number=number, solved=solved)
    solve_missing(problem, [asked for asked in current.batch if is_short(problem, asked)], threads, took=took)
    return current


def is_short(problem: InverseProblem, asked: Asked | None = None) -> bool:
    """Whether simulations take about as long as the start of a job: of small meshes, by the built-in solver.

    Parameters
    ----------
    problem : InverseProblem
    asked : Asked, optional
        A guess, which may be on the finer mesh; without one all those of the search.
    """
    solver, every = problem.settings.solver, problem.every
    names = [SEARCH] * len(every)
    if asked is not None:
        names = [test.mesh_of(one) for test, one in zip(every, asked.every, strict=True)]
    meshes = [test.meshes[name] for test, name in zip(every, names, strict=True)]
    return solver == BUILTIN and all(expected_seconds(solver, m.dim, len(m.points)) <= SHORT for m in meshes)
