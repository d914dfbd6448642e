"""Uniaxial compression of silicone cylinders (Dawood and others 2026) as a study of forces without pictures.

python examples/ecoflex/make_study.py EF10_50T/*.csv
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fingerfit.cli import exit_code
from fingerfit.core.errors import InputError
from fingerfit.core.files import read_text, write_text

DIAMETER, HEIGHT = 50.0, 30.0
"""Of the cylinders, mm."""
STEPS = 20
FRICTION = """# written by make_study.py: force on a disc between plates with friction, slab method (Siebel 1923)
title: friction at the plates
acts: observation
words: Friction between plates and cylinder raises the force above the uniaxial one, more so the flatter the cylinder.
look: The force rises faster at large compression than the material law says; the cylinder bulges like a barrel.
confirm: The same test with greased plates, or with cylinders of another height.
parameters:
  coefficient: {{unit: "1", absent: 0, lower: 0, upper: 0.5, step: 0.05}}
observes:
  force: "force * (1 + coefficient / 3 * {slimness:.6g} * (1 - {end:.6g} * k / n) ** -1.5)"
"""


def read_test(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Compression in mm and load in N of one of the authors' CSV files.

    Raises
    ------
    InputError
        When its columns or numbers are not those of the authors.
    """
    lines = read_text(path, expected="a readable CSV file").splitlines()
    head = next((n for n, line in enumerate(lines) if line.startswith("Time")), None)
    names = [name.strip() for name in lines[head].split(",")] if head is not None else []
    if head is None or "Compression (mm)" not in names or "Load (N)" not in names:
        raise InputError(path, "columns", ", ".join(names) or "none", "Time (s), Compression (mm), Load (N), ...")
    try:
        rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[head + 1 :] if line.strip()])
    except ValueError as error:
        raise InputError(path, "rows", error, "numbers") from error
    if rows.ndim != 2 or rows.shape[1] != len(names) or not np.isfinite(rows).all():
        raise InputError(path, "rows", "missing or infinite numbers", f"{len(names)} finite numbers each")
    if not rows[:, names.index("Compression (mm)")].max() > 0:
        raise InputError(path, "Compression (mm)", "none above 0", "a compression")
    return rows[:, names.index("Compression (mm)")], rows[:, names.index("Load (N)")]


def spread_of(forces: np.ndarray) -> tuple[np.ndarray, float]:
    """Noise of a curve from repeated tests: what is its own in each step, N, and what is common to all steps.

    A specimen that is stiffer than the others is so by much the same factor everywhere; this factor is taken apart,
    and what is left of the differences is the noise of the steps, averaged over five neighbouring ones.

    Parameters
    ----------
    forces : ndarray, shape (tests, steps)
        N. With a single test the noise is 1 % of each force, and no factor.
    """
    mean = forces.mean(axis=0)
    if len(forces) < 2:
        return 0.01 * mean, 0.0
    relative = forces / mean
    factor = relative.mean(axis=1, keepdims=True)
    own = ((relative / factor - 1) ** 2).sum(axis=0) / (len(forces) - 1)
    smooth = [own[max(0, n - 2) : n + 3].mean() for n in range(len(own))]
    return np.sqrt(smooth) * mean, float(factor.std(ddof=1))


def make_study(tests: Sequence[Path], out: Path) -> None:
    """Write a study of the mean of several tests.

    Forces are read at 20 even displacements, up to the smallest largest one; their mean is the measurement, their
    spread between the tests its noise. Plates without friction keep the state uniaxial, where the shape of the
    cross-section does not matter: the body is a square brick of the cylinder's area. What friction would do is
    written beside the study as an effect of its own.

    Parameters
    ----------
    tests : sequence of Path
        CSV files, one for each test.
    out : Path
        Folder of the study.

    Raises
    ------
    InputError
        When a file is not one of the authors', or its loads are none of compression.
    """
    curves = [read_test(path) for path in tests]
    end = min(compression.max() for compression, _ in curves)
    at = end * np.arange(1, STEPS + 1) / STEPS
    forces = np.array([np.interp(at, compression, load) for compression, load in curves])
    mean = forces.mean(axis=0)
    if not mean.min() > 0:
        raise InputError(tests[0], "Load (N)", "a mean load of 0 or less", "loads above 0 from the first step on")
    noise, factor = spread_of(forces)
    side = float(np.sqrt(np.pi / 4) * DIAMETER)
    common = (
        f"noise: {{force_gain: {factor:.3g}}}   # between specimens; what is left is in steps.csv\n" if factor else ""
    )
    rows = [f"{n},{d:.5f},{f:.5f},{s:.3g}" for n, (d, f, s) in enumerate(zip(at, mean, noise, strict=True), 1)]
    write_text(out / "steps.csv", "\n".join(["step,displacement,force,force_noise", *rows]) + "\n")
    write_text(out / "effects" / "plate_friction.yaml", FRICTION.format(slimness=DIAMETER / HEIGHT, end=end / HEIGHT))
    write_text(
        out / "study.yaml",
        f"title: Uniaxial compression of silicone, mean of {len(forces)} tests, friction neglected\n"
        "units: {length: mm, force: N, time: s}\n"
        "control: displacement\n"
        "steps: steps.csv\n"
        f"{common}"
        f"body: {{brick: [{side:.5f}, {side:.5f}, {HEIGHT:g}], layers: [{{name: silicone}}]}}\n"
        "boundary: {base: slides, indenter: slides}\n",
    )


def main() -> int:
    """Read the arguments; returns the exit code."""
    parser = argparse.ArgumentParser(description="Make a study of uniaxial compression tests (README.md).")
    parser.add_argument("tests", type=Path, nargs="+", help="the authors' CSV files, one for each test")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the study (this one)")
    args = parser.parse_args()
    return exit_code(lambda: make_study(args.tests, args.out), parser.prog)


if __name__ == "__main__":
    sys.exit(main())
