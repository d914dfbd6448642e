"""A table of forces as a testing machine writes it: which column is what, and in which unit."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import read_text
from fingerfit.readers.machine import columns_of, positive, refuse_unknown_units

MOST = 200
"""Rows of a table that are taken for steps: more is the record of a machine, which says nothing of pictures; without
pictures it is for `fingerfit new --from`."""


@dataclass(frozen=True)
class Forces:
    """What was read of a table.

    Parameters
    ----------
    columns : dict
        force, displacement, time and step, as far as they were found: numbers of all rows.
    heads : dict
        What the table calls them.
    units : dict
        Units that the heads name, by length, force and time.
    remarks : tuple of str
        What was done to the numbers.
    """

    columns: Mapping[str, list[float]]
    heads: Mapping[str, str]
    units: Mapping[str, str]
    remarks: tuple[str, ...] = ()


def read_forces(path: Path) -> Forces:
    """Read a table with a head: commas, semicolons (then with decimal commas) or tabs between its cells.

    Raises
    ------
    InputError
        For a table without a head or a column of forces, for units that are not known, for cells that are no numbers,
        and for too many rows.
    """
    lines = [line for line in read_text(path, "table").splitlines() if line.strip()]
    mark = max(";\t,", key=(lines[0] if lines else "").count)
    try:
        head, *rows = [[cell.strip() for cell in row] for row in csv.reader(lines, delimiter=mark)] or [[]]
    except csv.Error as error:
        raise InputError(path, "table", error, "a readable table") from error
    places, units = columns_of(head)
    if "force" not in places:
        raise InputError(path, "columns", ", ".join(head) or "an empty table", "a head with a column force or load")
    refuse_unknown_units(path, head)
    if not 1 <= len(rows) <= MOST:
        expected = f"1 to {MOST}, one for each step: copy from a long record the readings at the time of each picture"
        raise InputError(path, "rows", len(rows), expected)
    columns = {name: _numbers(path, rows, place, head[place], mark) for name, place in places.items()}
    columns, remarks = _tidy(columns)
    return Forces(columns, {name: head[place] for name, place in places.items()}, units, remarks)


def _numbers(path: Path, rows: Sequence[Sequence[str]], place: int, head: str, mark: str) -> list[float]:
    found = []
    for number, row in enumerate(rows, 2):
        text = row[place] if place < len(row) else ""
        try:
            found.append(float(text.replace(",", ".") if mark != "," else text))
        except ValueError:
            raise InputError(path, f"row {number}, {head}", text or "nothing", "a number") from None
    return found


def _tidy(columns: Mapping[str, list[float]]) -> tuple[dict[str, list[float]], tuple[str, ...]]:
    """Compression counted as positive, and the row before compression left out."""
    numbers, told = positive({name: np.array(values) for name, values in columns.items()})
    found, remarks = {name: values.tolist() for name, values in numbers.items()}, list(told)
    first = found.get("displacement", found["force"])[0]
    if first == 0 and len(found["force"]) > 1:
        found = {name: values[1:] for name, values in found.items()}
        remarks.append("the first row was before compression and is left out")
    return found, tuple(remarks)
