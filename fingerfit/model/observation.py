"""What effects on the observation do to a prediction; none of them needs a new simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import evaluate
from fingerfit.model.scales import extent


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
    now : tuple of float
        Share of the test that is over at each step of the study, as `Study.now`.
    """

    effects: tuple[Effect, ...]
    values: Mapping[str, float]
    low: np.ndarray
    high: np.ndarray
    now: tuple[float, ...]

    @classmethod
    def of(
        cls, effects: Iterable[Effect], values: Mapping[str, float], points: np.ndarray, now: tuple[float, ...]
    ) -> Observation | None:
        """Those that are present; None where there is none. `points` are those of the body, mm."""
        present = tuple(effect for effect in effects if effect.observes and effect.present(values))
        return cls(present, values, points.min(axis=0), points.max(axis=0), now) if present else None

    def shift(self, k: int, at: np.ndarray) -> np.ndarray:
        """How far from where they are the picture at the k-th step shows places, mm, shape (..., dim) as theirs."""
        names = {**self._step(k), **places(at, self.low, self.high)}
        axes = [f"shift_{axis}" for axis in "xyz"[: len(self.low)]]
        zero: np.ndarray = np.zeros(at.shape[:-1])
        return np.stack([np.broadcast_to(self._apply(axis, zero, names), zero.shape) for axis in axes], axis=-1)

    def intensity(self, picture: np.ndarray, k: int, *at: np.ndarray) -> np.ndarray:
        """A picture at the k-th step as the scanner shows it; `at`, x, y[, z] in mm, have its shape."""
        names = {**self._step(k), **places(np.stack(at, axis=-1), self.low, self.high)}
        return np.asarray(self._apply("intensity", picture, names))

    def response(self, values: np.ndarray, name: str) -> np.ndarray:
        """Measured ``force`` or ``displacement`` by step."""
        names = {"k": np.arange(1, len(values) + 1), "n": len(self.now), "now": np.array(self.now[: len(values)])}
        return np.asarray(self._apply(name, values, names))

    def _step(self, k: int) -> dict[str, float]:
        return {"k": k, "n": len(self.now), "now": self.now[k - 1] if k else 0.0}

    def _apply(self, what: str, value: Any, names: Mapping[str, Any]) -> Any:
        for effect in self.effects:
            if what not in effect.observes:
                continue
            try:
                known, shape = np.isfinite(value), np.shape(value)
                with np.errstate(all="ignore"):  # what comes out is told, not how
                    own = effect.own(self.values)
                    value = evaluate(effect.observes[what], {**names, what: value, **own})
                if np.shape(value) not in ((), shape):
                    raise ValueError(f"{effect.observes[what]!r} has {np.shape(value)} numbers, not {shape}")
                if not np.isfinite(np.broadcast_to(value, shape)[known]).all():
                    raise ValueError(f"{effect.observes[what]!r} is not finite everywhere")
            except ValueError as error:
                raise InputError(
                    f"effect {effect.name}", f"observes.{what}", error, "a formula of its names"
                ) from error
        return value


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
