"""The estimate of a finished search: constants, their uncertainty, what the data cannot tell.

Near the best guess the prediction is linear in the logarithms of the constants; the slopes come from
simulations at either side. A parametric bootstrap then repeats the measurement with new noise - on the picture
before compression, on the pictures during compression, on the prescribed force or displacement and on the
quantities measured beside - and finds the best constants of each repetition by the very score that was used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.forward.score import Prediction, deviations, score, weights
from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.warp import BackwardMap, spline_coefficients, warp
from fingerfit.model.parameters import Parameter, round_value
from fingerfit.study.data import Data

STEP = 0.03
"""Step of the sensitivities: in the logarithm, or as a share of the scale of a parameter."""


def coordinates(parameters: tuple[Parameter, ...], values: Mapping[str, float]) -> np.ndarray:
    """Logarithms, or multiples of the scale of a parameter, shape (parameters,)."""
    return np.array([np.log(values[p.name]) if p.log else values[p.name] / p.scale for p in parameters])


def moved(parameters: tuple[Parameter, ...], values: Mapping[str, float], delta: np.ndarray) -> dict[str, float]:
    """Values at a distance in those coordinates, within the bounds, with the digits of a guess."""
    z = coordinates(parameters, values) + delta
    found = (float(np.exp(x) if p.log else x * p.scale) for p, x in zip(parameters, z, strict=True))
    return {p.name: round_value(min(max(x, p.lower), p.upper)) for p, x in zip(parameters, found, strict=True)}


def sensitivity_values(parameters: tuple[Parameter, ...], best: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """Guesses at either side of the best one, by role ``+name`` and ``-name``; those beyond a bound are left out."""
    found = {}
    at = coordinates(parameters, best)
    for n, (parameter, step) in enumerate(zip(parameters, np.eye(len(parameters)) * STEP, strict=True)):
        for sign, factor in (("+", 1.0), ("-", -1.0)):
            guess = moved(parameters, best, factor * step)
            if abs(abs(coordinates(parameters, guess)[n] - at[n]) - STEP) < 1e-3 * STEP:
                found[sign + parameter.name] = guess
    return found


@dataclass(frozen=True)
class LinearModel:
    """Prediction near the best guess: base + sum of slope_i times delta_i, delta in search coordinates.

    Parameters
    ----------
    base : Prediction
        At the best guess.
    slopes : tuple of Prediction
        Derivatives by the logarithm of each parameter (by the value, where it is not on a log scale).
    control : Prediction or None
        Derivative by the relative size of the prescribed quantity, each step by its own; None where nobody asked.
    values : mapping
        The guess that the base belongs to.
    """

    base: Prediction
    slopes: tuple[Prediction, ...]
    control: Prediction | None
    values: Mapping[str, float]

    def at(self, delta: np.ndarray, offset: Prediction | None = None) -> Prediction:
        """Prediction at `delta`, shape (parameters,), from the search's best guess."""
        total = self.base if offset is None else self.base + offset
        for slope, d in zip(self.slopes, delta, strict=True):
            if d:
                total = total + slope * float(d)
        return total

    def by_control(self, relative: np.ndarray, data: Data) -> Prediction:
        """Change of the prediction with relative changes of the prescribed quantity, shape (steps,)."""
        if self.control is None:
            raise StateError("the slopes by the prescribed quantity were not asked for")
        return self.control.by_step(relative, data)

    def objective(
        self, kind: str, data: Data, bins: int, offset: Prediction | None = None
    ) -> Callable[[np.ndarray], float]:
        """Score against `data` as a function of delta; but for ``nmi`` it is a quadratic one, by inner products."""
        if kind == "nmi":
            return lambda delta: score(kind, self.at(delta, offset), data, bins)
        base = self.base if offset is None else self.base + offset
        pictures, others = weights(kind, data)
        left = base.pictures - data.measured
        middle = pictures * _inner(left, left)
        gradient = pictures * np.array([_inner(left, slope.pictures) for slope in self.slopes])
        curvature = pictures * self._products
        if others:
            away = deviations(base, data)
            columns = np.array([deviations(base + slope, data) - away for slope in self.slopes])
            middle += others * _inner(away, away)
            gradient, curvature = gradient + others * columns @ away, curvature + others * columns @ columns.T
        return lambda delta: middle + float(2.0 * gradient @ delta + delta @ curvature @ delta)

    @cached_property
    def _products(self) -> np.ndarray:
        """Inner products of the slopes of the pictures, shape (parameters, parameters)."""
        total = np.zeros((len(self.slopes), len(self.slopes)))
        for pictures in zip(*(slope.pictures for slope in self.slopes), strict=True):
            columns = np.stack([picture.ravel() for picture in pictures]).astype(float)
            total += columns @ columns.T
        return total


