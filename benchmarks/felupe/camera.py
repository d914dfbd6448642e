"""Textures fixed to the unloaded body, pictures of the deformed body, noise, and files of pictures (NRRD)."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from body import Body, simplices
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial import cKDTree

Array = np.ndarray
DARK = 0.04  # black level, as a share of the full scale


class Texture:
    """Random pattern with mean 0 and spread 1, read with cubic splines at places of the unloaded body."""

    def __init__(self, kind: str, length: float, low: Array, high: Array, step: float, rng: np.random.Generator):
        """Draw the pattern on a grid of `step` between two corners; `length` is that of its grains."""
        self.low, self.step = low - 4 * step, step
        shape = tuple(np.ceil((high - low) / step + 9).astype(int))
        grain = length / step
        if kind == "speckle":
            field = gaussian_filter(rng.normal(size=shape), grain / 2)
        elif kind == "dots":  # sprayed paint: dark dots of about one size
            field = -gaussian_filter((rng.random(shape) < 0.35 / grain ** len(shape)).astype(float), grain / 3)
        elif kind == "strands":  # fine structure along a direction that wanders
            field = gaussian_filter(rng.normal(size=shape), [grain / 1.2] + [grain / 4] * (len(shape) - 1))
            field += 0.6 * gaussian_filter(rng.normal(size=shape), grain / 3) * field.std() / 0.05
        elif kind == "cells":  # fat lobules: bright cells with darker walls
            count = int(np.prod(shape) / grain ** len(shape))
            seeds = rng.random((count, len(shape))) * shape
            places = np.stack([g.ravel() for g in np.meshgrid(*[np.arange(n) for n in shape], indexing="ij")], 1)
            far = cKDTree(seeds).query(places, 2)[0]
            field = np.minimum(far[:, 1] - far[:, 0], grain / 2).reshape(shape)
            field = gaussian_filter(field / grain, 0.8) + 0.3 * gaussian_filter(rng.normal(size=shape), grain / 4)
        else:
            msg = f"texture: found {kind}; expected speckle, dots, strands or cells"
            raise ValueError(msg)
        field = np.clip((field - field.mean()) / field.std(), -2.5, 2.5)
        self.splines = spline_filter(field, 3)

    def at(self, places: Array) -> Array:
        """Values at places (n, dim)."""
        return map_coordinates(self.splines, ((places - self.low) / self.step).T, order=3, prefilter=False)


@dataclass
class Camera:
    """Pixels and what happens between body and file. Places are in the coordinates of the body."""

    first: Array  # centre of the first pixel
    pixel: float
    shape: tuple[int, ...]
    parts: int  # sub-pixels along each side of a pixel
    blur: float = 0.0
    view: Callable[[Array, int], Array] | None = None  # where a point of the laboratory is seen, by step
    light: Callable[[Array, int], Array] | None = None  # brightness at places of the picture, by step

    def places(self) -> Array:
        """Centres of the sub-pixels."""
        step = self.pixel / self.parts
        axes = [
            self.first[k] - self.pixel / 2 + step * (np.arange(n * self.parts) + 0.5) for k, n in enumerate(self.shape)
        ]
        return np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], 1)

    def trace(self, body: Body, u: Array, step: int, origin: Array | None = None) -> tuple[Array, Array]:
        """Unloaded place of each sub-pixel (NaN outside) and its layer (-1 outside).

        `origin` gives places of the nodes to be traced to, in place of the nodes of the body.
        """
        now = body.points + u
        if self.view is not None:
            now = self.view(now, step)
        weights, corners = simplices(body, 4 if body.dim == 2 else 2)
        source = body.points if origin is None else origin
        fine = self.pixel / self.parts
        start = self.first - self.pixel / 2 + fine / 2
        at = (np.einsum("pn,cnd->cpd", weights, now[body.cells]) - start) / fine
        back = np.einsum("pn,cnd->cpd", weights, source[body.cells])
        at = at[:, corners].reshape(-1, *at[0, corners[0]].shape)
        back = back[:, corners].reshape(at.shape)
        layer = np.repeat(body.layer, len(corners))
        return _raster(at, back, layer, tuple(n * self.parts for n in self.shape))

    def expose(self, fine: Array, step: int) -> Array:
        """Picture (pixels) from the brightness of the sub-pixels."""
        fine = fine.reshape([n * self.parts for n in self.shape])
        if self.blur > 0:
            fine = gaussian_filter(fine, self.blur / self.pixel * self.parts)
        if self.light is not None:
            fine = fine * self.light(self.places(), step).reshape(fine.shape)
        blocks = [k for n in self.shape for k in (n, self.parts)]
        return fine.reshape(blocks).mean(tuple(range(1, 2 * len(self.shape), 2)))


def _raster(at: Array, back: Array, layer: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Fill simplices (n, dim + 1, dim), given in sub-pixels, with their unloaded places."""
    dim = at.shape[2]
    low = np.maximum(np.ceil(at.min(1) - 1e-6).astype(int), 0)
    high = np.minimum(np.floor(at.max(1) + 1e-6).astype(int), np.array(shape) - 1)
    found = np.full((int(np.prod(shape)), dim), np.nan)
    kind = np.full(len(found), -1)
    sides = np.moveaxis(at[:, 1:] - at[:, :1], 1, 2)  # columns
    inverse = np.linalg.inv(sides)
    spans = back[:, 1:] - back[:, :1]
    for offset in product(*[range(int(n) + 1) for n in (high - low).max(0)]):
        place = low + np.array(offset)
        some = np.flatnonzero((place <= high).all(1))
        if len(some) == 0:
            continue
        shares = np.einsum("nij,nj->ni", inverse[some], place[some] - at[some, 0])
        inside = (shares > -1e-7).all(1) & (shares.sum(1) < 1 + 1e-7)
        some, shares = some[inside], shares[inside]
        index = np.ravel_multi_index(place[some].T, shape)
        found[index] = back[some, 0] + np.einsum("ni,nid->nd", shares, spans[some])
        kind[index] = layer[some]
    return found, kind


