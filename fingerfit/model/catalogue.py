"""The catalogue: effects that come with fingerfit, and a study's own, one YAML file each."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fingerfit.core.errors import InputError
from fingerfit.core.folders import template_folders
from fingerfit.core.keys import unknown_key
from fingerfit.model.applicable import IN_WORDS
from fingerfit.model.effect import Effect


def catalogue(study: Path | None = None) -> dict[str, Effect]:
    """Effects by name: ours, those of installed packages, and a study's own, which go before others of the same name.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    InputError
        For an effect of a package whose name is taken.
    """
    return {path.stem: _read(path, changed) for path, changed in effect_files(study)}


def effect_files(study: Path | None = None) -> tuple[tuple[Path, int], ...]:
    """Files of `catalogue`, each with the time of its last change in ns: the last of a name is the one that counts.

    Raises
    ------
    InputError
        As of `catalogue`, and for files that would be overlooked.
    """
    found = list[tuple[Path, int]]()
    for folder in (*template_folders(), *([study] if study else [])):
        taken = {path.stem for path, _ in found}
        for path in sorted((folder / "effects").glob("*.yml")):
            raise InputError(path, "file", "the ending .yml", f"{path.stem}.yaml: files of effects end in .yaml")
        for path in sorted((folder / "effects").glob("*.yaml")):
            if path.stem in taken and folder != study:
                raise InputError(path, "name", path.stem, "one that no other effect has")
            found.append((path, path.stat().st_mtime_ns))
    return tuple(found)


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


def with_numbers(effect: Effect, numbers: Mapping[str, float]) -> Effect:
    """An effect as a model has it whose numbers of it, by the short names, are these: of a series its first few."""
    return effect.first(numbers.get(effect.series, effect.scan[effect.series][0])) if effect.series else effect


def wrong_numbers(
    given: Mapping[str, Mapping[str, float]],
    known: Mapping[str, Effect],
    where: Path | str,
    prefix: str,
    tests: Sequence[str] = (),
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
    tests : sequence of str
        Endings of numbers that each test has for itself, as ``@wide``.
    """
    problems = []
    for name, numbers in given.items():
        effect = known[name]
        if effect.series in numbers and numbers[effect.series] not in range(1, len(effect.parameters) + 1):
            found, expected = numbers[effect.series], f"a whole number from 1 to {len(effect.parameters)}"
            problems.append(InputError(where, f"{prefix}{name}.{effect.series}", f"{found:g}", expected))
            continue
        effect = with_numbers(effect, numbers)
        keys, bounds = list(effect.own({})), effect.bounds()
        for key, value in numbers.items():
            short = next((key.removesuffix(test) for test in tests if key.endswith(test)), key)
            low, high = bounds.get(short, (-math.inf, math.inf))
            if short not in keys:
                problems.append(unknown_key(where, f"{prefix}{name}.", key, keys))
            elif not low <= value <= high:
                expected = f"{low:g} to {high:g}, the bounds"
                problems.append(InputError(where, f"{prefix}{name}.{key}", f"{value:g}", expected))
    return problems


@functools.cache
def _read(path: Path, stamp: int) -> Effect:
    from fingerfit.model.keys import read_effect

    if not re.fullmatch(r"[\w-]+", path.stem):
        raise InputError(path, "name", path.stem, "letters, digits, _ and -: the file's name is the effect's")
    return read_effect(path)


def as_text(effect: Effect) -> dict[str, Any]:
    """What a report says of an effect."""
    shown = ("name", "title", "words", "look", "confirm", "acts", "family", "probe")
    return {name: getattr(effect, name) for name in shown} | {"told": dict(effect.told)}


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
