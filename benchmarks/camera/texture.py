"""Textures that lie in the unloaded body."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from study_table import Look

CELLS = 4
"""Cells of the texture along the side of a pixel."""
MARGIN = 0.08
"""Texture beyond the body, over the larger one of its width and height."""
LARGEST = 2.7
"""Standard deviations beyond which the texture is cut off."""


class Texture:
    """Intensity over its mean at places of the unloaded body; interpolated by cubic splines on a fine grid.

    Parameters
    ----------
    look : Look
        Kind, size and contrast of the texture.
    width, height : float
        Of the unloaded body, mm.
    seed : int
        Seed of the texture.
    """

    def __init__(self, look: Look, width: float, height: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.cell = look.pixel / CELLS
        self.levels = look.levels
        margin = MARGIN * max(width, height)
        self.corner = np.array([-margin, -margin])
        columns = int((width + 2 * margin) / self.cell) + 2
        rows = int((height + 2 * margin) / self.cell) + 2
        field = PATTERNS[look.kind](rng, rows, columns, look.size * CELLS)
        field = (field - field.mean()) / field.std()
        self.splines = spline_filter(1 + look.contrast * np.clip(field, -LARGEST, LARGEST))

    def at(self, places: np.ndarray, layers: np.ndarray) -> np.ndarray:
        """Values at places (n, 2) in mm, which lie in layers (n,)."""
        cells = ((places - self.corner) / self.cell).T[::-1]
        values = map_coordinates(self.splines, cells, order=3, prefilter=False, mode="nearest")
        return values if self.levels is None else values * np.asarray(self.levels)[layers]


def cloud(rng: np.random.Generator, rows: int, columns: int, size: float) -> np.ndarray:
    """Smoothed noise of two sizes."""
    fine = gaussian_filter(rng.standard_normal((rows, columns)), size)
    return fine + 0.6 * gaussian_filter(rng.standard_normal((rows, columns)), size * 2.2) * 2.2


def modes(rng: np.random.Generator, rows: int, columns: int, size: float) -> np.ndarray:
    """Sum of 220 plane waves in all directions."""
    y, x = np.mgrid[:rows, :columns]
    field = np.zeros((rows, columns))
    for _ in range(220):
        wave_number = (0.45 + 0.75 * rng.random()) / size
        angle = np.pi * rng.random()
        phase = 2 * np.pi * rng.random()
        field += np.cos(wave_number * (x * np.cos(angle) + y * np.sin(angle)) + phase)
    return field


def dots(rng: np.random.Generator, rows: int, columns: int, size: float) -> np.ndarray:
    """Round dots of three sizes at random places."""
    field = np.zeros((rows, columns))
    for factor in (0.8, 1.1, 1.5):
        radius = factor * size
        centres = rng.random((rows, columns)) < 0.035 / radius**2 * 0.9
        heights = centres.astype(float) * (0.5 + rng.random((rows, columns)))
        field += gaussian_filter(heights, radius) * 2 * np.pi * radius**2
    return np.tanh(1.1 * field)


def strands(rng: np.random.Generator, rows: int, columns: int, size: float) -> np.ndarray:
    """Bright and dark strands at random places in random directions."""
    field = np.zeros((rows, columns))
    y, x = np.mgrid[:rows, :columns]
    for _ in range(int(columns * rows / (size * size) * 0.12)):
        angle = np.pi * rng.random()
        centre = rng.random(2) * [columns, rows]
        length, breadth = 4 * size * (0.5 + rng.random()), 0.8 * size
        reach = int(3 * length)
        left, right = max(0, int(centre[0] - reach)), min(columns, int(centre[0] + reach))
        low, high = max(0, int(centre[1] - reach)), min(rows, int(centre[1] + reach))
        if right <= left or high <= low:
            continue
        dx = x[low:high, left:right] - centre[0]
        dy = y[low:high, left:right] - centre[1]
        along = dx * np.cos(angle) + dy * np.sin(angle)
        aside = -dx * np.sin(angle) + dy * np.cos(angle)
        sign = rng.choice([-1, 1])
        field[low:high, left:right] += sign * np.exp(-along * along / 2 / length**2 - aside * aside / 2 / breadth**2)
    return field


PATTERNS = {"cloud": cloud, "modes": modes, "dots": dots, "strands": strands}
