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
from fingerfit.model.effect import (
    ACTS,
    ASIDE,
    CONSTANTS,
    FAMILIES,
    FAMILY_OF,
    MESH_ERROR,
    NEEDS,
    OUTLINE,
    Effect,
    EffectParameter,
)
from fingerfit.model.formulas import FUNCTIONS, evaluate, named_by, names_in, put_in
from fingerfit.model.scales import IN_WORDS as SCALES
from fingerfit.model.scales import unit_of

CHANGES = (
    *CONSTANTS,
    "field",
    "border_down",
    "border_within",
    "force",
    "displacement",
    *ASIDE,
    "before",
    "pictured",
    "increment",
    "deeper",
    "beside_x",
    "beside_y",
    "swelling",
    "expansion",
    "ageing",
)
OBSERVES = ("displacement", "force", "intensity", *(f"{what}_{axis}" for what in ("shift", "first") for axis in "xyz"))

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
Texts = Annotated[
    list[Formula],
    BeforeValidator(lambda given: given if isinstance(given, list) else [given]),
    wanted("a text or a list of texts"),
]


def _scale(formula: str) -> str:
    """A formula of sizes of a study, and of nothing else, that is above 0 where all of them are 1."""
    try:
        good = names_in(formula) and float(evaluate(formula, dict.fromkeys(SCALES, 1.0))) > 0
    except ValueError:
        good = False
    if not good:
        raise PydanticCustomError("scale", "a formula above 0 of {names}", {"names": ", ".join(SCALES)})
    return formula


