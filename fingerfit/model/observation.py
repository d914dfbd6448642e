"""What effects on the observation do to a prediction; none of them needs a new simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import evaluate
from fingerfit.model.scales import extent

_ITERATIONS, _CLOSE = 50, 1e-6
"""Of the fixed-point iteration for a place, at most, and the change that ends it, mm (far below a pixel). Each one
multiplies the error by the gradient of the shift, 0.4 at a corner for a lens of 5 % at the sides."""


@dataclass(frozen=True)
class Observation:
    """The effects on the observation that a guess has.

    Parameters
    ----------
    effects : tuple of Effect
        Those that are present.
    values : mapping
        The guess.
    low, high : ndarray, shape (dim,)
        Corners of the undeformed body, mm.
    course : tuple of mapping
        What formulas know of each step of the study, as `Study.course`.
    """

    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    low: np.ndarray
    high: np.ndarray
    course: tuple[Mapping[str, float], ...]

    @classmethod
    def of(
        cls,
        effects: Iterable[Effect],
        values: Mapping[str, float],
        points: np.ndarray,
        course: tuple[Mapping[str, float], ...],
    ) -> Observation | None:
        """Those that are present; None where there is none. `points` are those of the body, mm."""
        present = tuple(effect for effect in effects if effect.observes and effect.present(values))
        return cls(present, values, points.min(axis=0), points.max(axis=0), course) if present else None

    @property
    def lit(self) -> bool:
        """Whether one of them changes the brightness."""
        return any("intensity" in effect.observes for effect in self.effects)

    @property
    def moves_first(self) -> bool:
        """Whether one of them shows places elsewhere in the first picture."""
        return any(effect.moves_first for effect in self.effects)

    def shift(self, k: int, at: np.ndarray) -> np.ndarray:
        """How far from where they are the picture at the k-th step shows places, mm, shape (..., dim) as theirs.

        What several effects do adds up.
        """
        return self._shift("shift", k, at)

    def first(self, at: np.ndarray) -> np.ndarray:
        """The same of the first picture, the one before compression."""
        return self._shift("first", 0, at)

    def moved(self, k: int, at: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Displacements of places from the first picture to that at the k-th step, as both show them, mm."""
        return displacement + self.shift(k, at + displacement) - self.first(at)

    def origin(self, seen: np.ndarray) -> np.ndarray:
        """Where the places are that the first picture shows at others, mm, shape (..., dim) as theirs."""
        found = seen
        for _ in range(_ITERATIONS if self.moves_first else 0):
            before, found = found, seen - self.first(found)
            if np.abs(found - before).max(initial=0.0) < _CLOSE:
                break
        return found

    def _shift(self, what: str, k: int, at: np.ndarray) -> np.ndarray:
        names = {**self._step(k), **places(at, self.low, self.high)}
        found: np.ndarray = np.zeros(at.shape)
        for axis, name in enumerate("xyz"[: len(self.low)]):
            for effect in self.effects:
                found[..., axis] += self._changed(effect, f"{what}_{name}", np.zeros(at.shape[:-1]), names)
        return found

    def intensity(self, picture: np.ndarray, k: int, *at: np.ndarray) -> np.ndarray:
        """A picture at the k-th step as the scanner shows it; `at`, x, y[, z] in mm, have its shape."""
        names = {**self._step(k), **places(np.stack(at, axis=-1), self.low, self.high)}
        return self._apply("intensity", picture, names)

    def response(self, values: np.ndarray, name: str) -> np.ndarray:
        """Measured ``force`` or ``displacement`` by step."""
        return self._apply(name, values, by_step(self.course[: len(values)]))

    def _step(self, k: int) -> Mapping[str, float]:
        return self.course[k - 1] if k else unloaded(self.course)

    def _apply(self, what: str, value: np.ndarray, names: Mapping[str, Any]) -> np.ndarray:
        for effect in self.effects:
            value = self._changed(effect, what, value, names)
        return value

    def _changed(self, effect: Effect, what: str, value: np.ndarray, names: Mapping[str, Any]) -> np.ndarray:
        """What one effect makes of a value, in its shape."""
        if what not in effect.observes:
            return value
        formula, known, own = effect.observes[what], np.isfinite(value), effect.own(self.values)
        try:
            with np.errstate(all="ignore"):  # what comes out is told, not how
                found = np.asarray(evaluate(formula, {**names, what: value, **own}))
            if found.shape not in ((), value.shape):
                raise ValueError(f"{formula!r} has {found.shape} numbers, not {value.shape}")
            found = found if found.shape == value.shape else np.full(value.shape, found)
            if not np.isfinite(found[known]).all():
                raise ValueError(f"{formula!r} is not finite everywhere")
        except ValueError as error:
            raise InputError(f"effect {effect.name}", f"observes.{what}", error, "a formula of its names") from error
        return found


def by_step(course: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """What formulas know of all steps (`Study.course`), shape (steps,) each."""
    return {name: np.array([step[name] for step in course]) for name in (course[0] if course else ())}


def unloaded(course: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """What formulas know of the first picture."""
    return {"k": 0.0, "n": float(len(course)), "now": 0.0, "loaded": 0.0, "indented": 0.0}


def places(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    """Names that formulas have for places, mm from the corner of the body.

    Parameters
    ----------
    points : ndarray, shape (..., dim)
    low, high : ndarray, shape (dim,)
        Corners of the body.

    Returns
    -------
    dict
        ``x``, ``y`` and in space ``z``; ``up``, the last of them; ``width``, ``height`` and in space ``breadth``: the
        body's extent along x, upwards, along y.
    """
    place, size = np.moveaxis(points - low, -1, 0), high - low
    found: dict[str, Any] = dict(zip("xyz", place, strict=False))
    return found | {"up": place[-1], **extent(size)}
