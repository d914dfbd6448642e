"""Where the sides of a rectangular body lie in the picture before compression."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval, legvander

from fingerfit.imaging.pictures import Picture

SIDES = ("left", "right", "lower", "upper")
REACH = 0.15
"""How far from a stated side it is looked for, as a share of the body's smaller extent. As wide a strip further in
tells how the body looks, and one further out what is around it. Both are half as wide as what the picture shows beside
the body, where that is less."""
SURELY = 3.0
"""Standard errors."""
_BLUR = 8
"""Half pixels over which an edge may be blurred, on either side."""
CORNER = 0.1
"""Share of a side at either end that is not looked at: the corners are other sides', too."""
_DEGREE = 2
_LEVELS = 24
"""Classes of intensity, of as many pixels each."""
SCATTERED = 0.15
"""Scatter of the lines' places, as a share of how far out is looked, from which they show no side: without one it is
three quarters and more."""
_FEWEST = 6
"""Half pixels on either side of a stated side, at least."""
_LOOKS = 8
"""How often a side is looked for, at most: 8 times `REACH` is more than the body."""
_PARTS = 8
"""Of a side; texture makes neighbouring places err alike, but parts of a side do not."""


@dataclass(frozen=True)
class Outline:
    """The sides of a rectangular body in the plane, as a picture shows them.

    Parameters
    ----------
    low, high : ndarray, shape (2,)
        Corners of the body as it is stated, mm.
    outward : ndarray, shape (4, 3)
        How far out each side lies, mm: Legendre coefficients of the position along it from -1 to 1, in the order of
        `SIDES`. NaN where the picture does not show a side.
    error : ndarray, shape (4,)
        Standard error of each coefficient, mm.
    pixel : float
        mm; edges are no better known than half of it.
    """

    low: np.ndarray
    high: np.ndarray
    outward: np.ndarray
    error: np.ndarray
    pixel: float

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation of each coefficient, mm, shape (4,): edges are no better known than half a pixel."""
        return np.hypot(self.error, self.pixel / 2.0)

    def elsewhere(self, expected: np.ndarray | float = 0.0) -> dict[str, float]:
        """Sides that surely do not lie as far out as `expected` (0: where stated), and how much further, mm."""
        along = np.linspace(2.0 * CORNER - 1.0, 1.0 - 2.0 * CORNER, 21)
        found = {}
        for name, outward, error in zip(SIDES, self.outward - expected, self.error, strict=True):
            there = legval(along, outward)
            farthest = float(there[np.abs(there).argmax()])
            # half a pixel that all pictures of a kind may be off, and what chance makes, are independent of each other
            if np.sqrt(np.mean(there**2)) > np.hypot(self.pixel / 2.0, SURELY * np.sqrt(len(outward)) * error):
                found[name] = farthest
        return found

    @property
    def likely(self) -> np.ndarray:
        """How far out each side likely lies, mm, shape (4, 3): coefficients shrunk towards the body as it is stated.

        One that is no larger than its spread is 0, and a large one stays (James and Stein 1961, positive part).
        """
        known = np.nan_to_num(self.outward)
        noise = np.nan_to_num(self.spread)[:, None] ** 2
        return known * np.maximum(0.0, 1.0 - noise / np.maximum(known**2, noise + 1e-300))

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Points of the stated body where they are in the body that the picture shows, shape (points, 2) both.

        Between two sides the distance changes linearly; sides that the picture does not show elsewhere stay.
        """
        share = (points - self.low) / (self.high - self.low)
        found, likely = points.copy(), self.likely
        for axis in (0, 1):
            along = 2.0 * share[:, 1 - axis] - 1.0
            first, last = (legval(along, likely[2 * axis + n]) for n in (0, 1))
            found[:, axis] += share[:, axis] * last - (1.0 - share[:, axis]) * first
        return found


def measure_outline(picture: Picture, low: np.ndarray, high: np.ndarray) -> Outline:
    """Find the sides of a rectangular body in a picture.

    Across each side runs a line at every pixel. The side lies where the intensities further in are likeliest those of
    the body and those further out those of what is around it, each with the frequencies of its own strip (region
    competition: Zhu and Yuille 1996). A parabola is laid through the places of all lines; outliers weigh little. A
    blurred edge lies where the mean of all lines, each from its place on the parabola, is half way from that of what is
    just within the body to that of what is just outside.

    Parameters
    ----------
    picture : Picture
        In the plane.
    low, high : ndarray, shape (2,)
        Corners of the body as it is stated, mm.
    """
    pixel = float(picture.spacing.max())
    outward, error = np.full((len(SIDES), _DEGREE + 1), np.nan), np.full(len(SIDES), np.nan)
    for number in range(len(SIDES)):
        found = _side(picture, low, high, *divmod(number, 2), pixel)
        if found is not None:
            outward[number], error[number] = found
    return Outline(low, high, outward, error, pixel)


