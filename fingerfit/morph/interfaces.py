"""Borders between the parts of a mesh, and how far those of a subject are from them: by labels, or in a volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import ndimage

from fingerfit.anatomy.surface import vertex_normals
from fingerfit.fem.facets import cut_faces
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.faces import Faces, faces_of
from fingerfit.mesh.mesh import Mesh
from fingerfit.morph.distance import surface_distance
from fingerfit.morph.edges import CLEAR, Profiles, averages, find_border
from fingerfit.segment.borders import to_zero
from fingerfit.segment.labels import depth_in

OUTSIDE = "outside"
REST = "REST"
"""Elements that are in no set."""
REACH = 3.0
"""Farthest way to a border of the subject at once, voxels. A choice."""
SMOOTH = 3.0
"""Length over which neighbours decide together about a border in a volume, voxels. A choice."""


@dataclass(frozen=True)
class Interface:
    """Border between two parts of a mesh, or of one with what is outside.

    Parameters
    ----------
    inner, outer : str
        Names of the parts.
    triangles : ndarray of int, shape (triangles, 3)
        Nodes, anticlockwise as seen from the outer part.
    """

    inner: str
    outer: str
    triangles: np.ndarray

    @property
    def nodes(self) -> np.ndarray:
        """All nodes of the border, shape (nodes,)."""
        return np.unique(self.triangles)

    def __str__(self) -> str:
        return f"{self.inner} to {self.outer}"


def parts_of(mesh: Mesh) -> dict[str, np.ndarray]:
    """Elements of each part: the smallest set that each is in, and those of no set."""
    parts = mesh.parts
    rest = np.setdiff1d(np.arange(mesh.element_count), np.concatenate([np.zeros(0, int), *parts.values()]))
    return {**parts, **({REST: rest} if len(rest) else {})}


def interfaces_of(mesh: Mesh) -> list[Interface]:
    """Borders between the parts of a mesh of tetrahedra, then those of each with what is outside."""
    parts = parts_of(mesh)
    part = np.full(mesh.element_count, -1)
    for number, members in enumerate(parts.values()):
        part[members] = number
    nodes = np.concatenate([block.nodes for block in mesh.blocks])
    quadratic = nodes.shape[1] > 4
    faces = np.array(faces_of("C3D10" if quadratic else "C3D4"))
    sides = nodes[:, faces].reshape(-1, faces.shape[1])
    owner = np.repeat(part, len(faces))
    _, which, count = np.unique(np.sort(sides[:, :3], axis=1), axis=0, return_inverse=True, return_counts=True)
    total = np.bincount(which, owner).astype(int)
    other = np.where(count[which] == 2, total[which] - owner, -1)
    names = [*parts, OUTSIDE]
    found = []
    for pair in np.unique(np.stack([owner, other], axis=1)[owner > other], axis=0).tolist():
        chosen = np.flatnonzero((owner == pair[0]) & (other == pair[1]))
        outward = _outward(mesh.points, sides[chosen], nodes[chosen // len(faces), :4])
        triangles = cut_faces((Faces(sides[chosen], outward, np.zeros(len(chosen))),), 3)
        found.append(Interface(names[pair[0]], names[pair[1]], triangles))
    return sorted(found, key=lambda one: one.outer == OUTSIDE)


def _outward(points: np.ndarray, sides: np.ndarray, element: np.ndarray) -> np.ndarray:
    """1 for sides that are anticlockwise as seen from outside of their elements, else -1."""
    a, b, c = (points[sides[:, n]] for n in range(3))
    inward = (np.cross(b - a, c - a) * (a - points[element].mean(axis=1))).sum(axis=1) < 0
    return np.where(inward, -1.0, 1.0)


class Sight(Protocol):
    """What shows where the borders of a subject are."""

    def ways(self, points: np.ndarray, interface: Interface, others: list[Interface]) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of an interface that are seen, shape (seen,), and their ways to the border, shape (seen, 3), mm."""


class Labels:
    """Borders of a segmentation: where a label and the deepest of all others are equally deep.

    At an interface that the subject lacks, as where another part lies between two of the mesh, the surface of the body
    comes first, then the smaller part.

    Parameters
    ----------
    picture : Picture
        Whole numbers; what has no name here is outside.
    tissues : mapping of int to str
        Part of the mesh of each label.
    """

    def __init__(self, picture: Picture, tissues: Mapping[int, str]) -> None:
        self._picture, self._step = picture, float(picture.spacing.min())
        values = np.pad(np.rint(picture.values).astype(int).T, 1)  # x first; outside of the picture nothing is
        held = {name: [label for label in tissues if tissues[label] == name] for name in tissues.values()}
        inside = {name: np.isin(values, labels) for name, labels in held.items()}
        size = {name: int(there.sum()) for name, there in inside.items()}
        self._order = [OUTSIDE, *sorted(size, key=size.__getitem__)]
        inside[OUTSIDE] = ~np.isin(values, list(tissues))
        depths = {name: depth_in(there, picture.spacing) for name, there in inside.items()}
        self._lead = {
            name: depth - np.max([other for key, other in depths.items() if key != name], axis=0)
            for name, depth in depths.items()
        }

    def ways(self, points: np.ndarray, interface: Interface, others: list[Interface]) -> tuple[np.ndarray, np.ndarray]:
        """All nodes, each with its way along the slope of both depths, `REACH` at most."""
        lead = self._lead[min(interface.inner, interface.outer, key=self._order.index)]

        def difference(at: np.ndarray) -> np.ndarray:
            index = (self._picture.to_index(at) + 1).T
            return np.asarray(ndimage.map_coordinates(lead, index, order=1, mode="nearest"))

        return interface.nodes, to_zero(difference, points[interface.nodes], self._step, REACH * self._step)


class Intensities:
    """Borders of a volume, where intensities change across an interface by more than its noise.

    Parameters
    ----------
    picture : Picture
    """

    def __init__(self, picture: Picture) -> None:
        self._profiles, self._voxel = Profiles(picture), float(picture.spacing.mean())

    def ways(self, points: np.ndarray, interface: Interface, others: list[Interface]) -> tuple[np.ndarray, np.ndarray]:
        """Nodes apart from all other borders and from the end of the volume; none where the border has no contrast."""
        nodes, reach = interface.nodes, REACH * self._voxel
        outward = vertex_normals(points, interface.triangles)[nodes]
        seen = self._profiles.holds(points[nodes], outward, reach)
        for other in others:
            seen &= surface_distance(points[nodes], points[other.triangles]) > reach
        nodes, outward = nodes[seen], outward[seen]
        if not len(nodes):
            return nodes, np.zeros((0, 3))
        near = averages(points[nodes], np.arange(len(nodes)), outward, SMOOTH * self._voxel)
        depth, contrast = find_border(self._profiles, points[nodes], outward, near, reach)
        if contrast <= CLEAR:
            return nodes[:0], np.zeros((0, 3))
        return nodes, (near @ depth)[:, None] * outward
