"""Keys of ``effects/{name}.yaml``: the source of docs/effect-keys.md; and what they must be for each other."""

from __future__ import annotations

import keyword
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from fingerfit.core.described import HEAD, Line, Strict, described, one_of, rows, wanted
from fingerfit.core.errors import InputError, Problems
from fingerfit.core.keys import read_yaml, unknown_key
from fingerfit.model.effect import ACTS, NEEDS, Effect, EffectParameter
from fingerfit.model.formulas import FUNCTIONS

CHANGES = ("alpha", "poisson", "field", "force", "displacement", "before", "increment")
OBSERVES = ("displacement", "force", "intensity", "shift_x", "shift_y", "shift_z")

PLACES = 1000
"""Places of one effect: each is tested by simulations of its own; a whole diagnosis has some hundred."""


def _name(name: str) -> str:
    """A name that a formula can have for a number."""
    reserved = keyword.iskeyword(name) or name in FUNCTIONS
    if reserved or not name.isidentifier():
        found = {"found": f"{name}, which means something else in formulas"} if reserved else None
        raise PydanticCustomError("name", "a name of its own of letters, digits and _, as formulas have it", found)
    return name


def _as_text(formula: Any) -> Any:
    return str(formula) if isinstance(formula, int | float) else formula


Name = Annotated[str, AfterValidator(_name)]
Formula = Annotated[str, BeforeValidator(_as_text), wanted("a formula: a text or a number")]
Values = Annotated[list[float], Field(min_length=1), wanted("a list of finite numbers")]
Bounds = Annotated[list[float], Field(min_length=2, max_length=2), wanted("2 numbers")]
Needs = Annotated[
    list[Annotated[str, one_of(NEEDS)]],
    BeforeValidator(lambda given: [given] if isinstance(given, str) else given),
    wanted(", ".join(NEEDS)),
]


class NumberKeys(Strict):
    """A number of an effect."""

    unit: Line = Field(description="Unit of the number, a text; '1' for a pure number.")
    lower: float = Field(description="Lower bound, a number.")
    upper: float = Field(description="Upper bound, a number above lower.")
    absent: float = Field(description="The number at which the effect is absent, within the bounds.")
    step: float = Field(description="A number, not 0: what a first look at the effect changes, from absent.")

    @field_validator("upper")
    @classmethod
    def _above(cls, upper: float, info: ValidationInfo) -> float:
        lower = info.data.get("lower", -math.inf)
        if not lower < upper:
            raise PydanticCustomError("upper", "a number above lower, {lower}", {"lower": f"{lower:g}"})
        return upper

    @field_validator("absent", "step")
    @classmethod
    def _within(cls, value: float, info: ValidationInfo) -> float:
        known, first = info.data, info.field_name == "absent"
        if not {"lower", "upper"} <= known.keys() or not (first or "absent" in known):
            return value
        reached = value if first else known["absent"] + value
        if not known["lower"] <= reached <= known["upper"] or not (first or value):
            words = "a number within {bounds}" if first else "a number from absent that stays within {bounds}"
            raise PydanticCustomError("within", words, {"bounds": f"{known['lower']:g} to {known['upper']:g}"})  # type: ignore[arg-type]
        return value


class EffectKeys(Strict):
    """effects/{name}.yaml."""

    title: Line = Field(description="The effect in a few words.")
    acts: Annotated[str, one_of(ACTS)] = Field(description="Where it acts: one of " + ", ".join(ACTS) + ".")
    words: Line = Field(description="What it is.")
    look: Line = Field(description="What it looks like in the data.")
    confirm: Line = Field(description="Which experiment would confirm it.")
    parameters: dict[Name, NumberKeys] = Field(min_length=1, description="Its numbers, which are fitted.")
    scan: dict[Name, Values] | None = Field(default=None, description="Places and the like that a first look tries.")
    refine: dict[str, Bounds] | None = Field(
        default=None, description="Bounds of those scanned numbers that a fit then moves, too; the others stay."
    )
    changes: dict[str, Formula] | None = Field(
        default=None, description="Formulas for what goes into the deck: " + ", ".join(CHANGES) + "."
    )
    observes: dict[str, Formula] | None = Field(
        default=None, description="Formulas for what is measured: " + ", ".join(OBSERVES) + "."
    )
    needs: Needs = Field(default=[], description="What a study must have: " + ", ".join(NEEDS) + ".")
    control: Annotated[str, one_of(("force", "displacement")), wanted("force or displacement")] | None = Field(
        default=None, description="force or displacement, where it makes sense for one of them only."
    )


def describe() -> str:
    """Markdown table of all keys, for docs/effect-keys.md."""
    lines = [
        "# Keys of effects/{name}.yaml",
        "",
        "Made by `fingerfit docs`; do not edit.",
        "",
        *HEAD,
        *rows(EffectKeys),
    ]
    return "\n".join(lines) + "\n"


def read_effect(path: Path) -> Effect:
    """Read an effect, whose name is the file's.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    given, problems = described(EffectKeys, read_yaml(path), path)
    problems += _cross_check(given, path)
    if problems:
        raise Problems(problems)
    part = path.with_suffix(".inp.j2")
    return Effect(
        path.stem,
        **{name: getattr(given, name) for name in ("title", "acts", "words", "look", "confirm")},
        parameters=tuple(
            EffectParameter(name, p.unit, p.absent, p.lower, p.upper, p.step) for name, p in given.parameters.items()
        ),
        scan={name: tuple(values) for name, values in (given.scan or {}).items()},
        refine={name: (low, high) for name, (low, high) in (given.refine or {}).items()},
        changes=given.changes or {},
        observes=given.observes or {},
        needs=tuple(given.needs),
        control=given.control or "",
        part=f"effects/{part.name}" if part.exists() else None,
    )


def _cross_check(given: Any, path: Path) -> Iterator[InputError]:
    """Keys that are right by themselves, but not with others."""

    def inside(key: str) -> Mapping[str, Any]:
        return getattr(given, key, None) or {}

    scan, refine = inside("scan"), inside("refine")
    for name in scan.keys() & inside("parameters").keys():
        yield InputError(path, f"scan.{name}", name, "a name that no other number of the effect has")
    if (count := math.prod(map(len, scan.values()))) > PLACES:
        yield InputError(path, "scan", f"{count} places in all", f"at most {PLACES}")
    for name, (low, high) in refine.items():
        if hasattr(given, "scan") and name not in scan:
            yield unknown_key(path, "refine.", name, list(scan))
        elif not low < high:
            yield InputError(path, f"refine.{name}", [low, high], "a lower bound and a higher one")
    for key, known in (("changes", CHANGES), ("observes", OBSERVES)):
        yield from (unknown_key(path, f"{key}.", name, known) for name in inside(key) if name not in known)
