"""An indenter that goes another way than straight down: closed forms, CalculiX, and a fit of the force across the load."""

import copy

import numpy as np
import pytest
import yaml
from blocks import FIT, STUDY
from seeds import generator

from fingerfit.core.files import read_npz
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.minimum import finest
from fingerfit.forward.decks import make_deck
from fingerfit.notebook import diagnose, fit
from fingerfit.prepare.prepare import make_mesh
from fingerfit.report.export import _forces as export_forces
from fingerfit.report.findings import write_compare
from fingerfit.report.page.build import _forces as forces_of
from fingerfit.report.page.inputs import Model, read_compare
from fingerfit.settings.config import load_settings
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED

MU, POISSON = 0.05, 0.45
WIDTH, HEIGHT, THICKNESS = 12.0, 8.0, 70.0
ONE_ELEMENT = {"element": "CPE4", "across": 1, "per_layer": 1, "grading": 1}
SEVERAL = {"element": "CPE8R", "across": 4, "per_layer": 3, "grading": 1}
MOVES = [(0.8, 0.0), (0.8, 1.6), (1.2, -1.6), (1.6, 2.4)]
"""Displacements down and along x, mm."""


def bulk(mu, poisson):
    return 2 * mu * (1 + poisson) / (3 * (1 - 2 * poisson))


def sheared(moves, mu=MU, poisson=POISSON):
    """Forces down and along x, N, of a neo-Hookean block of homogeneous strain, shape (steps, 2).

    F = [[1, g], [0, s]]: with b = F F^T, J = s and I1 = 2 + g^2 + s^2 the first Piola-Kirchhoff stresses on the upper
    side are P_22 = mu J^(-5/3) (s^2 - I1 / 3) + K (J - 1) and P_12 = mu g s J^(-5/3).
    """
    down, aside = np.transpose(moves)
    s, g = 1 - down / HEIGHT, aside / HEIGHT
    normal = mu * s ** (-5 / 3) * (s**2 - (2 + g**2 + s**2) / 3) + bulk(mu, poisson) * (s - 1)
    return WIDTH * THICKNESS * np.stack([-normal, mu * g * s ** (-2 / 3)], axis=1)


def placed(folder, steps, mesh=ONE_ELEMENT, parameters=("mu",), **own):
    """Settings of a study of a neo-Hookean block in a folder."""
    study = copy.deepcopy(STUDY)
    study["body"] = {"width": WIDTH, "thickness": THICKNESS, "layers": [{"name": "gel", "height": HEIGHT}]}
    study |= own
    known = {
        "mu": {"unit": "MPa", "start": MU, "lower": 0.01, "upper": 0.2},
        "poisson": {"unit": "1", "start": 0.4, "lower": 0.2, "upper": 0.49},
    }
    config = {
        "study": str(folder / "study"),
        "results": str(folder / "results"),
        "model": {
            "law": "neo_hooke",
            "material": {} if "poisson" in parameters else {"poisson": POISSON},
            "parameters": {name: known[name] for name in parameters},
            "mesh": mesh,
        },
        "fit": {**FIT, "replicates": 20},
    }
    (folder / "study").mkdir(parents=True)
    (folder / "study/study.yaml").write_text(yaml.safe_dump(study))
    (folder / "study/steps.csv").write_text(steps)
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return load_settings(folder / "config.yaml")


def solved(settings, folder, solver=None):
    """Solution of the deck of the start of the search."""
    study = settings.read_study()
    mesh = make_mesh(study, settings.model.mesh)
    deck = folder / "sims/one/deck.inp"
    deck.parent.mkdir(parents=True, exist_ok=True)
    (folder / "meshes").mkdir(exist_ok=True)
    (folder / "meshes/mesh.inp").write_text(format_mesh(mesh))
    deck.write_text(make_deck(settings, study, mesh, "mesh", settings.starts(), settings.known_effects()))
    # fully integrated, as in CalculiX
    outcome = (solver or BuiltinSolver(averaged=False)).solve(deck, deck.parent)
    assert outcome.status == CONVERGED
    return outcome


