"""ABAQUS as a solver: the same decks in its own words (`fingerfit.deck.dialect`), its ASCII results file read back.

ABAQUS itself waits for a licence when none is free; the time limit holds for waiting and running together.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError, NoSolverError, SolverError
from fingerfit.deck.cards import Card, read_cards
from fingerfit.deck.content import Deck
from fingerfit.deck.dialect import to_abaqus
from fingerfit.deck.reader import read_deck
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.solvers.abaqus_fil import FilIncrement, read_fil
from fingerfit.solvers.answer import by_node, check_balance, ended, verify
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome
from fingerfit.solvers.needs import FEATURES, refuse_lacking, require_sets
from fingerfit.solvers.process import LOG, has_left, read_left, run, write_cards

COMMAND = "abaqus job={job} cpus={threads} interactive ask_delete=OFF"
"""Template of the command; a site changes it by FINGERFIT_ABAQUS, for example to go through a container."""
ADAPTER = 4
"""Part of the identity; raised when the adapter accepts other decks or reads something else, so that old answers go."""
TIME_LIMIT = 4 * 3600.0
"""Seconds for one deck, licence included."""
_RESULTS = (
    Card(Path(), 0, "FILE FORMAT", {"ASCII": ""}),
    Card(Path(), 0, "NODE FILE", {"FREQUENCY": "9999"}, [(0, "U, RF")]),
)
"""Asked for at the end of every step."""
RESIDUAL = 0.01
"""Share of the nodal forces that may be left without balance: by default ABAQUS stops at 0.5 % of the mean force
(Analysis User's Guide, 7.2.3), here of a sum, to which each node may add with either sign; twice that."""
LACKS = frozenset({"*DLOAD", "*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN"})
"""What pressures push is not read back, so that the indenter's force would be wrong; strain without stress is
CalculiX's."""
_DIVERGED = (
    "TOO MANY ATTEMPTS",
    "TIME INCREMENT REQUIRED IS LESS THAN",
    "EXCESSIVELY DISTORTED",
    "TOO MANY INCREMENTS",
)


class AbaqusSolver:
    """Adapter of ABAQUS/Standard.

    Parameters
    ----------
    command : str or None
        Template with {job} and {threads}, split as a shell would, but run without one; by default FINGERFIT_ABAQUS,
        else `COMMAND`.
    time_limit : float
        Seconds after which a run is ended.
    """

    name = "abaqus"
    capabilities = Capabilities(elements=frozenset(ELEMENTS), features=FEATURES - LACKS)

    def __init__(self, command: str | None = None, time_limit: float = TIME_LIMIT) -> None:
        self.command = command or os.environ.get("FINGERFIT_ABAQUS", COMMAND)
        self.time_limit = time_limit

    def identity(self) -> dict[str, Any]:
        """Name, version, command and the adapter's own version.

        Raises
        ------
        SolverError
            When the executable is missing or does not tell its release.
        """
        program = self._arguments(1)[0]
        return {"name": self.name, "version": _version(program), "command": self.command, "adapter": ADAPTER}

    @property
    def executable(self) -> str:
        """Where it is; SolverError when it is missing."""
        return self._arguments(1)[0]

    def check(self, deck: Path) -> None:
        """Read the deck; SolverError without an executable, InputError for a deck without what is read back."""
        self._arguments(1)
        self._cards(deck)

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Run ABAQUS in a temporary folder inside `workdir`.

        Raises
        ------
        InputError
            For what it lacks.
        SolverError
            When it cannot be run, has no licence, refuses the deck, or leaves a damaged answer.
        """
        command = self._arguments(threads)
        cards, read = self._cards(deck)
        what = f"abaqus: {deck}"
        with tempfile.TemporaryDirectory(dir=workdir, prefix="abaqus-") as name:
            folder = Path(name)
            write_cards(cards, folder / "deck.inp")
            try:
                code, output = run(command, folder, self.time_limit, what=what)
            except SolverError as error:
                waiting = _waits("".join(read_left(folder / log, what) for log in (LOG, "deck.log")))
                if not waiting:
                    raise
                raise NoSolverError(f"{error}, while it waited for a licence: {waiting}") from None
            status = read_left(folder / "deck.sta", what)
            said = output + "".join(read_left(folder / f"deck.{end}", what) for end in ("msg", "dat")) + status
            written = has_left(folder / "deck.fil", what)
            diverged = any(sign in said.upper() for sign in _DIVERGED)
            # some scripts around ABAQUS end with 0 whatever it said
            if code < 0 or (not diverged and (code > 0 or (not written and _told(said)))):
                kind = NoSolverError if _waits(said) else SolverError
                raise kind(f"{what}: {_reason(said, code)}")
            try:
                found = read_fil(folder / "deck.fil").last() if written else []
            except InputError as error:
                raise SolverError(f"{what}: deck.fil: damaged: {error.field}: found {error.found}") from None
        complete = [increment for increment in found if _ended(increment, read)]
        lacking = len(complete) < len(read.steps)
        if lacking and not diverged:
            raise SolverError(f"{what}: deck.fil: damaged: {len(complete)} of {len(read.steps)} steps are in it")
        stopped = _last_step(status)
        if diverged and stopped is not None and stopped != len(complete) + 1:
            held = f"{len(complete)} steps are in it, no equilibrium was found in step {stopped}"
            raise SolverError(f"{what}: deck.fil: damaged: {held}")
        if diverged and not lacking:
            raise SolverError(f"{what}: {_reason(said, code)}, though all steps are in deck.fil")
        if [increment.step for increment in complete] != list(range(1, len(complete) + 1)):
            raise SolverError(f"{what}: deck.fil: damaged: a step is missing")
        return _outcome(complete, read, what)

    def _cards(self, path: Path) -> tuple[list[Card], Deck]:
        """The deck for ABAQUS, and what it says."""
        deck = read_deck(path)
        require_sets(deck, path, "BOTTOM", "INDENTER")
        refuse_lacking(deck, path, self.name, self.capabilities)
        return list(to_abaqus(read_cards(path), deck, _RESULTS)), deck

    def _arguments(self, threads: int) -> list[str]:
        try:
            parts = [part.format(job="deck", threads=threads) for part in shlex.split(self.command)]
        except (KeyError, IndexError, ValueError) as error:
            raise NoSolverError(
                f"solver abaqus: command {self.command}: {error}; it may name {{job}}, {{threads}}"
            ) from None
        program = shutil.which(parts[0]) if parts else None
        if program is None:
            name = parts[0] if parts else "(empty)"
            raise NoSolverError(f"solver abaqus: no executable {name}; install ABAQUS or set FINGERFIT_ABAQUS")
        # it runs in a folder of its own; links stay, as their names may matter
        return [os.path.abspath(program), *parts[1:]]  # noqa: PTH100


def _last_step(status: str) -> int | None:
    """Step of the last attempt in the .sta file, whose lines begin with step, increment and attempt."""
    rows = re.findall(r"^\s*(\d+)\s+\d+\s+\d+U?\s", status, re.MULTILINE)
    return int(rows[-1]) if rows else None


def _ended(increment: FilIncrement, deck: Deck) -> bool:
    """Whether an increment is the end of its step."""
    if increment.step > len(deck.steps) or "U" not in increment.nodal:
        return False
    end = sum(step.period for step in deck.steps[: increment.step])
    return abs(increment.time - end) < 1e-6 * end


def _outcome(found: list[FilIncrement], deck: Deck, what: str) -> Outcome:
    dim, nodes = deck.mesh.dim, len(deck.mesh.points)
    base, indenter = deck.mesh.node_sets["BOTTOM"], deck.mesh.node_sets["INDENTER"]
    # a deck of parts is numbered anew by ABAQUS, in the order of its instances
    flat = not any(scope for scope, _ in deck.labels)
    index = {label if flat else n + 1: n for n, (_, label) in enumerate(deck.labels)}
    top = set(deck.mesh.node_sets.get("TOP", indenter).tolist())
    displacement = np.zeros((len(found), nodes, dim))
    reaction = np.zeros((len(found), dim))
    # nodes of no element, as those that only place a surface, have no results
    used = {int(node) for block in deck.mesh.blocks for node in block.nodes.ravel()} | {int(indenter[0])}
    for step, increment in enumerate(found):
        read = {}
        for name in ("U", "RF"):
            table, where = increment.nodal.get(name, {}), f"{what}: {name} of step {step + 1}"
            if any(len(values) < dim for values in table.values()):
                raise SolverError(f"{where}: damaged: a node has less than {dim} components")
            values = np.array([row[:dim] for row in table.values()]).reshape(-1, dim)
            read[name] = by_node(list(table), values, index, used, where)
        displacement[step], forces = read["U"], read["RF"]
        check_balance(forces, deck, displacement[step], RESIDUAL, f"{what}: RF of step {step + 1}", applied=True)
        # equilibrium: base and springs hold what the indenter pushes, whose own nodes may follow one of them
        reaction[step] = -forces[base].sum(axis=0)
        for spring in deck.springs:
            node, axis = spring.first
            # those that hold the indenter's nodes sideways are how the body slips under it
            if spring.second is None and not (axis < dim - 1 and node in top):
                reaction[step, axis] += spring.force(displacement[step, node, axis])
    status = CONVERGED if len(found) == len(deck.steps) else DIVERGED
    message = f"{len(found)} steps"
    if status == DIVERGED:
        message = f"no equilibrium in step {len(found) + 1} of {len(deck.steps)}"
    return verify(Outcome(status, displacement, reaction, displacement[:, indenter[0]], message), deck, what)


def _reason(said: str, code: int) -> str:
    """Why it did not run, in one line."""
    return _told(said) or f"{ended(code)}, no results"


def _told(said: str) -> str:
    """What it said of a licence that it did not get, or its first error; empty where it said neither."""
    error = re.search(r"\*\*\*\s*ERROR[^\n]*(?:\n\s+\S[^\n]*)?", said, re.IGNORECASE)
    return _waits(said) or (" ".join(error.group(0).split()) if error else "")


def _waits(said: str) -> str:
    """The last that it said of licences, unless it got one."""
    lines = re.findall(r"[^\n]*licen[sc]e[^\n]*", said, re.IGNORECASE)
    return "" if not lines or re.search(r"checked out|checked in|released", lines[-1]) else " ".join(lines[-1].split())


@cache
def _version(program: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        _, output = run([program, "information=release"], Path(folder), 120.0, what="solver abaqus")
    found = re.search(r"\b(20\d\d(?:\.\w+)*|6\.\d+(?:-\d+)?)\b", output)
    if not found:
        told = f"information=release names no release, found {output.strip()[:60]!r}"
        raise NoSolverError(f"solver abaqus: {program}: {told}: is it ABAQUS?")
    return found.group(1)
