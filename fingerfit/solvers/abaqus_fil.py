"""Reader of ABAQUS's results file in ASCII (``*FILE FORMAT, ASCII``).

The file is a stream of records cut into lines of 80 characters: ``*`` and then items, each led by its type (``I`` with
two characters of length and the digits, ``D`` with 22 characters, ``A`` with 8). The first two items of a record are
its number of items and its key (ABAQUS Analysis User's Guide, 5.1.2 "Results file output format").
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import read_bytes
from fingerfit.solvers.process import most_results

Item = int | float | str

_HEAD = 1921
_ELEMENT, _NODE, _STEP_START, _STEP_END = 1900, 1901, 2000, 2001
_NODAL = {101: "U", 104: "RF", 106: "CF", 107: "COORD"}


@dataclass
class FilIncrement:
    """Results of one increment.

    Parameters
    ----------
    step, increment : int
        Their numbers, from 1.
    time : float
        Total time.
    nodal : dict
        By name (``U``, ``RF``, ``CF``, ``COORD``): node label to values, shape (components,), mm or N.
    """

    step: int
    increment: int
    time: float
    nodal: dict[str, dict[int, np.ndarray]] = field(default_factory=dict)


@dataclass
class FilResults:
    """What a results file says.

    Parameters
    ----------
    nodes : dict
        Node label to reference position, mm.
    elements : dict
        Element label to its type and node labels.
    increments : list of FilIncrement
        In the order of the file; each of them finished.
    """

    nodes: dict[int, np.ndarray]
    elements: dict[int, tuple[str, tuple[int, ...]]]
    increments: list[FilIncrement]

    def last(self) -> list[FilIncrement]:
        """The last increment of each step."""
        found = {increment.step: increment for increment in self.increments}
        return [found[step] for step in sorted(found)]


def records(path: Path) -> Iterator[list[Item]]:
    """Records of a results file, each as key and items.

    Raises
    ------
    InputError
        Where the file is missing or is not such a file, with the record.
    """
    content = read_bytes(Path(path), "results file", most_results(), "a readable .fil").decode("latin-1")
    text = "".join(line.ljust(80) for line in content.splitlines())
    at, number = text.find("*"), 0
    if at < 0 or text[:at].strip():
        raise InputError(path, "results file", text[:20], "an ASCII .fil, which starts with a record")
    while 0 <= at < len(text):
        number += 1
        try:
            items, at = _record(text, at + 1)
        except (ValueError, IndexError):
            raise InputError(path, f"record {number}", text[at : at + 40], "items I, D or A to its length") from None
        yield items
        if text[at:].strip() == "":
            return
        at += len(text[at:]) - len(text[at:].lstrip())
        if text[at] != "*":
            raise InputError(path, f"record {number + 1}", text[at : at + 20], "* at the start of a record")


def _record(text: str, at: int) -> tuple[list[Item], int]:
    count, at = _item(text, at)
    if not isinstance(count, int) or count < 2:
        raise ValueError(count)
    items: list[Item] = []
    for _ in range(count - 1):
        item, at = _item(text, at)
        items.append(item)
    return items, at


def _item(text: str, at: int) -> tuple[Item, int]:
    kind = text[at]
    if kind == "I":
        width = int(text[at + 1 : at + 3])
        return int(text[at + 3 : at + 3 + width]), at + 3 + width
    if kind == "D":
        return float(text[at + 1 : at + 23].replace("D", "E")), at + 23
    if kind == "A" and at + 9 <= len(text):
        return text[at + 1 : at + 9], at + 9
    raise ValueError(kind)


def read_fil(path: Path) -> FilResults:
    """Read nodes, elements and nodal results.

    Raises
    ------
    InputError
        When it is not an ASCII results file, ends within a record or an increment, or holds a node twice.
    """
    results = FilResults({}, {}, [])
    current: FilIncrement | None = None
    first: Item = _HEAD
    for number, items in enumerate(records(Path(path)), 1):
        first = items[0] if number == 1 else first
        try:
            current = _take(items, results, current)
        except (IndexError, ValueError) as error:
            reason = str(error) or "a record that is too short"
            raise InputError(path, f"record {number}", reason, "nodes, elements and results, each once") from None
    if first != _HEAD:
        raise InputError(path, "record 1", f"one of key {first}", f"the one of the release, {_HEAD}")
    if current is not None:
        raise InputError(path, f"step {current.step}, increment {current.increment}", "no end", "a record of its end")
    return results


def _take(items: list[Item], results: FilResults, current: FilIncrement | None) -> FilIncrement | None:
    """Put a record where it belongs; returns the increment that is open after it."""
    key, rest = items[0], items[1:]
    if key == _NODE:
        results.nodes[int(rest[0])] = np.array(rest[1:], dtype=float)
    elif key == _ELEMENT:
        nodes = tuple(int(item) for item in rest[2:])
        results.elements[int(rest[0])] = (str(rest[1]).strip(), nodes)
    elif key == _STEP_START:
        if current is not None:
            raise ValueError(f"a new increment in step {current.step}, increment {current.increment}")
        current = FilIncrement(int(rest[5]), int(rest[6]), float(rest[0]))
    elif key == _STEP_END and current is not None:
        results.increments.append(current)
        current = None
    elif key in _NODAL and current is not None:
        name = _NODAL[int(key)]
        table = current.nodal.setdefault(name, {})
        if int(rest[0]) in table:
            raise ValueError(f"{name} of node {rest[0]} twice")
        table[int(rest[0])] = np.array(rest[1:], dtype=float)
    return current
