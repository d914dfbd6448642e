"""Displacements of points in each frame, from whichever program: correlated ones, in mm, in the frame of the study."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.units import UNITS
from fingerfit.imaging.points import polynomials
from fingerfit.readers.layouts import AXES, LAYOUTS, MOTIONS, PIXEL, layout_of, uncorrelated, unit_named, unit_of
from fingerfit.readers.matlab import read_matlab
from fingerfit.readers.tables import Table, read_table

_OUTLIER = 5.0
"""Normalized median residual from which a displacement is an outlier; Westerweel and Scarano (Exp Fluids 39, 2005) take
2 where nothing else is known of the noise. A choice: 2 takes away points that are only noisy."""
_NEIGHBOURS = 8
_DEGREE, _SURPLUS = 3, 6
"""Of the smooth field that is taken away before, and points for each of its coefficients; choices."""
_FEWEST = 9
"""Points of a frame; fewer are no field."""
_SAME = 1e-5
"""Share of the extent within which two places are one point."""
_STILL = 1e-3
"""Share of the largest displacement up to which the first frame is the one before compression. A choice."""
BEFORE = "the picture before compression"
"""Name of a frame of which there is no file."""
_FLAT = 0.05
"""Depth of a surface, as a share of its extent, up to which it is drafted as plane. A choice."""


@dataclass(frozen=True)
class Record:
    """Frames of one measurement.

    Parameters
    ----------
    names : tuple of str
        What each frame is called, in their order; the first is 0.
    places : tuple of ndarray, each of shape (points, dim)
        Before compression.
    moved : tuple of ndarray, each of shape (points, dim)
        Displacements; NaN where nothing was correlated.
    program : str
    unit : str
        Of both, as the files have it; empty where they do not say it, ``pixel`` where it is a pixel.
    down : bool
        Whether y points downwards.
    remarks : tuple of str
        What was done to the numbers.
    size : float
        How many mm the unit of the files is, once the numbers are in mm.
    """

    names: tuple[str, ...]
    places: tuple[np.ndarray, ...]
    moved: tuple[np.ndarray, ...]
    program: str
    unit: str
    down: bool
    remarks: tuple[str, ...] = ()
    size: float = 1.0

    @property
    def dim(self) -> int:
        """Coordinates of a point."""
        return int(self.places[0].shape[1])


def natural(name: str) -> list[tuple[int, str]]:
    """Sorts step_10 after step_2."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def read_points(paths: Sequence[Path], columns: Sequence[str] | None = None) -> Record:
    """Read a file for each frame, or one .mat with all frames.

    Parameters
    ----------
    paths : sequence of Path
        In the order of the frames.
    columns : sequence of str or None
        What the columns are where the files do not say it: x, y, z, u, v, w, others for what is not used.
        Without u and v the coordinates are positions in each frame, of the same points in the same order.

    Raises
    ------
    InputError
        For what cannot be read or understood.
    """
    if paths[0].suffix.lower() == ".mat":
        if len(paths) > 1:
            raise InputError(paths[1], "files", f"{len(paths)} files of MATLAB", "one, which has all frames")
        program, unit, fields = read_matlab(paths[0])
        names = tuple(f"{paths[0].name}, frame {n}" for n in range(len(fields)))
        at, by = (tuple(one[n] for one in fields) for n in range(2))
        found = Record(names, at, by, program, unit_named(unit) or unit.strip(), True)
    else:
        tables = [read_table(path, "points") for path in paths]
        first = tables[0]
        for table in tables[1:]:
            if table.head != first.head or table.cells.shape[1] != first.cells.shape[1]:
                raise InputError(table.path, "columns", _told(table), f"{_told(first)}, as {first.path.name}")
        found = _positions(tables, columns) if columns and "u" not in columns else _fields(tables, columns)
    for name, places, moved in zip(found.names, found.places, found.moved, strict=True):
        if (count := int(np.isfinite(moved).all(axis=1).sum())) < _FEWEST or not np.isfinite(places).all():
            raise InputError(name, "points", f"{count} with a displacement", f"at least {_FEWEST}")
    return _from_reference(found)


def _from_reference(record: Record) -> Record:
    """The record with the picture before compression as frame 0, of which many programs write no file."""
    size = [float(np.nanmedian(np.abs(one).max(axis=1))) for one in record.moved]
    if size[0] <= _STILL * max(size):
        return record
    told = f"{Path(record.names[0]).name} has displacements already: it is frame 1, and frame 0 the picture before it"
    return replace(
        record,
        names=(BEFORE, *record.names),
        places=(record.places[0], *record.places),
        moved=(np.zeros_like(record.moved[0]), *record.moved),
        remarks=(*record.remarks, told),
    )


