"""Uniaxial compression of silicone cylinders (Dawood and others 2026) as a study of forces without pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fingerfit.errors import InputError
from fingerfit.files import write_text

DIAMETER, HEIGHT = 50.0, 30.0
"""Of the cylinders, mm."""
STEPS = 20


def read_test(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Compression in mm and load in N of one of the authors' CSV files.

    Raises
    ------
    InputError
        When its columns or numbers are not those of the authors.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, "file", getattr(error, "strerror", None) or error, "a readable CSV file") from error
    head = next((n for n, line in enumerate(lines) if line.startswith("Time")), None)
    names = [name.strip() for name in lines[head].split(",")] if head is not None else []
    if head is None or "Compression (mm)" not in names or "Load (N)" not in names:
        raise InputError(path, "columns", ", ".join(names) or "none", "Time (s), Compression (mm), Load (N), ...")
    try:
        rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[head + 1 :] if line.strip()])
    except ValueError as error:
        raise InputError(path, "rows", error, "numbers") from error
    return rows[:, names.index("Compression (mm)")], rows[:, names.index("Load (N)")]


def make_study(tests: Sequence[Path], out: Path) -> None:
    """Write a study of the mean of several tests.

    Forces are read at 20 even displacements, up to the smallest largest one; their mean is the measurement, their
    pooled spread between the tests its noise. Plates without friction keep the state uniaxial, where the shape of
    the cross-section does not matter: the body is a square brick of the cylinder's area.

    Parameters
    ----------
    tests : sequence of Path
        CSV files; with a single one, the noise is 1 % of the largest force.
    out : Path
        Folder of the study.
    """
    curves = [read_test(path) for path in tests]
    end = min(compression.max() for compression, _ in curves)
    at = end * np.arange(1, STEPS + 1) / STEPS
    forces = np.array([np.interp(at, compression, load) for compression, load in curves])
    mean = forces.mean(axis=0)
    spread = float(np.sqrt(forces.var(axis=0, ddof=1).mean())) if len(forces) > 1 else 0.01 * float(mean.max())
    side = float(np.sqrt(np.pi / 4) * DIAMETER)
    rows = [f"{n},{d:.5f},{f:.5f}" for n, (d, f) in enumerate(zip(at, mean, strict=True), 1)]
    write_text(out / "steps.csv", "\n".join(["step,displacement,force", *rows]) + "\n")
    write_text(
        out / "study.yaml",
        f"title: Uniaxial compression of silicone, mean of {len(forces)} tests, friction neglected\n"
        "units: {length: mm, force: N, time: s}\n"
        "control: displacement\n"
        "steps: steps.csv\n"
        f"noise: {{force: {spread:.4g}}}\n"
        f"body: {{brick: [{side:.5f}, {side:.5f}, {HEIGHT:g}], layers: [{{name: silicone}}]}}\n"
        "boundary: {base: slides, indenter: slides}\n",
    )
