"""Records of testing machines: which column is what and in which unit, where the loading runs, readings at a time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.units import UNITS, as_written
from fingerfit.readers.tables import read_table

KINDS = {"force": "force", "displacement": "length", "time": "time", "step": ""}
"""What is looked for, and the kind of its unit."""
_WORDS = {
    "force": r"force|load|kraft|(?<![a-z])f(?![a-z])",
    "displacement": r"displ|extension|travel|stroke|position|compression|indentation|depth|crosshead|weg",
    "time": r"time|zeit|temps|(?<![a-z])t(?![a-z])",
    "step": r"step|frame|number",
}
_UNIT = re.compile(r"[\[(/_ ]\s*([a-zA-Zµμ]+)\s*[\])]?$")
_BRACKETED = re.compile(r"[\[(]\s*([a-zA-Zµμ°%/]+)\s*[\])]$")
_OTHER_NAMES = {"µm": "um", "μm": "um", "sec": "s"}
_SWING = 0.05
"""Share of the range by which a reading must turn back before a ramp ends: less is noise. A choice."""
_BELOW = 0.01
"""Share of the indenter's way at which the record of it begins at the latest. A choice: frames up to there are before
compression for `fingerfit.start.measured`."""
_RAMP = 0.5
"""Share of the range that a ramp runs through at least. A choice."""


@dataclass(frozen=True)
class Machine:
    """Readings in s, mm and N; compression is positive.

    Parameters
    ----------
    path : Path
    columns : dict
        force, displacement and time, as far as they were found, each of shape (readings,).
    heads : dict
        What the file calls them.
    known : ndarray of bool, shape (rows,)
        Rows of the file that have numbers: those are the readings.
    remarks : tuple of str
        What was done to the numbers.
    """

    path: Path
    columns: Mapping[str, np.ndarray]
    heads: Mapping[str, str]
    known: np.ndarray
    remarks: tuple[str, ...] = ()

    def rows(self) -> dict[str, np.ndarray]:
        """The columns with all rows of the file, NaN in those that lack a number."""
        found = {name: np.full(len(self.known), np.nan) for name in self.columns}
        for name, values in self.columns.items():
            found[name][self.known] = values
        return found


def columns_of(head: Sequence[str]) -> tuple[dict[str, int], dict[str, str]]:
    """Places of the columns that are known by their name, the first of each, and their units where they are named.

    >>> columns_of(["Zeit [s]", "Standardkraft (kN)", "Weg/mm"])
    ({'time': 0, 'force': 1, 'displacement': 2}, {'time': 's', 'force': 'kN', 'length': 'mm'})
    """
    places: dict[str, int] = {}
    units: dict[str, str] = {}
    for place, cell in enumerate(head):
        unit = _UNIT.search(cell)
        name = cell[: unit.start()] if unit else cell
        kind = next((kind for kind, words in _WORDS.items() if re.search(words, name.lower() or cell.lower())), "")
        if not kind or kind in places:
            continue
        places[kind] = place
        if unit and (known := _unit(KINDS[kind], unit[1])):
            units[KINDS[kind]] = known
    return places, units


def _unit(kind: str, text: str) -> str:
    """A unit as it is named here; empty for what is none of that kind."""
    own = UNITS.get(kind, {})
    known = as_written(text, {unit.lower(): unit for unit in own} | _OTHER_NAMES)
    return known if known in own else ""


def refuse_unknown_units(path: Path, head: Sequence[str]) -> None:
    """Refuse columns with a unit in brackets that is not known, and with a mega unit wherever it stands.

    A unit that is not in brackets may be a word.

    Raises
    ------
    InputError
        For the first of them.
    """
    for name, place in columns_of(head)[0].items():
        unit, loose = _BRACKETED.search(head[place]), _UNIT.search(head[place])
        if unit is None and loose and not _unit(KINDS[name], loose[1]) and _unit(KINDS[name], loose[1].lower()):
            unit = loose  # no word: a unit, but for its capitals
        if KINDS[name] and unit and not _unit(KINDS[name], unit[1]):
            raise InputError(path, head[place], f"the unit {unit[1]}", "one of " + ", ".join(UNITS[KINDS[name]]))


def is_machine(head: Sequence[str]) -> bool:
    """Whether a table is the record of a machine: it has a column of forces."""
    return "force" in columns_of(head)[0]


def read_machine(files: Path | Mapping[str, Path], columns: Sequence[str] | None = None) -> Machine:
    """Read a record: one table, or a file of one column for each of force, displacement and time.

    Parameters
    ----------
    files : Path or mapping
    columns : sequence of str or None
        What the columns are, where the table does not say it: force, displacement, time, with units as ``force [kN]``.

    Raises
    ------
    InputError
        For what cannot be read, a record without forces, and units that are not known.
    """
    if isinstance(files, Mapping):
        tables = [read_table(file, name) for name, file in files.items()]
        path = tables[0].path
        for table in tables:
            if (wide := table.cells.shape[1]) != 1 or len(table.cells) != len(tables[0].cells):
                found = f"{len(table.cells)} rows of {wide}"
                raise InputError(
                    table.path, "columns", found, f"one column of {len(tables[0].cells)} rows, as {path.name}"
                )
        head = [
            f"{name} {table.head[0] if table.head else ''}".strip() for name, table in zip(files, tables, strict=True)
        ]
        values = [table.column(0) for table in tables]
    else:
        path, table = files, read_table(files, "machine")
        head = list(columns or table.head)
        if len(head) != table.cells.shape[1]:
            told = f"{table.cells.shape[1]} columns" + ("" if columns else " without names")
            raise InputError(path, "columns", told, f"{len(head)} names" if columns else "names: a line, or `columns`")
        wanted = columns_of(head)[0].values()
        values = [table.column(n) if n in wanted else np.zeros(0) for n in range(len(head))]
    places, units = columns_of(head)
    if "force" not in places:
        raise InputError(path, "columns", ", ".join(head), "a head with a column force or load")
    refuse_unknown_units(path, head)
    read = {name: values[place] for name, place in places.items() if name != "step"}
    known = np.isfinite(np.stack(list(read.values()))).all(axis=0)
    if known.sum() < 2:
        raise InputError(path, "rows", f"{known.sum()} with numbers in all columns", "at least 2")
    sizes = {name: UNITS[KINDS[name]].get(units.get(KINDS[name], ""), 1.0) for name in read}
    remarks = [f"{(~known).sum()} rows of {path.name} lack a number: left out"] if not known.all() else []
    default = {"force": "N", "displacement": "mm", "time": "s"}
    remarks += [
        f"{path.name} does not say the unit of {name}: taken as {default[name]}"
        for name in read
        if KINDS[name] not in units
    ]
    numbers = {name: sizes[name] * one[known] for name, one in read.items()}
    if "time" in numbers and (np.diff(numbers["time"]) < 0).any():
        row = int(np.flatnonzero(np.diff(numbers["time"]) < 0)[0]) + 2
        raise InputError(path, f"reading {row}, {head[places['time']]}", "an earlier time", "times that rise")
    numbers, signs = positive(numbers)
    return Machine(path, numbers, {name: head[places[name]] for name in read}, known, (*remarks, *signs))


def positive(columns: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Columns with compression counted as positive, and what is to be said of it.

    >>> positive({"force": np.array([0.0, -1.0]), "time": np.array([0.0, 1.0])})[1]
    ('force was negative: its sign is changed, compression is positive',)
    """
    turned = [name for name in ("force", "displacement") if name in columns and columns[name].sum() < 0]
    found = {name: -values if name in turned else values for name, values in columns.items()}
    return found, tuple(f"{name} was negative: its sign is changed, compression is positive" for name in turned)


