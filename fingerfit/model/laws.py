"""Hyperelastic laws of a body's layers: their constants, with units and limits."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from fingerfit.core.errors import InputError
from fingerfit.model.effect import Effect

OGDEN = "ogden"
EXPONENT = math.floor(math.log(sys.float_info.max))
"""Largest exponent of Ogden's law, either way: its powers of a stretch of e, or of its reciprocal, stay in double
precision, since e^709 does."""
FLAT = sys.float_info.epsilon**0.25
"""Smallest one: the law's energy is a difference of powers near 1, known to epsilon, over the square of the exponent.
At this one half of its digits are left; an exponent of 0 stands for a law that is not Ogden's."""


@dataclass(frozen=True)
class Constant:
    """A constant of a law.

    Parameters
    ----------
    unit : str
        ``MPa`` or ``1``.
    low, high : float
        Limits, which it does not reach.
    expected : str
        The same in words.
    least : float
        As far from 0, either way, it must be.
    """

    unit: str
    low: float
    high: float
    expected: str
    least: float = 0.0


_MU = Constant("MPa", 0.0, math.inf, "above 0")
_POISSON = Constant("1", -1.0, 0.5, "between -1 and 0.5")
_EXPONENT = Constant(
    "1", -float(EXPONENT + 1), float(EXPONENT + 1), f"not 0: {FLAT:.2g} to {EXPONENT}, or as far below 0", FLAT
)
_SHARE = Constant("1", math.nextafter(0.0, -1.0), 1.0, "from 0 to below 1")
_TERM = Constant("1", -math.inf, math.inf, "a finite number")


LAWS: Mapping[str, Mapping[str, Constant]] = {
    OGDEN: {"mu": _MU, "alpha": _EXPONENT, "poisson": _POISSON},
    "ogden2": {
        "mu": _MU, "alpha": _EXPONENT, "share": _SHARE,
        "alpha2": _EXPONENT, "poisson": _POISSON,
    },
    "neo_hooke": {"mu": _MU, "poisson": _POISSON},
    "mooney_rivlin": {"mu": _MU, "share": _SHARE, "poisson": _POISSON},
    "yeoh": {"mu": _MU, "c2": _TERM, "c3": _TERM, "poisson": _POISSON},
}  # fmt: skip
"""Laws by name: their constants, in the order in which a search ties them. Each has a card in ``templates/energy``."""


def impossible(where: Path | str, field: str, constant: Constant, value: float) -> list[InputError]:
    """A problem where a constant has a value that it cannot have."""
    if constant.low < value < constant.high and abs(value) >= constant.least:
        return []
    return [InputError(where, field, f"{value:g}", constant.expected)]


def foreign(effect: Effect, law: str) -> bool:
    """Whether an effect makes no sense with a law: it changes a constant that the law lacks, or Ogden's energy."""
    constants: Collection[str] = LAWS[law]
    lacking = {name for every in LAWS.values() for name in every} - set(constants)
    return bool(lacking & set(effect.changes)) or ("energy" in effect.replaces and law != OGDEN)