def _side(
    picture: Picture, low: np.ndarray, high: np.ndarray, axis: int, last: int, pixel: float
) -> tuple[np.ndarray, float] | None:
    """Coefficients of a side and their standard error, mm; None where the picture shows none.

    A side that is found more than half as far off as it is looked for is looked for again there: what was taken for
    surely inside, or outside, may not have been.
    """
    reach, ends, known = REACH * float((high - low).min()), np.array([low, high]), None
    share = np.linspace(CORNER, 1.0 - CORNER, max(int((high - low)[1 - axis] / pixel), 4 * _PARTS))
    along, centre = 2.0 * share - 1.0, 0.0
    for _ in range(_LOOKS):
        lines = _lines(picture, ends[0], ends[1], axis, bool(last), share, reach)
        if lines is None:
            break
        edges, far = _edges(*lines), lines[0][-1] / 2.0
        found, spread = _parabola(along, edges, pixel)
        if not (spread < SCATTERED * far and _contrast(lines[1]) > SURELY):
            break
        away = found[0]
        found[0] += _half_way(*lines, legval(along, found))
        error = _error(along, edges, found, spread)
        found[0] += centre
        known = found, error
        if abs(away) <= far / 2.0:
            break
        centre += away
        ends[last, axis] += away if last else -away
    return known


def _lines(
    picture: Picture, low: np.ndarray, high: np.ndarray, axis: int, last: bool, share: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Distances on lines across a side, outwards in mm, and the intensities there; None where the picture ends first.

    The first quarter is surely inside, the last one outside.
    """
    from scipy.ndimage import map_coordinates

    step, size = float(picture.spacing.min()) / 2.0, np.array(picture.values.shape[::-1])

    def on_lines(out: np.ndarray) -> np.ndarray:
        places = np.empty((len(share), len(out), 2))
        places[..., 1 - axis] = (low + share[:, None] * (high - low))[:, [1 - axis]]
        places[..., axis] = high[axis] + out if last else low[axis] - out
        return picture.to_index(places.reshape(-1, 2)).reshape(places.shape)

    far = on_lines(out := np.arange(0.0, 2.0 * reach, step))
    shown = ((far > -0.5) & (far < size - 0.5)).all(axis=(0, 2))
    half = int((len(out) if shown.all() else shown.argmin()) / 2)
    if half < _FEWEST:
        return None
    out = step * (np.arange(-2 * half, 2 * half) + 0.5)
    index = on_lines(out).reshape(-1, 2)
    return out, map_coordinates(picture.values, index.T[::-1], order=1, mode="nearest").reshape(len(share), -1)


def _edges(out: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """How far out the side lies on each line, mm."""
    half = len(out) // 4
    levels = np.quantile(seen, np.linspace(0.0, 1.0, _LEVELS + 1)[1:-1])
    classes = np.searchsorted(levels, seen)
    inside, outside = (
        (np.bincount(classes[:, part].ravel(), minlength=_LEVELS) + 1.0) / (classes[:, part].size + _LEVELS)
        for part in (slice(0, half), slice(3 * half, None))
    )
    speaks = np.log(inside / outside)[classes[:, half : 3 * half]]
    gained = np.concatenate([np.zeros((len(seen), 1)), np.cumsum(speaks, axis=1)], axis=1)
    return (out[1] - out[0]) * (gained.argmax(axis=1) - half)


def _contrast(seen: np.ndarray) -> float:
    """Difference of the mean intensities surely inside and surely outside, in standard errors."""
    quarter = seen.shape[1] // 4
    differences = seen[:, :quarter].mean(axis=1) - seen[:, -quarter:].mean(axis=1)
    parts = np.array([part.mean() for part in np.array_split(differences, _PARTS)])
    return float(abs(parts.mean()) / max(parts.std(ddof=1) / np.sqrt(_PARTS), 1e-300))


def _half_way(out: np.ndarray, seen: np.ndarray, edge: np.ndarray) -> float:
    """How far out from the places that were found, shape (lines,), the mean intensity is half way; mm."""
    around = np.arange(-2 * _BLUR, 2 * _BLUR + 1) * (out[1] - out[0])
    whole = np.mean([np.interp(around + its, out, line) for line, its in zip(seen, edge, strict=True)], axis=0)
    near, mean = around[_BLUR:-_BLUR], whole[_BLUR:-_BLUR]
    # what lies further in may be another layer, which looks otherwise
    inside, outside = whole[:_BLUR].mean(), whole[-_BLUR:].mean()
    share = (mean - outside) / (inside - outside) if inside != outside else np.full(len(near), 0.5)
    crossings = np.flatnonzero((share[:-1] >= 0.5) & (share[1:] < 0.5))
    if not len(crossings):
        return 0.0
    first = crossings[np.abs(near[crossings]).argmin()]
    part = (share[first] - 0.5) / (share[first] - share[first + 1])
    return float(near[first] + part * (near[1] - near[0]))


def _parabola(along: np.ndarray, out: np.ndarray, pixel: float) -> tuple[np.ndarray, float]:
    """Coefficients through places along a side, few of them outliers, and the scatter around it."""
    from scipy.optimize import least_squares

    basis = legvander(along, _DEGREE)
    start = np.zeros(_DEGREE + 1)
    start[0] = np.median(out)
    found = least_squares(lambda x: basis @ x - out, start, loss="soft_l1", f_scale=_scatter(out - start[0], pixel)).x
    return found, _scatter(basis @ found - out, pixel)


def _scatter(left: np.ndarray, pixel: float) -> float:
    """Standard deviation but for outliers, not below half a pixel."""
    return max(1.4826 * float(np.median(np.abs(left))), pixel / 2.0)


def _error(along: np.ndarray, out: np.ndarray, found: np.ndarray, spread: float) -> float:
    """Standard error of a coefficient, from what parts of a side are off."""
    left = np.clip(legval(along, found) - out, -SURELY * spread, SURELY * spread)
    parts = np.array([part.mean() for part in np.array_split(left - left.mean(), _PARTS)])
    return float(np.sqrt((parts**2).sum() / (_PARTS - _DEGREE - 1) / _PARTS))
