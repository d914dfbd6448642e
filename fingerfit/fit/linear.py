"""The prediction near the best guess: linear in the search coordinates (logarithms of constants, shares of a scale)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.fit.objective import Objective
from fingerfit.forward.score import Prediction, deviations, deviations_by_kind, weights
from fingerfit.imaging.similarity import LIMITS, Similar
from fingerfit.study.data import Data

IN_SPACE = 4
"""Axes of the pictures of all steps in space."""


@dataclass(frozen=True)
class LinearModel:
    """Prediction near the best guess: base + sum of slope_i times delta_i, delta in search coordinates.

    Parameters
    ----------
    base : Prediction
        At the best guess; a `JointPrediction` of a study with several tests, as all others are.
    slopes : tuple of Prediction
        Derivatives by the logarithm of each parameter (by multiples of its scale, where it is not on a log scale).
    control : Prediction or None
        Derivative by the relative size of the prescribed quantity, each step by its own; None where nobody asked.
    values : mapping
        The guess that the base belongs to.
    """

    base: Prediction
    slopes: tuple[Prediction, ...]
    control: Prediction | None
    values: Mapping[str, float]

    def at(self, delta: np.ndarray) -> Prediction:
        """Prediction at `delta`, shape (parameters,), from the search's best guess."""
        total = self.base
        for slope, d in zip(self.slopes, delta, strict=True):
            if d:
                total = total + slope * float(d)
        return total

    @cached_property
    def every(self) -> list[LinearModel]:
        """The models of the tests of a study with several; else itself."""
        if isinstance(self.base, Prediction):
            return [self]
        slopes: list[Any] = [*self.slopes, *([self.control] if self.control else [])]
        parts = [(base, [slope.tests[n] for slope in slopes]) for n, base in enumerate(self.base.tests)]
        count = len(self.slopes)
        return [
            LinearModel(base, tuple(own[:count]), own[count] if self.control else None, self.values)
            for base, own in parts
        ]

    @property
    def moving(self) -> np.ndarray:
        """How fast each number moves the pictures of all tests: norms of the slopes, shape (parameters,)."""
        return np.sqrt(np.sum([np.diag(test._products) for test in self.every], axis=0))

    def by_control(self, relative: np.ndarray, data: Data) -> Prediction:
        """Change of the prediction with relative changes of the prescribed quantity, shape (steps,)."""
        if self.control is None:
            raise StateError("the slopes by the prescribed quantity were not asked for")
        return self.control.by_step(relative, data)

    def objective(self, kind: str, data: Data, bins: int, offset: Prediction | None = None) -> Objective:
        """Score against `data` as a function of delta; but for ``nmi`` it is a quadratic one, by inner products."""
        if kind == "nmi":
            return self._similarity(data, bins, offset)
        base = self.base if offset is None else self.base + offset
        pictures, others = weights(kind, data)
        middle, gradient, curvature = self._squares(base.pictures - data.measured, data, pictures)
        if others:
            away = deviations(base, data)
            columns = np.array([deviations(base + slope, data) - away for slope in self.slopes])
            middle += others * _inner(away, away)
            gradient, curvature = gradient + others * columns @ away, curvature + others * columns @ columns.T
        return Objective.quadratic(middle, gradient, curvature)

    def _similarity(self, data: Data, bins: int, offset: Prediction | None) -> Objective:
        """The score ``nmi``; in the plane only those pixels are counted again that the numbers move.

        Of volumes nothing is kept: that would take several times their memory.
        """
        base = self.base if offset is None else self.base + offset
        keeps = data.measured.ndim < IN_SPACE
        moving = moved_pixels(self.slopes) if keeps else np.ones(data.measured.shape[1:], dtype=bool)
        sure = base.partial.sure(base.pictures.shape) if base.partial else [None] * len(base.pictures)
        make = [
            partial(Similar, one, other, moving, bins, LIMITS, share)
            for one, other, share in zip(data.measured, base.pictures, sure, strict=True)
        ]
        kept = [one() for one in make] if keeps else []

        def part(one: Prediction) -> Prediction:
            pictures = one.pictures[:, moving] if keeps else one.pictures.reshape(len(one.pictures), -1)
            return replace(one, pictures=pictures)

        def pairs(delta: np.ndarray) -> Iterator[tuple[Similar, np.ndarray]]:
            return zip(kept or (one() for one in make), near(delta).pictures, strict=True)

        slopes = tuple(part(slope) for slope in self.slopes)
        near = LinearModel(part(base), slopes, None, self.values)._nearby()

        def value(delta: np.ndarray) -> float:
            return -float(np.mean([one.value(picture) for one, picture in pairs(delta)]))

        def gradient(delta: np.ndarray) -> np.ndarray:
            by_pixel = np.array([one.gradient(picture) for one, picture in pairs(delta)])
            return -np.array([_inner(by_pixel, slope.pictures) for slope in slopes]) / len(by_pixel)

        return Objective(value, gradient)

    def misfits(self, data: Data) -> dict[str, Objective]:
        """Chi-square of each kind of data, as `fingerfit.forward.score.chi_square`, as a function of delta."""
        found: dict[str, Objective] = {}
        if data.measured.size and data.picture_noise > 0:
            left, factor = self.base.pictures - data.measured, 0.5 / data.picture_noise**2
            found["pictures"] = Objective.quadratic(*self._squares(left, data, factor))
        by_slope = [deviations_by_kind(self.base + slope, data) for slope in self.slopes]
        for kind, away in deviations_by_kind(self.base, data).items():
            columns = np.array([own[kind] - away for own in by_slope])
            found[kind] = Objective.quadratic(_inner(away, away), columns @ away, columns @ columns.T)
        return found

    def _nearby(self) -> Callable[[np.ndarray], Prediction]:
        """As `at`, but where one or two numbers differ from those of the last whole sum only these are added.

        Finite differences ask for nothing else, and a whole sum over tens of slopes takes longer than its score.
        """
        centre, there = np.zeros(len(self.slopes)), self.base

        def at(delta: np.ndarray) -> Prediction:
            nonlocal centre, there
            changed = np.flatnonzero(delta != centre)
            if len(changed) > 2:
                centre, there, changed = delta.copy(), self.at(delta), changed[:0]
            total = there
            for number in changed:
                total = total + self.slopes[number] * float(delta[number] - centre[number])
            return total

        return at

    def _squares(self, left: np.ndarray, data: Data, factor: float) -> tuple[float, np.ndarray, np.ndarray]:
        """Sum of the squares of a difference of pictures, half its slopes and half its curvature, times a factor."""
        middle, gradient = _inner(left, left), np.array([_inner(left, slope.pictures) for slope in self.slopes])
        products, partial = self._products, self.base.partial
        if partial:
            own = partial.read(left)
            middle -= partial.lacks(own, data)
            gradient = gradient - partial.missing(self._partial, own)
            products = products - partial.missing(self._partial, self._partial.T)
        return factor * middle, factor * gradient, factor * products

    @cached_property
    def _partial(self) -> np.ndarray:
        """The slopes at pixels of partial volume, shape (parameters, pixels)."""
        partial = self.base.partial
        return np.array([partial.read(slope.pictures) for slope in self.slopes if partial])

    @cached_property
    def _products(self) -> np.ndarray:
        """Inner products of the slopes of the pictures, shape (parameters, parameters)."""
        total = np.zeros((len(self.slopes), len(self.slopes)))
        for pictures in zip(*(slope.pictures for slope in self.slopes), strict=True):
            columns = np.stack([picture.ravel() for picture in pictures]).astype(float)
            total += columns @ columns.T
        return total


def moved_pixels(slopes: Sequence[Prediction]) -> np.ndarray:
    """Which pixels any of the slopes moves in any picture, bool, of the shape of a picture."""
    moved: np.ndarray = np.zeros(slopes[0].pictures.shape[1:], dtype=bool)
    for slope in slopes:
        moved |= slope.pictures.any(axis=0)
    return moved


def _inner(one: np.ndarray, other: np.ndarray) -> float:
    """Sum of products in double precision: pictures have single."""
    return float(sum(np.vdot(a.astype(float), b.astype(float)) for a, b in zip(one, other, strict=True)))
