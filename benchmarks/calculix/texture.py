"""Textures: values from 0.02 to 1.1 on a grid that is finer than the pixels.

Each pattern takes the shape of the grid, the points of it along the side of a pixel, and random numbers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

LIMITS = (0.02, 1.1)
"""Smallest and largest value."""
DOT = 45
"""Pixels for each blob."""
CELL = 40
"""Pixels for each cell."""

Shape = tuple[int, int]


def texture(kind: str, shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """A texture of one kind; `fine` is the number of its points along the side of a pixel."""
    return np.clip(PATTERNS[kind](shape, fine, rng), *LIMITS)


def _smoothed(shape: Shape, fine: int, rng: np.random.Generator, size: float | tuple[float, float]) -> np.ndarray:
    """Smoothed noise with mean 0 and standard deviation 1; the size in pixels, or one upwards and one across."""
    values = gaussian_filter(rng.normal(size=shape), np.multiply(size, fine))
    return (values - values.mean()) / values.std()


def speckle(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Size of a complex random number, as in ultrasound."""
    return np.hypot(_smoothed(shape, fine, rng, 1.1), _smoothed(shape, fine, rng, 1.1)) / 3


def grains(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Smoothed noise of three sizes."""
    values = 0.5 + 0.16 * _smoothed(shape, fine, rng, 1.0)
    return values + 0.13 * _smoothed(shape, fine, rng, 2.5) + 0.08 * _smoothed(shape, fine, rng, 6)


def fibres(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Smoothed noise that is long across, and upwards."""
    values = 0.5 + 0.17 * _smoothed(shape, fine, rng, (0.8, 6))
    return values + 0.15 * _smoothed(shape, fine, rng, (5, 0.9)) + 0.07 * _smoothed(shape, fine, rng, 2)


def blobs(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Bright round spots at random places."""
    values = np.zeros(shape)
    y, x = np.mgrid[: shape[0], : shape[1]]
    for _ in range(int(shape[0] * shape[1] / fine**2 / DOT)):
        radius = rng.uniform(1.2, 3.5) * fine
        up, across = rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
        reach = int(4 * radius) + 1
        near = np.s_[
            max(0, int(up) - reach) : int(up) + reach,
            max(0, int(across) - reach) : int(across) + reach,
        ]
        squares = (y[near] - up) ** 2 + (x[near] - across) ** 2
        values[near] += rng.uniform(0.3, 1) * np.exp(-squares / 2 / radius**2)
    return 0.15 + 0.8 * (values / np.percentile(values, 99.5))


def dark_blobs(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Dark round spots at random places."""
    return 1.05 - blobs(shape, fine, rng)


def cells(shape: Shape, fine: int, rng: np.random.Generator) -> np.ndarray:
    """Cells about random points, each with a brightness of its own and dark walls."""
    count = int(shape[0] * shape[1] / fine**2 / CELL)
    points = rng.uniform([0, 0], shape, (count, 2))
    y, x = np.mgrid[: shape[0], : shape[1]]
    distances, nearest = cKDTree(points).query(np.c_[y.ravel(), x.ravel()], k=2)
    inside = np.clip((distances[:, 1] - distances[:, 0]) / fine / 2.2, 0, 1)
    brightness = rng.uniform(0.3, 0.95, count)
    return gaussian_filter((brightness[nearest[:, 0]] * (0.25 + 0.75 * inside)).reshape(shape), 0.5 * fine)


PATTERNS: dict[str, Callable[[Shape, int, np.random.Generator], np.ndarray]] = {
    "speckle": speckle,
    "grains": grains,
    "fibres": fibres,
    "blobs": blobs,
    "dark blobs": dark_blobs,
    "cells": cells,
}
