"""Pictures of a body, before compression and at steps. Places in mm, with the body's lower left corner at (0, 0)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hidden import Effects
from matplotlib.path import Path as Polygon
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter
from scipy.spatial import cKDTree
from simulation import Simulated
from study_table import Look, Study
from texture import texture

FIELD = (1.42, 1.30)
"""Width and height of the pictures over those of the body, at least."""
ABOVE = 0.02
"""How much higher the middle of the pictures is than that of the body, over its height."""
FINE = 5
"""Points of the texture along the side of a pixel."""
MARGIN = 12
"""Texture beyond the pictures, pixels."""
WITHIN = 3
"""Points that are sampled along the side of a pixel."""
BESIDE = 0.06
"""Value beside the body."""
DARK = 0.12
"""Value of the parts that are dark."""
DENSE = 6
"""Parts of the side of an element, of the points between which displacements are interpolated."""
ARC = 8
"""Parts of the side of an element on the outline."""
SAME = 1e-6
"""Points that are closer than this, mm, are the same."""


@dataclass(frozen=True)
class Pixels:
    """Pixels of a picture: side and middle of the lower left one (mm), and how many."""

    side: float
    x: float
    y: float
    columns: int
    rows: int

    def points(self) -> np.ndarray:
        """The points that are sampled, row by row from below (rows * columns * WITHIN^2, 2)."""
        within = (np.arange(WITHIN) + 0.5) / WITHIN - 0.5
        x = (np.arange(self.columns)[:, None] + within).ravel() * self.side + self.x
        y = (np.arange(self.rows)[:, None] + within).ravel() * self.side + self.y
        across, up = np.meshgrid(x, y)
        return np.c_[across.ravel(), up.ravel()]

    def mean(self, values: np.ndarray, blur: float) -> np.ndarray:
        """Picture (rows, columns) of the values at these points, blurred (standard deviation in pixels) before."""
        image = values.reshape(self.rows * WITHIN, self.columns * WITHIN)
        if blur:
            image = gaussian_filter(image, blur * WITHIN)
        return image.reshape(self.rows, WITHIN, self.columns, WITHIN).mean((1, 3))


def pixels_of(study: Study) -> Pixels:
    """The pixels of a study."""
    look, width, height = study.look, study.width, study.height
    side = max(FIELD[0] * width / look.columns, FIELD[1] * height / look.rows)
    x = width / 2 - side * (look.columns - 1) / 2
    y = height / 2 - side * (look.rows - 1) / 2 + ABOVE * height
    return Pixels(side, x, y, look.columns, look.rows)


def take(study: Study, effects: Effects, simulated: Simulated) -> dict[int, np.ndarray]:
    """Pictures (rows, columns) with noise, as they are in the files; before compression (0) and of the steps."""
    rng = study.generator("pictures")
    pixels, look = pixels_of(study), study.look
    shape = ((look.rows + 2 * MARGIN) * FINE, (look.columns + 2 * MARGIN) * FINE)
    values = texture(look.texture, shape, FINE, rng)
    rng.permutation(max(2, len(study.layers)))  # not used; without it the noise would be another one
    body = _Textured(values, pixels, simulated)
    points = pixels.points()
    centre = np.array([study.width, study.height]) / 2
    clean = {}
    for step in (0, *study.pictured):
        places = points
        if step and effects.magnification:
            grown = simulated.indentation[step - 1] / simulated.indentation[-1]
            places = centre + (points - centre) / (1 + effects.magnification * grown)
        clean[step] = pixels.mean(body.seen(places, step), look.blur)
    return {step: _noisy(picture, look, rng) for step, picture in clean.items()}


class _Textured:
    """A body whose texture is fixed to its places in the first picture."""

    def __init__(self, values: np.ndarray, pixels: Pixels, simulated: Simulated) -> None:
        self.splines = spline_filter(values, mode="reflect")
        self.pixels, self.simulated = pixels, simulated
        first, quads = simulated.first, simulated.quads
        self.elements = cKDTree(first[quads[:, :4]].mean(1))

    def seen(self, points: np.ndarray, step: int) -> np.ndarray:
        """Values (points,) at points (points, 2) in the picture of a step, or in the first one (0)."""
        simulated = self.simulated
        first = simulated.first
        now = first + simulated.moved[step - 1] if step else first
        inside = Polygon(outline(now, simulated.outline)).contains_points(points)
        places = self._before(now, points[inside]) if step else points[inside]
        values = np.full(len(points), BESIDE)
        values[inside] = self._at(places)
        return values

    def _before(self, now: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Where points (points, 2) were in the first picture, with the front nodes at `now`."""
        quads = self.simulated.quads
        there, before = inner_points(now, quads), inner_points(self.simulated.first, quads)
        _, single = np.unique(np.round(there / SAME).astype(np.int64), axis=0, return_index=True)
        there, before = there[single], before[single]
        places = LinearNDInterpolator(there, before)(points)
        outside = ~np.isfinite(places[:, 0])
        if outside.any():
            places[outside] = before[cKDTree(there).query(points[outside])[1]]
        return places

    def _at(self, places: np.ndarray) -> np.ndarray:
        """Values (places,) at places (places, 2) of the body in the first picture."""
        pixels = self.pixels
        rows = (places[:, 1] - pixels.y) / pixels.side + MARGIN
        columns = (places[:, 0] - pixels.x) / pixels.side + MARGIN
        grid = np.array([rows, columns]) * FINE + (FINE - 1) / 2
        values = map_coordinates(self.splines, grid, order=3, mode="reflect", prefilter=False)
        if self.simulated.dark.any():
            values[self.simulated.dark[self.elements.query(places)[1]]] = DARK
        return values


def inner_points(nodes: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Points (elements * (DENSE + 1)^2, 2) on a regular grid in each element, of the places of the front nodes."""
    places = np.linspace(-1, 1, DENSE + 1)
    shapes = np.array([_shapes(a, b) for a in places for b in places])
    return np.concatenate([shapes @ nodes[quad] for quad in quads])


def _shapes(a: float, b: float) -> list[float]:
    """Shape functions of the 8 nodes at natural coordinates a and b."""
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    return [
        *(-(1 + i * a) * (1 + j * b) * (1 - i * a - j * b) / 4 for i, j in corners),
        (1 - a * a) * (1 - b) / 2,
        (1 + a) * (1 - b * b) / 2,
        (1 - a * a) * (1 + b) / 2,
        (1 - a) * (1 - b * b) / 2,
    ]


def outline(nodes: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Points (points, 2) around the body: quadratic arcs through the front nodes `around` (indices)."""
    places = nodes[np.r_[around, around[:1]]]
    start, middle, end = (places[begin : len(places) - 2 + begin : 2, None] for begin in range(3))
    s = np.linspace(0, 1, ARC, endpoint=False)[:, None]
    arcs = start * (1 - s) * (1 - 2 * s) + middle * 4 * s * (1 - s) + end * s * (2 * s - 1)
    return arcs.reshape(-1, 2)


def _noisy(clean: np.ndarray, look: Look, rng: np.random.Generator) -> np.ndarray:
    """A picture with noise, as it is in the file."""
    values = clean * look.level
    sigma = look.sigma
    noisy = values + rng.normal(0, sigma, values.shape)
    if look.magnitude:
        noisy = np.hypot(noisy, rng.normal(0, sigma, values.shape))
    if not look.whole:
        return noisy.astype(np.float32)
    limits = np.iinfo(np.int16)
    return np.clip(np.rint(noisy), limits.min, limits.max).astype(np.int16)
