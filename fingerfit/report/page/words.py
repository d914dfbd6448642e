"""Numbers and verdicts in words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from fingerfit.core.keys import listed
from fingerfit.diagnosis.families import family_told
from fingerfit.model.applicable import CURE
from fingerfit.model.effect import NUMERICS
from fingerfit.report.page.inputs import UNTESTED, Inputs, Model

MOST = 5
"""Effects that a sentence lists at most."""
_WORD = re.compile(r"([+-]|-?\d+(?:\.\d+)?): ([^;{}]*)")
_CHOICE = re.compile(rf"{{(?:{_WORD.pattern};? ?)+}}")
"""Words that depend on a number: ``{0: at an even pace; +: fast at first}``."""
VERDICTS = {
    "missing": ("▲", "An effect is missing"),
    "indistinguishable": ("◆", "Indistinguishable: two or more candidates explain the residual equally well"),
    "adequate": ("✓", "Model adequate: no missing effect detected"),
    "unexplained": ("?", "Unexplained: no known effect explains the residual"),
    UNTESTED: ("?", "Not tested: there are as many constants as measured values"),
}


def label(model: Model) -> tuple[str, str]:
    """Sign and words of a model's verdict."""
    if cure := _cure(model):
        return VERDICTS["unexplained"][0], f"Not solved well enough: take {cure}"
    return VERDICTS.get(model.verdict, ("", model.verdict or "not diagnosed yet"))


def _cure(model: Model) -> str:
    """What to take instead, where mesh or load steps are what leaves the misfit; else empty."""
    said = model.sentence.partition(CURE)[2] if model.diagnosis.get("family") == NUMERICS else ""
    return said.partition("; ")[0]


def number(value: Any, digits: int = 3) -> str:
    """A number with a few digits, a dash when it is not known.

    Examples
    --------
    >>> number(0.0361234), number(None), number(1234.6), number(1)
    ('0.0361', '–', '1235', '1')
    """
    if value is None:
        return "–"
    if not isinstance(value, int | float | np.number):
        return str(value)
    value = float(value)
    if not np.isfinite(value):
        return "–"
    if 10 ** (digits - 1) <= abs(value) < 1e6:
        return f"{value:.0f}".replace("-", "−")
    return f"{value:.{digits}g}".replace("-", "−")


def with_unit(value: Any, unit: str) -> str:
    """A number and its unit.

    Examples
    --------
    >>> with_unit(1.5, "mm"), with_unit(2, "1"), with_unit(0.195, "log")
    ('1.5 mm', '2', '1.22 times')
    """
    if unit == "log" and value is not None:  # logarithm of a factor
        return f"{number(np.exp(float(value)))} times"
    return number(value) if unit in ("", "1") else f"{number(value)} {unit}"


def place_words(place: Mapping[str, float], told: Mapping[str, str], layers: Sequence[str] = ()) -> str:
    """Where an effect was tried; `told` as in `fingerfit.model.effect.Effect`.

    Examples
    --------
    >>> place_words({"across": 0.85}, {"across": "at {percent} % of the width"}), place_words({"angle": 45}, {})
    ('at 85 % of the width', 'angle = 45')
    >>> place_words({"number": 2}, {"number": "in the layer {layer}"}, ["top", "bottom"])
    'in the layer bottom'
    >>> place_words({"number": 0}, {"number": "in the layer {layer}"}, ["top", "bottom"])
    'in all layers'
    >>> place_words({"side": -1, "gap": 0.2}, {"side": "{0: on both sides; -: on the left}", "gap": "{value} mm away"})
    'on the left, 0.2 mm away'
    """
    found = []
    for name, value in place.items():
        words = _chosen(str(told.get(name, name + " = {value}")), float(value))
        if value == 0 and "{layer}" in words:
            found.append("in all layers")
            continue
        percent = str(round(100 * float(value))).replace("-", "−")
        layer = layers[int(value) - 1] if 1 <= value <= len(layers) else number(value)
        for key, text in {"value": number(value), "percent": percent, "layer": layer}.items():
            words = words.replace(f"{{{key}}}", text)
        found.append(words)
    return ", ".join(found)


def _chosen(words: str, value: float) -> str:
    """Words in which ``{0: at an even pace; +: fast at first; -: slow at first}`` is what stands there for a value."""
    sign = "+" if value > 0 else "-"

    def words_for(choice: re.Match[str]) -> str:
        named = dict(_WORD.findall(choice[0]))
        return next(
            (text for key, text in named.items() if key not in "+-" and float(key) == value), named.get(sign, "")
        )

    return _CHOICE.sub(words_for, words)


def commands(effect: str) -> tuple[str, str]:
    """The lines that add an effect and fit and diagnose again; the page does not know the name of the settings."""
    return f"fingerfit add {effect} --config YOURS.yaml", "fingerfit run --config YOURS.yaml --diagnose"


def first_upper(text: str) -> str:
    """A sentence with a capital."""
    return text[:1].upper() + text[1:]


