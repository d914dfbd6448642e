"""Rigid surfaces of flat facets: distance and normal to the nearest one.

Where two facets meet, what is between them belongs to the nearer one, so that the gap is continuous and the normal
jumps. Behind the outer edge of a surface that is not closed there is no contact. Quadrilaterals are cut into two
triangles, quadratic faces into as many as they have nodes in the middle of sides, and more.
"""

from __future__ import annotations

import numpy as np

from fingerfit.mesh.faces import Faces, area_vectors

_NEAREST = 16
"""Facets that are looked at for each point, those with the nearest centres: more than meet at a corner of a
triangulated surface. A choice."""
_ALL = 64
"""Number of facets up to which all are looked at: for so few no search tree is made. A choice."""
_EDGE = 1e-3
"""Distance beyond an outer edge, relative to the facet, up to which a point still touches: so that one that lies on the
edge does, whatever rounding makes of it. A choice."""

_CUTS = {
    2: ((0, 1),),
    3: ((0, 1, 2),),
    4: ((0, 1, 2), (0, 2, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}
"""Triangles of a face by its number of nodes."""
_LINES = {2: ((0, 1),), 3: ((0, 2), (2, 1))}
"""Lines of a face in the plane."""


def cut_faces(faces: tuple[Faces, ...], dim: int) -> np.ndarray:
    """Nodes of the facets, shape (facets, dim), in the order that makes their normals point out of the elements."""
    found = []
    for group in faces:
        count = group.nodes.shape[1]
        for local in (_LINES if dim == 2 else _CUTS)[count]:
            chosen = group.nodes[:, list(local)]
            turned = group.outward < 0
            chosen[turned] = chosen[turned][:, ::-1]
            found.append(chosen)
    return np.concatenate(found)


def rigid_faces(facets: list[tuple[int, ...]], dim: int) -> tuple[Faces, ...]:
    """Faces of rigid elements, grouped by their number of nodes.

    Their normals are those of ABAQUS: to the left of a line, and by the right hand round triangles and quadrilaterals.
    """
    groups: dict[int, list[tuple[int, ...]]] = {}
    for nodes in facets:
        groups.setdefault(len(nodes), []).append(nodes)
    side = -1.0 if dim == 2 else 1.0
    return tuple(Faces(np.array(g), np.full(len(g), side), np.ones(len(g))) for _, g in sorted(groups.items()))


class Facets:
    """Triangles in space, lines in the plane; a `fingerfit.fem.surfaces.RigidSurface`.

    Parameters
    ----------
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    facets : ndarray of int, shape (facets, dim)
        Nodes, in the order of `fingerfit.mesh.faces.area_vectors`.

    Raises
    ------
    ValueError
        For a facet without area.
    """

    def __init__(self, points: np.ndarray, facets: np.ndarray) -> None:
        self.corners = points[facets]
        slopes = np.swapaxes(self.corners[:, 1:] - self.corners[:, :1], 1, 2)
        vectors = area_vectors(slopes)
        size = np.linalg.norm(vectors, axis=1)
        if not size.min() > 1e-12 * size.max():
            raise ValueError("a facet without area")
        self.normals = vectors / size[:, None]
        self._size = size ** (1 / (points.shape[1] - 1))
        self._border, self._end = _border(facets)
        # of each edge of a triangle, from one corner to the next, the way to the inside
        edges = np.roll(self.corners, -1, axis=1) - self.corners
        self._inwards = np.cross(self.normals[:, None], edges) if points.shape[1] == 3 else np.empty(0)
        self._tree = None
        if len(facets) > _ALL:
            from scipy.spatial import cKDTree

            self._tree = cKDTree(self.corners.mean(axis=1))

    def gap(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap, unit normal and its slope at x (points, dim): the slope of facets is zero."""
        count, dim = x.shape
        if self._tree is None:
            near = np.broadcast_to(np.arange(len(self.corners)), (count, len(self.corners)))
        else:
            near = self._tree.query(x, min(_NEAREST, len(self.corners)))[1]
        place, outside = self._project(x[:, None], near)
        away = x[:, None] - place
        distance = np.linalg.norm(away, axis=-1)
        signed = (away * self.normals[near]).sum(axis=-1)
        # of equally near ones, the one whose plane is the farther: at an edge the other is seen from behind
        best = np.lexsort((-np.abs(signed), np.round(distance / self._size.mean(), 9)), axis=-1)[:, 0]
        rows = np.arange(count)
        chosen = near[rows, best]
        across = np.sqrt(np.maximum(distance**2 - signed**2, 0.0))[rows, best]
        off = outside[rows, best] & (across > _EDGE * self._size[chosen])
        gap = np.where(off, distance[rows, best], signed[rows, best])
        return gap, self.normals[chosen], np.zeros((count, dim, dim))

    def _project(self, x: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nearest places on facets, shape (points, near, dim), and whether they are on an outer edge."""
        corners, border, end = self.corners[near], self._border[near], self._end[near]
        dim = x.shape[-1]
        flat = x - ((x - corners[..., 0, :]) * self.normals[near]).sum(axis=-1)[..., None] * self.normals[near]
        place, outside = flat, np.zeros(near.shape, dtype=bool)
        least, inside = np.full(near.shape, np.inf), np.ones(near.shape, dtype=bool)
        found = []
        for k in range(3 if dim == 3 else 1):
            first, way = corners[..., k, :], corners[..., (k + 1) % dim, :] - corners[..., k, :]
            share = np.clip(((flat - first) * way).sum(axis=-1) / (way * way).sum(axis=-1), 0.0, 1.0)
            if dim == 3:
                inside &= ((flat - first) * self._inwards[near, k]).sum(axis=-1) >= 0
            else:
                inside = (share > 0) & (share < 1)
            off = border[..., k] & (dim == 3)
            off = off | (end[..., k] & (share == 0)) | (end[..., (k + 1) % dim] & (share == 1))
            found.append((first + share[..., None] * way, off))
        for at, off in found:
            squared = ((flat - at) ** 2).sum(axis=-1)
            better = ~inside & (squared < least)
            place = np.where(better[..., None], at, place)
            outside, least = np.where(better, off, outside), np.where(better, squared, least)
        return place, outside


def _border(facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which edges belong to one facet only (of triangles: from each corner to the next), and which corners to those.

    Shapes (facets, dim); in the plane edges are lines themselves, and corners of one line only are the ends.
    """
    if facets.shape[1] == 2:
        _, at, count = np.unique(facets.ravel(), return_inverse=True, return_counts=True)
        return np.zeros(facets.shape, dtype=bool), (count[at] == 1).reshape(facets.shape)
    sides = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1), axis=-1)
    _, at, count = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
    border = (count[at.ravel()] == 1).reshape(facets.shape)
    return border, np.isin(facets, sides[border])
