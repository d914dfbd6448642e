"""Pictures as a scanner would take them of a body whose deformation is known: tissues, texture, partial volume."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from fingerfit.core.errors import LimitError
from fingerfit.core.files import free_memory
from fingerfit.core.progress import tell
from fingerfit.forward.predict import positions
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import backward_map, sample, spline_coefficients
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.observation import Observation
from fingerfit.solvers.contract import Outcome
from fingerfit.virtual.truth import Truth

SAMPLES = {2: 16, 3: 32}
"""Places in a pixel where the body is looked at, in the plane and in space."""
_WEAVE = 2.5
"""Points of the texture's grid within the length over which it changes."""


def grid(truth: Truth, mesh: Mesh) -> Picture:
    """Pixels of the pictures, all 0."""
    table = truth.picture
    if truth.dim == 2:
        height = sum(layer["height"] for layer in truth.layers)
        corner = np.array([truth.width - table["side"], height - table["side"]]) / 2
        size, spacing = [table["pixels"]] * 2, np.full(2, table["side"] / table["pixels"])
    else:
        size, spacing = [int(n) for n in table["pixels"]], np.array(table["spacing"], dtype=float)
        middle = (mesh.body.min(axis=0) + mesh.body.max(axis=0)) / 2
        corner = middle - spacing * size / 2
        if "origin" in table:
            corner = np.array(table["origin"], dtype=float) - spacing / 2
    # volumes are many: single precision
    values = np.zeros(size[::-1], dtype=np.float64 if truth.dim == 2 else np.float32)
    return Picture(values, spacing, corner + spacing / 2, np.eye(truth.dim))


def check_memory(truth: Truth, mesh: Mesh) -> None:
    """Refuse pictures and textures that the memory cannot hold, before anything is solved.

    Raises
    ------
    LimitError
    """
    table, free = truth.picture, free_memory()
    sizes = [table["pixels"]] * 2 if truth.dim == 2 else table["pixels"]
    pixels, number = float(math.prod(sizes)), 8 if truth.dim == 2 else 4
    # the pictures; and of the texture random values, those smoothed and the coefficients of their spline, in double
    # precision
    needed = {"pixels": (1 + len(truth.displacement)) * pixels * number}
    if truth.dim == 2:
        needed["pixels"] += 3 * 8 * pixels * SAMPLES[2]
    else:
        with np.errstate(over="ignore"):
            count = np.prod(np.ptp(mesh.body, axis=0) / (table["correlation"] / _WEAVE) + 4 * _WEAVE + 2)
        needed["correlation"] = 3 * 8 * float(count)
    for name, size in needed.items():
        if size > free:
            found = f"{table[name]}, with {size / 1e6:.3g} MB of pictures and texture"
            expected = f"what fits into the {free / 1e6:.3g} MB of memory that are free"
            raise LimitError(truth.path, f"picture.{name}", found, expected)


def take_pictures(truth: Truth, mesh: Mesh, outcome: Outcome, seen: Observation | None) -> tuple[np.ndarray, Picture]:
    """Pictures without noise, before compression and at the steps, and their grid.

    A pixel is the mean of `samples` places in it. They are taken one after the other, so that the memory is that of one
    sample for each pixel.

    Returns
    -------
    pictures : ndarray, shape (1 + steps, ny, nx) or (1 + steps, nz, ny, nx)
        Intensities, 0..1.
    frame : Picture
    """
    frame = grid(truth, mesh)
    places = sample_places(truth.dim, int(truth.picture.get("samples", SAMPLES[truth.dim])))
    texture = _Texture(truth, mesh, frame)
    intensity = _intensities(truth, mesh)
    pictures = np.zeros((1 + outcome.steps, *frame.values.shape), frame.values.dtype)
    for k, u in enumerate([np.zeros(mesh.points.shape), *outcome.displacement]):
        tell(f"picture {k + 1} of {1 + outcome.steps}")
        shown = u if seen is None else u + (seen.shift(k, mesh.points + u) if k else seen.first(mesh.points))
        flat = pictures[k].reshape(-1)
        for place in places:
            offset = place * frame.spacing
            way = backward_map(mesh, shown, replace(frame, origin=frame.origin + offset))
            points = frame.to_points(way.index) + offset
            signal = intensity[way.element]
            for shape in truth.drawn:
                signal = np.where(within(shape, points), shape["intensity"], signal)
            flat[way.pixel] += signal * (1 + texture.at(points)) / len(places)
        if seen is not None and k > 0:
            pictures[k] = seen.intensity(pictures[k], k, *positions(frame))
    return pictures, frame


