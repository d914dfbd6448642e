"""A draft of a study from files of other programs: displacements of points, a record of a testing machine, or both."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from fingerfit.core.errors import InputError
from fingerfit.readers.keys import DataKeys, IndenterKeys, MachineKeys, PointKeys, read_data
from fingerfit.readers.machine import Machine, at_displacements, at_times, is_machine, loading, ramps, read_machine
from fingerfit.readers.points import BEFORE, Record, common, in_mm, natural, plane, read_points, turned
from fingerfit.readers.tables import read_head, read_table
from fingerfit.start.draft import refuse_known, steps_text, write_draft
from fingerfit.start.forces import Forces

_MOVES = 0.01
"""Share of the largest displacement below which a frame is before compression. A choice."""
_TABLES = (".csv", ".txt", ".dat", ".out", ".tsv", ".mat")
_RESIDUE = 0.02
"""Share of the largest force that the first frame may have without a word. A choice."""


@dataclass(frozen=True)
class _Readings:
    """Of each frame (without points: of each reading), NaN where not known; how frames and readings were matched."""

    columns: dict[str, np.ndarray]
    how: str
    remarks: tuple[str, ...] = ()


def draft_from(
    study: Path, sources: Sequence[Path], scale: float | None = None, rate: float | None = None
) -> list[str]:
    """Write study.yaml, steps.csv, tables of points and, where there is none, config.yaml; returns what to tell.

    Parameters
    ----------
    study : Path
        Its folder; settings that are in it stay.
    sources : sequence of Path
        A data.yaml; or files and folders with displacements of points and the record of a machine.
    scale : float or None
        mm of a pixel.
    rate : float or None
        Frames in a second.

    Raises
    ------
    FingerfitError
        For what is there already, cannot be read, or does not say enough.
    """
    refuse_known(study, ("study.yaml", "steps.csv"))
    given, folder, where = _given(sources, scale, rate)
    record = _record(given.points, folder, where) if given.points else None
    machine = _machine(given.machine, folder) if given.machine else None
    readings = _readings(given, record, machine, folder, where)
    chosen = _chosen(given.frames, record, readings, where)
    steps = list(range(1, len(chosen) + 1))
    table = _table(readings, chosen, machine)
    known = given.study.model_dump(exclude_none=True)
    facts: dict[str, Any] = {
        "sources": ", ".join(path.as_posix() for path in sources),
        "pairing": readings.how,
        "table": table,
        "kind": "block",
        "box": None,
        "measured": steps,
        "given": {name: _yaml({name: value}) for name, value in known.items()},
    }
    texts: dict[str, str] = {}
    remarks: list[str] = []
    if record is not None and given.points is not None:
        up, down = _axes(given.points, record)
        places, moved, told = common(record, chosen)
        places, moved = turned(places, up, down), np.stack([turned(one, up, down) for one in moved])
        texts = {f"points/{n}.csv": _points(places, one) for n, one in zip(steps, moved, strict=True)}
        facts["points"] = (
            f"{len(places)} points, read as {record.program}; steps are frames {', '.join(map(str, chosen))}; the last"
            f" axis of the study is the measured {up}" + ", after y was turned upwards" * down
        )
        remarks = [*record.remarks, *told]
        facts["box"], facts["kind"] = _box(places), "block" if record.dim == 2 else "mesh"
    facts["table"] = replace(table, remarks=(*remarks, *readings.remarks, *table.remarks))
    texts["steps.csv"] = steps_text(table, steps, "points" if record else "", {n: f"points/{n}.csv" for n in steps})
    return write_draft(study, facts, texts)


def _given(sources: Sequence[Path], scale: float | None, rate: float | None) -> tuple[DataKeys, Path, str]:
    """What is said of the files, the folder they count from, and what errors name."""
    if len(sources) == 1 and sources[0].suffix in (".yaml", ".yml"):
        given = read_data(sources[0])
        if scale is not None or rate is not None:
            expected = "no such options: points.scale and rate stand in the file"
            raise InputError(sources[0], "--scale, --rate", "given beside data.yaml", expected)
        return given, sources[0].parent, str(sources[0])
    files: list[Path] = []
    for source in sources:
        inside = [p for p in source.iterdir() if p.suffix.lower() in _TABLES] if source.is_dir() else [source]
        if not inside:
            raise InputError(source, "folder", "no tables", "files " + ", ".join(_TABLES))
        files += sorted(inside, key=lambda path: natural(path.name))
    machines = [path for path in files if path.suffix.lower() != ".mat" and is_machine(read_head(path))]
    if len(machines) > 1:
        raise InputError(machines[1], "file", "a second table of forces", f"one, as {machines[0]}")
    points = [str(path) for path in files if path not in machines]
    try:
        given = DataKeys(
            points=PointKeys(files=points, scale=scale) if points else None,
            machine=MachineKeys(file=str(machines[0])) if machines else None,
            rate=rate,
        )
    except ValueError as error:  # of the options; files have names
        raise InputError("--scale, --rate", "number", f"{scale}, {rate}", "numbers above 0") from error
    return given, Path(), "--from"


def _record(keys: PointKeys, folder: Path, where: str) -> Record:
    names = [keys.files] if isinstance(keys.files, str) else keys.files
    paths: list[Path] = []
    for name in names:
        found = [folder / name]
        if not found[0].exists() and any(mark in name for mark in "*?["):
            anchor = Path(name).anchor
            every = Path(anchor or folder).glob(name.removeprefix(anchor))
            found = sorted(every, key=lambda path: natural(path.name))
        if not found:
            raise InputError(where, "points.files", name, "a pattern of files that exist")
        paths += found
    return plane(in_mm(read_points(paths, keys.columns), keys.unit, keys.scale, where), keys.flat)


def _axes(keys: PointKeys, record: Record) -> tuple[str, bool]:
    """The measured axis that becomes the last one, and whether y has to be turned upwards."""
    up = keys.up or ("y" if record.dim == 2 else "z")
    if up[-1] == "z" and record.dim == 2:
        raise InputError("points.up", "axis", up, "an axis of the plane, x or y")
    return up, record.down if keys.down is None else keys.down


def _machine(keys: MachineKeys, folder: Path) -> Machine:
    if keys.file is not None:
        return read_machine(folder / keys.file, keys.columns)
    names = {name: getattr(keys, name) for name in ("displacement", "force", "time")}
    return read_machine({name: folder / file for name, file in names.items() if file is not None})


def _readings(given: DataKeys, record: Record | None, machine: Machine | None, folder: Path, where: str) -> _Readings:
    if record is None:
        assert machine is not None
        if not isinstance(given.frames, int):  # numbers of rows
            return _Readings(machine.rows(), "readings of the record, counted from 0", machine.remarks)
        part, told = loading(machine)
        columns: dict[str, np.ndarray] = {name: values[part] for name, values in machine.columns.items()}
        return _Readings(columns, "the last loading of the record", (*machine.remarks, *told))
    count, columns = len(record.names), {}
    how, told = "no record of a machine", ()
    moves = _indenter(given.indenter, given.points, record, folder, where) if given.indenter and given.points else None
    if machine is not None:
        rows = len(machine.known)
        if rows == count - 1 and record.names[0] == BEFORE:
            columns = {name: np.append(0.0, one) for name, one in machine.rows().items() if name != "time"}
            how = "a reading for each file; before the first one force and displacement are taken as 0"
        elif rows == count:
            columns, how = machine.rows(), "a reading for each frame"
        elif given.rate is not None and "time" in machine.columns:
            times = given.start + np.arange(count) / given.rate
            first, last = machine.columns["time"][[0, -1]]
            if given.start > last * (1 + 1e-9):
                found = f"{given.start:g} s"
                raise InputError(where, "start", found, f"a time within the record, {first:g} to {last:g} s")
            at = at_times(machine, times[times <= last * (1 + 1e-9)])
            columns = {name: np.append(one, np.full(count - len(one), np.nan)) for name, one in at.items()}
            how = f"by time, {given.rate:g} frames in a second from {given.start:g} s"
        elif moves is not None and "displacement" in machine.columns:
            columns["force"], told = at_displacements(machine, moves)
            how = "by the displacement of the indenter"
        else:
            lacking = int((~machine.known).sum())
            found = f"{rows} readings for {count} frames" + f", {lacking} without a number" * (lacking > 0)
            raise InputError(
                where, "machine", found, "frames in a second (--rate HZ, or rate), or a reading for each frame"
            )
        told = (*machine.remarks, *told)
    if moves is not None:
        columns["displacement"] = moves
    elif "displacement" in columns:
        if machine is not None and np.isnan(columns["displacement"][0]):
            raise InputError(machine.path, "rows", "no number in the first", "a reading of frame 0")
        columns["displacement"] = columns["displacement"] - columns["displacement"][0]
    if not {"force", "displacement"} & columns.keys():
        raise InputError(
            where, "machine", "points alone", "forces or displacements of the indenter: machine, or indenter"
        )
    return _Readings(columns, how, told)


def _indenter(keys: IndenterKeys, points: PointKeys, record: Record, folder: Path, where: str) -> np.ndarray:
    """How far the indenter has moved in each frame, mm."""
    path = folder / keys.file
    table = read_table(path, "indenter")
    if (found := table.cells.shape[1]) != len(keys.columns):
        raise InputError(path, "columns", f"{found} columns", f"{len(keys.columns)}: {', '.join(keys.columns)}")
    if len(table.cells) != len(record.names):
        raise InputError(path, "rows", len(table.cells), f"{len(record.names)}, one for each frame of points")
    axes = "xyz"[: record.dim]
    if missing := [axis for axis in axes if axis not in keys.columns]:
        raise InputError(where, "indenter.columns", ", ".join(keys.columns), f"{', '.join(missing)} among them")
    places = np.stack([table.column(keys.columns.index(axis)) for axis in axes], axis=1)
    up, down = _axes(points, record)
    at = turned(record.size * places, up, down)[:, -1]
    moves = np.asarray(at[0] - at)
    if not np.isfinite(moves).all():
        raise InputError(path, "rows", "cells that are empty", "a position for each frame")
    if moves.sum() <= 0:
        found = f"a motion of {-moves.min():.3g} mm along {up}"
        other = up[1:] if up[0] == "-" else f"-{up}"
        raise InputError(where, "points.up", found, f"the axis against which the indenter moves, as {other}")
    return moves


def _chosen(frames: int | list[int], record: Record | None, readings: _Readings, where: str) -> list[int]:
    """Frames that become steps: those that are named, or some along the last loading."""
    name = "displacement" if "displacement" in readings.columns else "force"
    values = readings.columns[name]
    known = np.flatnonzero(np.isfinite(np.stack(list(readings.columns.values()))).all(axis=0))
    if not isinstance(frames, int):
        for n in frames:
            if n not in known:
                raise InputError(where, "frames", n, f"frames with a reading, {known[0]} to {known[-1]}")
        if any(a >= b for a, b in pairwise(frames)):
            raise InputError(where, "frames", frames, "rising numbers")
        return list(frames)
    part = values[known]
    runs = ramps(part)
    if not runs:
        raise InputError(where, "frames", f"a {name} that does not rise", "one loading at least")
    start, stop = runs[-1]
    moving = [n for n in range(start, stop + 1) if part[n] - part[start] > _MOVES * (part[stop] - part[start])]
    if record is None:  # readings are close to each other: evenly spaced in what is prescribed
        wanted = np.linspace(part[start], part[stop], frames + 1)[1:]
        near = {moving[int(np.abs(part[moving] - value).argmin())] for value in wanted}
        return sorted(int(known[n]) for n in near)
    at = np.linspace(0, len(moving), min(frames, len(moving)) + 1)[1:].round().astype(int) - 1
    return [int(known[moving[n]]) for n in at.tolist()]


def _table(readings: _Readings, chosen: Sequence[int], machine: Machine | None) -> Forces:
    """Readings of the steps, with what is to be said of them."""
    columns, told = {}, []
    for name, values in readings.columns.items():
        column = values[list(chosen)]
        if name != "time" and (column < 0).any():
            least = float(column.min())
            if least < -_MOVES * float(np.nanmax(np.abs(values))):
                place = machine.path if machine else "indenter"
                raise InputError(
                    place, name, f"{least:.4g} at a step", "0 or more at all steps: choose others by `frames`"
                )
            column = np.maximum(column, 0.0)
        columns[name] = column.tolist()
    force = readings.columns.get("force")
    if force is not None and abs(force[0]) > _RESIDUE * float(np.nanmax(np.abs(force))):
        told.append(f"the force is {force[0]:.3g} N already in the first frame: it is kept")
    heads = dict(machine.heads) if machine else {}
    return Forces(columns, {"force": "not measured", **heads}, {"length": "mm", "force": "N", "time": "s"}, tuple(told))


def _yaml(keys: Mapping[str, Any]) -> str:
    """One key on one line, as in the rest of the draft."""
    return yaml.safe_dump(keys, default_flow_style=True, width=10**6, sort_keys=False).strip()[1:-1]


def _points(places: np.ndarray, moved: np.ndarray) -> str:
    axes = "xyz"[: places.shape[1]]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*axes, *("u" + axis for axis in axes)])
    writer.writerows([[f"{value:.8g}" for value in row] for row in np.concatenate([places, moved], axis=1).tolist()])
    return out.getvalue()


def _box(places: np.ndarray) -> Mapping[str, list[float]]:
    """Lower corner and sizes of a block around the points, half their distance beyond the outermost ones."""
    from scipy.spatial import cKDTree

    apart = float(np.median(cKDTree(places).query(places, 2)[0][:, 1]))
    low, high = places.min(axis=0) - apart / 2, places.max(axis=0) + apart / 2
    return {"low": [float(f"{x:.4g}") for x in low], "size": [float(f"{x:.4g}") for x in high - low]}