def _inner(one: np.ndarray, other: np.ndarray) -> float:
    """Sum of products in double precision: pictures have single."""
    return float(sum(np.vdot(a.astype(float), b.astype(float)) for a, b in zip(one, other, strict=True)))


class Replicates:
    """Repetitions of the measurement with new noise.

    Parameters
    ----------
    model : LinearModel
        The truth of the repetitions is its base.
    data : Data
        Gives the noise.
    maps : list of BackwardMap
        Maps at the best guess: they carry the noise of the first picture along.
    kind, bins
        As for `score`.
    seed : int
        Of the noise: the same input gives the same digits, whatever the threads.
    threads : int
        Pictures that are warped and smoothed beside each other.
    """

    def __init__(
        self,
        model: LinearModel,
        data: Data,
        maps: list[BackwardMap],
        kind: str,
        bins: int,
        seed: int,
        threads: int = 1,
    ) -> None:
        self.model, self.data, self.maps, self.kind, self.bins = model, data, maps, kind, bins
        self.rng, self._pool = np.random.default_rng(seed), ThreadPoolExecutor(threads)

    def draw(self) -> Callable[[np.ndarray], float]:
        """Score of one repetition as a function of delta, shape (parameters,)."""
        data, base = self.data, self.model.base
        relative = self._control_noise()
        shift = self.model.by_control(relative, data)
        pictures = shift.pictures
        measured = base.pictures
        if data.measured.size:
            noise = spline_coefficients(self._gauss(data.before.shape, data.picture_noise))
            # beside each other, while the noise of the others is drawn
            warped = [self._pool.submit(self._warped, noise, way) for way in self.maps]
            fresh = [self._gauss(picture.shape, data.picture_noise) for picture in base.pictures]
            smoothed = [self._pool.submit(smooth, one, data.smooth) for one in fresh]
            pictures = pictures + np.array([one.result() for one in warped])
            measured = measured + np.array([one.result() for one in smoothed])
        offset = Prediction(pictures, shift.conjugate, shift.points)
        conjugate, spread = data.conjugate
        drawn = np.where(np.isfinite(conjugate), base.conjugate, np.nan)
        drawn = drawn + self._gauss(drawn.shape, spread)
        drawn = drawn + base.conjugate * self._gauss((1,), data.conjugate_gain)
        name = "displacement" if data.control == "force" else "force"
        repeated = replace(
            data,
            measured=measured,
            points_displacement=base.points + self._points_noise(),
            **{name: drawn},
        )
        return self.model.objective(self.kind, repeated, self.bins, offset)

    def _gauss(self, shape: tuple[int, ...], spread: float | np.ndarray) -> np.ndarray:
        return self.rng.normal(0.0, spread, shape) if np.any(spread) else np.zeros(shape)

    def _points_noise(self) -> np.ndarray:
        """Errors of points, alike at several steps, and a shift of all points of a step; shape (points, dim)."""
        data, dim = self.data, self.model.base.points.shape[1]
        noise = np.zeros((len(data.points_step), dim))
        if not data.points_noise > 0:
            return noise
        used = np.unique(data.points_step)
        parts = [np.flatnonzero(data.points_step == step) for step in used]
        values, vectors = np.linalg.eigh(data.between_steps[np.ix_(used, used)])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = self._gauss((max(map(len, parts)), dim, len(used)), 1.0) @ root.T
        for n, part in enumerate(parts):
            noise[part] = drawn[: len(part), :, n] + self._gauss((dim,), data.frame_noise)
        return noise

    def _warped(self, noise: np.ndarray, way: BackwardMap) -> np.ndarray:
        return smooth(warp(noise, 0.0, way), self.data.smooth)

    def _control_noise(self) -> np.ndarray:
        size = np.abs(self.data.controlled)
        spread = self._gauss(size.shape, self.data.control_noise)
        return np.divide(spread, size, out=np.zeros_like(spread), where=size > 0)
