"""A fit tried out: its first deck rendered and shown to the solver, its first simulation run as by the workflow."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from fingerfit.check.expect import expected
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.fit.jobs import is_short
from fingerfit.fit.joint import problem_of
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked, write_folders
from fingerfit.fit.simulate import write_meshes
from fingerfit.forward.decks import make_deck
from fingerfit.mesh.mesh import Mesh
from fingerfit.settings.config import Settings
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver
from fingerfit.study.data import Data
from fingerfit.study.study import Study

BETWEEN = 0.05
"""Seconds that Snakemake takes between two rounds (benchmarks/phantom.md)."""
GROWTH = {2: 1.5, 3: 2.0}
"""Exponent of the work to factorise the system of a mesh in its nodes, in the plane and in space: nested dissection
(George 1973). Assembly grows less."""


def try_out(settings: Settings, tests: Sequence[tuple[Study, Mesh, Data]], solve: bool) -> list[str]:
    """Lines on solver, deck, the simulation of the start, and what the fit will take.

    Parameters
    ----------
    settings : Settings
    tests : sequence of (Study, Mesh, Data)
        Each test of the study, with its mesh of the search and its measurements.
    solve : bool
        Whether the start is simulated; else there is nothing to derive minutes from.

    Raises
    ------
    Problems, InputError
        For a template that cannot be rendered, or a deck that the solver does not take.
    SolverError
        When the solver is not there, or cannot be run.
    """
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as name:
        problem = _fit(settings, tests, Path(name))
        lines = [_solver(problem), *(line for test in problem.every for line in _deck(test))]
        expects = expected(settings, REFINED in problem.meshes, is_short(problem))
        low, high = (len(problem.every) * count for count in expects.simulations)
        first, last = (len(problem.every) * count for count in expects.finest)
        finer = f", {first} to {last} of them on the finer mesh" if last else ""
        words = f"about {low} to {high} simulations in {expects.rounds[0]} to {expects.rounds[1]} rounds{finer}"
        if not solve:
            return [*lines, "start: not simulated", f"to expect: {words}"]
        told, seconds, scoring = _simulate(problem)
        lines += told
        cores = len(os.sched_getaffinity(0))
        shortest, longest = (
            _time(problem, rounds, simulations, finest, seconds, scoring, cores)
            for rounds, simulations, finest in zip(expects.rounds, expects.simulations, expects.finest, strict=True)
        )
        count = f"{cores} core{'s' * (cores > 1)}"
        lines.append(f"to expect: {words}; {_in_words(shortest, longest)} on {count} as busy as now")
        if settings.model.effects:
            below = ", ".join(settings.model.path[:-1])
            lines.append(f"that is for {settings.model.full_name} alone; what is not known yet of {below} comes before")
        return lines


def _fit(settings: Settings, tests: Sequence[tuple[Study, Mesh, Data]], folder: Path) -> InverseProblem:
    files = [write_meshes(settings, study, mesh, folder) for study, mesh, _ in tests]
    return problem_of(settings, [data for _, _, data in tests], files, folder / "sims")


def _solver(problem: InverseProblem) -> str:
    """Name, version and place of the solver; of a template that is wrong too, both are told at once."""
    problems: list[FingerfitError] = []
    try:
        found = problem.solver
    except FingerfitError as error:
        problems.append(error)
    try:
        for test in problem.every:
            start = test.own(test.settings.starts())
            make_deck(test.settings, test.study, test.meshes[SEARCH], "mesh", start, test.effects)
    except InputError as error:
        problems.append(error)
    if problems:
        raise Problems(problems) if len(problems) > 1 else problems[0]
    place = getattr(get_solver(problem.settings.solver), "executable", None)
    return f"solver: {found['name']} {found.get('version', '')}".rstrip() + (f", {place}" if place else "")


def _deck(problem: InverseProblem) -> list[str]:
    """The deck of the start on each mesh, as the solver sees it."""
    start = problem.settings.starts()
    lines = []
    for role, kind in ((SEARCH, "mesh of the search"), (FINAL, "finer mesh")):
        if role == FINAL and REFINED not in problem.mesh_files:
            continue
        asked = problem.ask(start, role)
        refused = problem.refusal(asked)
        if refused is not None:
            raise refused
        nodes = len(problem.meshes[problem.mesh_of(asked)].points)
        count = len(asked.deck.splitlines())
        lines.append(
            f"{_of(problem)}deck: {problem.settings.model.template} makes {count} lines for the {kind},"
            f" {nodes} nodes; accepted"
        )
    return lines


def _of(problem: InverseProblem) -> str:
    return f"{problem.test}: " if problem.test else ""


def _simulate(problem: InverseProblem) -> tuple[list[str], float, float]:
    """What the simulations of the start showed; seconds of their jobs, and of a round's job beside Snakemake."""
    asked = problem.ask(problem.settings.starts())
    write_folders(problem.sims.parent, [asked], problem.solver, problem.mesh_paths)
    lines, seconds, scoring = list[str](), 0.0, _run("-c", "import fingerfit.fit.course")
    for test, one in zip(problem.every, asked.every, strict=True):
        told, solving, comparing = _simulate_test(test, one)
        lines.append(told)
        seconds, scoring = seconds + solving, scoring + comparing
    return lines, seconds, scoring


