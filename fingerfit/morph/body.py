"""The mesh of any body brought to another subject: its borders are set on those of a segmentation or a volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.bent import clipped, ease, with_straight_edges
from fingerfit.mesh.inside import sizes
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.repair import FLAT, mend, moved
from fingerfit.mesh.tetrahedra import Quality, corners, quality, radius_ratio
from fingerfit.morph.interfaces import REST, Intensities, Interface, Labels, Sight, interfaces_of, parts_of
from fingerfit.morph.register import Registration, middle_of, register
from fingerfit.morph.render import frame_around, render

KNOTS = 8
"""Control points of the registration along the longest side of the body. A choice."""
COMPARED = 30_000
"""Voxels that the registration compares, about. A choice."""
SEARCHES = 6
"""Times that borders are set on those of the subject. A choice."""
AROUND = 3
"""How far around the mesh volumes are compared, voxels. A choice."""


@dataclass(frozen=True)
class Body:
    """A subject's mesh, and how well it fits.

    Parameters
    ----------
    mesh : Mesh
        Nodes, elements and sets of the reference.
    quality : Quality
    mended, eased : int
        Nodes that were moved to mend elements, and those in the middle of edges that were moved to bend them less.
    left : mapping of str to tuple of float
        Mean, 95 % and largest distance of the nodes of each border to that of the subject, mm; None where it is not
        seen, and lies where the registration brings it.
    volumes : mapping of str to tuple of float
        Of each part in the mesh, and by the labels of the subject if there are any, mm^3.
    """

    mesh: Mesh
    quality: Quality
    mended: int
    eased: int
    left: Mapping[str, tuple[float, float, float] | None]
    volumes: Mapping[str, tuple[float, ...]]

    def __str__(self) -> str:
        lines = [str(self.quality), f"{self.mended} nodes moved to mend elements, {self.eased} to bend them less"]
        for name, left in self.left.items():
            told = "not seen, as the registration brings it"
            if left is not None:
                told = "mean {:.3f}, 95 % below {:.3f}, largest {:.3f} mm".format(*left)
            lines.append(f"{name}: {told}")
        for name, both in self.volumes.items():
            lines.append(f"{name}: {both[0]:.5g} mm^3" + "".join(f"; by labels {own:.5g} mm^3" for own in both[1:]))
        return "\n".join(lines)


def morph_body(
    mesh: Mesh,
    own: Picture,
    subject: Picture,
    settings: Registration | None = None,
    where: tuple[Path | str, Path | str] = ("reference", "subject"),
) -> Body:
    """Bring the mesh of one subject to another, by a volume of each.

    Parameters
    ----------
    mesh : Mesh
        Of tetrahedra; its parts are its element sets.
    own, subject : Picture
        Volumes of the same part of the body, of any size and place, that lie alike within some 15 degrees. The mesh
        lies in its own one.
    settings : Registration, optional
    where : tuple of Path or str
        Mesh and subject as errors name them.

    Raises
    ------
    InputError
        For meshes of other elements, volumes that cannot be registered, and a mesh that lies outside of its own volume.
    SolverError
        When bad elements cannot be mended.
    """
    _check(mesh, subject, where)
    if own.dim != 3:
        raise InputError(where[0], "own picture", f"{own.dim} dimensions", "a volume")
    body = render(_of_parts(mesh), own, dict.fromkeys(parts_of(mesh), 1.0))
    if not body.values.any():
        raise InputError(where[0], "own volume", "no voxel in the mesh", "a volume around the mesh")
    return _fitted(mesh, own, subject, settings, _around(body), Intensities(subject))


def morph_labels(
    mesh: Mesh,
    subject: Picture,
    tissues: Mapping[int, str],
    settings: Registration | None = None,
    where: tuple[Path | str, Path | str] = ("reference", "subject"),
) -> Body:
    """Bring the mesh of one subject to another, by a segmentation of the other.

    Parameters
    ----------
    mesh : Mesh
        As for `morph_body`.
    subject : Picture
        Whole numbers; labels without a name are outside of the body.
    tissues : mapping of int to str
        Element set of each label.
    settings : Registration, optional
    where : tuple of Path or str
        Mesh and subject as errors name them.

    Raises
    ------
    InputError
        As `morph_body`; for labels that no voxel has, names that are no part of the mesh, and parts without a label.
    SolverError
        When bad elements cannot be mended.
    """
    _check(mesh, subject, where)
    parts = list(parts_of(mesh))
    labels = np.rint(subject.values).astype(int)
    for label, name in tissues.items():
        if name not in parts:
            raise InputError(where[1], f"label {label}", name, "one of " + ", ".join(parts))
        if not (labels == label).any():
            raise InputError(where[1], f"label {label}", "no voxel", f"voxels of {name}")
    if missing := [name for name in parts if name not in tissues.values()]:
        lacks = "elements in no set" if missing[0] == REST else f"no label of element set {missing[0]}"
        raise InputError(where[1], "labels", lacks, "a label of each part of the mesh")
    level = {name: (number + 1) / len(parts) for number, name in enumerate(parts)}
    values = np.zeros(labels.shape)
    for label, tissue in tissues.items():
        values[labels == label] = level[tissue]
    seen = replace(subject, values=values)
    frame = frame_around(mesh, float(subject.spacing.mean()), AROUND * float(subject.spacing.mean()))
    found = _fitted(mesh, render(_of_parts(mesh), frame, level), seen, settings, None, Labels(subject, tissues))
    voxel = float(subject.spacing.prod())
    counted = {name: voxel * int((values == level[name]).sum()) for name in parts}
    return replace(found, volumes={name: (*found.volumes[name], counted[name]) for name in parts})


def _check(mesh: Mesh, subject: Picture, where: tuple[Path | str, Path | str]) -> None:
    if subject.dim != 3:
        raise InputError(where[1], "picture", f"{subject.dim} dimensions", "a volume")
    for block in mesh.blocks:
        if not block.element.startswith(("C3D4", "C3D10")):
            raise InputError(where[0], "elements", block.element, "a mesh of tetrahedra, C3D4 or C3D10")


def _of_parts(mesh: Mesh) -> Mesh:
    return replace(mesh, element_sets=parts_of(mesh))


def _settings(mesh: Mesh, frame: Picture) -> Registration:
    longest = float(np.ptp(mesh.body, axis=0).max())
    return Registration(grid=longest / KNOTS, sampling=min(1.0, COMPARED / frame.values.size))


def _around(body: Picture) -> np.ndarray:
    """Voxels of a body and some around it."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(body.values > 0, iterations=AROUND))


