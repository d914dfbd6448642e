"""Sizes of a study that numbers of effects are shares of: those of the body, the largest load, the time it took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fingerfit.core.errors import InputError
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import evaluate, names_in
from fingerfit.study.study import Study, largest_of

IN_WORDS = {
    "width": "of the body along x, mm",
    "height": "of the body upwards, mm",
    "breadth": "of the body along y, in space, mm",
    "force": "the largest one, N",
    "displacement": "of the indenter, the largest one, mm",
    "duration": "of the test, from its beginning to the last step, s",
}
"""Names that formulas of scales (`shares_of` of an effect) have."""


def unit_of(formula: str) -> str:
    """Unit of what is a share of a formula of scales: mm, N or s; 1 for any other.

    >>> unit_of("minimum(width, height)"), unit_of("1 / width")
    ('mm', '1')
    """
    names = names_in(formula)
    units = {IN_WORDS[name].rpartition(", ")[2] for name in names}
    once, twice = (evaluate(formula, dict.fromkeys(names, size)) for size in (1.0, 2.0))
    return units.pop() if len(units) == 1 and abs(twice - 2.0 * once) < 1e-9 * abs(twice) else "1"


def extent(size: Sequence[float]) -> dict[str, float]:
    """Names that formulas have for the size of a body, mm.

    >>> extent([12.0, 8.0])
    {'width': 12.0, 'height': 8.0}
    """
    found = {"width": float(size[0]), "height": float(size[-1])}
    return found | ({"breadth": float(size[1])} if len(size) == 3 else {})


def scales(study: Study, size: Sequence[float]) -> dict[str, float]:
    """What numbers of effects may be shares of, as far as it is known: `IN_WORDS`.

    Parameters
    ----------
    study : Study
    size : sequence of float
        Extent of the body along each axis, mm.
    """
    steps = study.steps
    measured = {
        "force": [step.force for step in steps],
        "displacement": [step.displacement for step in steps],
        "duration": [step.time for step in steps],
    }
    largest = {name: largest_of(values) for name, values in measured.items()}
    return {**extent(size), **{name: value for name, value in largest.items() if value > 0}}


def bound(effects: Mapping[str, Effect], known: Mapping[str, float], control: str = "") -> dict[str, Effect]:
    """Effects as a study has them: under its control, with their shares as numbers, as far as these are known.

    Parameters
    ----------
    effects : mapping
    known : mapping
        What numbers are shares of: `scales`.
    control : str
        ``force`` or ``displacement``; empty where tests of a study differ.

    Raises
    ------
    InputError
        For a formula of a scale that has no value above 0.
    """
    found = {}
    for name, effect in effects.items():
        try:
            found[name] = (effect.under(control) if control else effect).bound(known)
        except ValueError as error:
            raise InputError(f"effect {name}", "shares_of", error, "a formula above 0") from error
    return found