def _simulate_test(problem: InverseProblem, asked: Asked) -> tuple[str, float, float]:
    """What the simulation of one test showed; its seconds, and those of its score."""
    folder = problem.sims / asked.sim
    deck, solver, out = (str(folder / name) for name in ("deck.inp", "solver.json", "solution.npz"))
    seconds = _run("-m", "fingerfit", "simulate", deck, "--solver", solver, "--out", out)
    outcome = problem.outcome(asked)
    values = ", ".join(f"{name} {value:g}" for name, value in problem.own(asked.values).items())
    head = f"{_of(problem)}start ({values})"
    if outcome.status != CONVERGED:
        told = f"{outcome.message}; such guesses get the worst score, so that most others should have a solution"
        return f"{head}: {told}", seconds, 0.0
    start = time.perf_counter()
    problem.predict_all([asked], 1)
    score = problem.score(problem.prediction(asked), asked.values)
    scoring = time.perf_counter() - start
    return f"{head}: {_steps(problem, asked)} in {seconds:.2g} s; {_scored(problem, score)}", seconds, scoring


def _steps(problem: InverseProblem, asked: Asked) -> str:
    iterations = sum(problem.outcome(asked).iterations)
    return f"solved, {len(problem.data.step)} steps" + (f" with {iterations} iterations," if iterations else ",")


def _scored(problem: InverseProblem, score: float) -> str:
    if not math.isfinite(score):
        raise FingerfitError(f"start: its {problem.settings.fit.score} is {score}: there is nothing to compare")
    return f"score {problem.settings.fit.score} {score:.6g}"


def _run(*arguments: str) -> float:
    """Seconds of a job of the workflow: Python is started for each.

    Raises
    ------
    FingerfitError
        What the job told.
    """
    start = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        told = [line for line in done.stderr.splitlines() if line.strip()] or [f"exit code {done.returncode}"]
        raise FingerfitError(f"start: {told[-1].removeprefix('fingerfit: error: ')}")
    return time.perf_counter() - start


def _time(
    problem: InverseProblem, rounds: int, simulations: int, finest: int, seconds: float, scoring: float, cores: int
) -> float:
    """Seconds of a fit: rounds follow each other, their simulations run beside each other."""
    turns = max(rounds, math.ceil(simulations / cores))
    growth = 1.0
    if REFINED in problem.meshes:
        nodes = {name: len(mesh.points) for name, mesh in problem.meshes.items()}
        growth = (nodes[REFINED] / nodes[SEARCH]) ** GROWTH[problem.meshes[SEARCH].dim]
    return rounds * (scoring + BETWEEN) + (turns + finest * (growth - 1)) * seconds


def _in_words(shortest: float, longest: float) -> str:
    """A span of time in one unit.

    >>> _in_words(31.0, 88.0), _in_words(100.0, 450.0), _in_words(5000.0, 9000.0)
    ('31 to 88 s', '1.7 to 7.5 minutes', '1.4 to 2.5 hours')
    """
    size, unit = (1, "s") if longest < 120 else (60, "minutes") if longest < 7200 else (3600, "hours")
    low, high = (float(f"{value / size:.2g}") for value in (shortest, longest))
    return f"{low:g} to {high:g} {unit}"
