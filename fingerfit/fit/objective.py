"""A score near a guess as a function of search coordinates, with its gradient."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Objective:
    """A score at a distance of shape (parameters,) from a guess.

    Parameters
    ----------
    value : callable
        The score.
    gradient : callable
        Its derivatives, shape (parameters,).
    """

    value: Callable[[np.ndarray], float]
    gradient: Callable[[np.ndarray], np.ndarray]

    def __call__(self, delta: np.ndarray) -> float:
        return self.value(delta)

    @classmethod
    def total(cls, parts: Sequence[Objective]) -> Objective:
        """The sum of several."""
        return cls(
            lambda delta: sum(part.value(delta) for part in parts),
            lambda delta: np.sum([part.gradient(delta) for part in parts], axis=0),
        )

    @classmethod
    def quadratic(cls, middle: float, gradient: np.ndarray, curvature: np.ndarray) -> Objective:
        """A value at delta = 0, half a gradient there, shape (parameters,), and half a matrix of second derivatives."""
        return cls(
            lambda delta: middle + float(2.0 * gradient @ delta + delta @ curvature @ delta),
            lambda delta: 2.0 * (gradient + curvature @ delta),
        )

    @classmethod
    def squares(cls, factor: float, left: np.ndarray, columns: np.ndarray) -> Objective:
        """A factor times the sum of the squares of `left`, shape (rows,), less columns times delta."""

        def away(delta: np.ndarray) -> np.ndarray:
            return np.asarray(left - columns @ delta)

        return cls(
            lambda delta: factor * float(np.sum(away(delta) ** 2)),
            lambda delta: -2.0 * factor * columns.T @ away(delta),
        )

    def times(self, factor: float) -> Objective:
        """A multiple of the score."""
        if factor == 1.0:
            return self
        return Objective(lambda delta: factor * self.value(delta), lambda delta: factor * self.gradient(delta))

    def along(self, chosen: np.ndarray, start: np.ndarray) -> Objective:
        """From `start` along the chosen coordinates alone, which are numbers of axes."""

        def at(step: np.ndarray) -> np.ndarray:
            found = start.copy()
            found[chosen] += step
            return found

        return Objective(lambda step: self.value(at(step)), lambda step: self.gradient(at(step))[chosen])
