"""Warping the picture before compression with the displacements of a mesh.

For each pixel of the deformed picture the element that covers it is found and its local coordinates, by Newton's
method on the element's own shape functions; these give the material point, and the picture before compression is
read there through cubic B-splines (Unser 1999). The same code serves two and three dimensions; in tetrahedra, of which
a body has many, scan lines take the place of the search (`fingerfit.imaging.tetrahedra`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fingerfit.imaging.inverse import bulge, interpolate, local_coordinates
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.tetrahedra import BESIDE_BODY, Claims, Tetrahedra, border_faces
from fingerfit.mesh.elements import ELEMENTS, distance, rule, shape
from fingerfit.mesh.mesh import Mesh

_DEEP = 1 - 1e-3
"""Depth, 0 in an element's middle and 1 on its border, below which a pixel in two elements counts as covered twice:
those on a common border are in both by rounding."""
_BESIDE = 1e-10
"""Distance, as a share of the body's extent, from the box around an element's nodes at which points are still tried:
rounding."""
_PAIRS = 4_000_000
"""Pairs of element and point that are looked at together: 12 MB for each comparison in space. A choice."""
_POLE = 3**0.5 - 2
"""Of the filter that makes cubic B-splines pass through the values (Unser 1999)."""


@dataclass(frozen=True)
class BackwardMap:
    """Where each pixel of the deformed picture comes from.

    Parameters
    ----------
    pixel : ndarray of int, shape (covered,)
        Flat indices of the pixels that the deformed body covers.
    index : ndarray, shape (covered, dim)
        Continuous pixel index (x, y[, z]) of the material point in the picture before compression.
    element : ndarray of int, shape (covered,)
        Element that covers the pixel.
    shape : tuple of int
        Shape of the picture.
    beside : ndarray of bool, shape (covered,)
        Which pixels lie beside the body, within the margin.
    inverted : int
        Elements that are turned inside out somewhere. Tetrahedra that are so between their corners cover nothing.
    overlaps : int
        Pixels inside more than one element; the one whose centre is nearest has them.
    folded : bool
        Whether somewhere they lie more than a pixel deep: the body has gone through itself.
    """

    pixel: np.ndarray
    index: np.ndarray
    element: np.ndarray
    shape: tuple[int, ...]
    beside: np.ndarray
    inverted: int = 0
    overlaps: int = 0
    folded: bool = False

    def window(self, margin: int) -> tuple[slice, ...]:
        """The part of the picture that has all of these pixels, and a margin of others; there must be some."""
        place = np.unravel_index(self.pixel, self.shape)
        return tuple(slice(max(0, int(p.min()) - margin), int(p.max()) + margin + 1) for p in place)


def backward_map(mesh: Mesh, displacement: np.ndarray, frame: Picture, margin: float = 0.0) -> BackwardMap:
    """Map of the pixels of `frame` back to the reference state.

    Parameters
    ----------
    mesh : Mesh
        Reference mesh, mm.
    displacement : ndarray, shape (nodes, dim)
        mm.
    frame : Picture
        Only its pixel grid is used.
    margin : float
        Pixels as near to the deformed body, in pixels, are mapped too, by its border elements carried on: the soft
        border of the picture before compression then moves along with the body.
    """
    deformed = frame.to_index(mesh.points + displacement)
    reference = frame.to_index(mesh.points)
    size = np.array(frame.values.shape[::-1])
    blocks = [(block.element, deformed[block.nodes], reference[block.nodes]) for block in mesh.blocks]
    first = np.cumsum([0, *(len(block.nodes) for block in mesh.blocks)])
    solid = {
        n: Tetrahedra(*block, size) for n, block in enumerate(blocks) if mesh.dim == 3 and ELEMENTS[block[0]].is_simplex
    }
    found = []
    for n, block in enumerate(blocks):
        claims = solid[n].inside() if n in solid else _search(*block, size)
        found.append(replace(claims, element=claims.element + first[n]))
    if margin > 0:
        # pixels beside the body are looked for apart: there are few
        covered = np.zeros(frame.values.size, dtype=bool)
        for claims in found:
            covered[claims.pixel] = True
        borders = dict(zip(solid, border_faces([mesh.blocks[n].nodes for n in solid]), strict=True))
        for n, block in enumerate(blocks):
            if n in solid:
                claims = solid[n].near(*borders[n], margin, covered)
            else:
                claims = _search(*block, size, margin, covered)
            found.append(replace(claims, element=claims.element + first[n]))
    inverted = sum(_count_inverted(*block) for block in blocks)
    return _winners(Claims.joined(found, mesh.dim), frame.values.shape, inverted)


def _search(
    kind: str,
    corners: np.ndarray,
    reference: np.ndarray,
    size: np.ndarray,
    reach: float = 0.0,
    covered: np.ndarray | None = None,
) -> Claims:
    """Claims of elements of any type, found by trying all pixels of the boxes around them that are not covered yet."""
    element, pixel = _candidates(corners, size, reach + _slack(kind, corners, reach))
    flat = np.ravel_multi_index(tuple(pixel[:, ::-1].T), tuple(size[::-1]))
    if covered is not None:
        new = ~covered[flat]
        element, pixel, flat = element[new], pixel[new], flat[new]
    xi, outside = local_coordinates(kind, corners, element, pixel.astype(float), reach)
    near = np.isfinite(outside)
    element, flat, xi, outside = element[near], flat[near], xi[near], outside[near]
    source = interpolate(kind, reference, element, xi)
    depth = np.where(outside > 0, BESIDE_BODY + outside, np.minimum(distance(kind, xi), 1.0))
    return Claims(element, flat, source, depth)


def _winners(claims: Claims, shape: tuple[int, ...], inverted: int) -> BackwardMap:
    """One claim for each pixel: the deepest, then that of the first element."""
    index = np.arange(len(claims.pixel), dtype=np.int32)
    # the picture filled with its claims: those that are not found there again have rivals
    owner = np.full(int(np.prod(shape)), -1, dtype=np.int32)
    owner[claims.pixel] = index
    lost = claims.pixel[owner[claims.pixel] != index]
    overlaps, folded = 0, False
    if len(lost):
        disputed = np.zeros(len(owner), dtype=bool)
        disputed[lost] = True
        rival = np.flatnonzero(disputed[claims.pixel])
        pixel, depth = claims.pixel[rival], claims.depth[rival]
        order = np.lexsort((claims.element[rival], depth, pixel))
        won = np.ones(len(order), dtype=bool)
        won[1:] = pixel[order][1:] != pixel[order][:-1]
        owner[pixel[order][won]] = rival[order[won]]
        twice = np.bincount(pixel[depth < _DEEP], minlength=len(owner)) > 1
        overlaps = int(twice.sum())
        folded = bool(overlaps) and _is_deep(twice.reshape(shape))
    # in the order of the picture: what is read there lies close together
    kept = owner[owner >= 0]
    pixel, source, element, depth = (own[kept] for own in (claims.pixel, claims.source, claims.element, claims.depth))
    return BackwardMap(pixel, source, element, shape, depth >= BESIDE_BODY, inverted, overlaps, folded)


def _is_deep(twice: np.ndarray) -> bool:
    """Whether a pixel and all of its neighbours are covered twice."""
    from scipy.ndimage import binary_erosion

    return bool(binary_erosion(twice).any())


def _count_inverted(kind: str, corners: np.ndarray, reference: np.ndarray) -> int:
    gradients = shape(kind, rule(kind)[0])[1]
    det = [np.linalg.det(np.einsum("eni,gnj->egij", nodes, gradients)) for nodes in (corners, reference)]
    return int(((det[0] * np.sign(det[1])) <= 0).any(axis=1).sum())


def _slack(kind: str, corners: np.ndarray, reach: float) -> np.ndarray | float:
    """How much wider than the box around its nodes an element may be; carried on beyond its border, still more."""
    if not reach:
        return bulge(kind, corners) + 1e-6
    return 0.1 * np.ptp(corners, axis=1) if corners.shape[1] > 2 ** corners.shape[2] else 1e-6


def _candidates(corners: np.ndarray, size: np.ndarray, slack: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of element and pixel whose bounding boxes meet: shapes (pairs,) and (pairs, dim)."""
    low = np.clip(np.ceil(corners.min(axis=1) - slack), 0, size).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1) + slack) + 1, 0, size).astype(np.int64)
    extent = np.maximum(high - low, 0)
    count = extent.prod(axis=1)
    element = np.repeat(np.arange(len(corners)), count)
    local = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    pixel = np.empty((len(element), corners.shape[2]), dtype=np.int64)
    for axis in range(corners.shape[2]):
        local, pixel[:, axis] = np.divmod(local, extent[element, axis])
    return element, pixel + low[element]


