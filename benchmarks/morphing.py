"""The reference finger brought to the shape of twenty others, from their volumes alone.

    python benchmarks/morphing.py

writes benchmarks/morphing.md. Each finger has numbers of its own, is turned, shifted and longer than the reference,
with texture and Rician noise in its volume; its mesh, from which the volume is made, is the truth.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from running import ROOT, machine
from scipy.ndimage import gaussian_filter

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.shape import Anatomy
from fingerfit.imaging.noise import add_rician
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.tetrahedra import corners, faces_on, outer_faces
from fingerfit.morph.distance import surface_distance
from fingerfit.morph.morph import morph
from fingerfit.morph.render import frame_around, render

VOXEL = 0.234
"""mm."""
TRUE = 1.0
"""Size of the measured fingers' linear tetrahedra."""
LONGER = 5.0
"""How much of each finger lies beyond the reference's end section, mm."""
INTENSITY = {"EPIDERMIS": 0.5, "SUBCUTANEOUS": 0.85, "DISTAL": 0.6, "MIDDLE": 0.6, "NAIL": 0.1}
"""Not those of the rendered reference."""
SPREAD = {
    "width": 0.10, "palmar": 0.10, "dorsal": 0.07, "tip": 0.12, "bone_width": 0.10, "bone_height": 0.08,
    "bone_cover": 0.12, "nail_length": 0.12, "joint": 0.05, "epidermis": 0.18,
}  # fmt: skip
"""Standard deviations, relative to the reference's numbers; cut off at twice."""

COLUMNS = (
    "finger", "skin before", "after: mean", "95 %", "largest", "bones before", "after: mean", "95 %",
    "epidermis, true", "found", "inverted", "poor", "mended nodes", "s",
)  # fmt: skip
HEAD = f"""# Morphing

Made by `python benchmarks/morphing.py`; do not edit. The reference finger ({{elements}}, {{nodes}} nodes) is
brought to {{count}} others from their volumes (voxels of {{voxel}} mm, texture of 10 %, Rician noise of 3 %, other
contrast than the reference's), each with numbers of its own (standard deviations of 5 to 18 %), turned by up to 8
degrees and shifted by up to 3 mm. Distances in mm from the nodes of the mesh to the true surface: of the rigidly moved
reference, that is with the true turn and shift, and of the morphed mesh. *Poor* is the smallest radius ratio of an
element (1 is regular).

Measured on {{machine}}; one thread, beside other work.

| {" | ".join(COLUMNS)} |
{"|---" * len(COLUMNS)}|
"""


def other(seed: int) -> tuple[Anatomy, np.ndarray, np.ndarray]:
    """Numbers of a finger, how it is turned (matrix) and shifted (mm)."""
    rng = np.random.default_rng([5, seed])
    own = Anatomy()
    factors = {name: 1 + s * np.clip(rng.normal(), -2, 2) for name, s in SPREAD.items()}
    numbers = {name: float(getattr(own, name) * factor) for name, factor in factors.items()}
    numbers["taper"] = float(rng.uniform(0.02, 0.2))
    numbers["slope"] = float(rng.uniform(0.08, 0.18))
    numbers["pulp"] = float(rng.uniform(0.05, 0.2))
    numbers["length"] = own.length + LONGER + float(rng.normal())
    angle = np.radians(rng.uniform(-8, 8, 3))
    turn = np.eye(3)
    for axis, value in enumerate(angle):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[[i, i, j, j], [i, j, i, j]] = np.cos(value), -np.sin(value), np.sin(value), np.cos(value)
        turn = step @ turn
    return Anatomy(**numbers), turn, rng.uniform(-3, 3, 3)


def volume(mesh: Mesh, seed: int) -> Picture:
    """What a scanner would show of a finger."""
    rng = np.random.default_rng([6, seed])
    clean = render(mesh, frame_around(mesh, VOXEL, 3.0), INTENSITY)
    texture = gaussian_filter(rng.normal(size=clean.values.shape), 2)
    return replace(clean, values=add_rician(clean.values * (1 + 0.1 * texture / texture.std()), 0.03, rng))


def bone_faces(mesh: Mesh) -> np.ndarray:
    """Corners of the bones' surface, shape (triangles, 3, 3)."""
    bone = Mesh(mesh.points, (Block("C3D4", corners(mesh)[mesh.element_sets["BONE"]]),))
    return mesh.points[faces_on(bone, outer_faces(bone))]


def measure(reference: Mesh, seed: int) -> tuple[str, list[float]]:
    """A row of the table, and of its numbers those that are averaged."""
    anatomy, turn, shift = other(seed)
    true = finger_mesh(anatomy, TRUE, "C3D4")
    true = replace(true, points=true.points @ turn.T + shift)
    seen = volume(true, seed)
    begin = time.perf_counter()
    found = morph(reference, seen)
    seconds = time.perf_counter() - begin
    tip = np.array([anatomy.length - Anatomy().length, 0.0, 0.0])
    rigid = replace(reference, points=(reference.points + tip) @ turn.T + shift)
    row = [*_distances(rigid, true)[:1], *_distances(found.mesh, true)[:3]]
    row += [_distances(rigid, true)[3], *_distances(found.mesh, true)[3:]]
    row += [anatomy.epidermis, found.thickness["mean"]]
    cells = [f"{seed}", *(f"{x:.3f}" for x in row), f"{found.quality.inverted}", f"{found.quality.ratio[0]:.3f}"]
    text = " | ".join([*cells, f"{len(found.mended)}", f"{seconds:.0f}"])
    return f"| {text} |", [*row, float(found.quality.inverted), seconds]


def _distances(mesh: Mesh, true: Mesh) -> list[float]:
    """Mean, 95th percentile and largest distance of the skin, mean and 95th percentile of the bones'."""
    nodes = np.setdiff1d(np.unique(faces_on(mesh, mesh.surfaces["SKIN"])), mesh.node_sets["END"])
    skin = surface_distance(mesh.points[nodes], true.points[faces_on(true, true.surfaces["SKIN"])])
    nodes = np.setdiff1d(mesh.node_sets["BONE_SURFACE"], mesh.node_sets["END"])
    bone = surface_distance(mesh.points[nodes], bone_faces(true))
    return [skin.mean(), float(np.percentile(skin, 95)), skin.max(), bone.mean(), float(np.percentile(bone, 95))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/morphing.md")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--element", default="C3D10H")
    parser.add_argument("--size", type=float, default=3.0)
    args = parser.parse_args()
    reference = finger_mesh(size=args.size, element=args.element)
    numbers = {"elements": f"{reference.element_count} {args.element}", "nodes": len(reference.points), "voxel": VOXEL}
    lines, rows = [HEAD.format(**numbers, count=args.count, machine=machine())], []
    for seed in range(1, args.count + 1):
        text, row = measure(reference, seed)
        rows.append(row)
        lines.append(text + "\n")
        print(text, flush=True)
        mean = np.mean(rows, axis=0)
        wrong = [abs(r[8] / r[7] - 1) for r in rows]
        close = (
            f"\nMean over all: skin {mean[0]:.3f} before, {mean[1]:.3f} mm after (largest mean of a finger"
            f" {max(r[1] for r in rows):.3f}); bones {mean[4]:.3f} before, {mean[5]:.3f} mm after; epidermis wrong by"
            f" {100 * np.mean(wrong):.1f} %, at most {100 * max(wrong):.1f} %; inverted elements"
            f" {sum(r[9] for r in rows):.0f}; {mean[10]:.0f} s.\n"
        )
        args.out.write_text("".join(lines) + close, encoding="utf-8")


if __name__ == "__main__":
    main()
