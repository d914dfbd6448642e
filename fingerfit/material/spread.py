"""Materials of many points as one material whose constants are arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from fingerfit.material.isotropic import Isotropic

AnyMaterial = TypeVar("AnyMaterial", bound=Isotropic)


def structure_of(material: Any) -> tuple:
    """What two materials have in common when `spread` can put them together: their kind and their numbers of terms."""
    shape: list[Any] = [type(material)]
    for field in fields(material):
        value = getattr(material, field.name)
        if isinstance(value, tuple):
            shape.append(len(value))
        elif value is None or isinstance(value, bool):
            shape.append(value)
        elif hasattr(value, "__dataclass_fields__"):
            shape.append(structure_of(value))
    return tuple(shape)


def spread(materials: Sequence[AnyMaterial], counts: Sequence[int]) -> AnyMaterial:
    """One material with constants of shape (points,), for runs of points that share a material.

    Parameters
    ----------
    materials : sequence of materials
        All with the same `structure_of`.
    counts : sequence of int
        Points of each, in order.
    """
    return _spread(materials, counts)


def _spread(items: Sequence[Any], counts: Sequence[int]) -> Any:
    first = items[0]
    if first is None or isinstance(first, bool):
        return first
    if hasattr(first, "__dataclass_fields__"):
        values = {f.name: _spread([getattr(item, f.name) for item in items], counts) for f in fields(first)}
        return type(first)(**values)
    if isinstance(first, tuple) and first and not isinstance(first[0], tuple):
        return tuple(np.repeat(row, counts) for row in zip(*items, strict=True))
    if isinstance(first, tuple):
        return tuple(np.repeat(np.array(row), counts, axis=0) for row in zip(*items, strict=True))
    return np.repeat(items, counts)
