"""The one seed of all random numbers that the tests draw: the environment variable FINGERFIT_TEST_SEED, 0 if there is none."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TypeVar

import numpy as np

VARIABLE = "FINGERFIT_TEST_SEED"
EVERYTHING = "FINGERFIT_TEST_EVERYTHING"
"""With this environment variable `part_of` leaves nothing out."""
APART = 1000
"""Between the seeds of two values of the variable: more than any test's own seed, so that none is used twice."""
LARGEST = 4_000_000
"""SimpleITK's registration takes seeds of 32 bits."""


def project_seed() -> int:
    """The seed of this run of the tests."""
    text = os.environ.get(VARIABLE, "0")
    if not text.isdecimal() or int(text) > LARGEST:
        raise ValueError(f"{VARIABLE}: found {text}; expected a whole number from 0 to {LARGEST}")
    return int(text)


def seed_of(own: int) -> int:
    """Seed of one use of random numbers: its own where the variable is 0, and another one for each other value."""
    return own + APART * project_seed()


def generator(own: int) -> np.random.Generator:
    """Random numbers of one use."""
    return np.random.default_rng(seed_of(own))


Item = TypeVar("Item")


def part_of(cases: Sequence[Item], parts: int) -> list[Item]:
    """One of so many parts of a long series of cases: which one, the seed of this run says.

    Of neighbours, which are alike, as many are taken from everywhere. All are taken with `EVERYTHING`.
    """
    if os.environ.get(EVERYTHING):
        return list(cases)
    return list(cases[project_seed() % parts :: parts])
