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


def warmed(
    material: AnyMaterial, chosen: np.ndarray, table: Sequence[tuple[float, Any]], at: np.ndarray
) -> AnyMaterial:
    """A material of many points with the constants that some of them have at their temperatures.

    Constants are linear between the temperatures of the table and stay beyond its ends, as in ABAQUS and CalculiX.

    Parameters
    ----------
    material : material
        As of `spread`.
    chosen : ndarray of int, shape (k,)
        Points of the material that the table is of.
    table : sequence of (float, material)
        Temperatures from the lowest on, and the material there, with the same `structure_of`.
    at : ndarray, shape (k,)
        Temperatures of these points.
    """
    temperatures = [one for one, _ in table]
    return _warmed(material, chosen, temperatures, [one for _, one in table], at)


def _warmed(base: Any, chosen: np.ndarray, temperatures: list[float], items: list[Any], at: np.ndarray) -> Any:
    if base is None or isinstance(base, bool):
        return base
    if hasattr(base, "__dataclass_fields__"):
        names = [f.name for f in fields(base)]
        columns = ([getattr(item, name) for item in items] for name in names)
        named = zip(names, columns, strict=True)
        return type(base)(**{name: _warmed(getattr(base, name), chosen, temperatures, own, at) for name, own in named})
    if isinstance(base, tuple):
        parts = zip(base, zip(*items, strict=True), strict=True)
        return tuple(_warmed(one, chosen, temperatures, list(own), at) for one, own in parts)
    found = np.array(base, dtype=float)
    found[chosen] = np.interp(at, temperatures, items)
    return found


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
