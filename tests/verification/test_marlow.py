"""Marlow's law in decks: a uniaxial test has the forces that it was given, at all temperatures of its table."""

import re

import numpy as np
import pytest
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import read_deck
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.testing.block import SIZE, write_block

STRAIN = (0.05, 0.1, 0.2, 0.3)
STRESS = (0.004, 0.007, 0.011, 0.016)
"""MPa; softens, then stiffens."""
TEST = "".join(f"{stress}, {strain}\n" for stress, strain in zip(STRESS, STRAIN, strict=True))
WARM = "".join(f"{row},, 20.\n" for row in TEST.splitlines()) + "".join(
    f"{2 * stress}, {strain},, 40.\n" for stress, strain in zip(STRESS, STRAIN, strict=True)
)
"""Twice as stiff at 40 as at 20."""
VOLUME = "2e3, 0.9\n-1e3, 1.05\n"


def block(folder, uniaxial=TEST, volume=VOLUME, element="C3D8H"):
    """A block that slides and is stretched to each strain of the test."""
    deck = write_block(folder, "displacement", [-SIZE * one for one in STRAIN], element, False, cells=2)
    tests = f"*UNIAXIAL TEST DATA\n{uniaxial}*VOLUMETRIC TEST DATA\n{volume}"
    text = re.sub(r"\*HYPERELASTIC.*\n.*\n", f"*HYPERELASTIC, MARLOW\n{tests}", deck.read_text(encoding="utf-8"))
    deck.write_text(text, encoding="utf-8")
    return deck


@pytest.mark.parametrize("element", ["C3D8H", "C3D10H", "C3D20H", "C3D4H"])
def test_a_block_has_the_forces_of_the_test(element, tmp_path):
    deck = block(tmp_path, element=element)
    found = BuiltinSolver().solve(deck, tmp_path).reaction[:, -1]
    # hardly compressible: as the shear modulus to the bulk modulus
    assert found / SIZE**2 == pytest.approx(STRESS, rel=1e-4)
    read, _ = solve_deck(deck)
    (material,) = read.materials.values()
    assert material.strain == STRAIN
    assert material.stress == STRESS
    assert material.d == (pytest.approx(1e-4),)


@pytest.mark.parametrize(("temperature", "factor"), [(20.0, 1.0), (30.0, 1.5), (50.0, 2.0)])
def test_a_test_for_each_temperature(temperature, factor, tmp_path):
    deck = block(tmp_path, WARM)
    begun = f"*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, {temperature}\n*STEP"
    deck.write_text(deck.read_text(encoding="utf-8").replace("*STEP", begun, 1), encoding="utf-8")
    found = BuiltinSolver().solve(deck, tmp_path).reaction[:, -1]
    assert found / SIZE**2 == pytest.approx(factor * np.array(STRESS), rel=1e-4)
    solve_deck(deck)


@pytest.mark.parametrize(
    ("tests", "told"),
    [
        ({"uniaxial": ""}, r"\*UNIAXIAL TEST DATA: found no data"),
        ({"uniaxial": "0.004, 0.05\n"}, "expected two nominal strains or more above 0"),
        ({"uniaxial": "0.004, 0.05\n0.003, 0.05\n"}, "each larger than that before"),
        ({"uniaxial": "-0.004, -0.05\n0.003, 0.05\n"}, "nominal strains or more above 0"),
        ({"uniaxial": "0.004, 0.05, -0.02\n0.003, 0.05\n"}, "an empty field and the temperature"),
        ({"uniaxial": WARM.replace("40.", "10.")}, "temperatures from the lowest on, each once"),
        ({"uniaxial": WARM + "0.04, 0.5,, 40.\n"}, "as many strains at all of them"),
        ({"volume": "2e3, 1.1\n"}, "a pressure above 0 where J is below 1"),
        ({"volume": "2e3, 0.9\n-2e3, 1.05\n"}, "pressures in proportion to 1 - J"),
        ({"volume": ""}, "found no data"),
    ],
)
def test_what_is_wrong_is_said(tests, told, tmp_path):
    with pytest.raises(InputError, match=told):
        read_deck(block(tmp_path, **tests))


@pytest.mark.parametrize("missing", ["UNIAXIAL", "VOLUMETRIC"])
def test_both_tests_must_be_there(missing, tmp_path):
    deck = block(tmp_path)
    text = re.sub(rf"\*{missing} TEST DATA\n(?:[^*].*\n)+", "", deck.read_text(encoding="utf-8"))
    deck.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"HYPERELASTIC: found no \*{missing} TEST DATA; expected both test data"):
        read_deck(deck)


def test_test_data_of_another_law_are_refused(tmp_path):
    deck = block(tmp_path)
    deck.write_text(re.sub("MARLOW\n", "NEO HOOKE\n0.02, 1e-4\n", deck.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match=r"\*UNIAXIAL TEST DATA: found another law; expected .*MARLOW before it"):
        read_deck(deck)
