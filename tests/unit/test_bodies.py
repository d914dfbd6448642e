"""A block whose stated height is that in the first picture: how high it is without load, and what is read of it."""

import numpy as np
import pytest
from conftest import LAYERS, MU, deck_text, phantom

from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.forward.bodies import lift, moved, without_load
from fingerfit.forward.predict import in_first_picture, since_first_picture
from fingerfit.mesh.blocks import layered_block
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver

MESH = layered_block(12.0, LAYERS, 4, 2, "CPE8H")
HEIGHT = float(np.ptp(MESH.points[:, 1]))
PRESSED = {"preload.force": 20.0}


def deck(values, control="force", mesh=MESH):
    steps = [20.0, 40.0] if control == "force" else [0.5, 1.0]
    return deck_text(phantom(control, steps), mesh, MU | values, {"alpha": 1.4, "poisson": 0.49})


def solved(text, folder, solver="builtin", mesh=MESH):
    write_text(folder / "mesh.inp", format_mesh(mesh))
    write_text(folder / "deck.inp", text)
    outcome = get_solver(solver).solve(folder / "deck.inp", folder)
    assert outcome.status == CONVERGED
    return outcome


@pytest.mark.parametrize("control", ["force", "displacement"])
def test_the_first_picture_has_the_stated_height(control, tmp_path):
    text = deck(PRESSED | {"preload.pictured": 1.0}, control)
    outcome, body = solved(text, tmp_path), without_load(MESH, text)
    pressed = -outcome.indenter[0, -1]
    assert pressed > 0.02 * HEIGHT
    assert np.ptp(body.points[:, 1]) - pressed == pytest.approx(HEIGHT, abs=1e-6)
    # all heights grow alike, and nothing else does
    assert body.points[:, 0] == pytest.approx(MESH.points[:, 0], abs=0)
    factor = np.ptp(body.points[:, 1]) / HEIGHT
    assert body.points[:, 1] == pytest.approx(factor * MESH.points[:, 1])
    shown = in_first_picture(MESH, since_first_picture(outcome, 2, True, lift(MESH, text)))
    top = np.isclose(MESH.points[:, 1], HEIGHT)
    assert shown.points[top, 1] == pytest.approx(HEIGHT, abs=1e-6)
    # the sides bulge from the start
    assert shown.points[:, 0].max() > 12.0 + 0.1


def test_it_is_the_answer_to_the_deck_of_the_higher_body(tmp_path):
    text = deck(PRESSED | {"preload.pictured": 1.0})
    higher = without_load(MESH, text)
    plain = deck(PRESSED)
    assert "*INCLUDE" not in text
    write_text(tmp_path / "mesh.inp", format_mesh(higher))
    write_text(tmp_path / "deck.inp", plain)
    known = get_solver("builtin").solve(tmp_path / "deck.inp", tmp_path)
    (tmp_path / "own").mkdir()
    assert solved(text, tmp_path / "own").displacement == pytest.approx(known.displacement, abs=1e-9)


def test_calculix_takes_the_mesh_in_the_deck(tmp_path, needs_ccx):
    mesh = layered_block(12.0, LAYERS, 4, 2, "CPE8")
    text = deck(PRESSED | {"preload.pictured": 1.0}, mesh=mesh)
    ours, theirs = (solved(text, tmp_path, solver, mesh) for solver in ("builtin", "calculix"))
    assert theirs.displacement == pytest.approx(ours.displacement, abs=1e-5 * HEIGHT)


def test_without_such_a_state_the_deck_includes_the_mesh():
    for values in (PRESSED, PRESSED | {"preload.pictured": 0.0}, {"preload.force": 0.0, "preload.pictured": 1.0}):
        text = deck(values)
        assert "*INCLUDE, INPUT=mesh.inp\n" in text
        assert without_load(MESH, text) is MESH
        assert lift(MESH, text) == 0.0


def test_a_load_without_equilibrium_leaves_the_body_as_stated():
    text = deck({"preload.force": 1e6, "preload.pictured": 1.0})
    assert without_load(MESH, text).points == pytest.approx(MESH.points, abs=0)


def test_a_higher_body_has_its_borders_elsewhere_too():
    """Under the load of the first picture they lie where they were put; without it so much higher as all else."""
    text = deck(PRESSED | {"preload.pictured": 1.0, "interface.down": 0.5, "interface.border": 1})
    beside, whole = moved(MESH, text), without_load(MESH, text)
    border, top = np.isclose(MESH.points[:, 1], 8.0), np.isclose(MESH.points[:, 1], 12.0)
    assert beside[border, 1] == pytest.approx(-0.5, abs=1e-6)
    assert beside[top, 1] == pytest.approx(0.0, abs=1e-6)
    assert whole.points[border, 1] / 7.5 == pytest.approx(whole.points[top, 1].mean() / 12.0)
    assert moved(MESH, deck(PRESSED | {"preload.pictured": 1.0})) is None
