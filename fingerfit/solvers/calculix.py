"""CalculiX (ccx) as a solver: the same decks, its .dat file read back.

The .dat file has seven digits and the nodes of the deck; the .frd file has six, and the nodes of the solid elements
that CalculiX makes of plane ones.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from functools import cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import NoSolverError, SolverError
from fingerfit.deck.cards import Card, read_cards, squeeze
from fingerfit.deck.content import Deck
from fingerfit.deck.reader import read_deck
from fingerfit.solvers.answer import DIGITS, by_node, check_balance, counted_steps, ended, verify
from fingerfit.solvers.calculix_output import diverged, finished, not_understood, read_dat, reason
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Capabilities, Outcome
from fingerfit.solvers.needs import FEATURES, refuse_lacking, require_sets
from fingerfit.solvers.process import read_left, run, write_cards

ELEMENTS = frozenset({"CPE3", "CPE4", "CPE6", "CPE8", "CPE8R", "C3D4", "C3D8", "C3D10", "C3D20", "C3D20R"})
"""Those that are tested against the built-in solver; CalculiX has no hybrids."""
LACKS = frozenset(
    {
        "*ANISOTROPIC HYPERELASTIC",
        "*ELEMENT twice in the plane",
        "*FRICTION, ROUGH",
        "*HYPERELASTIC, MARLOW",
        "*HYPERELASTIC, REDUCED POLYNOMIAL, N=4 or more",
        "*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN",
        "*INITIAL CONDITIONS, TYPE=STRESS",
        "*INSTANCE",
        "*RIGID BODY of rigid elements",
        "*STATIC, LONG TERM",
        "*SURFACE BEHAVIOR, NO SEPARATION",
        "*SURFACE, TYPE=CYLINDER",
        "*SURFACE, TYPE=REVOLUTION",
        "*SURFACE, TYPE=SEGMENTS",
        "*VISCOELASTIC",
    }
)
"""Of 2.20. Of some of these it only warns, and goes on without them; initial stress it takes by integration point.
Elements in the plane that lie on each other have the right answer, but 24 pairs take 100 s where 24 elements take 1."""
ADAPTER = 3
"""Part of the identity; raised when the adapter accepts other decks or reads something else, so that old answers go."""
TIME_LIMIT = 3600.0
"""Seconds for one deck."""
_BETWEEN = "SPRING_BETWEEN_FOR_CCX"
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
    capabilities = Capabilities(elements=ELEMENTS, features=FEATURES - LACKS)

    def __init__(self, time_limit: float = TIME_LIMIT, residual: float | None = RESIDUAL) -> None:
        self.time_limit, self.residual = time_limit, residual

    def identity(self) -> dict[str, Any]:
        """Name, version, where it stops iterating and the adapter's own version.

        Raises
        ------
        SolverError
            When the executable is missing.
        """
        version = _version(_executable())
        return {"name": self.name, "version": version, "residual": self.residual, "adapter": ADAPTER}

    @property
    def executable(self) -> str:
        """Where it is; SolverError when it is missing."""
        return _executable()

    def check(self, deck: Path) -> None:
        """Read the deck; SolverError without an executable, InputError for what CalculiX lacks."""
        _executable()
        self._read(deck)

    def solve(self, deck: Path, workdir: Path, threads: int = 1) -> Outcome:
        """Run ccx in a temporary folder inside `workdir`.

        Raises
        ------
        InputError
            For what it lacks.
        SolverError
            When it cannot be run, refuses the deck, leaves a part of it out, or leaves a damaged answer.
        """
        executable = _executable()
        read = self._read(deck)
        what = f"calculix: {deck}"
        with tempfile.TemporaryDirectory(dir=workdir, prefix="ccx-") as name:
            folder = Path(name)
            write_cards(_own_cards(list(read_cards(deck)), read, self.residual), folder / "deck.inp")
            code, output = run(
                [executable, "-i", "deck"],
                folder,
                self.time_limit,
                {"OMP_NUM_THREADS": str(threads), "CCX_NPROC_EQUATION_SOLVER": str(threads)},
                what,
            )
            text = read_left(folder / "deck.dat", what)
        left_out = not_understood(output)
        if left_out:
            raise SolverError(f"{what}: it does not know {left_out}, and went on without it")
        stopped = diverged(output)
        if code == 0 and finished(output):
            reached = len(read.steps)
        elif code > 0 and stopped is not None:
            reached = stopped - 1
        else:
            left = "and it does not say that it finished" if text else "no results"
            raise SolverError(f"{what}: {reason(output) or f'{ended(code)}, {left}'}")
        ends = list(accumulate(step.period for step in read.steps))
        tables = read_dat(text, ends, _wanted(read).values(), what)
        if any(tables[reached:]):
            raise SolverError(f"{what}: damaged: results of a step without equilibrium, {reached + 1}")
        silent = len(read.steps) - len(counted_steps(read))
        return _outcome(tables[silent:reached], read, what)

    def _read(self, path: Path) -> Deck:
        deck = read_deck(path)
        require_sets(deck, path, "INDENTER")
        refuse_lacking(deck, path, self.name, self.capabilities)
        return deck


def _wanted(deck: Deck) -> dict[str, str]:
    """Tables that are read back: displacements of all nodes, forces of those pushed, and of all, which must balance."""
    return {"moved": "U ALL", "pushed": f"RF {_pushed(deck)}", "forces": "RF ALL"}


def _outcome(found: list[dict[str, np.ndarray]], deck: Deck, what: str) -> Outcome:
    mesh, sets = deck.mesh, deck.mesh.node_sets
    # without what a deck adds to its mesh: rigid surfaces of elements
    dim, nodes = mesh.dim, int(sets["ALL"].max()) + 1 if "ALL" in sets else len(mesh.points)
    index = {label: n for n, (_, label) in enumerate(deck.labels)}
    every = sets.get("ALL", np.arange(nodes)).tolist()
    needed = {"moved": every, "pushed": sets[_pushed(deck)].tolist(), "forces": every}
    displacement = np.zeros((len(found), nodes, dim))
    reaction = np.zeros((len(found), dim))
    for step, tables in enumerate(found):
        read = {}
        for use, name in _wanted(deck).items():
            if name not in tables:
                raise SolverError(f"{what}: damaged: no table {name} of result {step + 1}")
            rows = tables[name]
            labels = rows[:, 0].astype(int).tolist()
            read[use] = by_node(
                labels, rows[:, 1 : 1 + dim], index, needed[use], f"{what}: {name} of result {step + 1}"
            )
        displacement[step] = read["moved"][:nodes]
        check_balance(read["forces"], deck, read["moved"], DIGITS, f"{what}: RF ALL of result {step + 1}")
        # internal forces, also where nodes follow others or a force is given
        reaction[step] = read["pushed"].sum(axis=0)
    wanted = len(counted_steps(deck))
    status = CONVERGED if len(found) == wanted else DIVERGED
    message = f"{wanted} steps" if status == CONVERGED else f"no equilibrium in step {len(found) + 1} of {wanted}"
    outcome = Outcome(status, displacement, reaction, displacement[:, sets["INDENTER"][0]], message)
    return verify(outcome, deck, what)


def _own_cards(cards: list[Card], deck: Deck, residual: float | None) -> Iterator[Card]:
    """A deck as ccx gets it: where iterations stop, and prints of what is read back, in each step that counts.

    These are the steps that print the nodes ALL, or all steps of a deck that has none. Its own *CONTROLS stay.
    """
    names = [squeeze(card.name) for card in cards]
    controlled, unnamed = "CONTROLS" in names, "ALL" not in deck.mesh.node_sets
    printing = [squeeze(c.name) == "NODEPRINT" and c.options.get("NSET", "").upper() == "ALL" for c in cards]
    silent, prints = not any(printing), False
    between = _between_springs(cards, deck)
    for card, name, own in zip(cards, names, printing, strict=True):
        if name == "SPRING":
            yield from between
            between = []
        prints = own or (prints and name != "STEP")
        if name == "STEP" and unnamed:
            unnamed = False
            yield _card("NSET", {"NSET": "ALL"}, *(str(label) for _, label in deck.labels))
        if name in ("STATIC", "VISCO") and residual is not None and not controlled:
            yield _card("CONTROLS", {"PARAMETERS": "FIELD"}, f"{residual:g}")
        if name == "ENDSTEP" and (silent or prints):
            for nodes, what in [("ALL", "U")] * silent + [(_pushed(deck), "RF"), ("ALL", "RF")]:
                yield _card("NODE PRINT", {"NSET": nodes, "FREQUENCY": "1000000"}, what)
        yield card


def _between_springs(cards: list[Card], deck: Deck) -> list[Card]:
    """A spring without stiffness between two nodes, for decks whose nonlinear springs all go to the ground.

    ccx 2.20 sets enough constants aside for *SPRING, NONLINEAR only where there is a SPRING2, and else says that there
    are no springs.
    """
    if not any(s.table for s in deck.springs) or any(s.second for s in deck.springs):
        return []
    numbers = [text.split(",")[0] for card in cards if squeeze(card.name) == "ELEMENT" for _, text in card.data]
    number = max(int(text) for text in numbers if text.strip().isdigit()) + 1
    nodes = [deck.labels[node][1] for node in deck.mesh.blocks[0].nodes[0, :2]]
    return [
        _card("ELEMENT", {"TYPE": "SPRING2", "ELSET": _BETWEEN}, f"{number}, {nodes[0]}, {nodes[1]}"),
        _card("SPRING", {"ELSET": _BETWEEN}, "1, 1", "0."),
    ]


def _pushed(deck: Deck) -> str:
    """Nodes that the indenter pushes: TOP where there is such a set."""
    return "TOP" if "TOP" in deck.mesh.node_sets else "INDENTER"


def _card(name: str, options: dict[str, str], *data: str) -> Card:
    return Card(Path(), 0, name, options, [(0, line) for line in data])


def _executable() -> str:
    name = os.environ.get("FINGERFIT_CCX", "ccx")
    found = shutil.which(name)
    if found is None:
        raise NoSolverError(
            f"solver calculix: no executable {name}; install CalculiX (Debian: calculix-ccx) or set FINGERFIT_CCX"
        )
    return os.path.abspath(found)  # noqa: PTH100 - it runs in a folder of its own; links stay, as their names may matter


@cache
def _version(executable: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        _, output = run([executable, "-v"], Path(folder), 30.0, what="solver calculix")
    found = re.search(r"[Vv]ersion\s+([\w.]+)", output)
    if not found:
        said = output.strip()[:60]
        raise NoSolverError(f"solver calculix: {executable}: its -v names no version, found {said!r}: is it CalculiX?")
    return found.group(1)
