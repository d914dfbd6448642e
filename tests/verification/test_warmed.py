"""Constants that depend on the temperature: closed forms, what is read, and CalculiX."""

import re

import numpy as np
import pytest
from scipy.optimize import brentq
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import read_deck
from fingerfit.material.ogden import Ogden
from fingerfit.report.fields import fields
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED
from fingerfit.testing.block import SIZE, write_block

ROWS = ((0.02, 1.4, 1.0, 10.0), (0.03, 1.4, 0.7, 20.0), (0.05, 2.0, 0.5, 40.0))


def warm_block(folder, element, temperatures, glued=False, begun=20.0, rows=None):
    """A block of 10 mm that is pressed by 2 mm, and then only becomes warmer; Ogden's constants have a table."""
    deck = write_block(folder, "displacement", [2.0] * len(temperatures), element, glued, cells=2)
    text = deck.read_text(encoding="utf-8")
    table = rows or "\n".join(", ".join(map(str, row)) for row in ROWS)
    text = re.sub(r"N=1\n.*\n", f"N=1\n{table}\n", text)
    text = text.replace("*STEP", f"*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, {begun}\n*STEP", 1)
    given = iter(f"*TEMPERATURE\nALL, {t}\n*NODE PRINT, NSET=ALL" for t in temperatures)
    deck.write_text(re.sub(r"\*NODE PRINT, NSET=ALL", lambda _: next(given), text), encoding="utf-8")
    return deck


def force(element, temperature):
    """Force in N on a block that slides, of the constants at a temperature."""
    mu, alpha, d = (np.interp(temperature, [row[3] for row in ROWS], [row[k] for row in ROWS]) for k in range(3))
    material, down = Ogden((mu,), (alpha,), (d,)), 0.8

    def first(wide):
        return material.derivatives(np.array([down, wide, wide if element.startswith("C3") else 1.0]))[0]

    wide = brentq(lambda w: first(w)[1], 0.5, 2.0, xtol=1e-15)
    return first(wide)[0] / down * SIZE * (SIZE if element.startswith("C3") else 2.0)


@pytest.mark.parametrize("element", ["CPE8H", "CPE4", "CPE3H", "C3D8", "C3D4H", "C3D10", "C3D20H"])
def test_a_block_has_the_force_of_the_constants_at_its_temperature(element, tmp_path):
    """Between two rows, at one, and beyond the ends, where constants stay as they are."""
    temperatures = [30.0, 40.0, 15.0, 0.0, 60.0]
    deck = warm_block(tmp_path, element, temperatures)
    found = BuiltinSolver().solve(deck, tmp_path).reaction[:, -1]
    assert found == pytest.approx([force(element, temperature) for temperature in temperatures], rel=1e-6)
    solve_deck(deck)  # what is written of it has the same solution


def test_stresses_are_those_at_the_end_of_a_step(tmp_path):
    deck = warm_block(tmp_path, "C3D8", [40.0, 10.0])
    outcome, mesh = BuiltinSolver().solve(deck, tmp_path), read_deck(deck).mesh
    for step, temperature in enumerate((40.0, 10.0)):
        u = outcome.displacement[step]
        stress = fields(mesh, deck, u, step).stress[:, 2, 2] * (SIZE + np.ptp(u[:, 0])) ** 2
        assert stress == pytest.approx(outcome.reaction[step, 2], rel=1e-4)
        assert stress == pytest.approx(force("C3D8", temperature), rel=1e-4)


@pytest.mark.parametrize("element", ["CPE4", "CPE8", "C3D10", "C3D20R"])
def test_calculix_agrees(element, tmp_path, needs_ccx):
    """A glued block; CalculiX stops at 1e-5 of the mean force (`tests/verification/test_against_calculix.py`)."""
    deck = warm_block(tmp_path, element, [35.0, 12.0, 50.0], glued=True)
    ours, theirs = BuiltinSolver(averaged=False).solve(deck, tmp_path), CalculixSolver().solve(deck, tmp_path)
    assert ours.status == theirs.status == CONVERGED
    assert np.abs(ours.displacement - theirs.displacement).max() < 1e-5 * np.abs(ours.displacement).max()
    assert ours.reaction[:, -1] == pytest.approx(theirs.reaction[:, -1], rel=1e-4)
    assert ours.reaction[2, -1] / ours.reaction[1, -1] > 1.3


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0.02, 1.4, 1., 10., 5.", "found 5 constants; expected 3: .* or sets of 4, each with its temperature"),
        ("0.02, 1.4, 1., 10.\n0.02, 1.4, 1., 10.", "expected temperatures from the lowest on, each once"),
        ("0.02, 1.4, 1., 10.\n0.03, 1.4, 0., 20.", "D = 0, incompressible"),
    ],
)
def test_what_is_wrong_is_said(rows, told, tmp_path):
    with pytest.raises(InputError, match=told):
        read_deck(warm_block(tmp_path, "CPE8", [20.0], rows=rows))
