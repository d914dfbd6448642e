"""Whole solutions: closed forms, equilibrium, and CalculiX on the same deck."""

import numpy as np
import pytest
from conftest import LAYERS, phantom

from fingerfit.fem.system import System
from fingerfit.material.ogden import Ogden
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED, DIVERGED
from fingerfit.study.study import Body, Layer, Noise, Step, Study

ALIKE = {"mu": 0.03}


def lateral(material: Ogden, stretch: float, free: int) -> float:
    """Stretch of the free directions at which they carry no stress, by bisection."""
    low, high = 0.5, 2.0
    for _ in range(200):
        middle = (low + high) / 2
        stretches = np.array([stretch, middle, middle if free == 2 else 1.0])
        low, high = (low, middle) if material.derivatives(stretches)[0][1] > 0 else (middle, high)
    return middle


def ogden(mu=0.03, alpha=1.4, nu=0.495) -> Ogden:
    return Ogden((mu,), (alpha,), (2 / (2 * mu * (1 + nu) / (3 * (1 - 2 * nu))),))


@pytest.mark.parametrize("element", ["CPE4", "CPE6", "CPE8", "CPE8R"])
def test_homogeneous_plane_strain_compression(write_deck, tmp_path, element):
    study = phantom("displacement", [1.2, 3.0], "slides", "slides")
    deck, _ = write_deck(study, layered_block(12.0, LAYERS, 3, 1, element), ALIKE)
    outcome = BuiltinSolver().solve(deck, tmp_path)
    assert outcome.status == CONVERGED
    for step, u in enumerate((1.2, 3.0)):
        stretch = 1 - u / 12
        wide = lateral(ogden(), stretch, 1)
        force = ogden().derivatives(np.array([stretch, wide, 1.0]))[0][0] / stretch * 12 * 70
        assert outcome.reaction[step, 1] == pytest.approx(force, rel=1e-7)
        assert np.ptp(outcome.displacement[step, :, 0]) == pytest.approx((wide - 1) * 12, rel=1e-6)


def test_uniaxial_compression_of_a_brick(write_deck, tmp_path):
    steps = tuple(Step(n, displacement=u) for n, u in enumerate((3.0, 9.0), 1))
    body = Body((Layer("body"),), brick=(10.0, 10.0, 20.0))
    study = Study(tmp_path, "brick", "displacement", steps, None, Noise(), body, "slides", "slides")
    deck, _ = write_deck(study, brick((10.0, 10.0, 20.0), (2, 1, 2)), ALIKE, alpha=3.0)
    outcome = BuiltinSolver().solve(deck, tmp_path)
    material = ogden(alpha=3.0)
    for step, u in enumerate((3.0, 9.0)):
        stretch = 1 - u / 20
        wide = lateral(material, stretch, 2)
        force = material.derivatives(np.array([stretch, wide, wide]))[0][0] / stretch * 100
        assert outcome.reaction[step, 2] == pytest.approx(force, rel=1e-7)


def test_force_and_displacement_control_agree(write_deck, tmp_path):
    deck, _ = write_deck(phantom("displacement", [0.5, 1.5, 2.5, 3.5]))
    moved = BuiltinSolver().solve(deck, tmp_path)
    deck, _ = write_deck(phantom("force", list(-moved.reaction[:, 1])))
    forced = BuiltinSolver().solve(deck, tmp_path)
    assert forced.displacement == pytest.approx(moved.displacement, abs=1e-6)
    assert forced.indenter[:, 1] == pytest.approx([-0.5, -1.5, -2.5, -3.5], abs=1e-6)


def test_reaction_of_the_papers_mesh(write_deck, tmp_path):
    """An independent prototype found 0.524 and 1.139 N/mm at 2 and 3.5 mm on 6 x 6 CPE8."""
    deck, mesh = write_deck(phantom("displacement", [2.0, 3.5]))
    assert len(mesh.points) == 133
    force = -BuiltinSolver().solve(deck, tmp_path).reaction[:, 1] / 70
    assert force == pytest.approx([0.524, 1.139], abs=6e-4)


@pytest.mark.parametrize("element", ["CPE8", "CPE8H"])
def test_a_foretold_pressure_saves_iterations_and_changes_no_answer(write_deck, tmp_path, monkeypatch, element):
    """Found: 28 and 30 iterations with it, 39 and 55 without."""
    force = [7.0, 14.5, 22.8, 32.8, 42.4, 54.1, 66.3]
    deck, _ = write_deck(phantom("force", force), layered_block(12.0, LAYERS, 8, 3, element, 4.0))
    led = BuiltinSolver().solve(deck, tmp_path)
    assert led.status == CONVERGED
    evaluate = System.evaluate
    monkeypatch.setattr(System, "evaluate", lambda system, u, tangent=True, led=False: evaluate(system, u, tangent))
    plain = BuiltinSolver().solve(deck, tmp_path)
    assert sum(led.iterations) < 0.8 * sum(plain.iterations)
    assert led.displacement == pytest.approx(plain.displacement, abs=1e-6)


def test_a_hopeless_guess_is_an_answer(write_deck, tmp_path):
    deck, _ = write_deck(phantom("force", [5.0, 4000.0]))
    outcome = BuiltinSolver().solve(deck, tmp_path)
    assert outcome.status == DIVERGED
    assert outcome.steps == 1
    assert "step 2" in outcome.message


@pytest.mark.parametrize("control", ["force", "displacement"])
@pytest.mark.parametrize("element", ["CPE4", "CPE6", "CPE8", "CPE8R"])
def test_agrees_with_calculix(write_deck, tmp_path, needs_ccx, element, control):
    values = [7.0, 23.0, 43.0] if control == "force" else [0.5, 1.5, 2.5]
    deck, _ = write_deck(phantom(control, values), layered_block(12.0, LAYERS, 6, 2, element))
    ours = BuiltinSolver(averaged=False).solve(deck, tmp_path)
    theirs = CalculixSolver().solve(deck, tmp_path)
    assert ours.status == theirs.status == CONVERGED
    indentation = np.abs(theirs.displacement).max()
    assert np.abs(ours.displacement - theirs.displacement).max() < 1e-4 * indentation
    assert ours.reaction[:, 1] == pytest.approx(theirs.reaction[:, 1], rel=1e-4)