Scale = Annotated[str, BeforeValidator(_as_text), AfterValidator(_scale)]
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
    family: Annotated[str, one_of(tuple(FAMILIES))] | None = Field(
        default=None,
        description="Its family: one of "
        + ", ".join(FAMILIES)
        + "; by acts, and indenter for boundary, where it is left out.",
    )
    probe: bool = Field(default=False, description="true where it stands for its whole family, known or not.")
    words: Line = Field(description="What it is.")
    look: Line = Field(description="What it looks like in the data.")
    confirm: Line = Field(description="Which experiment would confirm it.")
    parameters: dict[Name, NumberKeys] = Field(
        default={}, description=f"Its numbers, which are fitted: one or more, but for the effect {OUTLINE}."
    )
    scan: dict[Name, Values] | None = Field(default=None, description="Places and the like that a first look tries.")
    refine: dict[str, Bounds] | None = Field(
        default=None, description="Bounds of those scanned numbers that a fit then moves, too; the others stay."
    )
    let: dict[Name, Formula] = Field(
        default={},
        description="Names for parts of the formulas of changes, observes and place: a formula each, which may use"
        " those above it.",
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
    replaces: Texts = Field(default=[], description="Named blocks of the deck that lose what they have without it.")
    shares_of: dict[str, Scale] | None = Field(
        default=None, description="What its numbers are shares of: formulas of " + ", ".join(SCALES) + "."
    )
    place: Texts = Field(
        default=[],
        description="Formulas of where a scanned place is, mm from the corner of the body, for each axis.",
    )
    series: str | None = Field(
        default=None,
        description="The scanned number, of one value, that says how many of its parameters a model has, the first"
        " ones; the diagnosis finds out how many.",
    )
    polynomial: bool = Field(
        default=False,
        description="true where its parameters are coefficients of a polynomial by rising degree, each half as likely"
        " to be there as the one before.",
    )
    told: dict[str, Line] | None = Field(
        default=None, description="Words for scanned numbers; {value}, {percent} or {layer} in them stand for a number."
    )
    signal: Annotated[str, one_of((MESH_ERROR,))] | None = Field(
        default=None, description=f"{MESH_ERROR}: the effect, of one number, is this signal and changes no deck."
    )
    fault: Line | None = Field(default=None, description="What is wrong, where an effect of mesh and load steps shows.")
    cure: Line | None = Field(default=None, description="What to do then.")

    @field_validator("let")
    @classmethod
    def _whole(cls, let: dict[str, str]) -> dict[str, str]:
        try:
            return named_by(let)
        except ValueError as error:
            raise PydanticCustomError("let", "a formula for each name", {"found": str(error)}) from error

    @field_validator("changes", "observes")
    @classmethod
    def _put_in(cls, formulas: dict[str, str] | None, info: ValidationInfo) -> dict[str, str] | None:
        return formulas and {key: put_in(formula, info.data.get("let", {})) for key, formula in formulas.items()}

    @field_validator("place")
    @classmethod
    def _put_in_each(cls, formulas: list[str], info: ValidationInfo) -> list[str]:
        return [put_in(formula, info.data.get("let", {})) for formula in formulas]


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
    part, scan = path.with_suffix(".inp.j2"), given.scan or {}
    return Effect(
        path.stem,
        **{name: getattr(given, name) for name in ("title", "acts", "words", "look", "confirm")},
        parameters=tuple(
            EffectParameter(name, p.unit, p.absent, p.lower, p.upper, p.step) for name, p in given.parameters.items()
        ),
        scan={name: tuple(values) for name, values in scan.items()},
        refine={name: (low, high) for name, (low, high) in (given.refine or {}).items()},
        changes=given.changes or {},
        observes=given.observes or {},
        needs=tuple(given.needs),
        control=given.control or "",
        part=f"effects/{part.name}" if part.exists() else None,
        fills=_fills(path),
        replaces=tuple(given.replaces),
        shares_of=given.shares_of or {},
        units={name: unit_of(formula) for name, formula in (given.shares_of or {}).items() if name in scan},
        place=tuple(given.place),
        told=given.told or {},
        **{name: getattr(given, name) or "" for name in ("signal", "fault", "cure")},
        family=given.family or FAMILY_OF.get(given.acts, given.acts),
        probe=given.probe,
        series=given.series or "",
        polynomial=given.polynomial,
    )


def _fills(path: Path) -> dict[str, str]:
    """Parts beside an effect that fill a block of the deck, ``{name}.{block}.inp.j2``, by block."""
    found = sorted(path.parent.glob(f"{path.stem}.*.inp.j2"))
    return {part.name.split(".")[1]: f"effects/{part.name}" for part in found}


def _cross_check(given: Any, path: Path) -> Iterator[InputError]:
    """Keys that are right by themselves, but not with others."""

    def inside(key: str) -> Mapping[str, Any]:
        return getattr(given, key, None) or {}

    scan, refine = inside("scan"), inside("refine")
    if getattr(given, "parameters", None) == {} and path.stem != OUTLINE:
        yield InputError(path, "parameters", "none", "at least one number of the effect")
    for name in scan.keys() & inside("parameters").keys():
        yield InputError(path, f"scan.{name}", name, "a name that no other number of the effect has")
    for name in inside("let").keys() & (scan.keys() | inside("parameters").keys()):
        yield InputError(path, f"let.{name}", name, "a name that no number of the effect has")
    if (count := math.prod(map(len, scan.values()))) > PLACES:
        yield InputError(path, "scan", f"{count} places in all", f"at most {PLACES}")
    for name, (low, high) in refine.items():
        if hasattr(given, "scan") and name not in scan:
            yield unknown_key(path, "refine.", name, list(scan))
        elif not low < high:
            yield InputError(path, f"refine.{name}", [low, high], "a lower bound and a higher one")
    series = getattr(given, "series", None)
    if series and not (len(scan.get(series, ())) == 1 and scan[series][0] in range(1, 1 + len(inside("parameters")))):
        yield InputError(path, "series", series, "a key of scan, with one value from 1 to the number of parameters")
    if getattr(given, "signal", None) and len(inside("parameters")) > 1:
        yield InputError(path, "signal", given.signal, f"{MESH_ERROR}, of an effect with one number")
    numbers = [*inside("parameters"), *scan]
    for key, names in (("shares_of", numbers), ("told", list(scan))):
        if hasattr(given, "parameters") and hasattr(given, "scan"):
            yield from (unknown_key(path, f"{key}.", name, names) for name in inside(key) if name not in names)
    for key, known in (("changes", CHANGES), ("observes", OBSERVES)):
        yield from (unknown_key(path, f"{key}.", name, known) for name in inside(key) if name not in known)