def table(columns, *rows):
    lines = [",".join(f"{value:.12g}" for value in (n, *row)) for n, row in enumerate(rows, 1)]
    return "\n".join([f"step,{columns}", *lines]) + "\n"


def test_compression_and_shear_of_one_element_are_the_closed_form(tmp_path):
    steps = table("displacement,displacement_x,force", *[(*move, 1.0) for move in MOVES])
    outcome = solved(placed(tmp_path, steps), tmp_path)
    # negative down, as the last axis is; a shear to the right needs a force to the right
    found = np.stack([-outcome.reaction[:, 1], outcome.reaction[:, 0]], axis=1)
    assert np.allclose(found, sheared(MOVES), rtol=1e-8, atol=1e-8)


def test_an_oblique_indenter_goes_along_its_direction_and_its_force_is_the_one_along_it(tmp_path):
    boundary = {"base": "held", "indenter": {"kind": "glued", "direction": [3, -4]}}
    outcome = solved(placed(tmp_path, table("displacement,force", (1.0, 1.0), (2.0, 1.0)), boundary=boundary), tmp_path)
    assert np.allclose(outcome.indenter, [[0.6, -0.8], [1.2, -1.6]])
    wanted = sheared([(0.8, 0.6), (1.6, 1.2)])
    force = wanted @ [0.8, 0.6]
    assert np.allclose(outcome.reaction @ [0.6, -0.8], force, rtol=1e-8)
    # the same on a rail under that force
    steps = table("force,displacement", *[(one, 0.1) for one in force])
    driven = solved(placed(tmp_path / "force", steps, boundary=boundary, control="force"), tmp_path / "force")
    assert np.allclose(driven.displacement, outcome.displacement, atol=1e-6)
    assert np.allclose(driven.reaction, outcome.reaction, atol=1e-4)


DIRECTION = {"base": "held", "indenter": {"kind": "glued", "direction": [1, -2]}}
CASES = {
    "shear": ({}, table("displacement,displacement_x,force", (0.8, 0.0, 1), (0.8, 1.2, 1), (1.2, -0.5, 1))),
    "shear under force": ({"control": "force"}, table("force,displacement_x,displacement", (20, 0, 1), (20, 1.2, 1))),
    "direction": ({"boundary": DIRECTION}, table("displacement,force", (0.8, 1), (1.6, 1))),
    "rail": ({"boundary": DIRECTION, "control": "force"}, table("force,displacement", (20, 1), (45, 1))),
}


@pytest.mark.parametrize("case", CASES)
def test_calculix_says_the_same_of_the_same_deck(tmp_path, needs_ccx, case):
    own, steps = CASES[case]
    settings = placed(tmp_path, steps, SEVERAL, **own)
    ours, theirs = solved(settings, tmp_path), solved(settings, tmp_path, CalculixSolver())
    assert np.abs(ours.displacement - theirs.displacement).max() < 1e-6
    assert np.allclose(ours.reaction, theirs.reaction, rtol=1e-5, atol=1e-5)
    assert np.abs(ours.reaction[-1, 0]) > 0.5


def test_a_brick_is_moved_along_both_axes(tmp_path, needs_ccx):
    body = {"brick": [6, 5, 4], "layers": [{"name": "gel"}]}
    steps = table("displacement,displacement_x,displacement_y,force", (0.4, 0.6, -0.3, 1.0))
    mesh = {"element": "C3D8", "across": 2, "per_layer": 2}
    settings = placed(tmp_path, steps, mesh, body=body)
    ours, theirs = solved(settings, tmp_path), solved(settings, tmp_path, CalculixSolver())
    assert np.allclose(ours.indenter, [[0.6, -0.3, -0.4]])
    assert np.allclose(ours.reaction, theirs.reaction, rtol=1e-5)
    assert ours.reaction[0, 0] > 0 > ours.reaction[0, 1]


