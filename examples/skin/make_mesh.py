"""Meshes of the skin between two glued pads (Elouneg and others), of the lengths in the authors' .geo file.

    python examples/skin/make_mesh.py healthy_skin/healthy_skin.geo --out skin

The pads lie along the last axis of the study's frame, the one of the moving pad, which is pulled downwards, below:
the direction in which indenters push. The measured x runs along it, and the measured y to the left.
"""

from __future__ import annotations

import argparse
import re
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np

from fingerfit.cli import exit_code
from fingerfit.core.errors import InputError
from fingerfit.core.files import read_text, write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.mesh import Block, Mesh

MARK = 2.0
"""How far inside the moving pad's inner edge the authors put the mark that positions count from, mm."""
FINE, COARSE = 1.4, 5.0
"""Elements between and around the pads and at the border, mm; those of the finer mesh are `FINER` times as small."""
FINER = 0.6
NAMES = ("L0", "H0", "L", "H", "l_pad", "h_pad", "dL_pad")


def read_numbers(path: Path) -> dict[str, float]:
    """Lengths in mm of the authors' .geo file: body, pads, distance between the pads.

    Raises
    ------
    InputError
        When one of them is missing.
    """
    text = read_text(path)
    found = {m[1]: float(m[2]) for m in re.finditer(r"^\s*(\w+)\s*=\s*([\d.]+)\s*;", text, re.MULTILINE)}
    missing = [name for name in NAMES if name not in found]
    if missing:
        raise InputError(path, "lengths", f"no {', '.join(missing)}", "lines such as dL_pad = 32.0;")
    return {name: found[name] for name in NAMES}


def lines(edges: list[float], fine: float, coarse: float) -> np.ndarray:
    """Positions of mesh lines through given ones: `fine` between the inner ones, growing to `coarse` at both ends."""
    inner = edges[1:-1]
    found = [inner[0]]
    for a, b in pairwise(inner):
        found += list(np.linspace(a, b, max(1, round((b - a) / fine)) + 1)[1:])
    for end, sign in ((edges[0], -1.0), (edges[-1], 1.0)):
        start = inner[0] if sign < 0 else inner[-1]
        sizes = [fine]
        while sum(sizes) < abs(end - start):
            sizes.append(min(1.3 * sizes[-1], coarse))
        outer = start + sign * np.cumsum(sizes) * abs(end - start) / sum(sizes)
        found = [*outer[::-1], *found] if sign < 0 else [*found, *outer]
    return np.array(found)


def membrane(numbers: dict[str, float], fine: float, coarse: float) -> Mesh:
    """Membrane with a hole for each pad, of CPS4.

    Parameters
    ----------
    numbers : dict
        As `read_numbers` gives them.
    fine, coarse : float
        Sizes of elements, mm.

    Returns
    -------
    Mesh
        In the study's frame, with the mark on the moving pad at the origin. Node sets ``TOP``, the edge of the moving
        pad, ``BOTTOM``, that of the fixed one, and ``BORDER``; element set ``SKIN``.
    """
    n = numbers
    half, apart = n["h_pad"] / 2, n["dL_pad"]
    moving, fixed = (MARK - n["l_pad"], MARK), (MARK + apart, MARK + apart + n["l_pad"])
    middle = MARK + apart / 2
    x = lines([-n["H"] / 2, -half, half, n["H"] / 2], fine, coarse)
    y = lines([middle - n["L"] / 2, *moving, *fixed, middle + n["L"] / 2], fine, coarse)
    grid = np.arange(len(x) * len(y)).reshape(len(y), len(x))
    points = np.stack([np.tile(x, len(y)), np.repeat(y, len(x))], axis=1)
    quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1).reshape(-1, 4)
    centre = points[quads].mean(axis=1)

    def within(places: np.ndarray, pad: tuple[float, float], edge: float) -> np.ndarray:
        beside = np.abs(places[:, 0]) < half + edge
        return np.asarray(beside & (places[:, 1] > pad[0] - edge) & (places[:, 1] < pad[1] + edge))

    quads = quads[~within(centre, moving, 0.0) & ~within(centre, fixed, 0.0)]
    used = np.unique(quads)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    points = points[used]
    low, high = points.min(axis=0), points.max(axis=0)
    sets = {
        "TOP": np.flatnonzero(within(points, moving, 1e-6)),
        "BOTTOM": np.flatnonzero(within(points, fixed, 1e-6)),
        "BORDER": np.flatnonzero(((points < low + 1e-6) | (points > high - 1e-6)).any(axis=1)),
    }
    return Mesh(points, (Block("CPS4", number[quads]),), sets, {"SKIN": np.arange(len(quads))})


def make_mesh(geometry: Path, out: Path) -> None:
    """Write ``membrane.inp`` and the finer ``membrane_fine.inp``.

    Raises
    ------
    InputError
        When the file is missing or something else.
    """
    numbers = read_numbers(geometry)
    for name, share in (("membrane", 1.0), ("membrane_fine", FINER)):
        write_text(out / f"{name}.inp", format_mesh(membrane(numbers, share * FINE, share * COARSE)))


def main() -> int:
    """Read the arguments; returns the exit code."""
    parser = argparse.ArgumentParser(description="Make the meshes of skin stretched between two pads (README.md).")
    parser.add_argument("geometry", type=Path, help="the authors' healthy_skin.geo")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the study (this one)")
    args = parser.parse_args()
    return exit_code(lambda: make_mesh(args.geometry, args.out), parser.prog)


if __name__ == "__main__":
    sys.exit(main())