def ramps(values: np.ndarray) -> list[tuple[int, int]]:
    """First and last reading of each loading: where values rise through half of their range at least.

    >>> ramps(np.array([0.0, 5, 10, 5, 0, 0, 5, 10])), ramps(np.array([1.0, 1, 1]))
    ([(0, 2), (5, 7)], [])
    """
    if not len(values) or values.min() == values.max():
        return []
    swing = _SWING * float(np.ptp(values))
    turns, low, high, rising = [0], 0, 0, True
    for n, value in enumerate(values.tolist()):
        if value >= values[high]:
            high = n
        if value <= values[low]:
            low = n
        if rising and value < values[high] - swing:
            turns.append(high)
            rising, low = False, n
        elif not rising and value > values[low] + swing:
            turns.append(low)
            rising, high = True, n
    turns.append(high if rising else low)
    least = _RAMP * float(np.ptp(values))
    return [(a, b) for a, b in pairwise(turns) if b > a and values[b] - values[a] >= least]


def loading(machine: Machine) -> tuple[slice, tuple[str, ...]]:
    """Readings of the last loading, and what is to be said of it."""
    name = "displacement" if "displacement" in machine.columns else "force"
    found = ramps(machine.columns[name])
    if not found:
        raise InputError(machine.path, name, "no loading in it", "values that rise")
    told = [f"{machine.path.name} has {len(found)} loadings: the last one is taken"] if len(found) > 1 else []
    start, stop = found[-1]
    return slice(start, stop + 1), tuple(told)


def at_times(machine: Machine, times: np.ndarray) -> dict[str, np.ndarray]:
    """Readings at times, interpolated.

    Raises
    ------
    InputError
        For times beyond the record.
    """
    own = machine.columns["time"]
    for n, time in enumerate(times.tolist()):
        if not own[0] - 1e-9 <= time <= own[-1] + 1e-9:
            raise InputError(machine.path, "time", f"{own[0]:g} to {own[-1]:g} s", f"{time:g} s, that of frame {n}")
    return {name: np.interp(times, own, one) for name, one in machine.columns.items()}


def at_displacements(machine: Machine, wanted: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Forces at displacements of the last loading, interpolated, and what is to be said of it.

    Parameters
    ----------
    machine : Machine
    wanted : ndarray, shape (frames,)
        From where the indenter is at frame 0, mm; below 0, before compression, stands the first force.

    Raises
    ------
    InputError
        For displacements beyond those of the machine.
    """
    part, told = loading(machine)
    own = np.maximum.accumulate(machine.columns["displacement"][part])
    if own[0] > _BELOW * wanted.max():
        expected = "0 mm, as the indenter moves: subtract what the record has at frame 0"
        raise InputError(machine.path, "displacement", f"{own[0]:.4g} mm where the last loading begins", expected)
    if wanted.max() > own[-1] * (1 + 1e-6):
        found = f"at most {own[-1]:.4g} mm"
        raise InputError(machine.path, "displacement", found, f"up to {wanted.max():.4g} mm, as the indenter moves")
    return np.interp(wanted, own, machine.columns["force"][part]), told