def _fields(tables: Sequence[Table], columns: Sequence[str] | None) -> Record:
    """Frames that list places and displacements."""
    head = tuple(columns or tables[0].head)
    if columns and len(columns) != tables[0].cells.shape[1]:
        raise InputError(tables[0].path, "columns", f"{tables[0].cells.shape[1]} columns", f"{len(columns)}: {columns}")
    found = layout_of(head)
    if found is None:
        known = ", ".join(dict.fromkeys(layout.program for layout in LAYOUTS))
        expected = f"columns x, y, u, v of {known}; or say by `columns` what they are"
        raise InputError(tables[0].path, "columns", _told(tables[0]), expected)
    layout, places = found
    axes = [name for name in AXES if name in places]
    motions = MOTIONS[: len(axes)]
    where, moved = [], []
    for table in tables:
        at = np.stack([table.column(places[name]) for name in axes], axis=1)
        by = np.stack([table.column(places[name]) for name in motions], axis=1)
        bad = uncorrelated(layout, head, table.column) | ~np.isfinite(at).all(axis=1)
        by[np.broadcast_to(bad, len(by))] = np.nan
        where.append(at)
        moved.append(by)
    # a point without a place is no point
    kept = [np.isfinite(at).all(axis=1) for at in where]
    where, moved = ([one[k] for one, k in zip(parts, kept, strict=True)] for parts in (where, moved))
    names = tuple(str(table.path) for table in tables)
    return Record(names, tuple(where), tuple(moved), layout.program, layout.unit, layout.down)


def _positions(tables: Sequence[Table], columns: Sequence[str]) -> Record:
    """Frames that list where the same points are."""
    axes = [name for name in AXES if name in columns]
    first = tables[0]
    if first.cells.shape[1] != len(columns):
        raise InputError(first.path, "columns", f"{first.cells.shape[1]} columns", f"{len(columns)}: {columns}")
    if len(axes) < 2:
        raise InputError(first.path, "columns", ", ".join(columns), "x and y at least")
    at = []
    for table in tables:
        if len(table.cells) != len(first.cells):
            expected = f"{len(first.cells)}, as in {first.path.name}: positions are of the same points"
            raise InputError(table.path, "rows", len(table.cells), expected)
        at.append(np.stack([table.column(list(columns).index(name)) for name in axes], axis=1))
    kept = np.isfinite(at[0]).all(axis=1)
    names = tuple(str(table.path) for table in tables)
    unit = unit_of(first.head[0]) if first.head else ""
    return Record(names, (at[0][kept],) * len(at), tuple((one - at[0])[kept] for one in at), "positions", unit, False)


def _told(table: Table) -> str:
    return ", ".join(table.head) or f"no names above {table.cells.shape[1]} columns"


def in_mm(record: Record, unit: str | None, scale: float | None, where: str) -> Record:
    """The record in mm.

    Parameters
    ----------
    record : Record
    unit : str or None
        Of the numbers where the files do not say it.
    scale : float or None
        mm of a pixel.
    where : str
        What errors name.

    Raises
    ------
    InputError
        Where the unit is not known, the scale is missing, or there are two.
    """
    known = unit or record.unit
    if known and known not in (PIXEL, *UNITS["length"]):
        expected = "one of pixel, " + ", ".join(UNITS["length"])
        expected += "; another one as points.unit: pixel in data.yaml, with its size in mm as points.scale"
        raise InputError(record.names[-1], "unit", known, expected)
    if known == PIXEL:
        if scale is None:
            found = f"none, and coordinates in pixels ({record.program})"
            raise InputError(where, "scale", found, "how many mm a pixel is: --scale MM, or points.scale")
        size = scale
    elif scale is not None:
        found = f"{scale:g}, and coordinates in {known or 'no unit that is told'}"
        raise InputError(where, "scale", found, "no scale; or unit: pixel, where they are in pixels")
    elif known:
        size = UNITS["length"][known]
    else:
        size = 1.0
        record = replace(record, remarks=(*record.remarks, "the files do not say their unit of length: taken as mm"))
    places, moved = (tuple(size * one for one in part) for part in (record.places, record.moved))
    return replace(record, unit="mm", places=places, moved=moved, size=size)


