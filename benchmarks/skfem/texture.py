"""Textures that are fixed to the material, drawn on a fine grid and read with cubic splines."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial import cKDTree

Array = np.ndarray


class Texture:
    """Brightness (about 0.15 to 0.95) of material points of a block.

    Parameters
    ----------
    kind
        grains, droplets, fibres, tissue or marbled.
    width, height
        Extent of the block, mm.
    pixel
        Size of a picture's pixel, mm; structures are some pixels large.
    """

    def __init__(self, kind: str, width: float, height: float, pixel: float, rng: np.random.Generator) -> None:
        self.step = pixel / 3
        self.margin = 8 * pixel
        shape = tuple(int(np.ceil((size + 2 * self.margin) / self.step)) for size in (width, height))
        values = getattr(self, f"_{kind}")(shape, rng)
        low, high = np.percentile(values, [0.5, 99.5])
        values = 0.15 + 0.8 * np.clip((values - low) / (high - low), 0, 1)
        self.spline = spline_filter(gaussian_filter(values, 2.2), order=3)

    def __call__(self, where: Array) -> Array:
        """Brightness at points (n, 2)."""
        grid = (where.T + self.margin) / self.step
        return map_coordinates(self.spline, grid, order=3, prefilter=False, mode="nearest")

    @staticmethod
    def _grains(shape: tuple[int, int], rng: np.random.Generator) -> Array:
        count = int(shape[0] * shape[1] / 15**2)
        seeds = rng.uniform(0, 1, (count, 2)) * shape
        points = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).reshape(-1, 2)
        distance, index = cKDTree(seeds).query(points, k=2)
        tone = rng.beta(1.5, 1.5, count)[index[:, 0]]
        border = np.clip((distance[:, 1] - distance[:, 0]) / 4, 0, 1)
        return gaussian_filter((tone * (0.5 + 0.5 * border)).reshape(shape), 1.5)

    @staticmethod
    def _droplets(shape: tuple[int, int], rng: np.random.Generator) -> Array:
        total = np.zeros(shape)
        for radius in (3, 5, 8):
            layer = np.zeros(shape)
            count = int(shape[0] * shape[1] / (9 * radius) ** 2 * 5)
            at = (rng.uniform(0, 1, (2, count)) * np.array(shape)[:, None]).astype(int)
            np.add.at(layer, tuple(at), rng.lognormal(0, 0.4, count))
            total += np.tanh(gaussian_filter(layer, radius, mode="wrap") * 2 * np.pi * radius**2)
        return total

    @staticmethod
    def _fibres(shape: tuple[int, int], rng: np.random.Generator) -> Array:
        total = np.zeros(shape)
        bend = gaussian_filter(rng.normal(0, 1, shape), 90)
        angle = 0.5 + 0.7 * bend / bend.std()
        for _ in range(int(shape[0] * shape[1] / 220)):
            x, y = rng.uniform(0, 1, 2) * shape
            tone = rng.lognormal(0, 0.5)
            for _ in range(30):
                i, j = int(x) % shape[0], int(y) % shape[1]
                total[i, j] += tone
                x, y = x + 1.3 * np.cos(angle[i, j]), y + 1.3 * np.sin(angle[i, j])
        return gaussian_filter(total, 2.2)

    @staticmethod
    def _tissue(shape: tuple[int, int], rng: np.random.Generator) -> Array:
        total = np.zeros(shape)
        for size in (3.5, 6, 11, 20):
            part = gaussian_filter(rng.normal(0, 1, shape), size)
            total += part / part.std() * size**0.35
        veins = gaussian_filter(rng.normal(0, 1, shape), 9)
        return total - 3 * np.exp(-((veins / veins.std() / 0.12) ** 2))

    @staticmethod
    def _marbled(shape: tuple[int, int], rng: np.random.Generator) -> Array:
        phase = sum(gaussian_filter(rng.normal(0, 1, shape), s) * s * w for s, w in ((6, 3.0), (14, 4.0), (30, 3.0)))
        return np.sin(phase * 2) + 0.5 * gaussian_filter(rng.normal(0, 1, shape), 3) * 10
