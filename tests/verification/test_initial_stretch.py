"""A deviatoric initial stress of a hyperelastic body is that of a stretched material: where nothing holds it, it goes."""

import numpy as np
import pytest
from solving import solve_deck

from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.blocks import layered_block

MU, ALPHA = 0.03, 1.4
X = 1.2
"""Stretch along x."""


def deviator(*stretches):
    power = np.array(stretches) ** ALPHA
    return 2 * MU / ALPHA * (power - power.mean())


def moved(tmp_path, element, stretches, held, start=0.0):
    """Displacements of a square of 2 mm, and where its nodes were."""
    mesh = layered_block(2.0, [("body", 2.0)], 2, 2, element)
    mesh.points[:, 0] += start
    stress = ", ".join(f"{one:.15g}" for one in deviator(*stretches))
    path = tmp_path / "deck.inp"
    path.write_text(
        f"{format_mesh(mesh)}*SOLID SECTION, ELSET=BODY, MATERIAL=M\n1.\n*MATERIAL, NAME=M\n"
        f"*HYPERELASTIC, OGDEN, N=1\n{MU}, {ALPHA}, 1.\n*INITIAL CONDITIONS, TYPE=STRESS\nBODY, {stress}, 0.\n"
        f"*BOUNDARY\n{held}*STEP, NLGEOM\n*STATIC\n*END STEP\n"
    )
    _, steps = solve_deck(path)
    assert steps[-1].arrived
    return steps[-1].displacement, mesh.points


@pytest.mark.parametrize("element", ["CPS4", "CPS8", "CPE8", "CPE8H", "CPE4", "CPE3H", "CPE6"])
def test_in_the_plane(tmp_path, element):
    """In plane stress it goes all; in plane strain what is left of it is alike in both directions of the plane."""
    found, points = moved(tmp_path, element, (X, X**-0.5, X**-0.5), "BOTTOM, 2\n1, 1\n")
    gone = np.array([1 / X, X**0.5])
    along, up = 1 + found[points[:, 0] == 2.0, 0].mean() / 2.0, 1 + found[points[:, 1] == 2.0, 1].mean() / 2.0
    if element.startswith("CPS"):
        assert [along, up] == pytest.approx(gone, abs=1e-7)
    else:
        assert along / up == pytest.approx(gone[0] / gone[1], abs=1e-7)
        assert along * up == pytest.approx(1.0, abs=2e-2)
    assert np.ptp(found[points[:, 0] == 2.0, 0]) < 1e-7


@pytest.mark.parametrize("element", ["CAX4", "CAX8", "CAX8H", "CAX3H"])
def test_around_an_axis(tmp_path, element):
    """A ring that was stretched as a disc is: along its radius and around as much."""
    found, points = moved(tmp_path, element, (X, X**-2, X), "BOTTOM, 2\n", start=1.0)
    assert found == pytest.approx(points * [1 / X - 1, X**2 - 1], abs=1e-7)
