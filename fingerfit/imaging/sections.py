"""Plane sections through volumes and through meshes of bodies in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Mesh

NAMES = ("axial", "sagittal", "coronal")
"""Sections across x, y and z: of a finger along x with its palmar side up z."""


@dataclass(frozen=True)
class Slice:
    """A slice of a volume along two of its axes.

    Parameters
    ----------
    name : str
        axial, sagittal or coronal.
    axis : int
        Axis of the picture that it is across: 0 for x.
    index : int
        Along that axis.
    position : float
        Of it in space, along the coordinate that the axis is nearest to, mm.
    limits : tuple of float
        Left, right, bottom and top border, mm.
    labels : tuple of str
        Names of the coordinates to the right and upwards.
    """

    name: str
    axis: int
    index: int
    position: float
    limits: tuple[float, float, float, float]
    labels: tuple[str, str]

    def of(self, values: np.ndarray) -> np.ndarray:
        """The slice of values of shape (..., nz, ny, nx): rows upwards, columns to the right."""
        return np.take(values, self.index, axis=-1 - self.axis)

    @property
    def title(self) -> str:
        """Name and place."""
        return f"{self.name}, {'xyz'[self.axis]} = {self.position:.1f} mm"


def slice_at(frame: Picture, axis: int, index: int) -> Slice:
    """The slice across an axis of a picture.

    Its borders are coordinates of space where the axes of the picture run along those of space (whatever their order
    and sense), and distances from the first voxel where they do not.
    """
    size = np.array(frame.values.shape[::-1])
    middle = (size - 1) / 2.0
    across = [k for k in range(3) if k != axis]
    limits: list[float] = []
    labels = []
    for k in across:
        main = int(np.argmax(np.abs(frame.direction[:, k])))
        ends = np.repeat(middle[None], 2, axis=0)
        ends[:, k] = [-0.5, size[k] - 0.5]
        if abs(frame.direction[main, k]) > 0.999:
            limits += frame.to_points(ends)[:, main].tolist()
            labels.append(f"{'xyz'[main]} in mm")
        else:
            limits += [0.0, float(size[k] * frame.spacing[k])]
            labels.append(f"along axis {k + 1} in mm")
    at = middle.copy()
    at[axis] = index
    main = int(np.argmax(np.abs(frame.direction[:, axis])))
    position = float(frame.to_points(at[None])[0, main])
    return Slice(
        NAMES[main], axis, index, position, (limits[0], limits[1], limits[2], limits[3]), (labels[0], labels[1])
    )


def slices_through(frame: Picture, point: np.ndarray, axes: tuple[int, ...] = (0, 1)) -> list[Slice]:
    """Slices through the voxel at a point in space, mm: the axial and the sagittal one where nothing else is said."""
    index = np.clip(np.rint(frame.to_index(point[None])[0]), 0, np.array(frame.values.shape[::-1]) - 1).astype(int)
    found = []
    for main in axes:
        axis = int(np.argmax(np.abs(frame.direction[main])))
        found.append(slice_at(frame, axis, int(index[axis])))
    return found


def spread_slices(frame: Picture, axis: int, low: float, high: float, count: int) -> list[Slice]:
    """At most `count` slices across an axis of the picture, evenly spread between two of its indices."""
    last = frame.values.shape[-1 - axis] - 1
    low, high = np.clip([low, high], 0, last)
    places = np.linspace(low, high, 2 * count + 1)[1::2] if count > 1 else np.array([(low + high) / 2])
    return [slice_at(frame, axis, int(n)) for n in np.unique(np.rint(places).astype(int))]


def section(mesh: Mesh, points: np.ndarray, frame: Picture, cut: Slice) -> tuple[np.ndarray, np.ndarray]:
    """Lines in which a slice cuts the surfaces of a mesh and those between its parts.

    Parameters
    ----------
    mesh : Mesh
        Its element sets are the parts; elements in several belong to the first.
    points : ndarray, shape (nodes, 3)
        Positions, mm: the reference ones or the deformed ones.
    frame : Picture
    cut : Slice

    Returns
    -------
    lines : ndarray, shape (lines, 2, 2)
        Ends to the right and upwards, as `limits`, mm.
    part : ndarray of int, shape (lines,)
        Number of the part inside, in the order of the sets.
    """
    return cut_faces(*border_triangles(mesh), points, frame, cut)


def cut_faces(
    faces: np.ndarray, part: np.ndarray, points: np.ndarray, frame: Picture, cut: Slice
) -> tuple[np.ndarray, np.ndarray]:
    """The same from triangles, shape (faces, 3), and the number of the part of each."""
    index = frame.to_index(points)
    corners = index[faces]
    height = corners[:, :, cut.axis] - cut.index
    height = np.where(height == 0, 1e-9, height)
    crossing = (height.max(axis=1) > 0) & (height.min(axis=1) < 0)
    corners, height, part = corners[crossing], height[crossing], part[crossing]
    ends = np.full((len(corners), 3, 3), np.nan)
    for k in range(3):
        a, b = height[:, k], height[:, k - 1]
        share = np.where(a * b < 0, a / np.where(a == b, 1.0, a - b), np.nan)
        ends[:, k] = corners[:, k] + share[:, None] * (corners[:, k - 1] - corners[:, k])
    order = np.argsort(np.isnan(ends[:, :, 0]), axis=1, kind="stable")[:, :2]
    found = np.take_along_axis(ends, order[..., None], axis=1)
    across = [k for k in range(3) if k != cut.axis]
    size = np.array(frame.values.shape[::-1])
    low, high = np.array(cut.limits[::2]), np.array(cut.limits[1::2])
    lines = low + (found[..., across] + 0.5) / size[across] * (high - low)
    return lines, part


_FACES = {
    4: ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}


def parts_of(mesh: Mesh) -> np.ndarray:
    """Number of the part that each element belongs to, shape (elements,); -1 for none."""
    found = np.full(mesh.element_count, -1)
    for number, members in enumerate(mesh.parts.values()):
        found[members] = number
    return found


def border_triangles(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Triangles, by corner nodes, of faces that one element has alone or shares with one of another part."""
    parts, triangles, owner, first = parts_of(mesh), [], [], 0
    for block in mesh.blocks:
        for face in _FACES[ELEMENTS[block.element].corners]:
            for k in range(1, len(face) - 1):
                # all faces of four nodes are cut from their lowest one, so that neighbours cut alike
                nodes = block.nodes[:, list(face)]
                start = nodes.argmin(axis=1)[:, None]
                chosen = np.take_along_axis(nodes, (start + np.array([0, k, k + 1])) % len(face), axis=1)
                triangles.append(chosen)
                owner.append(parts[first : first + len(block.nodes)])
        first += len(block.nodes)
    every, part = np.concatenate(triangles), np.concatenate(owner)
    _, which, times = np.unique(np.sort(every, axis=1), axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    low, high = np.full(len(times), np.iinfo(np.int64).max), np.full(len(times), -1)
    np.minimum.at(low, which, part)
    np.maximum.at(high, which, part)
    shown = (times[which] == 1) | ((low[which] != high[which]) & (part == low[which]))
    return every[shown], part[shown]
