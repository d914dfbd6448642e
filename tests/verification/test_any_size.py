"""Lengths that are shares: bodies of micrometres, of 12 mm and of 60 mm get the same answers."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from seeds import generator

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.deck.render import render_deck
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.points import estimate_covariance
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.blocks import brick
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.study.study import Body, Layer, Noise, Step, Study

WIDTHS = (1e-5, 1e-3, 12.0, 60.0, 1e5)
"""mm; study.yaml takes lengths from 1e-6 to 1e6 mm."""
MU = {"mu_epidermis": 0.138, "mu_subcutaneous": 0.00798}


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    ("what", "moved", "same"),
    [("origin", 0.001, True), ("origin", 0.05, False), ("spacing", 1e-6, True), ("spacing", 1e-3, False)],
)
def test_pictures_lie_in_one_place_by_the_pixel(width, what, moved, same):
    pixel = width / 100
    one = Picture(np.zeros((120, 120)), np.full(2, pixel), np.full(2, -30 * pixel), np.eye(2))
    other = replace(one, **{what: getattr(one, what) + moved * pixel})
    assert one.same_place(other) is same
    # what is told is no row of zeros
    assert ("[" in one.difference(other)) is not same
    assert "[0.0" not in one.difference(other) or width > 1


@pytest.mark.parametrize("width", WIDTHS)
def test_points_are_found_in_their_elements(width):
    unit = brick((1.0, 1.0, 1.0), (6, 6, 6), element="C3D8")
    inside = generator(3).uniform(0.01, 0.99, (200, 3))
    points = np.vstack([inside, [[1.001, 0.5, 0.5], [0.5, -0.001, 0.5]]])
    expected = Probe(unit, points)
    assert (expected.element[:200] >= 0).all()
    assert (expected.element[200:] < 0).all()
    found = Probe(replace(unit, points=width * unit.points), width * points)
    assert found.element.tolist() == expected.element.tolist()
    moves = unit.points**2
    assert found.read(width * moves)[:200] == pytest.approx(width * expected.read(moves)[:200], rel=1e-6)


@pytest.mark.parametrize("width", WIDTHS)
def test_points_of_two_steps_are_the_same_by_their_extent(width):
    rng = generator(4)
    first = width * rng.uniform(0, 1, (60, 2))
    moved = np.vstack([0.01 * width * rng.normal(size=(60, 2)) for _ in range(2)])
    step = np.repeat([0, 1], 60)
    found = estimate_covariance(np.vstack([first, first + 1e-7 * width]), moved, step, 2)
    assert found[0, 0] == pytest.approx((0.01 * width) ** 2, rel=0.4)
    with pytest.raises(ValueError, match="different points"):
        estimate_covariance(np.vstack([first, first + 1e-2 * width]), moved, step, 2)


def pressed(folder, finger, times, control, value):
    """Deck and answer of a finger that is larger in all lengths, the sphere's among them."""
    mesh = replace(finger, points=times * finger.points)
    step = Step(1, **{control: value})
    body = Body((Layer("epidermis"), Layer("subcutaneous")))
    study = Study(ROOT, "finger", control, (step,), None, Noise(), body, "held", "slides")
    context = deck_context(study, mesh, "mesh.inp", MU, {"alpha": 1.4, "poisson": 0.45})
    folder.mkdir()
    (folder / "mesh.inp").write_text(format_mesh(mesh))
    (folder / "deck.inp").write_text(render_deck("fingertip.inp.j2", context, [ROOT / "templates"]))
    return read_deck(folder / "deck.inp"), BuiltinSolver().solve(folder / "deck.inp", folder), context["values"]


@pytest.mark.parametrize("times", [1e-3, 5.0])
def test_contact_is_as_stiff_in_a_larger_finger(tmp_path, times):
    """Stresses stay: the way grows with lengths, the force with their squares."""
    finger = add_fixtures(finger_mesh(size=5.0, element="C3D4"), (Anatomy().pulp_centre, 0.0))
    deck, small, values = pressed(tmp_path / "small", finger, 1.0, "displacement", 0.8)
    # today's numbers
    assert (values["contact_stiffness"], values["establish"]) == (5.0, 0.3)
    assert [law.stiffness for law in deck.laws.values()] == [5.0, 5.0]
    deck, large, values = pressed(tmp_path / "large", finger, times, "displacement", 0.8 * times)
    assert [law.stiffness for law in deck.laws.values()] == pytest.approx([5.0 / times] * 2)
    assert values["establish"] == pytest.approx(0.3 * times, rel=1e-6)
    assert large.reaction[0] == pytest.approx(times**2 * small.reaction[0], rel=1e-5, abs=1e-9 * times**2)
    apart = np.abs(large.displacement[0] / times - small.displacement[0]).max()
    assert apart < 1e-6
