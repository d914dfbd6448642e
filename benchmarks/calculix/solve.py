"""Run CalculiX (`ccx`) on a body, and read what it printed."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from body import Body
from deck import deck

LIMIT = 900
"""Seconds that ccx may take."""
JOB = "body"
"""Name of the files of ccx."""


class NotSolved(Exception):
    """CalculiX is not there, or has no solution."""


def solve(body: Body, indentations: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Compress a body.

    Parameters
    ----------
    body : Body
        Without load.
    indentations : sequence (steps,) of float
        Of the indenter, mm.

    Returns
    -------
    moved : ndarray (steps, front nodes, 2)
        Displacements of the front nodes, mm.
    force : ndarray (steps,)
        On the indenter over the thickness, N/mm; positive in compression.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / f"{JOB}.inp").write_text(deck(body, indentations), encoding="utf-8")
        _run(folder)
        file = Path(folder) / f"{JOB}.dat"
        text = file.read_text(encoding="utf-8") if file.exists() else ""
    moved, force = _read(text)
    count = len(body.mesh.front)
    for step in range(1, len(indentations) + 1):
        if len(moved.get(step, ())) != count or step not in force:
            raise NotSolved(f"ccx found no solution in step {step} of {len(indentations)}")
    steps = range(1, len(indentations) + 1)
    return np.array([moved[step] for step in steps]), -np.array([force[step] for step in steps]) / body.mesh.thickness


def _run(folder: str) -> None:
    """Run ccx in a folder, on one processor."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    try:
        subprocess.run(
            ["ccx", "-i", JOB], cwd=folder, env=environment, timeout=LIMIT, check=False,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except FileNotFoundError:
        raise NotSolved("ccx was not found; install CalculiX") from None
    except subprocess.TimeoutExpired:
        raise NotSolved(f"ccx took longer than {LIMIT} s") from None


def _read(text: str) -> tuple[dict[float, list[list[float]]], dict[float, float]]:
    """Displacements (mm) and total forces (N, of the slice) in a .dat file, by time; a step is one unit of time."""
    moved: dict[float, list[list[float]]] = {}
    force: dict[float, float] = {}
    time, displacements = 0.0, False
    for line in text.splitlines():
        words = line.split()
        if "displacements" in line or "total force" in line:
            time, displacements = float(words[-1]), "displacements" in line
            if displacements:
                moved[time] = []
        elif words and displacements:
            moved[time].append([float(word) for word in words[1:3]])
        elif words:
            force[time] = float(words[1])
    return moved, force
