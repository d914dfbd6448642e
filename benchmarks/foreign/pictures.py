"""Textures, the pictures of a deformed body, their noise, and files in NIfTI format, all written here by hand.

The texture lies in the body and is blurred there, before the body is deformed; a pixel is the mean over points within
it, inside and outside of the body. Brightness is a share of full scale until the file is written.
"""

from __future__ import annotations

import gzip
import itertools
import math
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from body import Solved
from observing import Observation
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import cKDTree

FULL = 4000
"""Full scale in the files."""
BACKGROUND = 0.0
WITHIN = {2: 3, 3: 2}
"""Points along each side of a pixel that its mean is taken of."""
FIELD = (48, 48, 40)
"""Voxels of a volume."""
PADDING = 8
"""Pixels of texture beyond the body."""


class Texture:
    """Brightness of the unloaded body at nominal places: layers and what is in them."""

    def __init__(self, setting: Mapping[str, Any], rng: np.random.Generator) -> None:
        look = setting["picture"]
        sizes = body_size(setting)
        self.step = look["pixel"] / WITHIN[len(sizes)]
        self.low = -PADDING * look["pixel"]
        shape = [math.ceil((s + 2 * PADDING * look["pixel"]) / self.step) + 1 for s in sizes]
        within = WITHIN[len(sizes)]
        own = _texture(look["texture"], shape, look["grain"] * within, rng)
        own -= own.mean()
        own /= own.std()
        height = self.low + self.step * np.arange(shape[-1])
        levels = np.cumsum(setting["heights"][::-1])[:-1]
        layers = np.array(look["looks"][::-1])[np.searchsorted(levels, height)]
        blurred = gaussian_filter(layers + look["contrast"] * own, look["blur"] * within, mode="nearest")
        self.values = np.clip(blurred, 0.05, 1.0)

    def at(self, places: list[np.ndarray]) -> np.ndarray:
        """Brightness at nominal places."""
        return map_coordinates(self.values, [(p - self.low) / self.step for p in places], order=1, mode="nearest")


def _texture(kind: str, shape: list[int], grain: float, rng: np.random.Generator) -> np.ndarray:
    """A random field whose spots are about as wide as the grain, in points."""
    if kind == "grain":
        return gaussian_filter(rng.standard_normal(shape), 0.35 * grain)
    count = int(np.prod(shape) / grain ** len(shape))
    where = rng.uniform(0, shape, (count, len(shape)))
    points = np.stack(np.meshgrid(*[np.arange(n) for n in shape], indexing="ij"), axis=-1).reshape(-1, len(shape))
    away, which = cKDTree(where).query(points)
    values = rng.uniform(-1, 1, count)[which]
    if kind == "dots":  # as wide as three quarters of the grain, between them nothing
        values = values * (away < 0.375 * grain)
    return values.reshape(shape)


def body_size(setting: Mapping[str, Any]) -> tuple[float, ...]:
    """Width, in space breadth, and height of the nominal body, mm."""
    deep = (setting["breadth"],) if setting["dimension"] == 3 else ()
    return (setting["width"], *deep, float(sum(setting["heights"])))


