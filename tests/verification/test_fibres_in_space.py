"""Fibres in the layers of a brick: closed forms, and what turning or mirroring them does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from test_effects_in_space import LAYERS, WIDTH, solve, study

from fingerfit.mesh.blocks import brick

NU, DOWN = 0.45, 1.2
MESH = brick((WIDTH, WIDTH, 6.0), (2, 2, 1), element="C3D20H", layers=LAYERS)
HELD = study("displacement", DOWN)


def fibres(angle, stiffness=0.5, exponent=6.0):
    return {
        f"fibres_in_space.{name}": x for name, x in (("stiffness", stiffness), ("angle", angle), ("exponent", exponent))
    }


def between_plates_that_slide(along, across, down, stiffness, exponent):
    """Energy over mu of a brick of three stretches with fibres along the first one, as ABAQUS has both laws."""
    volume = along * across * down
    even = np.array([along, across, down]) / np.cbrt(volume)
    bulk = 2 * (1 + NU) / (3 * (1 - 2 * NU))
    strain = max(even[0] ** 2 - 1, 0.0)
    own = stiffness / (2 * exponent) * (np.exp(exponent * strain**2) - 1)
    return 0.5 * (np.sum(even**2) - 3) + bulk / 2 * (volume - 1) ** 2 + own


@pytest.mark.parametrize("element", ["C3D8", "C3D20H", "C3D10"])
@pytest.mark.parametrize(("angle", "axis"), [(0.0, 0), (90.0, 1)])
def test_between_plates_that_slide_it_bulges_across_the_fibres(angle, axis, element, tmp_path):
    """Its energy is least: the matrix of the fibres has a millionth of mu."""
    mesh = brick((WIDTH, WIDTH, 6.0), (2, 2, 1), element=element, layers=LAYERS)
    free = replace(HELD, base="slides", indenter="slides")
    moved = solve(fibres(angle), tmp_path, of=free, mesh=mesh)
    found = 1 + moved[np.argmax(mesh.points.sum(axis=1))] / [WIDTH, WIDTH, 6.0]
    down = 1 - DOWN / 6.0
    least = minimize(
        lambda x: between_plates_that_slide(*x, down, 0.5, 6.0), [1.0, 1.0], method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-15},
    ).x  # fmt: skip
    assert found == pytest.approx([*(least if axis == 0 else least[::-1]), down], abs=2e-6)
    assert least[1] - least[0] > 0.02


def mirrored(field, sign):
    """Of a square brick, x and y exchanged, or with the sign -1 mirrored in x."""
    points = MESH.points[:, [1, 0, 2]] if sign > 0 else MESH.points * [-1, 1, 1] + [WIDTH, 0, 0]
    where = [np.abs(MESH.points - place).max(axis=1).argmin() for place in points]
    return field[where][:, [1, 0, 2]] if sign > 0 else field[where] * [-1, 1, 1]


def test_they_turn_with_their_angle(tmp_path):
    at = {angle: solve(fibres(angle), tmp_path, of=HELD, mesh=MESH) for angle in (0.0, 90.0, 45.0, -45.0)}
    assert at[90.0] == pytest.approx(mirrored(at[0.0], 1), abs=1e-6)
    assert at[-45.0] == pytest.approx(mirrored(at[45.0], -1), abs=1e-6)
    assert at[45.0] == pytest.approx(mirrored(at[45.0], 1), abs=1e-6)
    assert np.abs(at[0.0] - at[90.0]).max() > 0.01
    outwards = {}
    for x, y in ((0, 0), (1, 0)):  # a corner that the fibres at 45 degrees go to, and one that they do not
        corner = np.abs(MESH.points - [WIDTH * x, WIDTH * y, 3.0]).max(axis=1).argmin()
        outwards[x] = at[45.0][corner, :2] @ [2 * x - 1, 2 * y - 1]
    assert 0 < outwards[0] < 0.95 * outwards[1]
