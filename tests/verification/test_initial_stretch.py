"""A deviatoric initial stress of a hyperelastic body is that of a stretched material: where nothing holds it, it goes."""

import numpy as np
import pytest
from solving import solve_deck

from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.blocks import layered_block
from fingerfit.report.fields import fields

MU, ALPHA = 0.03, 1.4
X = 1.2
"""Stretch along x."""


def deviator(*stretches):
    power = np.array(stretches) ** ALPHA
    return 2 * MU / ALPHA * (power - power.mean())


def moved(tmp_path, element, stretches, held, start=0.0):
    """Displacements of a square of 2 mm, and its mesh; its deck is deck.inp."""
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
    return steps[-1].displacement, mesh


@pytest.mark.parametrize("element", ["CPS4", "CPS8", "CPE8", "CPE8H", "CPE4", "CPE3H", "CPE6"])
def test_in_the_plane(tmp_path, element):
    """In plane stress it goes all; in plane strain what is left of it is alike in both directions of the plane."""
    found, mesh = moved(tmp_path, element, (X, X**-0.5, X**-0.5), "BOTTOM, 2\n1, 1\n")
    points, gone = mesh.points, np.array([1 / X, X**0.5])
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
    found, mesh = moved(tmp_path, element, (X, X**-2, X), "BOTTOM, 2\n", start=1.0)
    assert found == pytest.approx(mesh.points * [1 / X - 1, X**2 - 1], abs=1e-7)


@pytest.mark.parametrize("element", ["CPE4", "CPE8H", "CPE3H", "CAX8", "CAX3H"])
def test_stress_that_is_exported(tmp_path, element):
    """Before anything moves it is the stress of the deck."""
    around = element.startswith("CAX")
    stretches = (X, X**-2, X) if around else (X, X**-0.5, X**-0.5)
    found, mesh = moved(tmp_path, element, stretches, "BOTTOM, 2\n1, 1\n", start=float(around))
    given = np.diag(deviator(*stretches))
    still = fields(mesh, tmp_path / "deck.inp", np.zeros_like(found)).stress
    assert still == pytest.approx(np.broadcast_to(given, still.shape), abs=1e-9 * MU)


@pytest.mark.parametrize("element", ["CPS8", "CAX8", "CAX3H"])
def test_no_stress_is_exported_of_what_is_free(tmp_path, element):
    around = element.startswith("CAX")
    stretches = (X, X**-2, X) if around else (X, X**-0.5, X**-0.5)
    found, mesh = moved(tmp_path, element, stretches, "BOTTOM, 2\n" + "1, 1\n" * (not around), start=float(around))
    assert fields(mesh, tmp_path / "deck.inp", found).stress == pytest.approx(0.0, abs=1e-6 * MU)
