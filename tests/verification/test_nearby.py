"""Simulations beside the solution of a guess: begun there, the same answer in fewer iterations; or to first order."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from blocks import STUDY
from test_fingertip import MU, solve, write

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.cli import main
from fingerfit.core.errors import StateError
from fingerfit.core.files import read_json, read_text
from fingerfit.fit import problem as problems
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.refine import around_best
from fingerfit.fit.rounds import FIRST_ORDER, NEARBY, Walk, check_deck, simulations
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.contract import BY_PATH, CONVERGED, DIVERGED, Outcome
from fingerfit.solvers.first_order import answers
from fingerfit.testing.block import write_block

FORCES = [0.05, 0.12]
STIFFER = {name: 1.03 * value for name, value in MU.items()}


@pytest.fixture(scope="module")
def finger():
    return add_fixtures(finger_mesh(size=4.0, element="C3D4"), (Anatomy().pulp_centre, 0.0))


@pytest.fixture(scope="module")
def softer(finger, tmp_path_factory):
    return solve(tmp_path_factory.mktemp("softer"), finger, "force", FORCES)


def both(folder, mesh, nearby, control="force", loads=FORCES, values=STIFFER, **how):
    """The outcomes from rest and from nearby."""
    deck = write(folder, mesh, control, loads, values=values, **how)
    return BuiltinSolver().solve(deck, folder), BuiltinSolver().solve(deck, folder, nearby=nearby)


@pytest.mark.parametrize("values", [STIFFER, {**MU, "indenter_place.x": 0.05}])
def test_a_pushed_indenter_finds_the_same_equilibrium(finger, softer, tmp_path, values):
    cold, warm = both(tmp_path, finger, softer, values=values)
    assert warm.status == CONVERGED
    for name in ("displacement", "reaction", "indenter"):
        assert getattr(warm, name) == pytest.approx(getattr(cold, name), abs=1e-6)
    # from rest it took 15 and 14 before contact was met within an iteration, 10 since (decision 33)
    assert sum(warm.iterations) < min(0.7 * 15, sum(cold.iterations))
    # it is another solution than that of the guess nearby
    assert np.abs(warm.displacement - softer.displacement).max() > 1e-3


def test_what_is_too_far_off_is_solved_from_rest(finger, softer, tmp_path):
    far = replace(softer, displacement=softer.displacement * 40.0)
    cold, warm = both(tmp_path, finger, far)
    assert warm.status == CONVERGED
    assert warm.displacement == pytest.approx(cold.displacement, abs=1e-6)


def test_with_friction_or_other_steps_it_begins_at_rest(finger, softer, tmp_path):
    rubbed = {**STIFFER, "friction.coefficient": 0.3}
    for nearby, values in ((softer, rubbed), (replace_steps(softer, 1), STIFFER)):
        cold, warm = both(tmp_path, finger, nearby, values=values)
        assert np.array_equal(warm.displacement, cold.displacement)
        assert warm.iterations == cold.iterations


def replace_steps(outcome, steps):
    """An outcome that reached fewer steps."""
    parts = {name: getattr(outcome, name)[:steps] for name in ("displacement", "reaction", "indenter", "iterations")}
    return replace(outcome, status=DIVERGED, **parts)


@pytest.mark.parametrize(("control", "loads"), [("force", FORCES), ("displacement", [0.8, 1.6])])
@pytest.mark.parametrize("name", MU)
def test_to_first_order_a_constant_of_a_finger_has_the_slopes_of_whole_simulations(
    finger, tmp_path, control, loads, name
):
    """Off by 0.0005 to 0.001 of the slope where it was made."""
    here = write(tmp_path, finger, control, loads)
    known, text = BuiltinSolver().solve(here, tmp_path), read_text(here)
    sides = [{**MU, name: share * MU[name]} for share in (1.03, 0.97)]
    decks = [read_text(write(tmp_path, finger, control, loads, values=values)) for values in sides]
    found = answers(tmp_path, text, known, decks)
    whole = [both(tmp_path, finger, known, control, loads, values)[1] for values in sides]
    for what, scale in (("displacement", 1.0), ("reaction", 0.1)):
        first, slope = (getattr(one[0], what) - getattr(one[1], what) for one in (found, whole))
        assert np.linalg.norm(first - slope) < 0.01 * max(np.linalg.norm(slope), 1e-3 * scale)


@pytest.mark.parametrize("values", [{"friction.coefficient": 0.3}, {"indenter_place.x": 0.05}])
def test_what_touches_by_its_path_or_elsewhere_has_no_answer_to_first_order(finger, softer, tmp_path, values):
    here = read_text(write(tmp_path, finger, "force", FORCES))
    assert answers(tmp_path, here, softer, [here])[0] is not None
    moved = read_text(write(tmp_path, finger, "force", FORCES, values={**MU, **values}))
    assert answers(tmp_path, here, softer, [moved]) == [None]


def test_a_glued_block_in_the_plane_begins_nearby(tmp_path):
    deck = write_block(tmp_path, "displacement", [1.0, 2.0])
    cold = BuiltinSolver().solve(deck, tmp_path)
    warm = BuiltinSolver().solve(deck, tmp_path, nearby=cold)
    assert warm.displacement == pytest.approx(cold.displacement, abs=1e-7)
    assert sum(warm.iterations) <= 2


CONFIG = """\
study: study
model:
  material: {alpha: 1.4, poisson: 0.45}
  mesh: {element: CPE8, across: 3, per_layer: 3}
  parameters:
    mu: {unit: MPa, start: 0.05, lower: 0.005, upper: 0.5}
