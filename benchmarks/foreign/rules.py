"""The rules of the table: what may be hidden, in which forms, and in which studies. Numbers are drawn in cases.py."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

FAMILIES = (
    "material", "structure", "base", "indenter", "loading", "state", "geometry", "observation", "numerics",
)  # fmt: skip
"""Families of effects: material law; stiffness from place to place; base; indenter and other boundaries; loading and
time; state before the first picture; interfaces and outline; observation; numerics."""
SIZES = {"trace": 0.3, "weak": 0.7, "clear": 1.5, "strong": 4.0, "largest": 10.0}
"""Sizes that are asked for, in units of the noise (README.md); each is varied by up to 15 %."""


@dataclass(frozen=True)
class Rule:
    """One kind of hidden effect.

    Parameters
    ----------
    kind : str
        Name of the function in effects.py or observing.py.
    families : tuple of str
        Where an answer may put it, the first one first: some effects are rightly called by two names.
    member : str or None
        Effect of fingerfit's catalogue that means the same, if there is one.
    forms : tuple of str
        Forms that it may take.
    start, largest : float
        Amount from which the generator looks for the size, and the largest it takes.
    numbers : mapping
        Further numbers: between which bounds each is drawn.
    signs : tuple of int
        Signs of the amount.
    count : int
        Cases of this kind in a half, each of another form while there are forms.
    setting : mapping
        What the study must have so that the effect can be told.
    """

    kind: str
    families: tuple[str, ...]
    member: str | None
    forms: tuple[str, ...]
    start: float
    largest: float
    numbers: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    signs: tuple[int, ...] = (1,)
    count: int = 1
    setting: Mapping[str, Any] = field(default_factory=dict)


BOTH = (-1, 1)
PLACE = {"across": (0.2, 0.8), "along": (0.2, 0.8)}
LAYERED = {"layers": (2, 3, 4)}
FORCE = {"control": ("force",)}

RULES = (
    # material law
    Rule("stiffening", ("material",), "stiffening", ("exponential", "quadratic", "cubic", "saturating"), 0.3, 30.0,
         count=3),
    Rule("softening", ("material",), "stiffening", ("logarithm", "exponential"), 0.4, 0.9, {"rate": (2.0, 8.0)}),
    Rule("second invariant", ("material",), "second_term", ("mooney", "ogden"), 0.4, 0.95, {"power": (2.5, 6.0)}),
    Rule("compressibility", ("material",), "compressibility", ("quadratic", "logarithm", "mixed"), 0.01, 0.15),
    Rule("fibres", ("material",), "fibres", ("square", "exponential"), 0.5, 30.0),
    Rule("oblique fibres", ("material",), "fibres", ("one family", "two families"), 0.5, 60.0, {"angle": (20.0, 40.0)},
         BOTH),
    Rule("one layer stiffens", ("material", "structure"), "layer_stiffening", ("exponential", "quadratic"), 1.0, 60.0,
         {"layer": (0.0, 1.0)}, setting=LAYERED),
    # structure
    Rule("inclusion", ("structure",), "inclusion", ("ellipse", "box", "triangle", "ring", "smooth"), 0.6, 3.0,
         {**PLACE, "radius": (0.8, 1.8), "aspect": (0.6, 1.6), "turn": (0.0, 90.0)}, BOTH, 2),
    Rule("two inclusions", ("structure",), None, ("ellipse", "box"), 0.6, 3.0,
         {**PLACE, "radius": (0.7, 1.3), "aspect": (0.7, 1.4), "turn": (0.0, 90.0)}, BOTH),
    Rule("gradient", ("structure",), "gradient", ("linear modulus", "cosine"), 0.5, 1.8, {}, BOTH, setting=LAYERED),
    Rule("sideways gradient", ("structure",), "sideways_gradient", ("steady", "edge"), 0.4, 3.0, {}, BOTH),
    Rule("gradient of the body", ("structure",), "body_gradient", ("parabola", "exponential"), 0.5, 3.0, {}, BOTH),
    Rule("film", ("structure",), "skin", ("sharp", "fading"), 0.8, 3.0, {"thickness": (0.4, 1.2)}, BOTH),
    Rule("split layer", ("structure",), "split_layer", ("half", "unequal"), 0.5, 2.0,
         {"layer": (0.0, 1.0), "share": (0.35, 0.65)}, BOTH, setting=LAYERED),
    Rule("stripes", ("structure",), None, ("upright", "oblique"), 0.6, 2.0, {"waves": (1.5, 4.0)}),
    # base
    Rule("base slip", ("base",), "base_slip", ("springs", "limited", "left", "right", "middle", "edges"), 5.0, 2000.0,
         {"share": (0.35, 0.6)}, count=3),
    Rule("bed", ("base",), "soft_bed", ("steady", "softer on one side"), 1.0, 60.0),
    # indenter and other boundaries
    Rule("indenter slip", ("indenter",), "indenter_slip", ("springs", "limited", "left", "edges"), 5.0, 300.0,
         {"share": (0.35, 0.6)}),
    Rule("tilt", ("indenter",), "tilt", ("growing", "settling", "late"), 0.005, 0.06, {}, BOTH),
    Rule("curved indenter", ("indenter",), None, ("round", "hollow"), 0.05, 0.8),
    Rule("sideways motion", ("indenter",), "sideways", ("growing", "late"), 0.03, 0.6, {}, BOTH),
    Rule("wall", ("indenter",), "wall", ("right", "left", "both"), 0.01, 5.0, {"gap": (0.02, 0.06)}),
    # loading and time
    Rule("relaxation", ("loading", "material"), "relaxation", ("one term", "power law"), 0.15, 0.8,
         {"time": (5.0, 60.0)}, setting={"schedule": ("uneven",)}),
    Rule("ageing", ("loading", "material"), "ageing", ("all", "one layer"), 0.1, 1.5, {"layer": (0.0, 1.0)}, BOTH),
    Rule("force offset", ("loading", "observation"), "force_offset", ("constant", "guide"), 0.02, 0.3, {}, BOTH,
         setting=FORCE),
    Rule("onset", ("loading", "observation"), "onset", ("constant", "settling"), 0.01, 0.08, {}, BOTH, setting=FORCE),
    Rule("soft frame", ("loading", "observation"), "soft_frame", ("steady", "stiffening"), 0.05, 0.4),
    Rule("bent force", ("loading", "observation"), "nonlinear_sensor", ("square", "root"), 0.05, 0.5, {}, BOTH),
    # state before the first picture
    Rule("preload", ("state", "loading"), "preload", ("pressed",), 0.02, 0.1, setting=FORCE),
    Rule("swelling", ("state",), "swollen", ("all", "one layer"), 0.01, 0.12, {"layer": (0.0, 1.0)}, BOTH),
    Rule("stretched before", ("state",), "prestretch", ("all", "one layer"), 0.01, 0.15, {"layer": (0.0, 1.0)}, BOTH),
    Rule("drying", ("state", "loading"), "swelling", ("steady", "fading"), 0.005, 0.06),
    # geometry
    Rule("interface", ("geometry",), "interface", ("moved", "inclined", "waved"), 0.03, 0.12, {"which": (0.0, 1.0)},
         BOTH, 2,
         LAYERED),
    Rule("outline", ("geometry",), "outline", ("tapered", "bulging", "sheared", "wider"), 0.02, 0.12, {}, BOTH, 2),
    # observation
    Rule("shift", ("observation",), "misregistration", ("constant",), 0.05, 0.6, {"direction": (0.0, 360.0)},
         setting={"seen": ("pictures",)}),
    Rule("wandering", ("observation",), "wandering_pictures", ("growing", "jumping"), 0.05, 0.6,
         {"direction": (0.0, 360.0)},
         setting={"seen": ("pictures",)}),
    Rule("turn", ("observation",), "turned_pictures", ("constant", "growing"), 0.5, 4.0, {}, BOTH,
         setting={"seen": ("pictures",)}),
    Rule("stretch", ("observation",), "stretched_pictures", ("both", "across", "along", "shear"), 0.005, 0.05, {}, BOTH,
         setting={"seen": ("pictures",)}),
    Rule("lens", ("observation",), "distorted_pictures", ("barrel",), 0.01, 0.08, {}, BOTH,
         setting={"seen": ("pictures",)}),
    Rule("drift", ("observation",), "intensity_drift", ("saturating", "contrast", "jumping"), 0.05, 0.45, {}, BOTH,
         setting={"seen": ("pictures",)}),
    Rule("bias", ("observation",), "bias_field", ("spot", "parabola", "steady"), 0.05, 0.45,
         {"direction": (0.0, 360.0)}, BOTH,
         setting={"seen": ("pictures",)}),
    # numerics: of the model, not of the data
    Rule("coarse model", ("numerics",), "coarse_mesh", ("of the paper", "linear"), 1.0, 1.0, count=2),
)  # fmt: skip

PAIRS = (
    ("tilt", "onset"), ("stiffening", "base slip"), ("inclusion", "drift"), ("compressibility", "indenter slip"),
    ("gradient", "shift"), ("film", "swelling"), ("fibres", "force offset"),
)  # fmt: skip
"""Kinds that are hidden together; a half has three of them."""
SPACE = ("nothing", "stiffening", "inclusion", "base slip", "shift")
"""Kinds that are hidden in space, once in each half."""
SPACE_FORMS = {
    "stiffening": ("exponential", "quadratic"),
    "inclusion": ("ellipse", "box"),
    "base slip": ("springs", "left"),
    "shift": ("constant",),
}
SPACE_NUMBERS = {"inclusion": {"radius": (2.2, 3.0), "aspect": (0.8, 1.25)}}
"""Bounds that are others in space: a voxel is half a millimetre."""

VARIATIONS: dict[str, dict[str, tuple[Any, ...]]] = {
    "plain": {},
    "fine mesh": {"rows": (40, 44), "compress": (0.12, 0.16)},
    "coarse mesh": {"rows": (14, 18)},
    "wide": {"width": (60.0,), "layers": (2, 3)},
    "less wide": {"width": (32.0, 40.0)},
    "one layer": {"layers": (1,)},
    "two layers": {"layers": (2,)},
    "four layers": {"layers": (4,)},
    "dots": {"texture": ("dots",)},
    "cells": {"texture": ("cells",)},
    "layers that look alike": {"looks": ("alike",)},
    "blurred": {"blur": (1.4, 2.0)},
    "sharp": {"blur": (0.3, 0.5)},
    "noisy pictures": {"picture_noise": (0.04, 0.06)},
    "quiet": {"picture_noise": (0.006, 0.01), "force_noise": (0.001, 0.002)},
    "noisy forces": {"force_noise": (0.02, 0.03)},
    "displacement control": {"control": ("displacement",)},
    "three steps": {"steps": (3,)},
    "one picture": {"pictured": ("last",)},
    "points": {"seen": ("points",), "control": ("displacement",)},
    "forces alone": {"seen": ("forces",), "layers": (1,), "control": ("displacement",)},
    "other exponent": {"alpha": (2.0, 3.0)},
    "other Poisson ratio": {"poisson": (0.48, 0.49)},
}
"""Studies in which nothing is hidden: what each has otherwise; two values are bounds, or a choice where not floats."""
