"""What the formulas of effects make of a number or array of a deck."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import evaluate


def changed_by(
    what: str, value: Any, names: Mapping[str, Any], present: Sequence[Effect], values: Mapping[str, float]
) -> Any:
    """A number or array after the formulas of the effects that are present."""
    for effect in present:
        if what not in effect.changes:
            continue
        try:
            with np.errstate(all="ignore"):  # what comes out is told, not how
                value = evaluate(effect.changes[what], {**names, what: value, **effect.own(values)})
            if not np.isfinite(value).all():
                raise ValueError(f"{effect.changes[what]!r} is not finite everywhere")
        except ValueError as error:
            raise InputError(f"effect {effect.name}", f"changes.{what}", error, "a formula of its names") from error
    return value
