"""Keys of data.yaml, which says of measured files what they do not say: the source of docs/data-keys.md."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from fingerfit.core.described import HEAD, Line, Positive, Strict, described, one_of, rows, wanted
from fingerfit.core.errors import InputError, Problems
from fingerfit.core.keys import read_yaml
from fingerfit.core.units import UNITS

UPS = ("x", "y", "z", "-x", "-y", "-z")
Names = Annotated[list[Line], Field(min_length=1)]
Files = Annotated[Line | Names, wanted("a file, a pattern as dic_*.csv, or a list of them")]


class PointKeys(Strict):
    """Displacements of points."""

    files: Files = Field(
        description="One for each frame, in the order of the numbers in their names: a pattern, as `dic/*.csv`, or a"
        " list. Or one .mat with all frames."
    )
    columns: Names | None = Field(
        default=None,
        description="What the columns are where the files do not say it, in their order: x, y, z, u, v, w; other words"
        " for what is not used. Without u and v, x and y are positions in each frame.",
    )
    unit: Annotated[str, one_of(("pixel", *UNITS["length"]))] | None = Field(
        default=None,
        description="Of coordinates and displacements: pixel, " + ", ".join(UNITS["length"]) + "; as the files say it"
        " when left out.",
    )
    scale: Annotated[Positive, wanted("a number above 0")] | None = Field(default=None, description="mm of a pixel.")
    up: Annotated[str, one_of(UPS)] | None = Field(
        default=None,
        description="Measured axis that points against the motion of the indenter, one of " + ", ".join(UPS) + "; y in"
        " the plane and z in space when left out. Axes are counted after y was turned upwards.",
    )
    down: bool | None = Field(
        default=None,
        description="Whether y points downwards in the files, as in pictures; as the program does it when left out.",
    )
    flat: bool | None = Field(
        default=None,
        description="Whether a surface in space is taken as plane, without z; when left out, where its depth is below"
        " 5 % of its size.",
    )


class MachineKeys(Strict):
    """Record of the testing machine: one table, or a file of one column for each quantity."""

    file: Line | None = Field(default=None, description="A table of readings.")
    columns: Names | None = Field(
        default=None,
        description="What its columns are where no line above them says it: time, displacement, force, with units as"
        " `force [kN]`.",
    )
    force: Line | None = Field(default=None, description="In place of `file`: a file of one column with the forces.")
    displacement: Line | None = Field(default=None, description="Likewise, of the displacements.")
    time: Line | None = Field(default=None, description="Likewise, of the times.")


class IndenterKeys(Strict):
    """Where the indenter, or marks on it, are in each frame."""

    file: Line = Field(description="A table with a row for each frame.")
    columns: Names = Field(description="What its columns are: x, y, z; other words for what is not used.")


class StudyGiven(Strict):
    """Keys of study.yaml."""

    title: Any = Field(default=None, description="As in study.yaml, like the following.")
    control: Any = Field(default=None, description="`displacement` when left out, where displacements were measured.")
    noise: Any = Field(default=None, description="Standard deviations.")
    body: Any = Field(default=None, description="The body; in the plane a block around the points when left out.")
    boundary: Any = Field(default=None, description="What base and indenter do.")


class DataKeys(Strict):
    """What is said of measured files."""

    points: PointKeys | None = Field(default=None, description="Displacements of points.")
    machine: MachineKeys | None = Field(default=None, description="Record of the testing machine.")
    indenter: IndenterKeys | None = Field(
        default=None,
        description="Positions of the indenter, or of a mark on it, in each frame, in unit and axes of the points: its"
        " displacement is then from here.",
    )
    rate: Annotated[Positive, wanted("a number above 0")] | None = Field(
        default=None, description="Frames in a second: each frame is given the readings at its time."
    )
    start: float = Field(default=0.0, description="Time of frame 0 on the clock of the machine, s.")
    frames: Annotated[
        Annotated[int, Field(ge=1, le=200)] | Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)],
        wanted("how many, from 1 to 200, or a list of frames, counted from 0"),
    ] = Field(
        default=10,
        description="Frames (without points: readings) that become steps: how many, evenly spaced along the last"
        " loading; or a list, counted from 0.",
    )
    study: StudyGiven = Field(
        default=StudyGiven(), description="Keys of study.yaml that are known already; they are written as they stand."
    )


def read_data(path: Path) -> DataKeys:
    """Read data.yaml.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    data = read_yaml(path)
    if isinstance(data, dict) and data.get("points") is None and data.get("machine") is None:
        raise InputError(path, "file", "neither points nor machine", "one of them at least")
    found, problems = described(DataKeys, data, path)
    for name in ("points", "indenter") if not problems else ():
        part = getattr(found, name)
        if part and part.columns and not {"x", "y"} <= set(part.columns):
            problems.append(InputError(path, f"{name}.columns", ", ".join(part.columns), "x and y among them"))
    if not problems and found.machine and (found.machine.file is None) == (found.machine.force is None):
        problems.append(InputError(path, "machine", "both or none of file and force", "one of them"))
    if not problems and found.indenter and not found.points:
        problems.append(InputError(path, "indenter", "positions, and no points", "points beside them"))
    if problems:
        raise Problems(problems)
    assert isinstance(found, DataKeys)
    return found


def describe() -> str:
    """Markdown table of all keys, for docs/data-keys.md."""
    lines = ["# Keys of data.yaml", "", "Made by `fingerfit docs`; do not edit.", "", *HEAD, *rows(DataKeys)]
    return "\n".join(lines) + "\n"
