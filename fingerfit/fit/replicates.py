"""Repetitions of the measurement with new noise: a parametric bootstrap (Efron and Tibshirani 1993).

Each repetition has new noise on the picture before compression, on the pictures during compression, on the prescribed
force or displacement and on the quantities measured beside; its score is the very one that was used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fingerfit.fit.linear import IN_SPACE, LinearModel, moved_pixels
from fingerfit.fit.objective import Objective
from fingerfit.fit.observed import Observed
from fingerfit.forward.score import Prediction
from fingerfit.imaging.preprocess import reach_of, smooth
from fingerfit.imaging.warp import BackwardMap, spline_coefficients, warp
from fingerfit.study.data import Data

Window = tuple[slice, ...]


def _window(model: LinearModel, margin: int) -> Window:
    """The part of a picture that the constants and the load move, and a margin of pixels: no other tells of them."""
    moving = moved_pixels([*model.slopes, *([model.control] if model.control else [])])
    found = []
    for axis, size in enumerate(moving.shape):
        at = np.flatnonzero(moving.any(axis=tuple(k for k in range(moving.ndim) if k != axis)))
        first, last = (at[0], at[-1]) if len(at) else (0, 0)
        found.append(slice(max(0, int(first) - margin), min(size, int(last) + margin + 1)))
    return tuple(found)


def _cut(model: LinearModel, window: Window) -> LinearModel:
    def cut(one: Prediction) -> Prediction:
        pictures = np.ascontiguousarray(one.pictures[(slice(None), *window)])
        partial = one.partial and one.partial.cut(one.pictures.shape, window)
        return Prediction(pictures, one.response, one.points, partial)

    control = cut(model.control) if model.control else None
    return LinearModel(cut(model.base), tuple(map(cut, model.slopes)), control, model.values)


def _cut_map(way: BackwardMap, window: Window) -> BackwardMap:
    place = np.array(np.unravel_index(way.pixel, way.shape))
    low, high = (np.array([getattr(own, end) for own in window])[:, None] for end in ("start", "stop"))
    inside = ((place >= low) & (place < high)).all(axis=0)
    shape = tuple(own.stop - own.start for own in window)
    pixel = np.ravel_multi_index(tuple((place - low)[:, inside]), shape)
    index, element, beside = (own[inside] for own in (way.index, way.element, way.beside))
    return replace(way, pixel=pixel, index=index, element=element, beside=beside, shape=shape)


@dataclass(frozen=True)
class _Noise:
    """Noise of one repetition.

    Parameters
    ----------
    control : ndarray, shape (steps,)
        Relative, of the prescribed quantity.
    before : ndarray or None
        Of the picture before compression, not smoothed.
    during : list of ndarray
        Of those during compression, not smoothed.
    response : ndarray, shape (responses,)
        N or mm.
    points : ndarray, shape (points, dim)
        mm.
    partial : ndarray, shape (pixels,)
        What pixels of partial volume during compression have beside, smoothed.
    """

    control: np.ndarray
    before: np.ndarray | None
    during: list[np.ndarray]
    response: np.ndarray
    points: np.ndarray
    partial: np.ndarray


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
    seed : int or sequence of int
        Of the noise: the same input gives the same digits, whatever the threads.
    threads : int
        Repetitions that are made beside each other.
    count : int
        How many are drawn: no more are begun ahead.
    observed : ndarray of bool, shape (parameters,), optional
        Which numbers are those of effects on the observation that the score may not see.

    Attributes
    ----------
    squares : Observed or None
        What finds these by least squares.
    moves : list of ndarray
        Their moves in the repetitions that were drawn, shape (numbers,) each; what the constants do is not in them.
    """

    def __init__(
        self,
        model: LinearModel,
        data: Data,
        maps: list[BackwardMap],
        kind: str,
        bins: int,
        seed: int | Sequence[int],
        threads: int = 1,
        count: int = 1,
        observed: np.ndarray | None = None,
    ) -> None:
        self.data, self.kind, self.bins, self.share = data, kind, bins, 1.0
        # volumes are cut to where constants move them: that saves half a minute of an estimate (decision 39)
        if kind != "nmi" and data.measured.ndim == IN_SPACE:
            window = _window(model, reach_of(data.smooth))
            if kind == "ssd":  # a mean over all pixels
                self.share = float(np.prod([own.stop - own.start for own in window])) / data.measured[0].size
            model, maps = _cut(model, window), [_cut_map(way, window) for way in maps]
        self.model, self.maps = model, maps
        self.rng, self._pool = np.random.default_rng(seed), ThreadPoolExecutor(threads)
        self._left, self._threads = count, threads
        self._begun = deque[Future[tuple[Objective, np.ndarray]]]()
        self.squares = Observed(observed, data, model) if observed is not None and observed.any() else None
        self.moves = list[np.ndarray]()

    def draw(self) -> Objective:
        """Score of one repetition as a function of delta, shape (parameters,)."""
        while not self._begun or (self._left > 0 and len(self._begun) < self._threads):
            self._begun.append(self._pool.submit(self._objective, self._noise()))
            self._left -= 1
        objective, moves = self._begun.popleft().result()
        self.moves.append(moves)
        return objective

    def close(self) -> None:
        """End the threads: nothing is drawn afterwards."""
        self._pool.shutdown(cancel_futures=True)

    def _noise(self) -> _Noise:
        """All noise of a repetition; drawn by one thread, so that digits do not depend on their number."""
        data, base = self.data, self.model.base
        control, before, during = self._control_noise(), None, list[np.ndarray]()
        if data.measured.size:
            before = self._gauss(data.before.shape, data.picture_noise)
            during = [self._gauss(picture.shape, data.picture_noise) for picture in base.pictures]
        response = self._gauss(base.response.shape, data.response[1])
        response = response + base.response * self._gauss((1,), data.response_gain)
        points = self._points_noise()
        partial = base.partial.noise(data.picture_noise, self.rng) if base.partial else np.zeros(0)
        return _Noise(control, before, during, response, points, partial)

    def _objective(self, noise: _Noise) -> tuple[Objective, np.ndarray]:
        data, base = self.data, self.model.base
        shift = self.model.by_control(noise.control, data)
        pictures, measured = shift.pictures, base.pictures
        if noise.before is not None:
            carried = spline_coefficients(noise.before)
            pictures = pictures + np.array([self._warped(carried, way) for way in self.maps])
            measured = measured + np.array([smooth(one, data.smooth) for one in noise.during])
        if base.partial:
            measured.reshape(-1)[base.partial.pixel] += noise.partial
        offset = Prediction(pictures, shift.response, shift.points)
        along, lateral = data.split(np.where(np.isfinite(data.response[0]), base.response, np.nan) + noise.response)
        responses: dict[str, Any] = {data.response_name(0)[0]: along, "lateral_force": lateral}
        repeated = replace(data, measured=measured, points_displacement=base.points + noise.points, **responses)
        moves = self.squares.repeated(offset, repeated) if self.squares else np.zeros(0)
        return self.model.objective(self.kind, repeated, self.bins, offset).times(self.share), moves

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
