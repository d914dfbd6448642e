"""Warping and scoring of volumes on one core, beside the way that tries every pixel of the box around each element.

    python benchmarks/warp.py

writes benchmarks/warp.md. The reference finger, and bricks of 40 x 18 x 16 mm, bent, twisted and dented.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from running import ROOT, machine

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.forward.predict import MARGIN
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.similarity import nmi
from fingerfit.imaging.warp import _search, _winners, backward_map, spline_coefficients, warp
from fingerfit.mesh.blocks import brick
from fingerfit.mesh.mesh import Mesh

SIZE = (40.0, 18.0, 16.0)
WHOLE, HALF = (256, 128, 128), (128, 64, 64)
CASES = (
    ("finger C3D4", (), WHOLE),
    ("finger C3D10 3", (), WHOLE),
    ("finger C3D10", (), WHOLE),
    ("C3D4", (36, 18, 9), WHOLE),
    ("C3D10", (18, 9, 5), WHOLE),
    ("C3D10", (36, 18, 9), WHOLE),
    ("C3D4", (36, 18, 9), HALF),
    ("C3D10", (18, 9, 5), HALF),
)
"""The reference finger (and the size of its elements) or the element type of a brick; elements along its axes before
the cut into six; voxels."""
HEAD = """# Warping a volume

Made by `make benchmark-warp`; do not edit. Processor seconds on one core, the best of five: *map* finds where each
voxel comes from, up to {margin} voxels around the body; *warp* reads the volume before compression there through cubic
B-splines and smooths (Gaussian, 1 voxel); SSD and NMI (32 bins) compare the whole volume. *Whole* is map, warp and SSD.
*Search* is the way for elements of any type, which tries every voxel of the box around each element, where its memory
allows; *difference* is the largest one between the two of where a voxel inside the body comes from, in voxels. Volumes
are 1.4 times as wide as the body, along each axis; a brick fills more of that than the finger.

Measured on {machine}.

| voxels | elements | nodes | voxels of the body | map | warp | SSD | NMI | whole | search | ratio | difference |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def best(run: Callable[[], Any], times: int) -> tuple[float, Any]:
    """Shortest processor time, s, and the answer."""
    found, shortest = None, np.inf
    for _ in range(times):
        start = time.process_time()
        found = run()
        shortest = min(shortest, time.process_time() - start)
    return shortest, found


def displacement(points: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Bending, twisting and a dent, mm, of a body with its lower corner at 0."""
    x, y, z = points.T
    aside = ((x - 0.5 * size[0]) ** 2 + (y - 0.5 * size[1]) ** 2) / 30
    return np.stack([0.4 * np.sin(y / 5), 0.3 * np.sin(z / 4 + x / 6), -2.0 * z / size[2] * np.exp(-aside)], axis=1)


def search(mesh: Mesh, u: np.ndarray, frame: Picture) -> Any:
    """The map by trying every voxel of all boxes."""
    (block,) = mesh.blocks
    nodes = [frame.to_index(points)[block.nodes] for points in (mesh.points + u, mesh.points)]
    claims = _search(block.element, *nodes, np.array(frame.values.shape[::-1]), 0.0)
    return _winners(claims, frame.values.shape, 0)


def measure(kind: str, cells: tuple[int, int, int], voxels: tuple[int, int, int]) -> str:
    """A row of the table."""
    if cells:
        mesh = brick(SIZE, cells, element=kind)
    else:
        _, element, *size_of = kind.split()
        mesh = finger_mesh(element=element, size=float(size_of[0] if size_of else 1))
    low, size = mesh.points.min(axis=0), np.ptp(mesh.points, axis=0)
    u = displacement(mesh.points - low, size)
    spacing = 1.4 * size / voxels
    frame = Picture(np.zeros(voxels[::-1]), spacing, low - 0.2 * size + spacing / 2, np.eye(3))
    values = np.random.default_rng(1).uniform(size=voxels[::-1]).astype(np.float32)
    coefficients = spline_coefficients(values).astype(np.float32)
    found, way = best(lambda: backward_map(mesh, u, frame, MARGIN), 5)
    warped, picture = best(lambda: warp(coefficients, 0.0, way, 1.0), 5)
    squared = best(lambda: float(np.mean((picture - values) ** 2)), 5)[0]
    scores = [squared, best(lambda: nmi(picture, values, 32, limits=(0.0, 1.0)), 5)[0]]
    whole = found + warped + scores[0]
    other, ratio, difference = "", "", ""
    if max(voxels) <= 128:
        inside, exact = best(lambda: backward_map(mesh, u, frame), 5)
        seconds, there = best(lambda: search(mesh, u, frame), 1)
        assert np.array_equal(exact.pixel, there.pixel)
        other, ratio = f"{seconds:.1f}", f"{seconds / inside:.0f}"
        difference = f"{np.abs(exact.index - there.index).max():.0e}"
    grid = " x ".join(map(str, voxels))
    numbers = " | ".join(f"{value:.2f}" for value in (found, warped))
    scored = " | ".join(f"{value:.3f}" for value in scores)
    return (
        f"| {grid} | {mesh.element_count} {kind} | {len(mesh.points)} | {len(way.pixel)} | {numbers} | {scored} |"
        f" {whole:.2f} | {other} | {ratio} | {difference} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/warp.md")
    args = parser.parse_args()
    rows = []
    for case in CASES:
        rows.append(measure(*case))
        args.out.write_text(HEAD.format(margin=MARGIN, machine=machine()) + "\n".join(rows) + "\n")
        print(rows[-1], flush=True)


if __name__ == "__main__":
    main()
