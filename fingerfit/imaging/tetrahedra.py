"""Which pixels lie in tetrahedra, and where they come from: scan lines in place of a search.

In a tetrahedron with straight edges the local coordinates are linear in space. Along a row of pixels each of its four
faces therefore cuts off one end, and what is left needs no test and no iteration. A tetrahedron with curved edges is
the one between its corners and a small bulge; local coordinates are found by letting the bulge follow (a fixed point),
and those few that do not settle are left to Newton's method (`fingerfit.imaging.inverse`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.imaging.inverse import local_coordinates
from fingerfit.imaging.raster import distances, scan, slabs
from fingerfit.mesh.shapes import EDGES

BESIDE_BODY = 2.0
"""Depth of a pixel beside the body, less its distance in pixels."""
INSIDE = 5e-7
"""Barycentric coordinates down to minus this count as inside, so that no pixel on a common face is lost by rounding:
the depth in `inverse`, up to 1 + 2e-6 there, is 1 minus four times the smallest coordinate."""
_SOON, _TURNS = 5, 12
"""Turns of a fixed point by all pixels, and at most: most settle soon, what has not by then goes to `inverse`.
Choices."""
_SETTLED = 1e-5
"""Barycentric change at which a fixed point has settled; the next one would be some ten times smaller."""
STRAIGHT = 1e-6
"""Pixels by which the middle of an edge may lie beside it and the element still counts as straight: what cannot be seen
in a picture."""
_FACES = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
"""Corners of the faces, each opposite to the corner of its number, anticlockwise from outside."""
_MIDDLE = np.zeros((4, 4), dtype=int)
"""Nodes in the middle of the edges, by their corners."""
for _number, (_i, _j) in enumerate(EDGES[3], 4):
    _MIDDLE[_i, _j] = _MIDDLE[_j, _i] = _number


@dataclass(frozen=True)
class Claims:
    """Pixels that elements claim.

    Parameters
    ----------
    element, pixel : ndarray of int, shape (claims,)
        Pixels as flat indices.
    source : ndarray, shape (claims, 3)
        Continuous index (x, y, z) of the material point in the reference state.
    depth : ndarray, shape (claims,)
        0 in the middle of the element, 1 at its border, `BESIDE_BODY` plus the distance in pixels outside.
    """

    element: np.ndarray
    pixel: np.ndarray
    source: np.ndarray
    depth: np.ndarray

    @classmethod
    def joined(cls, parts: list[Claims], dim: int = 3) -> Claims:
        """All claims in one."""
        if not parts:
            nothing = np.zeros(0, dtype=np.int64)
            return cls(nothing, nothing, np.zeros((0, dim)), np.zeros(0))
        names = ("element", "pixel", "source", "depth")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


class Tetrahedra:
    """Tetrahedra of a block in a grid of pixels.

    Parameters
    ----------
    kind : str
        Element type.
    deformed, reference : ndarray, shape (elements, nodes, 3)
        Nodes as continuous pixel indices (x, y, z).
    size : ndarray of int, shape (3,)
        Pixels along x, y, z.

    Attributes
    ----------
    inverted : ndarray of bool, shape (elements,)
        Between its corners an element is turned inside out, or flat: it claims nothing here.
    """

    def __init__(self, kind: str, deformed: np.ndarray, reference: np.ndarray, size: np.ndarray) -> None:
        self.kind, self.nodes, self.reference, self.size = kind, deformed, reference, size
        corners = deformed[:, :4]
        gradient, volume = _barycentric(corners)
        self._sense = _barycentric(reference[:, :4])[1]
        self.inverted = volume * self._sense <= 0
        self.curved = deformed.shape[1] > 4
        # coefficients by x, y, z and 1; planes of shape (4, faces, elements)
        offset = -(gradient * corners[:, :1]).sum(axis=2)
        offset[:, 0] += 1.0
        self.planes = np.ascontiguousarray(np.concatenate([gradient, offset[..., None]], axis=2).transpose(2, 1, 0))
        # columns by corner and axis, and by edge and axis
        self._corners = np.ascontiguousarray(reference[:, :4].transpose(1, 2, 0))
        self._rest_bulges = np.zeros((0, 3, len(deformed)))
        # how far its pixels may lie beyond a tetrahedron: in space, and as barycentric coordinates below 0 by face
        self.bulge = np.zeros(len(deformed))
        self._beyond = np.zeros((4, len(deformed)))
        if self.curved:
            bulges = _bulges(deformed)
            # the sum of the six products of two barycentric coordinates is at most 3/8, each of them 1/4
            self.bulge = 0.375 * np.linalg.norm(bulges, axis=2).max(axis=1)
            change = np.einsum("eac,efc->afe", bulges, gradient)
            outward = np.maximum(-change, 0.0)
            self._beyond = np.minimum(0.375 * outward.max(axis=0), 0.25 * outward.sum(axis=0))
            self._change = np.ascontiguousarray(change[:, 1:])
            rest = _bulges(reference)
            if np.abs(rest).max(initial=0.0) > STRAIGHT:
                self._rest_bulges = np.ascontiguousarray(rest.transpose(1, 2, 0))

    def inside(self) -> Claims:
        """Pixels inside the elements."""
        chosen = np.flatnonzero(~self.inverted)
        planes = self.planes[:, :, chosen].copy()
        planes[3] += INSIDE + self._beyond[:, chosen]
        slack = self.bulge[chosen, None]
        nodes, parts, late = self.nodes[chosen], [], []
        for owner, place, pixel in scan(planes, nodes.min(axis=1) - slack, nodes.max(axis=1) + slack, self.size):
            element = chosen[owner]
            share, lost = self._settle(element, place)
            if len(lost):
                late.append((element[lost], place[:, lost], pixel[lost]))
                share[:, lost] = np.nan  # claims nothing yet
            parts.append(self._claims(element, pixel, share))
        if late:
            # together: a call for each part would cost as much again
            element, place, pixel = (np.concatenate(part, axis=-1) for part in zip(*late, strict=True))
            parts.append(self._claims(element, pixel, self._solved(element, place)))
        return Claims.joined(parts)

    def near(self, element: np.ndarray, face: np.ndarray, margin: float, covered: np.ndarray) -> Claims:
        """Pixels that no element holds, but a face on the border has within reach.

        Parameters
        ----------
        element, face : ndarray of int, shape (faces,)
            Faces on the border of the body: their elements and the corners opposite to them.
        margin : float
            Reach, pixels.
        covered : ndarray of bool, shape (pixels,)
            Pixels that need no claim.
        """
        kept = ~self.inverted[element]
        element, triangles = self._triangles(element[kept], face[kept])
        parts = []
        for owner, place, pixel in scan(*slabs(triangles, margin, self.bulge[element]), self.size):
            free = np.flatnonzero(~np.take(covered, pixel))
            owner, pixel = owner[free], pixel[free]
            # rounded, so that of triangles with the nearest edge in common always the same one wins
            away = np.round(distances(place[:, free], triangles, owner), 6)
            close = np.flatnonzero(away <= margin)
            parts.append((owner[close], pixel[close], away[close]))
        if not parts:
            return Claims.joined([])
        owner, pixel, away = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort((owner, away, pixel))
        first = order[np.diff(pixel[order], prepend=-1) > 0]
        z, row = np.divmod(pixel[first], self.size[0] * self.size[1])
        y, x = np.divmod(row, self.size[0])
        element, place = element[owner[first]], np.stack([x, y, z]).astype(float)
        pixel, depth = pixel[first], BESIDE_BODY + away[first]
        share, lost = self._settle(element, place)
        if len(lost):
            share[:, lost] = self._solved(element[lost], place[:, lost])
            known = np.isfinite(share[0])
            element, pixel, depth, share = element[known], pixel[known], depth[known], share[:, known]
        return self._claims(element, pixel, share, depth)

    def _triangles(self, element: np.ndarray, face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Elements and corners, anticlockwise from outside, of the triangles of faces: four where they are curved."""
        nodes = _FACES[face]
        # reference and deformed elements have the same sense, but a mirrored picture turns both
        turn = (self._sense[element] < 0)[:, None]
        nodes = np.where(turn, nodes[:, ::-1], nodes)
        if not self.curved:
            return element, self.nodes[element[:, None], nodes]
        between = np.stack([_MIDDLE[nodes[:, k], nodes[:, k - 2]] for k in range(3)], axis=1)
        a, b, c = nodes.T
        ab, bc, ca = between.T
        small = np.stack([(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]).transpose(0, 2, 1)
        owner = np.tile(element, 4)
        return owner, self.nodes[owner[:, None], small.reshape(-1, 3)]

    def _claims(
        self, element: np.ndarray, pixel: np.ndarray, share: np.ndarray, depth: np.ndarray | None = None
    ) -> Claims:
        """Claims on pixels, by their barycentric coordinates; without `depth`, of those inside."""
        if depth is None:
            lowest = share.min(axis=0)
            depth = np.minimum(1.0 - 4.0 * lowest, 1.0)
            if self.curved:
                kept = np.flatnonzero(lowest >= -INSIDE)
                element, pixel, depth, share = element[kept], pixel[kept], depth[kept], share[:, kept]
        source = np.zeros((3, len(element)))
        for weight, corner in zip(share, self._corners, strict=True):
            for axis in range(3):
                source[axis] += weight * np.take(corner[axis], element)
        for (i, j), edge in zip(EDGES[3], self._rest_bulges, strict=False):
            product = share[i] * share[j]
            for axis in range(3):
                source[axis] += product * np.take(edge[axis], element)
        return Claims(element, pixel, source.T, depth)

    def _between_corners(self, element: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Barycentric coordinates of pixels in elements with straight edges, shape (4, pixels)."""
        share = np.empty((4, len(element)))
        for corner, (a, b, c, d) in enumerate(self.planes.transpose(1, 0, 2)):
            share[corner] = np.take(a, element) * place[0] + np.take(b, element) * place[1]
            share[corner] += np.take(c, element) * place[2] + np.take(d, element)
        return share

    def _settle(self, element: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Barycentric coordinates of pixels in elements, shape (4, pixels), and which of them did not settle."""
        start = self._between_corners(element, place)
        if not self.curved:
            return start, np.zeros(0, dtype=np.int64)
        change = np.take(self._change, element, axis=2)
        found = start.copy()
        # most settle soon, some never
        going = _follow(found, start, change, _SOON)
        rest = found[:, going]
        never = _follow(rest, start[:, going], change[:, :, going], _TURNS - _SOON)
        found[:, going] = rest
        return found, going[never]

    def _solved(self, element: np.ndarray, place: np.ndarray) -> np.ndarray:
        """The same by Newton's method; NaN where there is no solution near by."""
        used, which = np.unique(element, return_inverse=True)
        at, outside = local_coordinates(self.kind, self.nodes[used], which, place.T, np.inf)
        at[~np.isfinite(outside)] = np.nan
        return np.concatenate([1.0 - at.T.sum(axis=0, keepdims=True), at.T])


def _follow(found: np.ndarray, start: np.ndarray, change: np.ndarray, turns: int) -> np.ndarray:
    """Let the bulge follow the coordinates `found`, in place; returns which have not settled."""
    moved = np.full(found.shape[1], np.inf)
    with np.errstate(over="ignore", invalid="ignore"):  # those that run away are found again
        for _ in range(turns):
            later = start[1:].copy()
            for (i, j), by in zip(EDGES[3], change, strict=True):
                product = found[i] * found[j]
                for axis in range(3):
                    later[axis] -= product * by[axis]
            moved = np.abs(later - found[1:]).max(axis=0)
            found[1:] = later
            found[0] = 1.0 - later.sum(axis=0)
    return np.flatnonzero(~(moved < _SETTLED))


def border_faces(nodes: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Faces of tetrahedra that only one element has: by block, elements and the corners opposite to the faces.

    Parameters
    ----------
    nodes : list of ndarray of int, shape (elements, nodes)
        Of each block.
    """
    keys = []
    count = max((int(block.max()) + 1 for block in nodes if block.size), default=1)
    for block in nodes:
        a, b, c = np.moveaxis(np.sort(block[:, _FACES], axis=2).astype(np.int64), 2, 0)
        keys.append(((a * count + b) * count + c).ravel())
    every = np.concatenate(keys) if keys else np.zeros(0, dtype=np.int64)
    _, which, times = np.unique(every, return_inverse=True, return_counts=True)
    alone, found, first = times[which] == 1, [], 0
    for key in keys:
        found.append(np.divmod(np.flatnonzero(alone[first : first + len(key)]), 4))
        first += len(key)
    return found


def _bulges(nodes: np.ndarray) -> np.ndarray:
    """What multiplies the product of the barycentric coordinates of an edge's corners, shape (elements, 6, 3)."""
    i, j = np.array(EDGES[3]).T
    return 4 * (nodes[:, 4:] - (nodes[:, i] + nodes[:, j]) / 2)


def _barycentric(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients of the barycentric coordinates, shape (elements, 4, 3), 0 in flat elements; six times the volumes."""
    a, b, c = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    crosses = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    volume = (a * crosses[:, 0]).sum(axis=1)
    size = np.abs(np.stack([a, b, c])).max(axis=(0, 2))
    flat = np.abs(volume) <= 1e-12 * size**3
    gradient = crosses / np.where(flat, np.inf, volume)[:, None, None]
    volume = np.where(flat, 0.0, volume)
    return np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1), volume