fit:
  score: likelihood
  stages:
    - {name: grid, kind: grid, points: 3}
"""


@pytest.fixture
def fit(tmp_path, monkeypatch):
    """A fit whose simulations count as long."""
    monkeypatch.setattr(problems, "SHORT", 0.0)
    (tmp_path / "study").mkdir()
    (tmp_path / "study/study.yaml").write_text(
        yaml.safe_dump({**STUDY, "noise": {"force": 0.02, "displacement": 1e-4}})
    )
    (tmp_path / "study/steps.csv").write_text("step,displacement,force\n1,0.5,1.0\n2,1.0,2.0\n")
    (tmp_path / "config.yaml").write_text(CONFIG.replace("study: study", f"study: {tmp_path / 'study'}"))
    return begin(load_settings(tmp_path / "config.yaml"), tmp_path / "results")[0]


def around(fit):
    base = {"number": 0, "solver": fit.solver, "meshes": {}, "best": {"values": {"mu": 0.05}, "score": None}}
    return around_best(fit, base, {"mu": 0.05}, "a test")


@pytest.fixture
def from_nearby(fit, monkeypatch):
    """A solver that gives no answers to first order."""
    monkeypatch.setattr(BuiltinSolver, "capabilities", replace(BuiltinSolver.capabilities, first_order=False))
    return fit


def test_slopes_begin_at_the_guess_between_them_and_are_named_so(from_nearby, tmp_path):
    fit = from_nearby
    batch = {asked.role: asked for asked in around(fit).batch}
    middle = batch["anchor"]
    assert not middle.nearby
    assert batch["+mu"].nearby == middle.sim
    # one is solved beside the guess: with fit.batch 2 a processor would wait
    assert not batch["-mu"].nearby
    assert batch["-mu"].sim == fit.ask(batch["-mu"].values).sim
    assert batch["+mu"].sim != fit.ask(batch["+mu"].values).sim
    solve_missing(fit, list(batch.values()), 2)
    folder = fit.sims / batch["+mu"].sim
    said = read_json(folder / "solver.json", kept=False)
    assert said[NEARBY] == middle.sim
    check_deck(folder / "deck.inp", said)
    with pytest.raises(StateError, match="not what its name says"):
        check_deck(folder / "deck.inp", {**said, NEARBY: batch["-mu"].sim})
    inputs = Walk(fit.sims.parent, tmp_path).sim_inputs(batch["+mu"].sim)
    assert inputs[-1] == str(fit.sims / middle.sim / "solution.npz")
    assert len(Walk(fit.sims.parent, tmp_path).sim_inputs(middle.sim)) == 3
    cold = fit.ask(batch["+mu"].values)
    solve_missing(fit, [cold], 1)
    ours, theirs = (Outcome.load(fit.sims / one.sim / "solution.npz") for one in (batch["+mu"], cold))
    assert ours.displacement == pytest.approx(theirs.displacement, abs=1e-7)


def test_short_simulations_and_solvers_that_cannot_begin_at_rest(from_nearby, monkeypatch):
    monkeypatch.setattr(problems, "SHORT", 1.0)
    assert not any(asked.nearby for asked in simulations(around(from_nearby).batch))


@pytest.mark.parametrize("threads", [1, 2])
def test_slopes_are_answered_to_first_order_beside_the_guess_and_named_so(fit, tmp_path, threads):
    batch = {asked.role: asked for asked in around(fit).batch}
    middle, sides = batch["anchor"], [batch["+mu"], batch["-mu"]]
    assert [(one.nearby, one.first_order) for one in sides] == [(middle.sim, True)] * 2
    assert not middle.first_order
    solve_missing(fit, list(batch.values()), threads)
    folder = fit.sims / sides[0].sim
    said = read_json(folder / "solver.json", kept=False)
    assert (said[NEARBY], said[FIRST_ORDER]) == (middle.sim, True)
    check_deck(folder / "deck.inp", said)
    with pytest.raises(StateError, match="not what its name says"):
        check_deck(folder / "deck.inp", {key: value for key, value in said.items() if key != FIRST_ORDER})
    inputs = Walk(fit.sims.parent, tmp_path).sim_inputs(sides[0].sim)
    assert inputs[-2:] == [str(fit.sims / middle.sim / name) for name in ("deck.inp", "solution.npz")]
    whole = [fit.ask(one.values) for one in sides]
    solve_missing(fit, whole, 1)
    ours, theirs = ([fit.answer(one.sim) for one in pair] for pair in (sides, whole))
    assert {outcome.message for outcome in ours} == {"to first order"}
    ahead, behind = ((one.reaction - fit.answer(middle.sim).reaction)[:, 1] for one in ours)
    assert ahead == pytest.approx(-behind, rel=0.04)
    # both leave out what is of the third order in a step of 0.03
    slope, expected = (first.reaction - second.reaction for first, second in (ours, theirs))
    assert slope == pytest.approx(expected, rel=1e-3, abs=1e-9)


def test_a_job_of_its_own_answers_the_same(fit, tmp_path):
    batch = {asked.role: asked for asked in around(fit).batch}
    solve_missing(fit, list(batch.values()), 1)
    folder = fit.sims / batch["+mu"].sim
    known = Outcome.load(folder / "solution.npz")
    (folder / "solution.npz").unlink()
    files = [str(folder / name) for name in ("deck.inp", "solver.json", "solution.npz")]
    assert main(["simulate", files[0], "--solver", files[1], "--out", files[2], "--time-limit", "0"]) == 0
    again = Outcome.load(folder / "solution.npz")
    assert again.message == known.message == "to first order"
    assert np.array_equal(again.displacement, known.displacement)


def test_where_there_is_no_such_answer_it_is_simulated(fit, monkeypatch):
    monkeypatch.setattr(BuiltinSolver, "first_order", lambda self, folder, deck, known, moved: [None] * len(moved))
    batch = {asked.role: asked for asked in around(fit).batch}
    solve_missing(fit, list(batch.values()), 2)
    cold = fit.ask(batch["+mu"].values)
    solve_missing(fit, [cold], 1)
    ours, theirs = (fit.answer(one.sim) for one in (batch["+mu"], cold))
    assert ours.iterations and ours.displacement == pytest.approx(theirs.displacement, abs=1e-7)


def test_where_the_way_matters_nothing_is_asked_for_to_first_order(fit):
    deck = fit.ask({"mu": 0.05}).deck
    assert not BY_PATH.search(deck)
    assert BY_PATH.search(f"{deck}*SURFACE INTERACTION, NAME=SKIN\n*FRICTION\n0.2\n")
