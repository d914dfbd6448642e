"""Slopes: the guesses at either side of one, and the derivative of what they lead to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from fingerfit.model.parameters import Parameter, round_value
from fingerfit.search.descent import STEP

TENTH, LEAST = 0.1, 0.01
"""Share of what there is of an effect by which its numbers are changed for a slope, and the shortest such step as a
share of the usual one. Choices, made after a single fit (docs/decisions/0004-parametric-bootstrap.md)."""
Measured = TypeVar("Measured", bound=Any)
"""What a solution leads to: a prediction, or an array."""


def coordinates(parameters: Sequence[Parameter], values: Mapping[str, float]) -> np.ndarray:
    """Logarithms, or multiples of the scale of a parameter, shape (parameters,)."""
    return np.array([np.log(values[p.name]) if p.log else values[p.name] / p.scale for p in parameters])


def bounds_of(parameters: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds in those coordinates, each of shape (parameters,)."""
    low, high = (coordinates(parameters, {p.name: getattr(p, end) for p in parameters}) for end in ("lower", "upper"))
    return low, high


def evenly(parameters: Sequence[Parameter]) -> np.ndarray:
    """Precision of numbers that are as likely anywhere between their bounds, in those coordinates: (parameters,)."""
    low, high = bounds_of(parameters)
    return np.asarray(12.0 / (high - low) ** 2)


def moved(parameters: tuple[Parameter, ...], values: Mapping[str, float], delta: np.ndarray) -> dict[str, float]:
    """Values at a distance in those coordinates, within the bounds, with the digits of a guess."""
    z = coordinates(parameters, values) + delta
    found = (float(np.exp(x) if p.log else x * p.scale) for p, x in zip(parameters, z, strict=True))
    return {p.name: round_value(min(max(x, p.lower), p.upper)) for p, x in zip(parameters, found, strict=True)}


def neighbours(
    parameters: tuple[Parameter, ...], best: Mapping[str, float], absent: Mapping[str, float] | None = None
) -> dict[str, dict[str, float]]:
    """Guesses at either side of the best one, by role ``+name`` and ``-name``; those beyond a bound are left out.

    Parameters
    ----------
    parameters : tuple of Parameter
    best : mapping
    absent : mapping, optional
        Numbers of effects where these are absent: they are changed by a tenth of what there is of the effect, where
        that is less than the usual step. Over a longer one its pictures do not change in proportion.
    """
    found = {}
    at = coordinates(parameters, best)
    null = coordinates(parameters, {**best, **(absent or {})})
    steps = np.where(null == at, STEP, np.clip(TENTH * np.abs(at - null), LEAST * STEP, STEP))
    for n, (parameter, step) in enumerate(zip(parameters, np.diag(steps), strict=True)):
        for sign, factor in (("+", 1.0), ("-", -1.0)):
            guess = moved(parameters, best, factor * step)
            if abs(abs(coordinates(parameters, guess)[n] - at[n]) - steps[n]) < 1e-3 * steps[n]:
                found[sign + parameter.name] = guess
    return found


def step_to(parameter: Parameter, guess: Mapping[str, float], best: Mapping[str, float]) -> float:
    """How far a guess of `neighbours` is from the one between, in search coordinates."""
    there, here = (coordinates((parameter,), values)[0] for values in (guess, best))
    return float(abs(there - here))


def step_of(name: str, by_role: Mapping[str, Any], parameters: Sequence[Parameter], best: Mapping[str, float]) -> float:
    """The step of a slope by a number, from the guesses by role; the usual one by the prescribed quantity."""
    parameter = next((p for p in parameters if p.name == name), None)
    asked = by_role.get("+" + name) or by_role.get("-" + name)
    return step_to(parameter, asked.values, best) if parameter and asked else STEP


def difference(
    ahead: Measured | None, behind: Measured | None, middle: Callable[[], Measured | None], step: float = STEP
) -> Measured | None:
    """Derivative by a number from what lies a step ahead and a step behind of a guess.

    Parameters
    ----------
    ahead, behind : optional
        None where there is no solution.
    middle : callable
        Gives what lies at the guess itself: asked for where only one side is known.
    step : float
        In search coordinates, or in the number's own unit.

    Returns
    -------
    As given
        Central where both sides are known, one-sided where one is; None where none is.
    """
    known = (ahead is not None) + (behind is not None)
    if known == 1:
        ahead, behind = (middle() if side is None else side for side in (ahead, behind))
    if ahead is None or behind is None:
        return None
    slope: Measured = (ahead - behind) * (1.0 / (step * known))
    return slope
