"""Outlines of regions of a body in the plane: reading them, and what lies inside."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.files import DOCUMENT, read_text
from fingerfit.core.units import LENGTHS

COLUMNS = ["x", "y"]
CORNERS = 2000
"""Most corners of an outline: each side is compared with each other one."""
OUTLINE = "3 or more corners in turn, around one area"

Outline = tuple[tuple[float, float], ...]


def read_outline(given: Sequence[Sequence[float]] | str, size: float, study: Path, field: str) -> Outline:
    """Corners of an outline in mm, from a list or from the table that it names.

    Parameters
    ----------
    given : sequence of (x, y), or str
    size : float
        Of the study's unit of length, mm.
    study : Path
        study.yaml.
    field : str
        Named in errors of a list.

    Raises
    ------
    InputError
        For a table that cannot be read, and for what is no outline.
    """
    where, rows = study, given
    if isinstance(given, str):
        where, field = study.parent / given, "outline"
        rows = _table(where)
    corners = np.array(rows, dtype=float).reshape(-1, 2) * size
    if len(corners) > 1 and (corners[0] == corners[-1]).all():  # closed, as programs write it
        corners = corners[:-1]
    if not (np.abs(corners) <= LENGTHS[1]).all():
        raise InputError(where, field, "a corner that is far away", f"corners of at most {LENGTHS[1]:g} mm")
    if not 3 <= len(corners) <= CORNERS:
        raise InputError(where, field, f"{len(corners)} corners", f"{OUTLINE}, at most {CORNERS}")
    if crossing := _crossing(corners):
        raise InputError(where, field, crossing, OUTLINE)
    return tuple((float(x), float(y)) for x, y in corners)


def _table(file: Path) -> list[list[float]]:
    text = read_text(file, "outline", DOCUMENT, f"a table with the columns {','.join(COLUMNS)}")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(map(str.strip, row))]
    except csv.Error as error:
        raise InputError(file, "outline", error, "a readable CSV table") from error
    if not rows or rows[0] != COLUMNS:
        raise InputError(file, "columns", ",".join(rows[0]) if rows else "nothing", ",".join(COLUMNS))
    found = []
    for number, row in enumerate(rows[1:], 2):
        try:
            x, y = (math.nan if "_" in cell else float(cell) for cell in row)  # Python reads 1_0 as 10
        except ValueError:
            x = y = math.nan
        if not math.isfinite(x + y):
            raise InputError(file, f"row {number}", ",".join(row), "2 finite numbers")
        found.append([x, y])
    return found


def area(outline: Outline) -> float:
    """Area inside an outline, mm^2.

    >>> area(((0, 0), (2, 0), (0, 2)))
    2.0
    """
    x, y = np.array(outline, dtype=float).T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def _crossing(corners: np.ndarray) -> str:
    """What is wrong with the sides of an outline, in words; empty where nothing is."""
    ends = np.roll(corners, -1, axis=0)
    if (corners == ends).all(axis=1).any():
        return "a corner twice in turn"

    def turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        """On which side of a line from a to b each c lies."""
        (ux, uy), (vx, vy) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        return np.sign(ux * vy - uy * vx)

    a, b = corners[:, None], ends[:, None]
    first, second = turn(a, b, corners[None]), turn(a, b, ends[None])
    cross = (first * second <= 0) & (first * second <= 0).T & ((first != 0) | (second != 0))
    count = len(corners)
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    cross &= (apart > 1) & (apart < count - 1)
    if cross.any():
        i, j = np.argwhere(cross)[0] + 1
        return f"side {i} across side {j}"
    return "" if area(tuple(map(tuple, corners))) > 0 else f"{count} corners around no area"


def inside(outline: Outline, places: np.ndarray) -> np.ndarray:
    """Which places an outline holds, shape (places,) of bool: those from which a ray crosses it an odd number of times.

    >>> inside(((0, 0), (2, 0), (0, 2)), np.array([[0.5, 0.5], [1.5, 1.5]])).tolist()
    [True, False]
    """
    x, y = places[:, 0], places[:, 1]
    found = np.zeros(len(places), dtype=bool)
    for (x1, y1), (x2, y2) in zip(outline, (*outline[1:], outline[0]), strict=True):
        if y1 != y2:
            found ^= ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) * (x2 - x1) / (y2 - y1))
    return found