def brightness(
    texture: Texture, found: Array, kind: Array, bright: Array, spread: float, borders: Array | None, width: float
) -> Array:
    """Brightness of sub-pixels: that of their layers with the texture; dark outside.

    With `borders` (heights) that of the layers changes over `width` there, as the mean over a sub-pixel does.
    """
    fine = np.full(len(found), DARK)
    on = kind >= 0
    level = bright[kind[on]]
    if borders is not None:
        level = np.full(len(level), bright[0])
        for k, border in enumerate(borders):
            level += (bright[k + 1] - bright[k]) * np.clip((found[on, -1] - border) / width + 0.5, 0, 1)
    fine[on] = np.clip(level * (1 + spread * texture.at(found[on])), DARK, 1.2)
    return fine


def with_noise(picture: Array, kind: str, level: float, rng: np.random.Generator) -> Array:
    """Add Gaussian noise, or that of magnitudes (Rician)."""
    if kind == "rician":
        return np.hypot(picture + rng.normal(0, level, picture.shape), rng.normal(0, level, picture.shape))
    return picture + rng.normal(0, level, picture.shape)


def write(file: Path, picture: Array, pixel: float, first: Array, whole: bool) -> None:
    """Write a picture as NRRD with gzip: int16 or float32, x first."""
    dim = picture.ndim
    data = np.round(picture).clip(0, 32767).astype("<i2") if whole else picture.astype("<f4")
    vectors = [tuple(float(f"{pixel:.9g}") if i == k else 0.0 for i in range(dim)) for k in range(dim)]
    text = "NRRD0004\n" + f"type: {'short' if whole else 'float'}\ndimension: {dim}\n"
    text += "space: left-posterior-superior\n" if dim == 3 else "space dimension: 2\n"
    text += "sizes: " + " ".join(map(str, picture.shape)) + "\nencoding: gzip\nendian: little\n"
    text += "space directions: " + " ".join("(" + ",".join(map(str, v)) + ")" for v in vectors) + "\n"
    text += "space origin: (" + ",".join(f"{x:.9g}" for x in first) + ")\n\n"
    file.write_bytes(text.encode() + gzip.compress(data.tobytes(order="F"), 6, mtime=0))