def _fitted(
    mesh: Mesh,
    reference: Picture,
    subject: Picture,
    settings: Registration | None,
    mask: np.ndarray | None,
    sight: Sight,
) -> Body:
    """The mesh where a registration brings it, its borders on those of the subject."""
    way = register(reference, subject, settings or _settings(mesh, reference), mask, middle_of)
    interfaces = interfaces_of(mesh)
    corner = np.unique(corners(mesh))
    nodes, registered = np.concatenate([block.nodes for block in mesh.blocks]), way(mesh.points)
    beside = registered - with_straight_edges(registered, nodes)
    found, mended = mend(mesh, registered, np.intersect1d(corner, _nodes(interfaces)))
    least = np.minimum(FLAT, 0.9 * radius_ratio(found, corners(mesh)))
    for _ in range(SEARCHES):
        seen, shift = _shift(sight, with_straight_edges(found, nodes) + beside, interfaces)
        known = np.isin(seen, corner)
        found = moved(mesh, found, seen[known], shift[known], least)
    found = with_straight_edges(found, nodes) + beside
    for _ in range(SEARCHES):
        seen, shift = _shift(sight, found, interfaces)
        between = ~np.isin(seen, corner)
        found[seen[between]] += shift[between]
        found = clipped(found, nodes)
    bent, eased = ease(replace(mesh, points=found))
    left: dict[str, tuple[float, float, float] | None] = {}
    for one in interfaces:
        far = np.linalg.norm(sight.ways(bent.points, one, _others(interfaces, one))[1], axis=1)
        left[str(one)] = (float(far.mean()), float(np.percentile(far, 95)), float(far.max())) if len(far) else None
    volume = sizes(bent)
    held = {name: (float(volume[members].sum()),) for name, members in parts_of(bent).items()}
    return Body(bent, quality(bent), len(mended), eased, left, held)


def _nodes(interfaces: list[Interface]) -> np.ndarray:
    return np.unique(np.concatenate([one.triangles for one in interfaces]))


def _others(interfaces: list[Interface], own: Interface) -> list[Interface]:
    return [one for one in interfaces if one is not own]


def _shift(sight: Sight, points: np.ndarray, interfaces: list[Interface]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes that are seen and their ways, shapes (seen,) and (seen, 3): where several borders meet, to each in turn.

    The surface of the body is the last one, so that it is not bent by parts that the subject has elsewhere.
    """
    place, seen = points.copy(), np.zeros(len(points), dtype=bool)
    for one in interfaces:
        nodes, way = sight.ways(place, one, _others(interfaces, one))
        place[nodes] += way
        seen[nodes] = True
    return np.flatnonzero(seen), (place - points)[seen]