def in_lines(name: str) -> Markup:
    """A name that a line may break after an underline."""
    return escape(name).replace("_", Markup("_<wbr>"))


def titles(diagnosis: dict[str, Any]) -> dict[str, str]:
    """Titles of the effects of a diagnosis by their names."""
    return {str(e.get("effect")): str(e.get("title") or e.get("effect")) for e in diagnosis.get("ranking") or []}


def _not_shown(diagnosis: dict[str, Any]) -> str:
    """Effects that an adequate model may lack all the same."""
    named = titles(diagnosis)
    hidden = [named[str(e.get("effect"))] for e in diagnosis.get("ranking") or [] if e.get("imitated")]
    untried = [f"{e.get('title')} (needs {e.get('lacks')})" for e in diagnosis.get("not_tried") or []]
    found = f" These data would not show: {', '.join(hidden)}." if hidden else ""
    return found + (f" Not tried, for lack of what they need: {', '.join(untried)}." if untried else "")


def unsolved(diagnosis: dict[str, Any]) -> str:
    """Effects that do not count, since the solver ended their simulations without an answer."""
    told = [f"{e.get('title')} ({e.get('why')})" for e in diagnosis.get("unsolved") or []]
    return f" Tried, but without an answer of the solver, so that it does not count: {'; '.join(told)}." if told else ""


def _as_good(inputs: Inputs) -> str:
    """Which effects the measurements cannot tell from those of the model."""
    there, told = set(inputs.models[-1].rung.get("effects") or []), ""
    for model in inputs.models[:-1]:
        named = titles(model.diagnosis)
        as_good = [str(name) for name in model.diagnosis.get("effects") or []]
        added = [named.get(name, name) for name in as_good if name in there]
        others = [named.get(name, name) for name in as_good if name not in there]
        if added and others:
            told += f" These measurements cannot tell {' and '.join(added)} from {' or '.join(others)}:"
            told += " the intervals reach to those that the constants have with each."
    return told


def headline(inputs: Inputs) -> dict[str, Any]:
    """What was found and what to do next."""
    last = inputs.models[-1]
    first = inputs.models[0].error["fitted"]
    error = last.error["fitted"]
    falls = ""
    if error is not None and last.verdict != UNTESTED:
        falls = f"The residual is {number(error)} times the noise level"
        falls += f"; it was {number(first)} times with {inputs.models[0].name}." if _fell(inputs, first) else "."
    effects = last.diagnosis.get("effects") or []
    add = commands(str(effects[0])) if effects else ()
    named = titles(last.diagnosis)
    candidates = [named.get(str(name), str(name)) for name in effects]
    left_out = [str(title) for title in last.diagnosis.get("left_out") or []]
    effect = "effect that was tried" if left_out else "known effect"
    found, following = {
        "adequate": (
            f"The model “{last.name}” explains the measurements as well as their noise allows.",
            "Nothing needs to be added: take the constants with their intervals from the table below."
            + _as_good(inputs)
            + _not_shown(last.diagnosis),
        ),
        "missing": (
            f"The model “{last.name}” lacks an effect" + (f": {' and '.join(candidates)}." if candidates else "."),
            f"{family_told(last.diagnosis)} Add it and fit again.".lstrip() if add else "See the candidates below.",
        ),
        "indistinguishable": (
            f"The model “{last.name}” lacks " + (" or ".join(candidates) or "one of several effects")
            + "; these measurements cannot tell them apart.",
            "Make the further measurement that is suggested below, or add one of them knowing this.",
        ),
        "unexplained": (
            f"The model “{last.name}” does not explain the measurements, and no {effect} does.",
            "See below where it fails, then describe an effect of your own or check the measurement there.",
        ),
        UNTESTED: (
            f"The model “{last.name}” has as many constants as there are measured values: it cannot be tested.",
            "Such a fit says nothing of whether the model is right. Measure more steps, or points or pictures beside"
            " the forces, and fit again.",
        ),
    }.get(
        last.verdict,
        (f"The model “{last.name}” was compared with the measurements.", "The next step is the diagnosis."),
    )  # fmt: skip
    if last.verdict == "adequate" and last.rung.get("ranges"):
        found = f"The model “{last.name}” leaves no more than what the form of its own effects may be off by."
        following = "Nothing needs to be added: take the constants from the table below, in doubt."
    if cure := _cure(last):
        found = f"The model “{last.name}” does not explain the measurements: {last.sentence.partition(':')[0]}."
        following = f"Take {cure}, and fit again."
    following += unsolved(last.diagnosis)
    if left_out:
        following += f" Not tried, as diagnosis in config.yaml says: {listed(left_out, MOST)}."
    return {"found": found, "falls": falls, "next": following, "add": add, "sentence": last.sentence,
            "verdict": last.verdict if last.verdict in VERDICTS else "none"}  # fmt: skip


def _fell(inputs: Inputs, first: float | None) -> bool:
    return len(inputs.models) > 1 and first is not None
