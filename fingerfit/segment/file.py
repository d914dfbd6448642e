"""From a file of a segmentation, or of outlines, to a file of a mesh."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError, Problems
from fingerfit.core.files import write_text
from fingerfit.core.keys import read_yaml
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.check import faults_of_mesh
from fingerfit.mesh.inside import sizes
from fingerfit.mesh.mesh import Mesh
from fingerfit.segment.labels import read_labels, read_names
from fingerfit.segment.mesher import mesh_labels
from fingerfit.segment.outlines import SIDES, mesh_shapes, read_shapes, shapes_of
from fingerfit.study.reader import load_study


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
    """Mesh a segmentation or outlines with the node sets BOTTOM and TOP; returns what was made, for a person.

    Parameters
    ----------
    segmentation, out : Path
        A picture of labels, or a YAML file: of outlines, or the study of a body in the plane. ``out`` ends in .inp.
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
    ends = (base, indenter, element.upper(), grading)
    labelled: dict[str, str] = {}
    if segmentation.suffix.lower() in (".yaml", ".yml"):
        for option, given in (("--labels", labels), ("--holes", holes)):
            if given:
                raise InputError(option, "option", "names of labels", f"none: {segmentation.name} has names")
        mesh = _outlined(segmentation, size, *ends)
    else:
        mesh, labelled = _segmented(segmentation, size, labels, holes or {}, *ends)
    tried = Mesh(mesh.points, mesh.blocks, {**mesh.node_sets, "INDENTER": mesh.node_sets["TOP"][:1]}, mesh.element_sets)
    if faults := faults_of_mesh(tried, {name: mesh.element_sets[name] for name in labelled}, segmentation):
        raise Problems(faults)
    write_text(out, format_mesh(mesh))
    measure, unit = sizes(mesh), "mm^2" if mesh.dim == 2 else "mm^3"
    lines = [f"{out}: {len(mesh.points)} nodes, {mesh.element_count} {mesh.blocks[0].element}"]
    for name, members in mesh.element_sets.items():
        told = f"; {labelled[name]} {unit}" if name in labelled else ""
        lines.append(f"{name}: {len(members)} elements, {measure[members].sum():.5g} {unit}{told}")
    lines += [f"node set {name}: {len(nodes)} nodes" for name, nodes in mesh.node_sets.items()]
    return "\n".join(lines)


def _segmented(
    path: Path,
    size: float,
    labels: dict[int, str] | None,
    holes: dict[int, str],
    base: str | None,
    indenter: str | None,
    element: str,
    grading: float,
) -> tuple[Mesh, dict[str, str]]:
    """The mesh, and label and size by pixels of each of its element sets."""
    picture = read_labels(path)
    there = sorted({int(label) for label in set(picture.values.ravel().tolist())} - {0, *holes})
    names = labels or {label: read_names(path).get(label, f"LABEL_{label}") for label in there}
    last = "xyz"[picture.dim - 1]
    sides = {"BOTTOM": base or f"{last}-", "TOP": indenter or f"{last}+"}
    sides = {name: side for name, side in sides.items() if name not in holes.values()}
    mesh = mesh_labels(picture, size, names, holes, element, grading, sides, path)
    pixel = float(picture.spacing.prod())
    told: dict[str, str] = {}
    for name in mesh.element_sets:
        own = [label for label, other in names.items() if other == name]
        listed = ", ".join(map(str, own))
        told[name] = f"label {listed} {pixel * int(np.isin(picture.values, own).sum()):.5g}"
    return mesh, told


def _outlined(path: Path, size: float, base: str | None, indenter: str | None, element: str, grading: float) -> Mesh:
    given = read_yaml(path)
    study = isinstance(given, dict) and "body" in given
    sides = {**SIDES, "BOTTOM": base or SIDES["BOTTOM"], "TOP": indenter or SIDES["TOP"]}
    taken = (sides["BOTTOM"], sides["TOP"])
    sides = {name: side for name, side in sides.items() if name in ("BOTTOM", "TOP") or side not in taken}
    shapes = shapes_of(load_study(path)) if study else read_shapes(path)
    return mesh_shapes(shapes, size, element, grading, sides, path)
