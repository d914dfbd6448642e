"""Units that a study may use, and their size in mm, N and s."""

from __future__ import annotations

from collections.abc import Mapping

UNITS: dict[str, dict[str, float]] = {
    "length": {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3},
    "force": {"mN": 1e-3, "N": 1.0, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665},
    "time": {"ms": 1e-3, "s": 1.0, "min": 60.0},
}

LENGTHS = (1e-6, 1e6)
"""mm that a length of a body or picture has: from a nanometre, where bodies are atoms, to a kilometre."""


def as_written(text: str, names: Mapping[str, str]) -> str:
    """A unit as it is named here, by how a person or a program wrote it; empty for what is none.

    Case does not count where it cannot change what is meant: ``n`` and ``KN`` are N and kN. A capital M before a unit
    is mega, not milli: of ``MN``, ``Mn``, ``Mm`` and ``Ms`` nothing is known. ``MM`` and ``MS``, in a head of capitals,
    are mm and ms, since there is no unit of length or time that is called M or S.

    Parameters
    ----------
    text : str
    names : mapping
        Names of units in small letters, and the units.

    >>> names = {unit.lower(): unit for kind in UNITS.values() for unit in kind}
    >>> [as_written(text, names) for text in ("mN", "mn", "MN", "Mn", "KN", "mm", "MM", "Mm", "n", "Min")]
    ['mN', 'mN', '', '', 'kN', 'mm', 'mm', '', 'N', 'min']
    """
    found = names.get(text.lower(), "")
    base = found[1:] if found[:1] == "m" and found[1:] in names.values() else ""
    mega = base and text[0] == "M" and (text[1:] == base or not text.isupper())
    return "" if mega else found