def turned(vectors: np.ndarray, up: str, down: bool) -> np.ndarray:
    """Vectors in the frame of the study, whose last axis points against the indenter's motion.

    Parameters
    ----------
    vectors : ndarray, shape (n, dim)
    up : str
        Measured axis that becomes the last one, as ``y`` or ``-x``, after y was turned upwards.
    down : bool
        Whether y points downwards: it is turned upwards, in space together with z, so that nothing is mirrored.

    >>> turned(np.array([[1.0, 2.0]]), "x", False).tolist(), turned(np.array([[1.0, 2.0]]), "y", True).tolist()
    ([[-2.0, 1.0]], [[1.0, -2.0]])
    """
    dim = vectors.shape[1]
    if down:
        vectors = vectors * ([1, -1] if dim == 2 else [1, -1, -1])
    axis = AXES.index(up[-1])
    order = [(axis + 1 + n) % dim for n in range(dim)]
    found = vectors[:, order]
    if dim == 2 and axis == 0:
        found = found * [-1, 1]
    if up[0] == "-":
        found = -found if dim == 2 else found * [1, -1, -1]
    return found


def plane(record: Record, flat: bool | None) -> Record:
    """The record without depth, where that is small or `flat` says so."""
    if record.dim == 2 or flat is False:
        return record
    size = np.ptp(record.places[0], axis=0)
    if flat is None and size[2] > _FLAT * size[:2].max():
        return record
    told = f"the surface is taken as plane: its depth is {size[2]:.3g} mm of {size[:2].max():.3g} mm"
    return replace(
        record,
        places=tuple(one[:, :2] for one in record.places),
        moved=tuple(one[:, :2] for one in record.moved),
        remarks=(*record.remarks, told),
    )


def common(record: Record, chosen: Sequence[int]) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Points that have a displacement in all chosen frames, without outliers.

    Parameters
    ----------
    record : Record
    chosen : sequence of int
        Frames.

    Returns
    -------
    places : ndarray, shape (points, dim)
    moved : ndarray, shape (frames, points, dim)
    remarks : tuple of str
        What was left out.

    Raises
    ------
    InputError
        Where too few are left.
    """
    first = record.places[chosen[0]]
    grain = _SAME * float(np.ptp(first, axis=0).max())
    rows = {tuple(key): n for n, key in enumerate(np.round(first / grain).astype(np.int64).tolist())}
    moved = np.full((len(chosen), len(first), record.dim), np.nan)
    for at, frame in enumerate(chosen):
        places = record.places[frame]
        if places is first or (places.shape == first.shape and np.abs(places - first).max() < grain):
            moved[at] = record.moved[frame]
            continue
        keys = np.round(places / grain).astype(np.int64).tolist()
        pairs = [(rows[key], n) for n, key in enumerate(map(tuple, keys)) if key in rows]
        here, there = (list(part) for part in zip(*pairs, strict=True)) if pairs else ([], [])
        moved[at, here] = record.moved[frame][there]
    known = np.isfinite(moved).all(axis=2)
    kept = known.all(axis=0)
    remarks = []
    if kept.sum() < len(kept):
        worst = chosen[int(known.sum(axis=1).argmin())]
        told = f"the least in {Path(record.names[worst]).name}"
        remarks.append(f"{(~kept).sum()} of {len(kept)} points have no displacement in some frame, {told}: left out")
    if kept.sum() >= _FEWEST:
        wild = np.zeros(len(kept), dtype=bool)
        for one in moved:
            wild[kept] |= outliers(first[kept], one[kept])
        if wild.any():
            remarks.append(f"{wild.sum()} points move otherwise than all around them (outliers): left out")
        kept &= ~wild
    if kept.sum() < _FEWEST:
        found = f"{kept.sum()} in all of the frames {', '.join(map(str, chosen))}"
        raise InputError(record.names[chosen[-1]], "points", found, f"at least {_FEWEST}; choose others by `frames`")
    return first[kept], moved[:, kept], tuple(remarks)


def outliers(places: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Which points move otherwise than the points around them: the normalized median test.

    Residuals from the median of the neighbours, as multiples of the neighbours' own residuals (Westerweel and Scarano,
    Exp Fluids 39, 2005, 1096-1100); in place of their 0.1 pixel stands the median residual of the frame. A smooth
    field is taken away before: where strain is large, neighbours move otherwise too.

    Parameters
    ----------
    places, moved : ndarray, shape (points, dim)
    """
    from scipy.spatial import cKDTree

    basis = polynomials(places, _DEGREE if len(places) >= _SURPLUS * _DEGREE ** places.shape[1] else 1)
    moved = moved - basis @ np.linalg.lstsq(basis, moved, rcond=None)[0]
    count = min(_NEIGHBOURS, len(places) - 1)
    around = moved[cKDTree(places).query(places, count + 1)[1][:, 1:]]
    middle = np.median(around, axis=1)
    spread = np.median(np.abs(around - middle[:, None]), axis=1)
    off = np.abs(moved - middle)
    usual = np.median(off, axis=0) + 1e-9 * float(np.abs(moved).max(initial=0.0)) + 1e-12
    return np.asarray((off / (spread + usual) > _OUTLIER).any(axis=1))
