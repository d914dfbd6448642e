"""One seed moves all random numbers of the tests, and no test draws any that it does not move."""

import re
from pathlib import Path

import numpy as np
import pytest
from seeds import LARGEST, VARIABLE, generator, seed_of

TESTS = Path(__file__).resolve().parents[1]
OWN = re.compile(r"default_rng\((?!\))|np\.random\.(?!Generator|default_rng)|random\.Random\((?!seed_of)|\"seed\": *\d")
"""Random numbers with a seed of their own; the load of `default_rng()` in a program of its own is of no test."""


def test_without_the_variable_a_use_has_its_own_seed(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert [seed_of(own) for own in (0, 7)] == [0, 7]
    assert np.array_equal(generator(7).normal(size=5), np.random.default_rng(seed_of(7)).normal(size=5))


def test_another_value_is_other_numbers_everywhere(monkeypatch):
    drawn = set()
    for value in ("0", "1", "2", str(LARGEST)):
        monkeypatch.setenv(VARIABLE, value)
        drawn |= {float(generator(own).normal()) for own in range(50)}
    assert len(drawn) == 4 * 50
    assert seed_of(999) < 2**32


@pytest.mark.parametrize("value", ["", "-1", "1.5", "new", str(LARGEST + 1)])
def test_a_wrong_value_is_told(monkeypatch, value):
    monkeypatch.setenv(VARIABLE, value)
    with pytest.raises(
        ValueError, match=rf"{VARIABLE}: found {re.escape(value)}; expected a whole number from 0 to {LARGEST}"
    ):
        seed_of(1)


def test_no_test_draws_with_a_seed_of_its_own():
    found = [
        f"{path.relative_to(TESTS)}:{number}: {line.strip()}"
        for path in sorted(TESTS.rglob("*.py"))
        if path.name not in {"seeds.py", Path(__file__).name}
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if OWN.search(line)
    ]
    assert found == []
