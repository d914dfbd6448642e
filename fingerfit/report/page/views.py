"""Slices of the volumes of a comparison, each as a comparison in the plane."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import Slice, cut_faces, slice_at, spread_slices
from fingerfit.report.page.inputs import Compare
from fingerfit.report.page.regions import patch_size

COUNTS = {0: 5, 1: 3}
"""Slices across x (axial) and y (sagittal)."""


@dataclass(frozen=True)
class View:
    """A slice.

    Parameters
    ----------
    group, title : str
        Direction of the slice; its name and place.
    compare : Compare
        What is seen in it: pictures, and of the patches that it goes through the displacements along it.
    patches : ndarray of int, shape (cells,)
        Which patches these are.
    mains : list of int
        Coordinates of space to the right and upwards.
    lines : list of list of (int, list)
        By picture: part of the deformed mesh, and the lines in which the slice cuts its border.
    """

    group: str
    title: str
    compare: Compare
    patches: np.ndarray
    mains: list[int]
    lines: list[list[tuple[int, list[Any]]]]


def cuts_of(compare: Compare) -> list[Slice]:
    """Slices through the body, axial ones first; none where pictures are plane."""
    if not compare.volumes:
        return []
    frame = _frame(compare)
    index = np.array([[0.0] * 3, [n - 1.0 for n in frame.values.shape[::-1]]])
    if len(compare.mesh_faces):
        # nodes of rigid tools, which no face has, may lie far away
        index = frame.to_index(compare.mesh_points[np.unique(compare.mesh_faces)])
    found = []
    for main, count in COUNTS.items():
        axis = int(np.argmax(np.abs(frame.direction[main])))
        found += spread_slices(frame, axis, index[:, axis].min(), index[:, axis].max(), count)
    return found


def cuts_at(compare: Compare, x: np.ndarray) -> list[Slice]:
    """Axial slices at places along x, mm, each once."""
    frame, found = _frame(compare), []
    middle = compare.patch_centre.mean(axis=0)
    axis = int(np.argmax(np.abs(frame.direction[0])))
    for place in np.unique(x):
        index = float(frame.to_index(np.array([[place, *middle[1:]]]))[0, axis])
        found.append(slice_at(frame, axis, int(np.clip(np.rint(index), 0, frame.values.shape[-1 - axis] - 1))))
    return found


def views_of(compare: Compare, cuts: list[Slice]) -> list[View]:
    """What is seen in slices."""
    return [_view(compare, _frame(compare), cut) for cut in cuts]


def _frame(compare: Compare) -> Picture:
    return Picture(compare.measured[0], compare.spacing, compare.origin, compare.direction)


def _view(compare: Compare, frame: Picture, cut: Slice) -> View:
    across = [k for k in range(3) if k != cut.axis]
    mains = [int(np.argmax(np.abs(frame.direction[:, k]))) for k in across]
    left, right, bottom, top = cut.limits
    turn = (slice(None), slice(None, None, -1 if top < bottom else 1), slice(None, None, -1 if right < left else 1))
    spacing = compare.spacing[across]
    origin = np.array([min(left, right), min(bottom, top)]) + spacing / 2
    patches, plane = _patches(compare, cut, mains)
    lines = []
    for n in range(compare.pictures):
        segments, part = _lines(compare, compare.mesh_moved[n] if len(compare.mesh_moved) else None, frame, cut)
        lines.append(
            [(int(number), np.round(segments[part == number], 2).tolist()) for number in np.unique(part)]
        )  # fmt: skip
    flat = replace(
        compare,
        measured=cut.of(compare.measured)[turn],
        synthesized=cut.of(compare.synthesized)[turn],
        spacing=spacing,
        origin=origin,
        mesh_points=np.zeros((0, 2)),
        mesh_moved=np.zeros((0, 0, 2)),
        edges=_lines(compare, compare.mesh_points, frame, cut)[0],
        axes=cut.labels,
        **plane,
    )
    return View(cut.name, cut.title, flat, patches, mains, lines)


def _patches(compare: Compare, cut: Slice, mains: list[int]) -> tuple[np.ndarray, dict[str, Any]]:
    """Patches that a slice goes through, and what a comparison in the plane knows of them."""
    if not compare.mapped:
        nothing = np.zeros((0, 0, 2))
        empty = {
            "residual_displacement": nothing,
            "residual_displacement_noise": nothing,
            "patch_centre": np.zeros((0, 2)),
            "patch_layer": np.zeros(0, int),
        }
        return np.zeros(0, int), {**empty, "patch_count": np.zeros(2, int)}
    main = ({0, 1, 2} - set(mains)).pop()
    count, size = compare.patch_count.astype(int), patch_size(compare)
    low = compare.patch_centre.min(axis=0) - size / 2
    own = int(np.clip((cut.position - low[main]) // size[main], 0, count[main] - 1))
    grid = np.arange(len(compare.patch_centre)).reshape(count)
    cells = np.take(grid, own, axis=main)
    patches = (cells if mains[0] < mains[1] else cells.T).ravel()
    noise = (
        compare.residual_displacement_noise[:, patches][..., mains]
        if compare.residual_displacement_noise.shape == compare.residual_displacement.shape
        else None
    )
    return patches, {
        "residual_displacement": compare.residual_displacement[:, patches][..., mains],
        "residual_displacement_noise": np.zeros((0, 0, 2)) if noise is None else noise,
        "patch_centre": compare.patch_centre[patches][:, mains],
        "patch_count": count[mains],
        "patch_layer": compare.patch_layer[patches] if len(compare.patch_layer) else np.zeros(0, int),
    }


def _lines(compare: Compare, points: np.ndarray | None, frame: Picture, cut: Slice) -> tuple[np.ndarray, np.ndarray]:
    if points is None or not len(compare.mesh_faces):
        return np.zeros((0, 2, 2)), np.zeros(0, int)
    return cut_faces(compare.mesh_faces, compare.mesh_face_part, points, frame, cut)
