"""A model with one effect more: its settings, started where the model without it stopped, and its rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.settings.config import Settings, load_settings
from fingerfit.study.several import AT

EVERYWHERE = (-math.inf, math.inf)
"""Bounds of shares of what no study says."""
EDGE = 0.02
"""How near to a bound a start may be, as a share of the scale of its parameter."""


def extended(
    settings: Settings,
    effect: Effect,
    place: Mapping[str, float],
    size: Mapping[str, float],
    values: Mapping[str, float],
) -> Settings:
    """Settings of a model with one effect more.

    Parameters
    ----------
    settings : Settings
        Of the model without it.
    effect : Effect
    place, size : mapping
        Its scanned numbers, by their names in a guess, and the size that was predicted, by short names; those that a
        test has for itself with its name, as ``gain@wide``.
    values : mapping
        Estimate of the model without it: where the search starts.
    """
    data: dict[str, Any] = settings.model_dump(mode="json")
    model = data["model"]
    for name, entry in model["parameters"].items():
        found = [values[key] for key in settings.names_of(name)]
        start = sum(found) / len(found)  # of a constant that each test has for itself, in the middle of them
        entry["start"] = min(max(start, entry["lower"]), entry["upper"])
    bounds = {(one.name, key): pair for one in settings.effects() for key, pair in one.bounds().items()}
    for name, numbers in model["effects"].items():
        known = {key.split(".")[1]: v for key, v in values.items() if key.split(".")[0] == name}
        ends_of = {key: bounds.get((name, key.partition(AT)[0]), EVERYWHERE) for key in known}
        numbers.update({key: _within(v, ends_of[key]) for key, v in known.items()})
    ends = effect.bounds()
    places = {name.split(".")[1]: value for name, value in place.items()}
    own = {name: _within(value, ends.get(name.partition(AT)[0], EVERYWHERE)) for name, value in places.items()}
    for p in effect.parameters:
        edge = EDGE * p.scale
        low, high = ends.get(p.name, EVERYWHERE)
        given = {p.name: p.null} | {key: value for key, value in size.items() if key.partition(AT)[0] == p.name}
        own |= {key: _within(value, (low + edge, high - edge)) for key, value in given.items()}
    model["effects"][effect.name] = own
    return load_settings(data, "config.yaml")


def with_model(settings: Settings, **keys: Any) -> Settings:
    """Settings with other keys of the model."""
    return settings.model_copy(update={"model": settings.model.model_copy(update=keys)})


def rivals(
    settings: Settings,
    effect: str,
    values: Mapping[str, float],
    named: Sequence[str],
    intervals: Mapping[str, Mapping[str, Sequence[float]]],
) -> dict[str, dict[str, tuple[float, float]]]:
    """Models whose last effect the data could not tell from this one, and how far from it they have the constants.

    Parameters
    ----------
    settings : Settings
        Of the model without any of these effects.
    effect : str
        The one that is added.
    values : mapping
        Of all numbers, as its refit has them.
    named : sequence of str
        Effects that the diagnosis of that model named.
    intervals : mapping
        95 % intervals of all numbers by effect, where each was refitted.

    Returns
    -------
    dict
        By name of the model, as ``model.rivals`` of config.yaml has them; empty where `effect` is the only one, or none
        of them.
    """
    if effect not in named:
        return {}

    def away(p: Parameter, ends: Sequence[float]) -> tuple[float, float]:
        low, high = (end / values[p.name] if p.log else end - values[p.name] for end in ends)
        return low, high

    others = {other: intervals[other] for other in named if other != effect and other in intervals}
    return {
        f"{settings.model.full_name}+{other}": {p.name: away(p, ends[p.name]) for p in settings.parameters()}
        for other, ends in others.items()
    }


def _within(value: float, bounds: tuple[float, float]) -> float:
    return min(max(value, bounds[0]), bounds[1])