@pytest.fixture(scope="module")
def measured():
    """Forces with noise of 0.05 N, and their rows with and without the one along x."""
    forces = sheared(MOVES) + generator(7).normal(0.0, 0.05, (len(MOVES), 2))
    both = table("displacement,displacement_x,force,force_x", *np.column_stack([MOVES, forces]))
    down = table("displacement,displacement_x,force", *np.column_stack([MOVES, forces[:, 0]]))
    return both, down


def test_the_force_across_the_load_is_data(tmp_path, measured):
    """From forces down, modulus and bulk modulus are nearly one; the force across depends on the modulus alone."""
    both, down = (
        fit(placed(tmp_path / name, steps, parameters=("mu", "poisson")), tmp_path / name / "results")
        for name, steps in zip(("both", "down"), measured, strict=True)
    )
    found, error = both.constants.value, both.constants.standard_error
    for name, truth in (("mu", MU), ("poisson", POISSON)):
        # 20 repetitions tell a standard error to 16 %
        assert abs(found[name] - truth) < 5 * error[name]
    assert down.constants.standard_error["mu"] > 5 * error["mu"]
    # Fisher's information of the forces across alone, whose noise is 0.05 N: they are proportional to mu
    across = sheared(MOVES)[:, 1]
    assert error["mu"] / MU < 1.5 * 0.05 / np.linalg.norm(across)


def test_straight_and_oblique_are_two_tests_of_one_study(tmp_path):
    forces = sheared([(0.8, 0.0), (1.2, 1.6)])
    indenter = {"kind": "glued", "direction": [4, -3]}
    tests = {"straight": {}, "oblique": {"steps": "oblique.csv", "boundary": {"base": "held", "indenter": indenter}}}
    settings = placed(
        tmp_path, table("displacement,force", (0.8, forces[0, 0])), parameters=("mu", "poisson"), tests=tests
    )
    (tmp_path / "study/oblique.csv").write_text(table("displacement,force", (2.0, forces[1] @ [0.6, 0.8])))
    found = fit(settings, tmp_path / "results").constants.value
    assert found["mu"] == pytest.approx(MU, rel=1e-3)
    assert found["poisson"] == pytest.approx(POISSON, rel=1e-3)


def test_tables_and_page_list_the_force_across(tmp_path, measured):
    result = fit(placed(tmp_path, measured[0]), tmp_path / "results")
    write_compare(diagnose(result).diagnosis.comparison, tmp_path / "compare.npz")
    compare = read_compare(tmp_path / "compare.npz")
    assert compare.response.shape == (len(MOVES),)
    forces = forces_of(Model("base", {}, compare, {}, {}))
    assert forces[2]["lateral"] == [("−9.41", "−9.36")]
    head, *rows = export_forces(read_npz(tmp_path / "compare.npz"))
    assert head[-4:] == ["force_x_measured_N", "force_x_model_N", "force_x_residual_N", "force_x_noise_N"]
    assert rows[2][-3] == pytest.approx(sheared(MOVES)[2, 1], rel=1e-2)
    assert rows[2][-1] == 0.05


def test_a_force_across_the_load_that_is_wrong_is_said(tmp_path, measured):
    rows = measured[0].splitlines()
    rows[-1] = ",".join([*rows[-1].split(",")[:-1], "10"])
    wrong = fit(placed(tmp_path, "\n".join(rows) + "\n"), tmp_path / "results")
    assert any(line.startswith("force_x of step 4 is ") for line in wrong.estimate["remarks"])
    assert diagnose(wrong).verdict != "adequate"


def test_the_diagnosis_reads_the_force_across(tmp_path, measured):
    result = fit(placed(tmp_path, measured[0]), tmp_path / "results")
    found = diagnose(result)
    assert found.verdict == "adequate"
    assert len(found.diagnosis.comparison.vector) == 2 * len(MOVES)
    prediction = result.problem.prediction(finest(result.problem, result.last))
    along, across = result.problem.data.split(prediction.response)
    mu = result.constants.value["mu"]
    assert np.allclose(np.column_stack([along, across[:, 0]]), sheared(MOVES, mu), rtol=1e-3, atol=1e-3)
    assert np.array_equal(result.steps[["model_force", "model_force_x"]], np.column_stack([along, across]))
