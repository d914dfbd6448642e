"""What CalculiX says: its .dat file, the reason of a stop, what it did not understand."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from fingerfit.core.errors import SolverError
from fingerfit.deck.cards import squeeze
from fingerfit.deck.reader import IGNORED

HARMLESS = frozenset({"INTERNAL", "UNSORTED"})
"""Parameters that change no answer."""
_IGNORED = frozenset(map(squeeze, IGNORED))
_DIVERGED = re.compile(
    r"^ \*ERROR(?:: too many cutbacks|: increment size smaller than minimum"
    r"| in nonlingeo: max\. # of increments reached)",
    re.MULTILINE,
)
"""All it says where it found no equilibrium in as many increments, as small, as the deck allows; it ends with 201."""
_TABLE = re.compile(r"(displacements|forces) \(.*?\) for set (\S+) and time\s+(\S+)")
_QUANTITIES = {"displacements": "U", "forces": "RF"}


def read_dat(text: str, ends: Sequence[float], wanted: Collection[str], what: str) -> list[dict[str, np.ndarray]]:
    """Tables at the end of each step, empty for a step without any.

    Parameters
    ----------
    text : str
        Of the .dat file.
    ends : sequence of float
        Total time at the end of each step, s.
    wanted : collection of str
        Tables that are read, as ``U ALL`` or ``RF TOP``.
    what : str
        Solver and deck, for the message.

    Returns
    -------
    list of dict
        By quantity and set: rows of node label and three components, shape (nodes, 4), mm or N.

    Raises
    ------
    SolverError
        For a row that is not a label and three numbers, a file that ends within a line, and a table that is there
        twice with other numbers.
    """
    if text and not text.endswith("\n"):
        raise SolverError(f"{what}: damaged: deck.dat ends within a line")
    found: list[dict[str, np.ndarray]] = [{} for _ in ends]
    heads = list(_TABLE.finditer(text))
    for head, following in zip(heads, [*heads[1:], None], strict=False):
        name, time = f"{_QUANTITIES[head.group(1)]} {head.group(2)}", _number(head.group(3))
        # times have seven digits
        step = next((n for n, end in enumerate(ends) if abs(time - end) <= 1e-6 * end), None)
        if name not in wanted or step is None:
            continue
        rows = _rows(text[head.end() : following.start() if following else len(text)], f"{what}: {name}")
        if not np.array_equal(found[step].get(name, rows), rows, equal_nan=True):
            raise SolverError(f"{what}: {name}: damaged: two tables at {time:g} s with other numbers")
        found[step][name] = rows
    return found


def _rows(body: str, what: str) -> np.ndarray:
    """Label and three numbers of each line up to the first blank one after them, shape (rows, 4)."""
    rows: list[list[float]] = []
    for line in body.splitlines():
        cells = line.split()
        if not cells:
            if rows:
                break
            continue
        if len(cells) != 4 or not cells[0].isdecimal():
            raise SolverError(f"{what}: damaged: found {line.strip()[:60]!r}; expected a node and three numbers")
        rows.append([float(cells[0]), *map(_number, cells[1:])])
    return np.array(rows).reshape(-1, 4)


def _number(text: str) -> float:
    """Number as Fortran writes it: no E where the exponent has three digits; NaN where it is stars or no number."""
    try:
        return float(re.sub(r"(?<=\d)(?=[+-]\d{3}$)", "E", text))
    except ValueError:
        return math.nan


def finished(output: str) -> bool:
    """Whether it says that it came to the end of the deck."""
    return re.search(r"^\s*Job finished\s*$", output, re.MULTILINE) is not None


def diverged(output: str) -> int | None:
    """Number of the step, from 1, in which it says that it found no equilibrium; None where it does not say so.

    That the size of an increment is decreased for divergence is no such word: it then goes on.
    """
    last = _DIVERGED.search(output)
    steps = re.findall(r"^ STEP\s+(\d+)\s*$", output[: last.start()], re.MULTILINE) if last else []
    return int(steps[-1]) if steps else None


def reason(output: str) -> str | None:
    """Its first error with the lines that belong to it, in one line; None without one."""
    for found in re.finditer(r"\*ERROR(?! in calinput: at least one)[^\n]*(?:\n[ \t]+(?!\*)\S[^\n]*)*", output):
        if not _DIVERGED.match(f" {found.group(0)}"):
            return " ".join(found.group(0).split())
    return None


def not_understood(output: str) -> str | None:
    """The first keyword or parameter that it only warns of and leaves out; None where there is none that matters."""
    return next(_left_out(output), None)


def _left_out(output: str) -> Iterator[str]:
    for found in re.finditer(r"\*WARNING reading (\*[^:\n]+): parameter not recognized:\s*(\S+)", output):
        keyword, parameter = found.groups()
        if squeeze(keyword[1:]) not in _IGNORED and parameter.partition("=")[0].upper() not in HARMLESS:
            yield f"parameter {parameter} of {keyword}"
    for found in re.finditer(r"interpreted:\s*\*WARNING reading the input file\. Card image:\s*(\S+)", _joined(output)):
        card = found.group(1)
        # data lines of a keyword that is not known follow it
        if card.startswith("*") and squeeze(card[1:].partition(",")[0]) not in _IGNORED:
            yield card


def _joined(output: str) -> str:
    """It writes ``inter    preted``."""
    return re.sub(r"inter\s+preted", "interpreted", output)
