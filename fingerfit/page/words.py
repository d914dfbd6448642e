"""Numbers and verdicts in words."""

from __future__ import annotations

from typing import Any

import numpy as np

from fingerfit.page.inputs import Inputs

VERDICTS = {
    "missing": ("▲", "An effect is missing"),
    "indistinguishable": ("◆", "Something is missing; two or more effects explain it alike"),
    "adequate": ("✓", "Nothing is missing"),
    "unexplained": ("?", "Something is missing that no known effect explains"),
}


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
    >>> with_unit(1.5, "mm"), with_unit(2, "1")
    ('1.5 mm', '2')
    """
    return number(value) if unit in ("", "1") else f"{number(value)} {unit}"


def headline(inputs: Inputs) -> dict[str, str]:
    """What was found and what to do next."""
    last = inputs.models[-1]
    first = inputs.models[0].error["fitted"]
    error = last.error["fitted"]
    falls = ""
    if error is not None:
        falls = f"What is left is {number(error)} times the noise"
        falls += f"; it was {number(first)} times with {inputs.models[0].name}." if _fell(inputs, first) else "."
    add = str(last.diagnosis.get("add") or "")
    blamed = [str(name) for name in last.diagnosis.get("effects") or []]
    found, following = {
        "adequate": (
            f"The model “{last.name}” explains the measurements as well as their noise allows.",
            "Nothing needs to be added: take the constants with their intervals from the ladder below.",
        ),
        "missing": (
            f"The model “{last.name}” lacks an effect" + (f": {' and '.join(blamed)}." if blamed else "."),
            "Add it and fit again." if add else "Look at the candidates below.",
        ),
        "indistinguishable": (
            f"The model “{last.name}” lacks " + (" or ".join(blamed) or "one of several effects")
            + "; these measurements cannot tell which.",
            "Make the further measurement that is suggested below, or add one of them knowing this.",
        ),
        "unexplained": (
            f"The model “{last.name}” lacks something that none of the known effects explains.",
            "See below where it fails, then describe an effect of your own or check the measurement there.",
        ),
    }.get(
        last.verdict,
        (f"The model “{last.name}” was compared with the measurements.", "The next step is the diagnosis."),
    )  # fmt: skip
    return {"found": found, "falls": falls, "next": following, "add": add, "sentence": last.sentence,
            "verdict": last.verdict if last.verdict in VERDICTS else "none"}  # fmt: skip


def _fell(inputs: Inputs, first: float | None) -> bool:
    return len(inputs.models) > 1 and first is not None
