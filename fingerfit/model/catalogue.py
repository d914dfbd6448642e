"""The catalogue: effects that come with fingerfit, and a study's own, one YAML file each."""

from __future__ import annotations

import functools
import keyword
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.folders import template_folders
from fingerfit.core.keys import Keys, is_number, read_yaml, unknown_key
from fingerfit.model.applicable import IN_WORDS
from fingerfit.model.effect import ACTS, CONSTANTS, MESH_ERROR, NEEDS, Effect, EffectParameter
from fingerfit.model.formulas import FUNCTIONS, evaluate, names_in
from fingerfit.model.scales import IN_WORDS as SCALES

CHANGES = (*CONSTANTS, "field", "force", "displacement", "before", "increment", "follow", "beside_x", "beside_y")
OBSERVES = ("displacement", "force", "intensity", "shift_x", "shift_y", "shift_z")

DECK_KEYS = ("replaces", "shares_of", "place", "told", "signal", "fault", "cure")
PLACES = 1000
"""Places of one effect: each is tested by simulations of its own; a whole diagnosis has some hundred."""


def catalogue(study: Path | None = None) -> dict[str, Effect]:
    """Effects by name: ours, those of installed packages, and a study's own, which go before others of the same name.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    InputError
        For an effect of a package whose name is taken.
    """
    found: dict[str, Effect] = {}
    for folder in (*template_folders(), *([study] if study else [])):
        for path in sorted((folder / "effects").glob("*.yaml")):
            if path.stem in found and folder != study:
                raise InputError(path, "name", path.stem, "one that no other effect has")
            found[path.stem] = _read(path, path.stat().st_mtime_ns)
    return found


def chosen(names: Sequence[str], known: Mapping[str, Effect], where: Path | str) -> tuple[Effect, ...]:
    """Effects of a model, in order.

    Raises
    ------
    InputError
        For a name that is not known, with the nearest one that is.
    """
    for name in names:
        if name not in known:
            raise unknown_key(where, "model.effects.", name, sorted(known))
    return tuple(known[name] for name in names)


def wrong_numbers(
    given: Mapping[str, Mapping[str, float]], known: Mapping[str, Effect], where: Path | str, prefix: str
) -> list[InputError]:
    """Problems of the numbers of effects: names that they do not have, values out of their bounds.

    Parameters
    ----------
    given : mapping
        Numbers by the short names, for each effect.
    known : mapping
        Has these effects and may have others.
    where, prefix : Path or str
        File and beginning of the fields in errors, for example ``model.effects.``.
    """
    problems = []
    for name, numbers in given.items():
        keys, bounds = list(known[name].own({})), known[name].bounds()
        for key, value in numbers.items():
            low, high = bounds.get(key, (-math.inf, math.inf))
            if key not in keys:
                problems.append(unknown_key(where, f"{prefix}{name}.", key, keys))
            elif not low <= value <= high:
                expected = f"{low:g} to {high:g}, the bounds"
                problems.append(InputError(where, f"{prefix}{name}.{key}", f"{value:g}", expected))
    return problems


@functools.cache
def _read(path: Path, stamp: int) -> Effect:
    problems: list[FingerfitError] = []
    if not re.fullmatch(r"[\w-]+", path.stem):
        raise InputError(path, "name", path.stem, "letters, digits, _ and -: the file's name is the effect's")
    keys = Keys(path, read_yaml(path), "", problems)
    words = ("title", "words", "look", "confirm")
    keys.known(*words, "acts", "parameters", "scan", "refine", "changes", "observes", "needs", "control", *DECK_KEYS)
    texts = {name: keys.text(name) or "" for name in words}
    acts = keys.text("acts") or ""
    if acts and acts not in ACTS:
        keys.wrong("acts", acts, "one of " + ", ".join(ACTS))
    parameters = _parameters(keys)
    changes = _formulas(keys, "changes", CHANGES)
    observes = _formulas(keys, "observes", OBSERVES)
    scan = keys.mapping("scan", {})
    places: dict[str, tuple[float, ...]] = {}
    for name, values in scan.data.items():
        if not isinstance(values, list) or not values or not all(is_number(v) for v in values):
            scan.wrong(name, values, "a list of finite numbers")
        elif _is_name(scan, name, taken=[p.name for p in parameters]):
            places[name] = tuple(float(v) for v in values)
    group = keys.mapping("refine", {})
    group.known(*places)
    bounds = {name: group.numbers(name, 2) for name in group.data}
    for name, pair in bounds.items():
        if pair and not pair[0] < pair[1]:
            group.wrong(name, list(pair), "a lower bound and a higher one")
    control, given = keys.text("control", None), keys.data.get("needs", [])
    needs = [given] if isinstance(given, str) else given
    if not isinstance(needs, list) or any(need not in NEEDS for need in needs):
        keys.wrong("needs", given, ", ".join(NEEDS))
    if control not in (None, "force", "displacement"):
        keys.wrong("control", control, "force or displacement")
    refine = {name: (pair[0], pair[1]) for name, pair in bounds.items() if pair}
    count = math.prod(map(len, places.values()))
    if count > PLACES:
        keys.wrong("scan", f"{count} places in all", f"at most {PLACES}")
    part = path.with_suffix(".inp.j2")
    more = {**texts, **_more(keys, [p.name for p in parameters], list(places))}
    if problems:
        raise Problems(problems)
    return Effect(
        path.stem, acts=acts, parameters=parameters, scan=places, refine=refine, changes=changes,
        observes=observes, needs=tuple(needs), control=control or "",
        part=f"effects/{part.name}" if part.exists() else None, fills=_fills(path), **more,
    )  # fmt: skip


