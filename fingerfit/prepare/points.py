"""Tables of measured points of a study, and how well they are known."""

from __future__ import annotations

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import TABLE, read_text
from fingerfit.imaging.points import estimate_covariance, unusable
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.mesh import Mesh
from fingerfit.study.study import ESTIMATED, Study


def read_points(study: Study, mesh: Mesh, problems: list[FingerfitError]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of measured points, their displacements (mm) and the steps they belong to; adds to the problems."""
    columns = [*"xyz"[: mesh.dim], *("u" + axis for axis in "xyz"[: mesh.dim])]
    tables, owners = [], []
    for number, step in enumerate(study.steps):
        if step.points is None:
            continue
        try:
            text = read_text(step.points, "points", TABLE, "a table of points").splitlines()
            head = [cell.strip() for cell in text[0].split(",")] if text else []
            if head != columns:
                raise InputError(step.points, "columns", ",".join(head) or "nothing", ",".join(columns))
            lines = [line for line, row in enumerate(text, 1) if line > 1 and row.strip()]
            rows = [[_number(cell) for cell in text[line - 1].split(",")] for line in lines]
            for line, row in zip(lines, rows, strict=True):
                if len(row) != len(columns) or not np.isfinite(row).all():
                    found, expected = text[line - 1].strip(), f"{len(columns)} finite numbers"
                    raise InputError(step.points, f"line {line}", found, expected)
            if not rows:
                raise InputError(step.points, "rows", "none", f"{len(columns)} finite numbers for each point")
            table = np.array(rows)
            wrong = unusable(table[:, : mesh.dim] * study.length, table[:, mesh.dim :] * study.length, mesh.body)
            if wrong is not None:
                raise InputError(step.points, "rows", *wrong)
            # a point of no element has no displacement to compare with
            outside = np.flatnonzero(Probe(mesh, table[:, : mesh.dim] * study.length).element < 0)
            if len(outside):
                place = ", ".join(f"{x:g}" for x in table[outside[0], : mesh.dim])
                found = f"{place} in no element of the mesh ({len(outside)} of {len(table)} points are)"
                raise InputError(step.points, f"line {lines[outside[0]]}", found, "points in the body")
        except InputError as error:
            problems.append(error)
            continue
        except ValueError as error:
            problems.append(InputError(step.points, "rows", error, f"{len(columns)} finite numbers"))
            continue
        tables.append(table * study.length)
        owners.append(np.full(len(table), number))
    if not tables:
        return np.zeros((0, mesh.dim)), np.zeros((0, mesh.dim)), np.zeros(0, dtype=int)
    table = np.concatenate(tables)
    return table[:, : mesh.dim], table[:, mesh.dim :], np.concatenate(owners)


def points_covariance(
    study: Study, points: tuple[np.ndarray, np.ndarray, np.ndarray], problems: list[FingerfitError]
) -> np.ndarray:
    """Covariance of a point's error at two steps, mm^2: as given and independent, or estimated from all points.

    Adds to the problems.
    """
    count = len(study.steps)
    if study.noise.points != ESTIMATED:
        return float(study.noise.points or 0.0) ** 2 * np.eye(count)
    try:
        return estimate_covariance(*points, count) if len(points[2]) else np.zeros((count, count))
    except ValueError as error:
        expected = "a number, or at least 9 points, the same at all steps"
        problems.append(InputError(study.path, "noise.points", f"estimated, from {error}", expected))
        return np.zeros((count, count))


def _number(text: str) -> float:
    """A number of a table; ValueError for the 1_0 that Python reads as 10, too."""
    if "_" in text:
        raise ValueError(f"could not read {text.strip()!r}")
    return float(text)
