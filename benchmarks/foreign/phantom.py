"""The paper's phantom, 12 x 12 x 70 mm, pressed by 29 %: cases in plain numbers, for looking at (`--half phantom`).

Other halves press by 11 to 19 %. Here sides fold over the glued edges, and elements there are deformed much more.
Amounts are given, no sizes: what they come to stands in the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cases import Case, Hidden
from rules import RULES, Rule

OUT_OF_PLANE = Rule("out of plane", ("state", "loading"), "swelling", ("growing",), 0.0, 0.0)
"""The phantom is not held in its length: no case of other halves."""

SETTING: Mapping[str, Any] = {
    "dimension": 2,
    "width": 12.0,
    "heights": [4.0, 4.0, 4.0],
    "names": ["top", "middle", "bottom"],
    "thickness": 70.0,
    "mu": [0.0211, 0.0357, 0.0656],
    "alpha": 1.4,
    "poisson": 0.495,
    "rows": 24,
    "compress": 3.5 / 12,
    "steps": 7,
    "times": [60.0 * step for step in range(1, 8)],
    "pictured": list(range(1, 8)),
    "fitted": [1, 3, 5, 7],
    "control": "force",
    "seen": "pictures",
    "picture": {
        "pixel": 0.098,
        "texture": "grain",
        "grain": 4.5,
        "contrast": 0.2,
        "looks": [0.506, 0.506, 0.506],
        "blur": 0.8,
    },
    "noise": {"picture": 0.02, "force_share": 0.005, "displacement": 0.01, "points": 0.015},
    "model_mesh": "usual",
}
FINE = {"nothing-b": 40}
"""Rows of the data's mesh in cases that have more than the setting says."""

HOLE = {"across": 0.65, "along": 0.45, "radius": 1.2, "aspect": 1.1, "turn": 0.0}
TABLE: Mapping[str, tuple[tuple[str, str, float, Mapping[str, float]], ...]] = {
    "base-free": (("base slip", "springs", 400.0, {}),),
    "base-limited": (("base slip", "limited", 60.0, {}),),
    "void": (("inclusion", "ellipse", -4.0, HOLE),),
    "left-right": (("sideways gradient", "steady", 1.0, {}),),
    "interface": (("interface", "moved", 0.045, {"which": 0.0}),),
    "turned": (("turn", "constant", 0.6, {}),),
    "stretched": (("stretch", "both", 0.01, {}),),
    "tilt-onset": (("tilt", "growing", 0.01, {}), ("onset", "constant", 0.03, {})),
    "swelling": (("swelling", "all", 0.015, {"layer": 0.0}),),
    "drying": (("drying", "steady", 0.015, {}),),
    "out-of-plane": (("out of plane", "growing", 0.03, {}),),
    "fibres35": (("oblique fibres", "one family", 0.25, {"angle": 35.0}),),
    "wall": (("wall", "right", 0.02, {"gap": 0.02}),),
    "relaxed": (("relaxation", "one term", 0.34, {"time": 15.0}),),
    "nothing-a": (),
    "nothing-b": (),
}
"""Kind, form, amount and numbers of what is hidden, by name of the case."""


def phantoms() -> list[Case]:
    """All cases, in the order of the table."""
    return [
        _case(name, number, tuple(_hidden(*one) for one in TABLE[name])) for number, name in enumerate(TABLE, start=100)
    ]


def _case(name: str, number: int, hidden: tuple[Hidden, ...]) -> Case:
    family = hidden[0].families[0] if len(hidden) == 1 else "pair" if hidden else "nothing"
    return Case(name, "phantom", number, family, hidden, {**SETTING, "rows": FINE.get(name, SETTING["rows"])})


def _hidden(kind: str, form: str, amount: float, numbers: Mapping[str, float]) -> Hidden:
    rule = next(rule for rule in (*RULES, OUT_OF_PLANE) if rule.kind == kind)
    sign, much = (-1, -amount) if amount < 0 else (1, amount)
    return Hidden(kind, form, rule.families, rule.member, 0.0, sign, much, much, numbers)
