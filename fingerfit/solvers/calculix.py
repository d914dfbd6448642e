"""CalculiX (ccx) as a solver: the same decks, its .dat file read back."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.deck.reader import read_deck
from fingerfit.errors import InputError, SolverError
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome
from fingerfit.solvers.process import copy_deck, run

ELEMENTS = frozenset({"CPE3", "CPE4", "CPE6", "CPE8", "CPE8R", "C3D4", "C3D8", "C3D10", "C3D20", "C3D20R"})
"""Those that are tested against the built-in solver; CalculiX has no hybrids."""
TIME_LIMIT = 3600.0
"""Seconds for one deck."""
RESIDUAL = 1e-5
"""Residual force over the mean one at which it stops iterating; by itself it stops at 5e-3, which fits would see."""


class CalculixSolver:
    """Adapter of CalculiX; the executable is `ccx` on the path, or what FINGERFIT_CCX names.

    Parameters
    ----------
    time_limit : float
        Seconds after which a run is ended.
    residual : float or None
        Given to decks that have no *CONTROLS of their own; None for CalculiX's own 5e-3.
    """

    name = "calculix"
    capabilities = Capabilities(elements=ELEMENTS, dialect="calculix")

    def __init__(self, time_limit: float = TIME_LIMIT, residual: float | None = RESIDUAL) -> None:
        self.time_limit, self.residual = time_limit, residual

    def identity(self) -> dict[str, Any]:
        """Name, version and where it stops iterating.

        Raises
        ------
        SolverError
            When the executable is missing.
        """
        return {"name": self.name, "version": _version(_executable()), "residual": self.residual}

    def check(self, deck: Path) -> None:
        """Read the deck; SolverError without an executable, InputError for elements that are not tested."""
        _executable()
        for block in read_deck(deck).mesh.blocks:
            if block.element not in self.capabilities.elements:
                raise InputError(
                    deck, "*ELEMENT", block.element, "one of " + ", ".join(sorted(self.capabilities.elements))
                )

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Run ccx in a temporary folder inside `workdir`.

        Raises
        ------
        SolverError
            When it cannot be run, or refuses the deck.
        """
        read = read_deck(deck)
        executable = _executable()
        with tempfile.TemporaryDirectory(dir=workdir, prefix="ccx-") as name:
            folder = Path(name)
            copy_deck(deck, folder)
            if self.residual is not None:
                _control(folder / "deck.inp", self.residual)
            code, output = run(
                [executable, "-i", "deck"],
                folder,
                self.time_limit,
                {"OMP_NUM_THREADS": str(threads), "CCX_NPROC_EQUATION_SOLVER": str(threads)},
            )
            result = folder / "deck.dat"
            text = result.read_text(errors="replace") if result.exists() else ""
        refused = re.search(r"\*ERROR(?! in|: increment size).*?(?:\n\s+.*)?", output)
        found, silent = _read_dat(text, len(read.steps))
        if not found and not _diverged(output):
            reason = " ".join(refused.group(0).split()) if refused else f"exit code {code}, no results"
            raise SolverError(f"calculix: {deck}: {reason}")
        return _outcome(found, read.mesh, len(read.steps) - silent)


def _outcome(found: list[dict[str, np.ndarray]], mesh: Any, wanted: int) -> Outcome:
    # without what a deck adds to its mesh: rigid surfaces of elements
    dim, nodes = mesh.dim, int(mesh.node_sets["ALL"].max()) + 1
    displacement = np.zeros((len(found), nodes, dim))
    reaction = np.zeros((len(found), dim))
    for step, tables in enumerate(found):
        rows = tables["ALL"]
        displacement[step, rows[:, 0].astype(int) - 1] = rows[:, 1 : 1 + dim]
        # equilibrium: the base holds what the indenter pushes
        reaction[step] = -tables["BOTTOM"][:, 1 : 1 + dim].sum(axis=0)
    status = CONVERGED if len(found) == wanted else DIVERGED
    message = f"{wanted} steps" if status == CONVERGED else f"no equilibrium in step {len(found) + 1} of {wanted}"
    return Outcome(status, displacement, reaction, displacement[:, mesh.node_sets["INDENTER"][0]], message)


def _control(deck: Path, residual: float) -> None:
    """Set where iterations stop, in each step of a deck that does not."""
    lines = deck.read_text(encoding="utf-8").splitlines()
    if any(line.strip().upper().startswith("*CONTROLS") for line in lines):
        return
    given = f"*CONTROLS, PARAMETERS=FIELD\n{residual:g}\n"
    starts = tuple(f"*{name}" for name in ("STATIC", "VISCO"))
    lines = [given + line if line.strip().upper().startswith(starts) else line for line in lines]
    deck.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _executable() -> str:
    name = os.environ.get("FINGERFIT_CCX", "ccx")
    found = shutil.which(name)
    if found is None:
        raise SolverError(
            f"solver calculix: no executable {name}; install CalculiX (Debian: calculix-ccx) or set FINGERFIT_CCX"
        )
    return found


@cache
def _version(executable: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        _, output = run([executable, "-v"], Path(folder), 30.0)
    found = re.search(r"[Vv]ersion\s+([\w.]+)", output)
    if not found:
        raise SolverError(f"{executable}: its -v names no version: is it CalculiX?")
    return found.group(1)


def _diverged(output: str) -> bool:
    return any(sign in output for sign in ("too many cutbacks", "increment size smaller", "best solution", "diverg"))


def _read_dat(text: str, steps: int) -> tuple[list[dict[str, np.ndarray]], int]:
    """Tables by set at the end of each step (total times 1, 2, ...) that was reached; steps before the first such.

    Force control begins with a step that only finds the contact; it prints nothing, and its end is no answer.
    """
    tables: dict[float, dict[str, np.ndarray]] = {}
    heads = list(re.finditer(r"(?:displacements|forces) \(.*?\) for set (\S+) and time\s+(\S+)", text))
    for head, following in zip(heads, [*heads[1:], None], strict=False):
        body = text[head.end() : following.start() if following else len(text)]
        values = np.array(body.split(), dtype=float)
        tables.setdefault(round(float(head.group(2)), 6), {})[head.group(1)] = values.reshape(-1, 4)
    complete = {time for time, sets in tables.items() if {"ALL", "BOTTOM"} <= set(sets)}
    first = next((step for step in range(1, steps + 1) if float(step) in complete), 1)
    found = []
    for step in range(first, steps + 1):
        if float(step) not in complete:
            break
        found.append(tables[float(step)])
    return found, first - 1
