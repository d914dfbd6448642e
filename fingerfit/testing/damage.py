"""Results of a program, damaged in the ways in which disks, limits and other versions damage them.

`fingerfit.testing.solver.ExternalSolverConformance` asks an adapter about each: it must be an error, never an answer.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

Row = tuple[int, list[float]]
"""A row of a table of results: label of a node, and its values."""


@dataclass(frozen=True)
class Format:
    """How a results file is taken apart and put together again.

    Parameters
    ----------
    name : str
        The file, in the folder where the program runs.
    split : callable
        Text to pieces, each of them one row of a table at most.
    join : callable
        The inverse.
    row : callable
        Label and values of a piece that is a row of displacements or forces; None for any other piece.
    piece : callable
        A piece with another label and other values, like the one that is given.
    """

    name: str
    split: Callable[[str], list[str]]
    join: Callable[[Sequence[str]], str]
    row: Callable[[str], Row | None]
    piece: Callable[[str, Row], str]


def _rows(form: Format, pieces: Sequence[str]) -> list[int]:
    return [n for n, piece in enumerate(pieces) if form.row(piece) is not None]


def _last_table(form: Format, pieces: Sequence[str]) -> list[int]:
    """Places of the last rows that follow each other with growing labels."""
    rows = [(n, row[0]) for n, piece in enumerate(pieces) if (row := form.row(piece)) is not None]
    first = len(rows) - 1
    while first and rows[first - 1][0] == rows[first][0] - 1 and rows[first - 1][1] < rows[first][1]:
        first -= 1
    return [n for n, _ in rows[first:]]


def _changed(change: Callable[[Row], Row], where: Callable[[list[int]], list[int]], last: bool = False) -> Damage:
    def damage(form: Format, pieces: list[str]) -> list[str]:
        for n in where(_last_table(form, pieces) if last else _rows(form, pieces)):
            row = form.row(pieces[n])
            assert row is not None
            pieces[n] = form.piece(pieces[n], change(row))
        return pieces

    return damage


def _number(value: float, axis: int) -> Callable[[Row], Row]:
    return lambda row: (row[0], [*row[1][:axis], value, *row[1][axis + 1 :]])


def _without(where: Callable[[list[int]], list[int]], last: bool = False) -> Damage:
    def damage(form: Format, pieces: list[str]) -> list[str]:
        gone = set(where(_last_table(form, pieces) if last else _rows(form, pieces)))
        return [piece for n, piece in enumerate(pieces) if n not in gone]

    return damage


def _twice(form: Format, pieces: list[str]) -> list[str]:
    n = _rows(form, pieces)[0]
    return [*pieces[: n + 1], *pieces[n:]]


def _cut(share: float) -> Damage:
    def damage(form: Format, pieces: list[str]) -> list[str]:
        last = _rows(form, pieces)[-1]
        return [*pieces[:last], pieces[last][: int(share * len(pieces[last]))]]

    return damage


def _half(form: Format, pieces: list[str]) -> list[str]:
    text = form.join(pieces)
    return form.split(text[: len(text) // 2])


Damage = Callable[[Format, list[str]], list[str]]
DAMAGES: dict[str, Damage] = {
    "empty": lambda form, pieces: [],
    "cut in half": _half,
    "cut within the last row": _cut(0.6),
    "cut after the last but one row": _cut(0.0),
    "NaN among the displacements": _changed(_number(math.nan, 0), lambda rows: rows[len(rows) // 8 :][:1]),
    "NaN among the forces": _changed(_number(math.nan, 1), lambda rows: rows[:1], last=True),
    "an infinite displacement": _changed(_number(math.inf, 1), lambda rows: rows[1:2]),
    "a displacement of 1e30": _changed(_number(1e30, 0), lambda rows: rows[len(rows) // 8 :][:1]),
    "a force of 1e30": _changed(_number(1e30, 1), lambda rows: rows[1:2], last=True),
    "a held node that moves": _changed(_number(1.0, 1), lambda rows: rows[:1]),
    "labels shifted by one": _changed(lambda row: (row[0] + 1, row[1]), lambda rows: rows),
    "a label that is no node": _changed(lambda row: (row[0] + 5000, row[1]), lambda rows: rows[2:3]),
    "a node missing": _without(lambda rows: rows[3:4]),
    "the last node missing": _without(lambda rows: rows[-1:], last=True),
    "the last table empty": _without(lambda rows: rows, last=True),
    "all tables empty": _without(lambda rows: rows),
    "a node twice": _twice,
}
"""By name: what is done to the pieces of a results file."""


def script(folder: Path, body: str, name: str = "program") -> str:
    """Path of an executable shell script."""
    path = folder / name
    path.write_text("#!/bin/sh\n" + body, encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def recorder(folder: Path, program: Sequence[str]) -> str:
    """A script that runs a program and keeps its files, what it says and its exit code in ``folder/kept``."""
    kept = folder / "kept"
    words = " ".join(f"'{word}'" for word in program)
    keep = f"cat said.txt\ncp -r . {kept}\necho $code > {kept}/code.txt\nexit $code\n"
    return script(folder, f'{words} "$@" > said.txt 2>&1\ncode=$?\n{keep}', "recorder")


def replay(folder: Path, ending: str = "exit $(cat code.txt)") -> str:
    """A script that leaves what the recorder kept, says it, and ends in another way if wanted."""
    return script(folder, f"cp -r {folder / 'kept'}/. .\ncat said.txt\n{ending}\n", "replay")