@cache
def sample_places(dim: int, count: int) -> np.ndarray:
    """Places in a pixel, from -1/2 to 1/2 along each side, shape (count, dim).

    In the plane a grid. In space a lattice (Korobov) in which every place has a height of its own along each axis: of
    a grid, layers of places cross a plane border together, and the border seems to jump from one to the next.
    """
    if dim == 2:
        side = round(count**0.5)
        steps = (np.arange(side) + 0.5) / side - 0.5
        return np.stack([steps[i[::-1]] for i in np.indices((side, side)).reshape(2, -1)[::-1]], axis=1)
    index, best, widest = np.arange(count), np.zeros((count, 3)), -1.0
    for step in (n for n in range(1, max(count, 2)) if np.gcd(n, count) == 1):
        places = (index[:, None] * np.array([1, step, step**2]) % count) / count
        gaps = np.abs(places[1:] - places[0])
        distance = np.linalg.norm(np.minimum(gaps, 1 - gaps), axis=1).min(initial=1.0)
        if distance > widest + 1e-12:
            best, widest = places, distance
    return best + (0.5 / count - 0.5)


def within(shape: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Whether points, shape (points, 3), lie in a shape of a description, bool.

    >>> cube = {"shape": "box", "low": (0, 0, 0), "high": (1, 1, 1)}
    >>> within(cube, np.array([[0.5, 0.5, 0.5], [2.0, 0.5, 0.5]])).tolist()
    [True, False]
    """
    if shape["shape"] == "box":
        return ((points >= shape["low"]) & (points <= shape["high"])).all(axis=1)
    if shape["shape"] == "ellipsoid":
        return (((points - shape["centre"]) / shape["radii"]) ** 2).sum(axis=1) <= 1
    start, end = np.array(shape["from"], dtype=float), np.array(shape["to"], dtype=float)
    axis = end - start
    along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-300), 0.0, 1.0)
    return ((points - start - along[:, None] * axis) ** 2).sum(axis=1) <= shape["radius"] ** 2


def _intensities(truth: Truth, mesh: Mesh) -> np.ndarray:
    found = np.zeros(mesh.element_count)
    for name, value in truth.tissues.items():
        found[mesh.element_sets[name]] = value
    for layer in truth.layers:
        found[mesh.element_sets[layer["name"].upper()]] = layer["intensity"]
    return found


class _Texture:
    """Random field that is fixed to the material."""

    def __init__(self, truth: Truth, mesh: Mesh, frame: Picture) -> None:
        from scipy.ndimage import gaussian_filter

        length = truth.picture["correlation"]
        if truth.dim == 2:
            # the samples themselves, as far as the picture reaches
            fine = round(SAMPLES[2] ** 0.5)
            spacing, size = frame.spacing / fine, np.array(frame.values.shape[::-1]) * fine
            origin = frame.origin - frame.spacing / 2 + spacing / 2
        else:
            spacing = np.full(3, length / _WEAVE)
            low, high = mesh.body.min(axis=0) - 2 * length, mesh.body.max(axis=0) + 2 * length
            origin, size = low, np.ceil((high - low) / spacing).astype(int) + 1
        noise = np.random.default_rng([truth.seed, 1]).normal(size=size[::-1])
        noise = gaussian_filter(noise, length / spacing[0] / 2, mode="wrap")
        self._field = spline_coefficients(noise / noise.std() * truth.picture["texture"])
        self._grid = Picture(self._field, spacing, origin, np.eye(truth.dim))

    def at(self, points: np.ndarray) -> np.ndarray:
        """Relative brightness at reference points, shape (points,)."""
        return sample(self._field, self._grid.to_index(points))
