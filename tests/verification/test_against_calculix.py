"""Elements and materials against CalculiX on the same decks, glued blocks in compression.

Linear quadrilaterals and bricks are integrated fully for this, as CalculiX does. Axisymmetric and plane stress
elements are thin wedges and plates there, a difference of their own.
"""

from dataclasses import replace

import numpy as np
import pytest

from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED
from fingerfit.testing.solver import write_block

MATERIALS = {
    "ogden": "*HYPERELASTIC, OGDEN, N=1\n0.03, 1.4, 0.7",
    "ogden2": "*HYPERELASTIC, OGDEN, N=2\n0.02, 1.4, 0.01, -2., 0.7, 0.9",
    "neo hooke": "*HYPERELASTIC, NEO HOOKE\n0.015, 0.7",
    "mooney-rivlin": "*HYPERELASTIC, MOONEY-RIVLIN\n0.01, 0.005, 0.7",
    "yeoh": "*HYPERELASTIC, YEOH\n0.015, 0.002, 0.0003, 0.7, 0.7, 0.7",
    "elastic": "*ELASTIC\n0.08, 0.4",
}
ELEMENTS = ["CPE3", "CPE4", "CPE6", "CPE8", "CPE8R", "C3D4", "C3D8", "C3D10", "C3D20", "C3D20R"]
EXACT = 2e-7  # seven digits in its .dat, 1 mm of indentation
CASES = {
    **{(element, "ogden"): EXACT for element in ELEMENTS},
    **{("C3D20R", material): EXACT for material in MATERIALS},
    ("CPE8", "elastic"): EXACT,
    ("C3D10", "elastic"): EXACT,
    **{(element, "ogden"): 3e-4 for element in ("CAX3", "CAX4", "CAX6", "CAX8", "CAX8R")},
    **{(element, "elastic"): 1e-3 for element in ("CPS4", "CPS8", "CPS8R")},
    **{(element, "elastic"): 4e-3 for element in ("CPS3", "CPS6")},
}


class AllElements(CalculixSolver):
    """Also those that the adapter refuses, because CalculiX makes wedges and plates of them."""

    capabilities = replace(CalculixSolver.capabilities, elements=frozenset(name for name, _ in CASES))


@pytest.mark.parametrize("element, material", CASES, ids=lambda name: name)
def test_agrees(tmp_path, needs_ccx, element, material):
    deck = write_block(tmp_path, "displacement", [0.5, 1.0], element, cells=2)
    text = deck.read_text(encoding="utf-8")
    start, end = text.index("*HYPERELASTIC"), text.index("*SOLID SECTION")
    deck.write_text(text[:start] + MATERIALS[material] + "\n" + text[end:])
    ours, theirs = BuiltinSolver(averaged=False).solve(deck, tmp_path), AllElements().solve(deck, tmp_path)
    assert ours.status == theirs.status == CONVERGED
    assert np.abs(ours.displacement - theirs.displacement).max() < CASES[element, material]
    # a wedge of 2 degrees carries 1/180 of the force
    share = 180 if element.startswith("CAX") else 1
    assert share * theirs.reaction[:, -1] == pytest.approx(
        ours.reaction[:, -1], rel=max(1e-6, CASES[element, material])
    )


@pytest.mark.parametrize("ends", [1, 2])
def test_nonlinear_springs_agree_within_their_tables_and_beyond(tmp_path, needs_ccx, ends):
    """Three nodes of a block with 3 x 3 CPE8 that move by 0.5 to 0.7 mm in all; ccx reads SPRING1 only beside a SPRING2."""
    deck = write_block(tmp_path, "displacement", [0.3, 1.0])
    rows = {1: ("900, 20", "901, 24", "902, 15"), 2: ("900, 20, 2", "901, 24, 2", "902, 6, 15")}[ends]
    table = "-0.04, -0.6\n-0.03, -0.1\n0., 0.\n0.02, 0.1"
    springs = [f"*ELEMENT, TYPE=SPRING{ends}, ELSET=S", *rows, "*SPRING, ELSET=S, NONLINEAR", "2, 2"[: 3 * ends - 2]]
    text = deck.read_text(encoding="utf-8")
    deck.write_text(text.replace("*MATERIAL", "\n".join([*springs, table, "*MATERIAL"]), 1))
    ours, theirs = BuiltinSolver().solve(deck, tmp_path), CalculixSolver().solve(deck, tmp_path)
    moved = ours.displacement[:, [19, 23, 14], 1] * [1, 1, 1 if ends == 1 else -1]
    assert moved[1].min() < -0.6 and -0.6 < moved[0].min() < -0.1
    assert ours.status == theirs.status == CONVERGED
    # ccx stops at 1e-5 of the mean force; measured 6.3e-7 mm and 5e-7 of the force
    assert np.abs(ours.displacement - theirs.displacement).max() < 2e-6
    assert theirs.reaction[:, 1] == pytest.approx(ours.reaction[:, 1], rel=2e-6)
