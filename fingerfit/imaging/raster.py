"""Scan lines: which pixels lie in convex bodies with plane faces, or near triangles."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

_ROWS = 1 << 13
"""Rows of pixels at once: what they need, some hundred kB, stays in the processor's cache. A choice."""


def slabs(triangles: np.ndarray, margin: float, bulge: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Planes and boxes, for `scan`, of what lies before triangles within a margin."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    normal = np.cross(sides[:, 0], sides[:, 1])
    inward = np.cross(normal[:, None], sides)
    every = np.concatenate([normal[:, None], -normal[:, None], inward], axis=1)
    every /= np.maximum(np.linalg.norm(every, axis=2, keepdims=True), 1e-300)
    # the upper and the lower face go through the first corner, each side through its own
    through = triangles[:, [0, 0, 0, 1, 2]]
    slack = np.stack([bulge + 1e-6, *[np.full(len(bulge), margin)] * 4], axis=1)
    offset = slack - (every * through).sum(axis=2)
    planes = np.concatenate([every, offset[..., None]], axis=2).transpose(2, 1, 0)
    return np.ascontiguousarray(planes), triangles.min(axis=1) - margin, triangles.max(axis=1) + margin


def distances(place: np.ndarray, triangles: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Distances of points, shape (3, points), from their triangles."""
    sides = np.roll(triangles, -1, axis=1) - triangles
    normal = np.cross(sides[:, 0], sides[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    inward = np.cross(normal[:, None], sides)
    along = sides / np.maximum((sides**2).sum(axis=2, keepdims=True), 1e-300)
    nearest, inside = np.full(place.shape[1], np.inf), np.ones(place.shape[1], dtype=bool)
    away = place
    for k in range(3):
        away = place - _of(triangles[:, k], owner)
        share = np.clip(_dot(_of(along[:, k], owner), away), 0.0, 1.0)
        gap = away - share * _of(sides[:, k], owner)
        nearest = np.minimum(nearest, _dot(gap, gap))
        inside &= _dot(_of(inward[:, k], owner), away) >= 0
    return np.where(inside, np.abs(_dot(_of(normal, owner), away)), np.sqrt(nearest))


def _of(vectors: np.ndarray, owner: np.ndarray) -> np.ndarray:
    return np.take(np.ascontiguousarray(vectors.T), owner, axis=1)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ip,ip->p", a, b)


def scan(
    planes: np.ndarray, lowest: np.ndarray, highest: np.ndarray, size: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Pixels where all planes of an element are positive, inside its box.

    Parameters
    ----------
    planes : ndarray, shape (4, planes, elements)
        Coefficients by x, y, z and 1.
    lowest, highest : ndarray, shape (elements, 3)
        Corners of the boxes.
    size : ndarray of int, shape (3,)

    Yields
    ------
    owner : ndarray of int, shape (pixels,)
        Element.
    place : ndarray, shape (3, pixels)
        x, y, z.
    pixel : ndarray of int, shape (pixels,)
        Flat indices.
    """
    low = np.clip(np.ceil(lowest - 1e-6), 0, size).astype(np.int64)
    high = np.clip(np.floor(highest + 1e-6) + 1, 0, size).astype(np.int64)
    extent = np.maximum(high - low, 0)
    rows = extent[:, 1] * extent[:, 2] * (extent[:, 0] > 0)
    part = np.cumsum(rows) // _ROWS
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    for first, last in zip(starts, [*starts[1:], len(rows)], strict=True):
        count = rows[first:last]
        owner = np.repeat(np.arange(first, last), count)
        if not len(owner):
            continue
        local = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
        z, y = np.divmod(local, np.take(extent[:, 1], owner))
        y, z = y + np.take(low[:, 1], owner), z + np.take(low[:, 2], owner)
        left, right = np.take(low[:, 0], owner).astype(float), np.take(high[:, 0], owner) - 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            for a, b, c, d in planes.transpose(1, 0, 2):
                slope = np.take(a, owner)
                height = np.take(b, owner) * y + np.take(c, owner) * z + np.take(d, owner)
                cut = -height / slope
                # a row along the plane: all or nothing
                left = np.where(slope > 0, np.maximum(left, cut), left)
                right = np.where(slope < 0, np.minimum(right, cut), right)
                right = np.where((slope == 0) & (height < 0), -1.0, right)
        begin, end = np.ceil(left).astype(np.int64), np.floor(right).astype(np.int64)
        length = np.maximum(end - begin + 1, 0)
        full = np.flatnonzero(length)
        length, begin = length[full], begin[full]
        step = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        x = np.repeat(begin, length) + step
        pixel = np.repeat((z[full] * size[1] + y[full]) * size[0], length) + x
        place = np.stack([x, np.repeat(y[full], length), np.repeat(z[full], length)]).astype(float)
        yield np.repeat(owner[full], length), place, pixel