class Camera:
    """The field of view of a study."""

    def __init__(self, setting: Mapping[str, Any], rng: np.random.Generator) -> None:
        self.pixel = setting["picture"]["pixel"]
        sizes = body_size(setting)
        if len(sizes) == 3:
            self.shape = FIELD
        else:
            wide, high = sizes
            self.shape = (round((wide + 0.9 * high) / self.pixel), round(1.7 * high / self.pixel))
        middle = np.array(sizes) / 2 + rng.uniform(-0.5, 0.5, len(sizes)) * self.pixel
        self.origin = middle - self.pixel * (np.array(self.shape) - 1) / 2
        """Centre of the first pixel, mm."""

    def points(self) -> Iterator[list[np.ndarray]]:
        """One point of each pixel after the other, as places along each axis, mm.

        The points of a pixel stand askew: along each axis no two are at the same place, so that an edge along the
        other axes moves by a ninth (in space an eighth) of a pixel, not by a third (a half).
        """
        axes = len(self.shape)
        within = WITHIN[axes]
        for index in itertools.product(range(within), repeat=axes):
            offsets = []
            for axis in range(axes):
                others = [i for other, i in enumerate(index) if other != axis]
                rank = sum(i * within**power for power, i in enumerate(others))
                offsets.append((index[axis] + (rank + 0.5) / within ** (axes - 1)) / within - 0.5)
            yield [
                origin + self.pixel * (np.arange(count) + offset)
                for origin, count, offset in zip(self.origin, self.shape, offsets, strict=True)
            ]

    def clean(self, texture: Texture, solved: Solved, step: int, seen: Observation) -> np.ndarray:
        """The picture before compression (step 0) or at a step, without noise."""
        moved = solved.before if step == 0 else solved.moved[step - 1]
        share = step / solved.asked
        places = seen.moved(share, list(solved.places + moved))
        nodes = np.stack([p.ravel() for p in places], axis=-1)
        find = LinearNDInterpolator(nodes, np.stack([p.ravel() for p in solved.nominal], axis=-1))
        total = np.zeros(self.shape)
        for axes in self.points():
            inside = _inside(places, axes)
            points = np.meshgrid(*axes, indexing="ij")
            nominal = find(np.stack([p[inside] for p in points], axis=-1))
            known = np.isfinite(nominal[:, 0])
            found = np.full(len(nominal), BACKGROUND)
            found[known] = texture.at(list(nominal[known].T))
            values = np.full(self.shape, BACKGROUND)
            values[inside] = found
            total += seen.light(share, points, values)
        return total / WITHIN[len(self.shape)] ** len(self.shape)


def _inside(places: list[np.ndarray], axes: list[np.ndarray]) -> np.ndarray:
    """Points of a grid that lie in the body: in the plane within its outline, in space within its convex hull."""
    if len(places) == 3:
        low, high = ([f(p) for p in places] for f in (np.min, np.max))
        near = [(a >= lo) & (a <= hi) for a, lo, hi in zip(axes, low, high, strict=True)]
        return np.logical_and.reduce(np.meshgrid(*near, indexing="ij"))
    rim = [np.concatenate([p[:-1, 0], p[-1, :-1], p[:0:-1, -1], p[0, :0:-1]]) for p in places]
    x, y = rim
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    found = np.zeros((len(axes[0]), len(axes[1])), bool)
    for j, level in enumerate(axes[1]):
        cut = (y > level) != (y2 > level)
        where = np.sort(x[cut] + (level - y[cut]) / (y2[cut] - y[cut]) * (x2[cut] - x[cut]))
        found[:, j] = np.searchsorted(where, axes[0]) % 2 == 1
    return found


def noisy(clean: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """A picture with Rician noise, in the numbers of the files."""
    real, other = (sigma * rng.standard_normal(clean.shape) for _ in range(2))
    counts = np.rint(FULL * np.hypot(clean + real, other))
    return np.clip(counts, 0, np.iinfo(np.int16).max).astype(np.int16)


def write_nifti(path: Path, values: np.ndarray, pixel: float, origin: np.ndarray) -> None:
    """Write int16 values (axes x, y[, z]) as NIfTI-1; places are those of DICOM, mm: x and y of the other sign."""
    axes = values.ndim
    place = np.zeros(3)
    place[:axes] = origin
    place[:2] *= -1
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, axes, *values.shape, *([1] * (7 - axes)))
    struct.pack_into("<2h", head, 70, 4, 16)  # int16
    struct.pack_into("<8f", head, 76, 1.0, pixel, pixel, pixel if axes == 3 else 1.0, 1.0, 1.0, 1.0, 1.0)
    struct.pack_into("<f", head, 108, 352.0)
    struct.pack_into("<f", head, 112, 1.0)
    head[123] = 2 | 8  # mm and s
    struct.pack_into("<2h", head, 252, 1, 1)
    struct.pack_into("<6f", head, 256, 0.0, 0.0, 1.0, *place)
    up = pixel if axes == 3 else 1.0
    rows = ((-pixel, 0, 0, place[0]), (0, -pixel, 0, place[1]), (0, 0, up, place[2]))
    for number, row in enumerate(rows):
        struct.pack_into("<4f", head, 280 + 16 * number, *row)
    head[344:348] = b"n+1\0"
    data = bytes(head) + np.asfortranarray(values).astype("<i2").tobytes(order="F")
    path.write_bytes(gzip.compress(data, mtime=0))