def _more(keys: Keys, numbers: Sequence[str], places: Sequence[str]) -> dict[str, Any]:
    """What an effect replaces in the deck, what its numbers are shares of, where it is, and the rest of its words."""
    shares, signal = keys.mapping("shares_of", {}), keys.text("signal", None)
    shares.known(*numbers, *places)
    for name, formula in shares.data.items():
        if not _is_scale(str(formula)):
            shares.wrong(name, formula, "a formula above 0 of " + ", ".join(SCALES))
    told = keys.mapping("told", {})
    told.known(*places)
    if signal not in (None, MESH_ERROR) or (signal and len(numbers) != 1):
        keys.wrong("signal", signal, f"{MESH_ERROR}, of an effect with one number")
    return {
        "replaces": _texts(keys, "replaces"),
        "place": _texts(keys, "place"),
        "shares_of": {name: str(formula) for name, formula in shares.data.items()},
        "told": {name: told.text(name) or "" for name in told.data},
        "signal": signal or "",
        "fault": keys.text("fault", None) or "",
        "cure": keys.text("cure", None) or "",
    }


def _is_scale(formula: str) -> bool:
    """Whether a formula names sizes of a study, and nothing else, and is above 0 where all of them are 1."""
    try:
        return bool(names_in(formula)) and float(evaluate(formula, dict.fromkeys(SCALES, 1.0))) > 0
    except ValueError:
        return False


def _texts(keys: Keys, key: str) -> tuple[str, ...]:
    """One text or a list of them."""
    given = keys.data.get(key, [])
    found = given if isinstance(given, list) else [given]
    if not all(isinstance(text, (str, int, float)) for text in found):
        keys.wrong(key, given, "a text or a list of texts")
    return tuple(map(str, found))


def _fills(path: Path) -> dict[str, str]:
    """Parts beside an effect that fill a block of the deck, ``{name}.{block}.inp.j2``, by block."""
    found = sorted(path.parent.glob(f"{path.stem}.*.inp.j2"))
    return {part.name.split(".")[1]: f"effects/{part.name}" for part in found}


def _parameters(keys: Keys) -> tuple[EffectParameter, ...]:
    found: list[EffectParameter] = []
    group = keys.mapping("parameters")
    if not group.data and not group.broken:
        keys.wrong("parameters", "none", "at least one number, which is fitted")
    for name in group.data:
        inner = group.mapping(name)
        inner.known("unit", "absent", "lower", "upper", "step")
        numbers = [inner.number(key) for key in ("absent", "lower", "upper", "step")]
        unit = inner.text("unit")
        if unit is None or any(n is None for n in numbers) or not _is_name(group, name):
            continue
        null, lower, upper, step = (float(n or 0.0) for n in numbers)
        if not lower < upper:
            inner.wrong("upper", upper, f"a number above lower, {lower:g}")
        elif not lower <= null <= upper:
            inner.wrong("absent", null, f"a number within {lower:g} to {upper:g}")
        elif not lower <= null + step <= upper or step == 0:
            inner.wrong("step", step, f"a number from null that stays within {lower:g} to {upper:g}")
        found.append(EffectParameter(str(name), unit, null, lower, upper, step))
    return tuple(found)


def _is_name(group: Keys, name: object, taken: Sequence[str] = ()) -> bool:
    """Whether a formula can name a number so; else it is noted."""
    reserved = keyword.iskeyword(name) or name in FUNCTIONS if isinstance(name, str) else False
    if isinstance(name, str) and name.isidentifier() and name not in taken and not reserved:
        return True
    found = f"{name}, which means something else in formulas" if reserved else name
    group.wrong(str(name), found, "a name of its own of letters, digits and _, as formulas have it")
    return False


def _formulas(keys: Keys, key: str, known: Sequence[str]) -> dict[str, str]:
    group = keys.mapping(key, {})
    group.known(*known)
    return {name: str(formula) for name, formula in group.data.items()}


def as_text(effect: Effect) -> dict[str, Any]:
    """What a report says of an effect."""
    return {"name": effect.name, "title": effect.title, "words": effect.words, "look": effect.look,
            "confirm": effect.confirm, "acts": effect.acts, "told": dict(effect.told)}  # fmt: skip


def as_lines(effect: Effect) -> str:
    """An effect for a person to read: what it is, its numbers with units and bounds, and how it is confirmed."""
    lines = [
        f"{effect.name}: {effect.title}",
        effect.words,
        f"in the data: {effect.look}",
        f"confirm: {effect.confirm}",
    ]
    units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in effect.parameters}
    units |= {name: f" of {formula}" for name, formula in effect.shares_of.items()}
    for p in effect.parameters:
        unit = units[p.name]
        lines.append(f"{p.name}: {p.lower:g} to {p.upper:g}{unit}, absent at {p.null:g}")
    for name, values in effect.scan.items():
        low, high = effect.refine.get(name, (None, None))
        fitted = "not fitted" if low is None else f"fitted from {low:g} to {high:g}"
        lines.append(f"{name}: tried at {', '.join(f'{value:g}' for value in values)}{units.get(name, '')}; {fitted}")
    needs = [IN_WORDS[need] for need in effect.needs] + [f"a prescribed {effect.control}"] * bool(effect.control)
    if needs:
        lines.append(f"needs: {', '.join(needs)}")
    return "\n    ".join(lines)
