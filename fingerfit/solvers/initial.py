"""The state of a body before anything moves: stresses, and stretches of the material that they come from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Deck
from fingerfit.material.invariant import TENSOR
from fingerfit.material.prestretch import prestretch

_ROUNDING = 1e-9
"""Share of a stress: what the text of a deck leaves of its digits."""


def initial_state(
    deck: Deck, path: Path, numbers: np.ndarray, materials: Sequence[Any]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Stress in the reference state, MPa, and how the material is stretched there, shape (elements, 3, 3) each.

    What strains without stress make is the negative of the stress. Where a hyperelastic body has large deformations a
    deviatoric stress comes from a stretch (docs/decisions/0046-stretch-before-gluing.md).

    Parameters
    ----------
    deck : Deck
    path : Path
        For messages.
    numbers : ndarray of int, shape (elements,)
        Of the elements in the deck.
    materials : sequence of materials
        Of each element, with constants that are numbers.

    Raises
    ------
    InputError
        For strain in a hyperelastic body, and for a stress that a material does not reach.
    """
    if not any(int(number) in deck.stress or int(number) in deck.strain for number in numbers):
        return None, None
    found = np.array([deck.stress.get(int(number), [0.0] * 6) for number in numbers])[:, TENSOR]
    for n, number in enumerate(numbers):
        if int(number) not in deck.strain:
            continue
        material = materials[n]
        if not is_elastic(material):
            expected = "*ELASTIC, or TYPE=STRESS"
            raise InputError(path, "*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN", "a hyperelastic body", expected)
        given = np.array(deck.strain[int(number)])[TENSOR]
        lame = material.bulk - 2 * material.shear / 3
        found[n] -= lame * np.trace(given) * np.eye(3) + 2 * material.shear * given
    return _stretched(found, path, materials) if deck.steps[0].finite else (found, None)


def _stretched(stress: np.ndarray, path: Path, materials: Sequence[Any]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """What is left of a stress where its deviator comes from a stretch, and this stretch."""
    left, stretches = stress.copy(), np.broadcast_to(np.eye(3), stress.shape).copy()
    known = dict[tuple[int, bytes], tuple[np.ndarray, np.ndarray]]()
    for n, (one, material) in enumerate(zip(stress, materials, strict=True)):
        if is_elastic(material) or not one.any():
            continue
        key = id(material), one.tobytes()
        if key not in known:
            try:
                found = prestretch(material, one)
            except ValueError as error:
                raise InputError(path, "*INITIAL CONDITIONS, TYPE=STRESS", error, "a smaller one") from error
            back, mean = np.linalg.inv(found), np.trace(one) / 3
            # what rounding leaves of a deviator is no stress
            mean = 0.0 if abs(mean) < _ROUNDING * np.abs(one).max() else mean
            known[key] = mean * back @ back, found
        left[n], stretches[n] = known[key]
    return (left if left.any() else None), stretches


def is_elastic(material: Any) -> bool:
    """Whether a material is linear elastic, for small strain too."""
    return type(material).__name__ == "Elastic"
