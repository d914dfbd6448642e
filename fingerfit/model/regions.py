"""The effect of a region that a study names: it is stiffer or softer than the layers that it lies in."""

from __future__ import annotations

from collections.abc import Iterable

from fingerfit.model.effect import Effect, EffectParameter

PREFIX = "region_"
"""Beginning of the names of these effects."""
WIDEST = 4.0
"""Bound of the logarithm of a region's mu over its layer's: a factor of 55. A choice."""
INSIDE = "inside_"
"""Beginning of the names that formulas have for what is inside a region: 1 there, 0 elsewhere."""


def region_effects(names: Iterable[str]) -> dict[str, Effect]:
    """An effect for each region, by its name; its number is the logarithm of mu over that of the layer around it.

    >>> list(region_effects(["scar"]))
    ['region_scar']
    """
    return {
        PREFIX + name: Effect(
            PREFIX + name,
            f"another stiffness of the region {name}",
            "structure",
            f"The region {name} is stiffer or softer than the layer that it lies in.",
            "Material flows around what is stiffer, and through what is softer; the residual is largest there.",
            "Palpation or elastography of the region, or a test of a sample of it.",
            (EffectParameter("contrast", "log", 0.0, -WIDEST, WIDEST, 0.2),),
            changes={"field": f"contrast * {INSIDE}{name}"},
            needs=("displacements",),
            family="structure",
        )
        for name in names
    }
