"""From a file of a segmentation to a file of a mesh."""

from __future__ import annotations

import math
from pathlib import Path

from fingerfit.core.errors import InputError, Problems
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.check import faults_of_mesh
from fingerfit.mesh.inside import sizes
from fingerfit.mesh.mesh import Mesh
from fingerfit.segment.labels import read_labels, read_names
from fingerfit.segment.mesher import mesh_labels


def write_mesh(
    segmentation: Path,
    out: Path,
    size: float,
    labels: dict[int, str] | None = None,
    holes: dict[int, str] | None = None,
    base: str | None = None,
    indenter: str | None = None,
    element: str = "",
    grading: float = 0.3,
) -> str:
    """Mesh a segmentation with the node sets BOTTOM and TOP; returns what was made, for a person.

    Parameters
    ----------
    segmentation, out : Path
        ``out`` ends in .inp.
    size : float
        Of elements at borders, mm.
    labels : dict, optional
        Element set of each label; when left out the names of 3D Slicer, or ``LABEL_1`` and so on.
    holes : dict, optional
        Labels that are left out; the nodes on their border become a node set.
    base, indenter : str, optional
        Sides of the body, as ``z-``; the ends of the last axis when left out. A hole of the name BOTTOM or TOP is in
        their place.
    element, grading
        As for `fingerfit.segment.mesher.mesh_labels`.

    Raises
    ------
    FingerfitError
        For what is no segmentation, wrong names or sizes, and a body that cannot be meshed.
    """
    if out.suffix.lower() != ".inp":
        raise InputError("--out", "name", out, "one that ends in .inp")
    if not (math.isfinite(size) and size > 0):
        raise InputError("--size", "size", f"{size:g}", "a number above 0, mm")
    if not 0 < grading <= 1:
        raise InputError("--grading", "grading", f"{grading:g}", "above 0, and at most 1")
    holes = holes or {}
    picture = read_labels(segmentation)
    there = sorted({int(label) for label in set(picture.values.ravel().tolist())} - {0, *holes})
    names = labels or {label: read_names(segmentation).get(label, f"LABEL_{label}") for label in there}
    last = "xyz"[picture.dim - 1]
    sides = {"BOTTOM": base or f"{last}-", "TOP": indenter or f"{last}+"}
    sides = {name: side for name, side in sides.items() if name not in holes.values()}
    mesh = mesh_labels(picture, size, names, holes, element.upper(), grading, sides, segmentation)
    tried = Mesh(mesh.points, mesh.blocks, {**mesh.node_sets, "INDENTER": mesh.node_sets["TOP"][:1]}, mesh.element_sets)
    if faults := faults_of_mesh(tried, dict(mesh.element_sets), segmentation):
        raise Problems(faults)
    write_text(out, format_mesh(mesh))
    measure, unit = sizes(mesh), "mm^2" if mesh.dim == 2 else "mm^3"
    own = float(picture.spacing.prod())
    lines = [f"{out}: {len(mesh.points)} nodes, {mesh.element_count} {mesh.blocks[0].element}"]
    for label, name in names.items():
        members = mesh.element_sets[name]
        pixels = own * int((picture.values == label).sum())
        lines.append(
            f"{name}: {len(members)} elements, {measure[members].sum():.5g} {unit}; label {label} {pixels:.5g} {unit}"
        )
    lines += [f"node set {name}: {len(nodes)} nodes" for name, nodes in mesh.node_sets.items()]
    return "\n".join(lines)
