"""What CalculiX says: its .dat file, the reason of a stop, what it did not understand."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from fingerfit.deck.cards import squeeze
from fingerfit.deck.reader import IGNORED

HARMLESS = frozenset({"INTERNAL", "UNSORTED"})
"""Parameters that change no answer."""
_IGNORED = frozenset(map(squeeze, IGNORED))
_DIVERGED = ("too many cutbacks", "increment size smaller", "best solution", "diverg")
_TABLE = re.compile(r"(displacements|forces) \(.*?\) for set (\S+) and time\s+(\S+)")
_QUANTITIES = {"displacements": "U", "forces": "RF"}


def read_dat(text: str, ends: Sequence[float], wanted: Collection[str]) -> tuple[list[dict[str, np.ndarray]], int]:
    """Tables at the end of each step that was reached, and how many steps before the first such print nothing.

    Force control may begin with a step that only finds the contact; it prints nothing, and its end is no answer.

    Parameters
    ----------
    text : str
        Of the .dat file.
    ends : sequence of float
        Total time at the end of each step, s.
    wanted : collection of str
        Tables that a step must have, as ``U ALL`` or ``RF TOP``.

    Returns
    -------
    list of dict
        By quantity and set: rows of node label and three components, shape (nodes, 4), mm or N.
    int
    """
    tables: list[tuple[float, str, np.ndarray]] = []
    heads = list(_TABLE.finditer(text))
    for head, following in zip(heads, [*heads[1:], None], strict=False):
        body = text[head.end() : following.start() if following else len(text)]
        values = np.array(body.split(), dtype=float)
        name = f"{_QUANTITIES[head.group(1)]} {head.group(2)}"
        tables.append((float(head.group(3)), name, values.reshape(-1, 4)))
    # times have seven digits
    reached = [{name: rows for time, name, rows in tables if abs(time - end) <= 1e-6 * end} for end in ends]
    complete = [set(wanted) <= set(sets) for sets in reached]
    first = complete.index(True) if True in complete else 0
    last = first
    while last < len(ends) and complete[last]:
        last += 1
    return reached[first:last], first


def diverged(output: str) -> bool:
    """Whether it says that it found no equilibrium."""
    return any(sign in output for sign in _DIVERGED)


def reason(output: str) -> str | None:
    """Its first error with the lines that belong to it, in one line; None without one."""
    for found in re.finditer(r"\*ERROR(?! in calinput: at least one)[^\n]*(?:\n[ \t]+(?!\*)\S[^\n]*)*", output):
        if not re.match(r"\*ERROR: increment size", found.group(0)):
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
