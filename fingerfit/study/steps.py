"""The table of a study's steps, one row for each: what was prescribed, what was measured, and its files."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from pathlib import Path

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import DOCUMENT, read_text
from fingerfit.study.study import SIDEWAYS, Step

COLUMNS = ("step", "time", "displacement", "force", "force_noise", "picture", "points", *SIDEWAYS)
_SEPARATORS = {";": "semicolons", "\t": "tabs"}
"""What other programs put between the cells of a table."""


def read_steps(file: Path, sizes: Mapping[str, float], problems: list[FingerfitError]) -> tuple[Step, ...]:
    """The steps of a table.

    Parameters
    ----------
    file : Path
    sizes : mapping
        Of the units of the study, by ``length``, ``force`` and ``time``.
    problems : list
        What is wrong is put there, one line for each mistake.
    """
    try:
        text = read_text(file, "steps", DOCUMENT, "a readable CSV table")
        rows = [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    except InputError as error:
        problems.append(error)
        return ()
    except csv.Error as error:
        problems.append(InputError(file, "steps", error, "a readable CSV table"))
        return ()
    head = [cell.strip() for cell in rows[0]] if rows else []
    wrong = [column for n, column in enumerate(head) if column not in COLUMNS or column in head[:n]]
    if len(head) == 1 and (mark := next((mark for mark in _SEPARATORS if mark in head[0]), "")):
        expected = "commas between the cells, and decimal points in numbers"
        problems.append(InputError(file, "columns", f"{_SEPARATORS[mark]} between the cells", expected))
        return ()
    if wrong or "step" not in head:
        found = wrong[0] if wrong else ",".join(head) or "an empty table"
        problems.append(InputError(file, "columns", found, "columns " + ", ".join(COLUMNS) + " (step is needed)"))
        return ()
    if len(rows) < 2:
        problems.append(InputError(file, "rows", "none", "a row for each step"))
    steps: list[Step] = []
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(head):
            problems.append(InputError(file, f"row {number}", f"{len(row)} cells", f"{len(head)} cells"))
            continue
        cells = {column: cell.strip() for column, cell in zip(head, row, strict=True)}
        step = _step(file, number, cells, sizes, problems)
        if step is None:
            continue
        _compare(file, number, steps[-1] if steps else None, step, problems)
        steps.append(step)
    return tuple(steps)


def _step(
    file: Path, row: int, cells: Mapping[str, str], sizes: Mapping[str, float], problems: list[FingerfitError]
) -> Step | None:
    values: dict[str, float | None] = {}
    of = {"time": "time", "displacement": "length", "force": "force"}
    for column in ("time", "displacement", "force", "force_noise", *SIDEWAYS):
        kind = of[column.partition("_")[0]]
        text = cells.get(column, "")
        values[column] = None
        if not text:
            continue
        try:
            given = math.nan if "_" in text else float(text)  # Python reads 1_0 as 10
        except ValueError:
            given = math.nan
        value = given * sizes[kind]
        if not math.isfinite(given):
            problems.append(InputError(file, f"row {row}, {column}", text, "a finite number"))
        elif column not in ("time", *SIDEWAYS) and value < 0:
            problems.append(InputError(file, f"row {row}, {column}", text, "0 or more: compression is positive"))
        elif not math.isfinite(value):
            problems.append(InputError(file, f"row {row}, {column}", text, "a number that is finite in N, mm and s"))
        elif column == "force_noise" and value == 0:
            problems.append(InputError(file, f"row {row}, {column}", text, "a standard deviation above 0"))
        else:
            values[column] = value
    if not cells["step"].isdecimal() or len(cells["step"]) > 9:
        problems.append(InputError(file, f"row {row}, step", cells["step"] or "nothing", "a whole number"))
        return None
    files = {}
    for column in ("picture", "points"):
        name = cells.get(column, "")
        files[column] = file.parent / name if name else None
        if name and not (name.isprintable() and (file.parent / name).exists()):
            problems.append(InputError(file, f"row {row}, {column}", name, "a file that exists"))
    return Step(
        int(cells["step"]),
        values["time"],
        values["displacement"],
        values["force"],
        files["picture"],
        files["points"],
        values["force_noise"],
        **{column: values[column] for column in SIDEWAYS},
    )


def _compare(file: Path, row: int, last: Step | None, step: Step, problems: list[FingerfitError]) -> None:
    if last is None:
        return
    if step.number <= last.number:
        problems.append(InputError(file, f"row {row}, step", step.number, f"a number above {last.number}"))
    if step.time is not None and last.time is not None and step.time <= last.time:
        problems.append(InputError(file, f"row {row}, time", f"{step.time:g}", f"more than {last.time:g} s"))
