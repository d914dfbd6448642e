"""Tables in text as other programs write them: what stands above the numbers, delimiter and decimal mark are found."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import TABLE, read_bytes

if TYPE_CHECKING:
    import pandas as pd

_LOOKED_AT = 400
"""Lines from which the form of a table is found; the longest preamble of a testing machine has some tens. A choice."""
_DELIMITERS = (";", "\t", ",", "")
"""The empty one stands for white space."""
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf(inity)?)", re.I)
_FILLED = 0.5
"""Share of cells that are numbers in a row of numbers; others may be names of points or marks. A choice."""
_UNIT_CELL = re.compile(r"[\[(]?\s*[a-zA-Zµμ°%/\-]{0,6}\s*[\])]?")
"""A cell that holds a unit and nothing else, as the second line of a head may have."""


@dataclass(frozen=True)
class Table:
    """A table of numbers.

    Parameters
    ----------
    path : Path
    head : tuple of str
        Names of the columns with their units; empty where the file has none.
    cells : DataFrame
        A column of numbers, NaN for empty cells, or of texts.
    lines : list of int
        Line of each row in the file, from 1.
    mark : str
        Decimal mark.
    """

    path: Path
    head: tuple[str, ...]
    cells: pd.DataFrame
    lines: list[int]
    mark: str

    def column(self, place: int) -> np.ndarray:
        """Numbers of a column, NaN for empty cells.

        Raises
        ------
        InputError
            For the first cell that is no number.
        """
        values = self.cells[place]
        if values.dtype.kind in "iuf":
            return values.to_numpy(dtype=float)
        found = [_number(cell, self.mark) for cell in values]
        if None in found:
            bad = found.index(None)
            name = self.head[place] if self.head else f"column {place + 1}"
            raise InputError(self.path, f"line {self.lines[bad]}, {name}", values[bad], "a number")
        return np.array(found, dtype=float)


def read_table(path: Path, field: str = "table") -> Table:
    """Read the numbers of a table with the line above them.

    Raises
    ------
    InputError
        For what is no text, has no numbers, or has rows of different lengths.
    """
    import pandas as pd

    try:
        lines, start, delimiter = _opened(path, field)
        numbers = [n for n, line in enumerate(lines) if n >= start and line.strip()]
        rows = [lines[n] for n in numbers]
        wide = len(_cells(rows[0], delimiter))
        for n, row in zip(numbers, rows, strict=True):
            if (found := _count(row, delimiter)) != wide:
                raise InputError(path, f"line {n + 1}", f"{found} cells", f"{wide}, as in line {start + 1}")
        mark = _mark(rows, delimiter)
        text = io.StringIO("\n".join(rows))
        cells = pd.read_csv(text, sep=delimiter or r"\s+", header=None, decimal=mark, skipinitialspace=True)
        return Table(path, _head(lines[:start], delimiter, wide), cells, [n + 1 for n in numbers], mark)
    except (csv.Error, pd.errors.ParserError) as error:
        raise InputError(path, field, error, "a readable table") from error


def read_head(path: Path, field: str = "table") -> tuple[str, ...]:
    """Names of the columns of a table, whose numbers are not read.

    Raises
    ------
    InputError
        For what is no text or has no numbers.
    """
    try:
        lines, start, delimiter = _opened(path, field)
        return _head(lines[:start], delimiter, len(_cells(lines[start], delimiter)))
    except csv.Error as error:
        raise InputError(path, field, error, "a readable table") from error


def _opened(path: Path, field: str) -> tuple[list[str], int, str]:
    """Lines of a table, the first one with numbers, the delimiter."""
    lines = _text(path, field).splitlines()
    start, delimiter = _form(lines)
    if start is None:
        raise InputError(path, field, "fewer than 2 rows of numbers", "a table with a row for each point or reading")
    return lines, start, delimiter


def _text(path: Path, field: str) -> str:
    """Text in UTF-8, UTF-16 with its mark, or else in the code page of western Windows."""
    content = read_bytes(path, field, TABLE, "a table")
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if not wide and b"\0" in content:
        raise InputError(path, field, "a binary file", "a table in text")
    try:
        return content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            raise InputError(path, field, "a damaged text in UTF-16", "a table in text") from error
        return content.decode("cp1252", errors="replace")


def _form(lines: Sequence[str]) -> tuple[int | None, str]:
    """The first line of numbers, and the delimiter with which most rows of one length have the most numbers."""
    best: tuple[float, int, int | None, str] = (0.0, 0, None, "")
    for delimiter in _DELIMITERS:
        found: dict[int, list[tuple[int, float]]] = {}
        for n, line in enumerate(lines[:_LOOKED_AT]):
            cells = _cells(line, delimiter)
            if (share := _share(cells)) >= _FILLED:
                found.setdefault(len(cells), []).append((n, share))
        for wide, rows in found.items():
            score = sum(share for _, share in rows)
            if len(rows) > 1 and (score, wide) > best[:2]:
                best = (score, wide, rows[0][0], delimiter)
    return best[2], best[3]


def _share(cells: Sequence[str]) -> float:
    """Share of cells that are numbers, of those that are not empty."""
    filled = [cell for cell in cells if cell]
    return sum(bool(_NUMBER.fullmatch(cell)) for cell in filled) / len(filled) if filled else 0.0


def _mark(rows: Sequence[str], delimiter: str) -> str:
    """The decimal mark: the one that more cells have of those that are numbers."""
    commas = '"' if delimiter == "," else ","
    if not any(commas in row for row in rows):
        return "."
    if delimiter != "," and not any("." in row for row in rows):
        return ","
    numbers = [cell for row in rows for cell in _cells(row, delimiter) if _NUMBER.fullmatch(cell)]
    return "," if sum("," in cell for cell in numbers) > sum("." in cell for cell in numbers) else "."


def _number(cell: object, mark: str) -> float | None:
    """The number in a cell that may be a text; None where there is none, or one with the other decimal mark."""
    text = str(cell)
    other = isinstance(cell, str) and ("." if mark == "," else ",") in text
    return float(text.replace(mark, ".")) if _NUMBER.fullmatch(text) and not other else None


def _cells(line: str, delimiter: str) -> list[str]:
    if not delimiter:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def _count(line: str, delimiter: str) -> int:
    return line.count(delimiter) + 1 if delimiter and '"' not in line else len(_cells(line, delimiter))


def _head(lines: Sequence[str], delimiter: str, wide: int) -> tuple[str, ...]:
    """The names above the numbers, with units of a line of their own."""
    above = [_cells(line.lstrip("#"), delimiter) for line in lines if line.strip()]
    if not above or len(above[-1]) != wide:
        return ()
    names = above[-1]
    if len(above) > 1 and len(above[-2]) == wide and all(_UNIT_CELL.fullmatch(cell) for cell in names):
        units = [cell.strip("[]() ") for cell in names]
        names = [f"{name} [{unit}]" if unit else name for name, unit in zip(above[-2], units, strict=True)]
    return tuple(names)
