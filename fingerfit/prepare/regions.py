"""Regions of a study as element sets of its mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.mesh.inside import points_inside, sizes
from fingerfit.mesh.mesh import Mesh
from fingerfit.segment.labels import read_labels
from fingerfit.study.regions import area, inside
from fingerfit.study.study import Region, Study


def with_regions(study: Study, mesh: Mesh) -> Mesh:
    """The mesh with a set for each region: the elements of which at least half lies in it.

    Raises
    ------
    InputError
        For a region of which the mesh has no element, regions that share elements, and labels that are none or do not
        fit to the body or its pictures.
    """
    if not study.body.regions:
        return mesh
    read, look = cache(read_labels), cache(read_picture)  # several regions may be in one picture
    samples = points_inside(mesh)
    owner = np.repeat(np.arange(len(samples)), [len(one) for one in samples])
    points = np.concatenate(samples)
    found, taken = dict(mesh.element_sets), dict[int, str]()
    for number, region in enumerate(study.body.regions):
        field = f"body.regions.{number}"
        if region.elements:
            members = _own_set(mesh, region, study, field)
        else:
            if region.labels:
                held = _labelled(study, region, points, field, read, look)
            else:
                held = _outlined(study, region, points, field)
            members = np.flatnonzero(np.bincount(owner, held) >= np.bincount(owner) / 2)
            if not len(members):
                part = f"less than half of every element, {held.sum()} of {len(held)} sample points"
                what = "nothing of the body" if not held.any() else part
                raise InputError(
                    study.path, field, f"{region.name} holds {what}", "one element or more, or a finer mesh"
                )
        for other in {taken[element] for element in members.tolist() if element in taken}:
            shared = sum(taken.get(element) == other for element in members.tolist())
            expected = "regions that share no element"
            raise InputError(study.path, field, f"{region.name} and {other} on {shared} elements", expected)
        taken |= dict.fromkeys(members.tolist(), region.name)
        found[region.name.upper()] = members
    return replace(mesh, element_sets=found)


def region_lines(study: Study, meshes: Sequence[Mesh]) -> list[str]:
    """How much of the body each region is on each mesh, and by its outline."""
    unit, lines = "mm^2" if meshes[0].dim == 2 else "mm^3", []
    for region in study.body.regions:
        sets = [(mesh, mesh.element_sets[region.name.upper()]) for mesh in meshes]
        there = [f"{len(members)} elements of {sizes(mesh)[members].sum():.4g} {unit}" for mesh, members in sets]
        own = f"; its outline has {area(region.outline):.4g} mm^2" if region.outline else ""
        lines.append(f"region {region.name}: {', on the finer mesh '.join(there)}{own}")
    return lines


def _own_set(mesh: Mesh, region: Region, study: Study, field: str) -> np.ndarray:
    sets = {name.upper(): members for name, members in mesh.element_sets.items()}
    members = sets.get(str(region.elements).upper(), np.zeros(0, int))
    if not len(members):
        expected = "a set with elements, one of " + ", ".join(sorted(sets))
        raise InputError(study.path, f"{field}.elements", region.elements, expected)
    return members


def _outlined(study: Study, region: Region, points: np.ndarray, field: str) -> np.ndarray:
    if points.shape[1] == 3:
        raise InputError(study.path, f"{field}.outline", "a body in space", "labels or elements; outlines are plane")
    return inside(region.outline, points)


def _labelled(
    study: Study,
    region: Region,
    points: np.ndarray,
    field: str,
    read: Callable[[Path], Picture],
    look: Callable[[Path], Picture],
) -> np.ndarray:
    """Which points have the label of a region, those of the nearest pixel; by readers of labels and of pictures."""
    assert region.labels is not None
    labels = read(region.labels)
    if labels.dim != points.shape[1]:
        expected = f"{points.shape[1]}, as of the body"
        raise InputError(region.labels, "dimensions", labels.dim, expected)
    if study.before is not None and (other := labels.difference(look(study.before))):
        raise InputError(region.labels, "labels", other, f"the pixels of {study.before.name}")
    there = np.unique(labels.values).astype(int)
    if region.label not in there:
        expected = "one of " + ", ".join(map(str, there[there != 0][:20])) if there.any() else "a label above 0"
        raise InputError(study.path, f"{field}.label", f"{region.label}, which no pixel has", expected)
    index = np.rint(labels.to_index(points)).astype(int)
    shape = np.array(labels.values.shape[::-1])
    there_is = ((index >= 0) & (index < shape)).all(axis=1)
    index = np.clip(index, 0, shape - 1)
    return there_is & (labels.values[tuple(index.T[::-1])] == region.label)