def spline_coefficients(values: np.ndarray) -> np.ndarray:
    """Cubic B-spline coefficients of a picture, mirrored at its borders, by the recursions of Unser (1999).

    The same as scipy.ndimage.spline_filter, whose import costs more than what it filters here in the plane.
    """
    if values.ndim == 3:
        from scipy.ndimage import spline_filter

        return spline_filter(values, order=3, output=float, mode="mirror")
    found = values.astype(float)
    for axis, size in enumerate(values.shape):
        if size < 2:
            continue
        c = 6.0 * np.moveaxis(found, axis, 0)
        weight = _POLE ** np.arange(size) + _POLE ** np.arange(2 * size - 2, size - 2, -1)
        weight[0], weight[-1] = 1.0, _POLE ** (size - 1)
        c[0] = np.tensordot(weight, c, 1) / (1 - _POLE ** (2 * size - 2))
        for k in range(1, size):
            c[k] += _POLE * c[k - 1]
        c[-1] = _POLE / (_POLE**2 - 1) * (c[-1] + _POLE * c[-2])
        for k in range(size - 2, -1, -1):
            c[k] = _POLE * (c[k + 1] - c[k])
        found = np.moveaxis(c, 0, axis)
    return np.ascontiguousarray(found)


def sample(coefficients: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Value of a spline at continuous pixel indices.

    Parameters
    ----------
    coefficients : ndarray, shape (ny, nx) or (nz, ny, nx)
        Of `spline_coefficients`.
    index : ndarray, shape (points, dim)
        x, y[, z]; beyond the border the picture is mirrored.
    """
    if coefficients.ndim == 3:
        from scipy.ndimage import map_coordinates

        # the same sum, compiled
        return map_coordinates(
            coefficients, index.T[::-1], output=coefficients.dtype, order=3, mode="mirror", prefilter=False
        )
    size = np.array(coefficients.shape[::-1])
    low = np.floor(index).astype(np.int64) - 1
    weights = [_weights(t) for t in (index - np.floor(index)).T]
    strides = np.cumprod([1, *size[:-1]])
    places = []
    for axis in range(index.shape[1]):
        around = np.abs(low[:, axis] + np.arange(4)[:, None])
        period = max(2 * (size[axis] - 1), 1)
        around = around % period
        places.append(np.minimum(around, period - around) * strides[axis])
    return _summed(coefficients.ravel(), weights, places, 0)


def _summed(
    flat: np.ndarray, weights: Sequence[np.ndarray], places: Sequence[np.ndarray], start: np.ndarray | int
) -> np.ndarray:
    """Sum over the neighbours along the last axis, and for each of them along those before it."""
    if not weights:
        return np.take(flat, start)
    pairs = zip(weights[-1], places[-1], strict=True)
    return sum(w * _summed(flat, weights[:-1], places[:-1], start + p) for w, p in pairs)


def _weights(t: np.ndarray) -> np.ndarray:
    """Cubic B-spline weights of the four neighbours, shape (4, points)."""
    s, tt = 1 - t, t * t
    first, last = s * s * s / 6, tt * t / 6
    second = tt * (t / 2 - 1) + 2 / 3
    return np.stack([first, second, 1 - first - second - last, last])


def warp(
    coefficients: np.ndarray,
    background: float,
    way: BackwardMap,
    sigma: float = 0.0,
    seen: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """The synthesized picture, as precise as the coefficients.

    Parameters
    ----------
    coefficients : ndarray
        Of the picture before compression, from `spline_coefficients`.
    background : float
        Intensity of the pixels that the body does not cover.
    way : BackwardMap
        Where the covered pixels come from.
    sigma : float
        Standard deviation of a Gaussian that follows, pixels.
    seen : callable, optional
        What becomes of the intensities of covered pixels, shape (pixels,): the background is not the body's.
    """
    flat = np.full(int(np.prod(way.shape)), background, dtype=coefficients.dtype)
    own = sample(coefficients, way.index)
    flat[way.pixel] = own if seen is None else seen(own)
    picture = flat.reshape(way.shape)
    if sigma > 0 and len(way.pixel):
        # all else is background and stays as it is
        window = way.window(2 * reach_of(sigma))
        picture[window] = smooth(picture[window], sigma)
    return picture


def _parts(points: np.ndarray, size: int) -> Iterator[tuple[int, np.ndarray]]:
    for first in range(0, len(points), size):
        yield first, points[first : first + size]


class Probe:
    """Reads displacements at fixed material points.

    Parameters
    ----------
    mesh : Mesh
        Reference mesh.
    points : ndarray, shape (points, dim)
        mm.

    Attributes
    ----------
    element : ndarray of int, shape (points,)
        Element that a point is in, the last one of several; -1 outside.
    """

    def __init__(self, mesh: Mesh, points: np.ndarray) -> None:
        widest = max(block.nodes.shape[1] for block in mesh.blocks)
        self._points = points
        self._nodes = np.zeros((len(points), widest), dtype=int)
        self._weights = np.full((len(points), widest), np.nan)
        self.element, start = np.full(len(points), -1), 0
        slack = _BESIDE * np.ptp(mesh.points, axis=0).max()
        for block in mesh.blocks:
            corners = mesh.points[block.nodes]
            low, high = corners.min(axis=1) - slack, corners.max(axis=1) + slack
            pairs = []
            for first, part in _parts(points, _PAIRS // len(corners) + 1):
                near = ((low[:, None] <= part) & (part <= high[:, None])).all(axis=2)
                element, point = np.nonzero(near)
                pairs.append((element, first + point))
            element, point = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), dtype=int)
            xi, outside = local_coordinates(block.element, corners, element, points[point])
            inside = outside == 0
            element, point = element[inside], point[inside]
            self.element[point] = element + start
            start += len(block.nodes)
            self._nodes[point, : block.nodes.shape[1]] = block.nodes[element]
            self._weights[point] = 0.0
            self._weights[point, : block.nodes.shape[1]] = shape(block.element, xi[inside])[0]

    def read(self, displacement: np.ndarray) -> np.ndarray:
        """Displacements, shape (points, dim), from those of the nodes; NaN for points outside the mesh."""
        return np.einsum("pn,pni->pi", self._weights, displacement[self._nodes])

    def read_near(self, displacement: np.ndarray) -> np.ndarray:
        """The same; a point outside, by a curved border of another mesh, has that of the nearest point inside."""
        found, inside = self.read(displacement), self.element >= 0
        if inside.any() and not inside.all():
            from scipy.spatial import cKDTree

            nearest = cKDTree(self._points[inside]).query(self._points[~inside])[1]
            found[~inside] = found[inside][nearest]
        return found
