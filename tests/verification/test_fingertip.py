"""The deck of the fingertip: both solvers, its parts, and that they can be exchanged."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.core.errors import InputError
from fingerfit.deck.cards import read_cards
from fingerfit.deck.context import deck_context
from fingerfit.deck.dialect import to_abaqus
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.deck.render import render_deck
from fingerfit.deck.write import format_deck
from fingerfit.model.catalogue import catalogue
from fingerfit.model.scales import bound
from fingerfit.solvers.abaqus import AbaqusSolver
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.contract import CONVERGED
from fingerfit.study.study import Body, Layer, Noise, Step, Study

ROOT = Path(__file__).resolve().parents[2]
TEMPLATES = ROOT / "templates"
EFFECTS = bound(catalogue(ROOT / "studies/fingertip"), {"height": 13.1, "width": 32.0, "force": 1.0, "duration": 10.0})
MU = {"mu_epidermis": 0.138, "mu_subcutaneous": 0.00798}


@pytest.fixture(scope="module")
def finger():
    return add_fixtures(finger_mesh(size=3.0, element="C3D4"), (Anatomy().pulp_centre, 0.0))


LAYERS = ("epidermis", "subcutaneous")


def write(folder, mesh, control, loads, template="fingertip.inp.j2", values=MU, layers=LAYERS, aside=(), direction=()):
    own = aside or [{}] * len(loads)
    steps = tuple(Step(n, **{control: load}, **its) for n, (load, its) in enumerate(zip(loads, own, strict=True), 1))
    body = Body(tuple(Layer(name) for name in layers))
    study = Study(folder, "finger", control, steps, None, Noise(), body, "held", "slides", direction=direction)
    (folder / "mesh.inp").write_text(format_mesh(mesh))
    context = deck_context(study, mesh, "mesh.inp", values, {"alpha": 1.4, "poisson": 0.45}, EFFECTS)
    (folder / "deck.inp").write_text(render_deck(template, context, (TEMPLATES,)))
    return folder / "deck.inp"


def solve(*args, **kwargs):
    deck = write(*args, **kwargs)
    outcome = BuiltinSolver().solve(deck, deck.parent)
    assert outcome.status == CONVERGED
    return outcome


@pytest.fixture(scope="module")
def pressed(finger, tmp_path_factory):
    return solve(tmp_path_factory.mktemp("pressed"), finger, "displacement", [0.5, 1.0])


def test_force_and_displacement_control_are_one_experiment(finger, pressed, tmp_path):
    force = -pressed.reaction[:, 2]
    assert 0 < force[0] < force[1]
    driven = solve(tmp_path, finger, "force", force.tolist())
    assert np.allclose(driven.indenter[:, 2], [-0.5, -1.0], atol=1e-4)
    assert np.allclose(driven.displacement, pressed.displacement, atol=2e-4)


def test_what_is_held_stays(finger, pressed):
    assert not pressed.displacement[:, finger.node_sets["NAIL"]].any()
    assert not pressed.displacement[:, finger.node_sets["END"], 0].any()
    end = pressed.displacement[-1, finger.node_sets["END"], 1:]
    assert np.abs(end).max() > 1e-3
    # nobody leaves the tube by more than the contact's own softness
    axis = finger.points[finger.node_sets["TUBE_TURN"][0]]
    bottom = finger.points[finger.node_sets["TUBE"][0]]
    moved = finger.points + pressed.displacement[-1]
    dorsal = np.unique(finger.blocks[0].nodes[finger.surfaces["DORSAL"][:, 0]])
    assert np.hypot(*(moved[dorsal] - axis)[:, 1:].T).max() < axis[2] - bottom[2] + 0.02


def test_bone_moves_as_one_unless_it_is_fixed(finger, pressed, tmp_path):
    bone = finger.node_sets["BONE"]
    distal = np.unique(finger.blocks[0].nodes[finger.element_sets["DISTAL"]])
    before, after = finger.points[distal], finger.points[distal] + pressed.displacement[-1, distal]
    assert np.abs(after - before).max() > 0.02
    turn, _, other = np.linalg.svd((before - before.mean(axis=0)).T @ (after - after.mean(axis=0)))
    rigid = (before - before.mean(axis=0)) @ turn @ other + after.mean(axis=0)
    assert np.abs(rigid - after).max() < 1e-3 * np.abs(after - before).max()
    fixed = solve(tmp_path, finger, "displacement", [1.0], "fingertip_fixed.inp.j2")
    assert not fixed.displacement[:, bone].any()
    assert fixed.reaction[0, 2] < 1.01 * pressed.reaction[-1, 2]
    # springs are between both: stiff ones hold the bones nearly, soft ones hardly, and in between they move in proportion
    nearly, half, hardly, free = (
        solve(tmp_path, finger, "displacement", [1.0], "fingertip_fixed.inp.j2", {**MU, "bone_mobility.freedom": f})
        for f in (1e-3, 0.5, 0.999, 1.0)
    )
    assert np.abs(nearly.displacement[0, distal]).max() < 1e-3
    assert np.allclose(free.displacement[0], pressed.displacement[-1], atol=1e-5)
    assert np.allclose(hardly.displacement[0], pressed.displacement[-1], atol=2e-3)
    way = [np.abs(one.displacement[0, distal, 2]).mean() for one in (half, free)]
    assert 0.4 < way[0] / way[1] < 0.6


def test_friction_holds_the_skin(finger, tmp_path):
    pressed = solve(tmp_path, finger, "displacement", [1.0])
    rubbed = solve(tmp_path, finger, "displacement", [1.0], values={**MU, "friction.coefficient": 0.3})
    palmar = np.unique(finger.blocks[0].nodes[finger.surfaces["PALMAR"][:, 0]])
    under = palmar[np.hypot(*(finger.points[palmar, :2] - finger.points[finger.node_sets["TOP"][0], :2]).T) < 1.5]
    aside = [np.abs(o.displacement[0, under, :2]).max() for o in (rubbed, pressed)]
    assert aside[0] < 0.9 * aside[1]
    assert rubbed.reaction[0, 2] < pressed.reaction[0, 2]
    assert "*FRICTION" not in write(tmp_path, finger, "displacement", [1.0]).read_text()


@pytest.mark.parametrize("template", ["fingertip.inp.j2", "fingertip_meshed.inp.j2"])
def test_an_indenter_on_a_rail_goes_as_one_that_is_moved_along_it(finger, tmp_path, template):
    way = np.array([0.3, 0.1, -1.0]) / np.linalg.norm([0.3, 0.1, -1.0])
    moved = solve(tmp_path, finger, "displacement", [0.6, 1.0], template, direction=tuple(way))
    assert np.allclose(moved.indenter, np.outer([0.6, 1.0], way))
    force = moved.reaction @ way
    assert 0 < force[0] < force[1]
    driven = solve(tmp_path, finger, "force", force.tolist(), template, direction=tuple(way))
    # the meshed sphere has a friction of its facets: 0.001 mm
    assert np.allclose(driven.indenter, moved.indenter, atol=2e-3)


def test_a_sphere_moved_aside_takes_friction_along(finger, tmp_path):
    aside = [{"displacement_x": 0.0}, {"displacement_x": 0.3}]
    free = solve(tmp_path, finger, "displacement", [0.6, 0.6], aside=aside)
    rubbed = solve(
        tmp_path, finger, "displacement", [0.6, 0.6], values={**MU, "friction.coefficient": 0.3}, aside=aside
    )
    assert np.allclose(free.indenter[:, 0], [0, 0.3])
    assert abs(free.reaction[1, 0]) < 0.1 * rubbed.reaction[1, 0]
    assert rubbed.reaction[1, 0] == pytest.approx(-0.3 * rubbed.reaction[1, 2], rel=0.3)


@pytest.mark.parametrize("template", ["fingertip.inp.j2", "fingertip_meshed.inp.j2"])
def test_an_indenter_beside_its_place_is_one_that_comes_down_there(finger, tmp_path, template):
    beside = {**MU, "indenter_place.x": 0.2, "indenter_place.y": -0.3}
    shifted = solve(tmp_path, finger, "displacement", [0.6], template, beside)
    count = len(finger.points) - 4
    bare = replace(finger, points=finger.points[:count])
    there = add_fixtures(bare, (Anatomy().pulp_centre + 0.2, -0.3))
    other = solve(tmp_path, there, "displacement", [0.6], template)
    assert np.allclose(shifted.displacement[0, :count], other.displacement[0, :count], atol=2e-4)
    assert shifted.reaction[0, 2] == pytest.approx(other.reaction[0, 2], rel=1e-3)
    with pytest.raises(InputError, match="place above the skin"):
        write(tmp_path, finger, "displacement", [0.6], template, {**MU, "indenter_place.y": 30.0})


@pytest.mark.parametrize("template", ["fingertip.inp.j2", "fingertip_fixed.inp.j2"])
@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_absent_an_effect_leaves_the_deck_byte_for_byte(finger, tmp_path, name, template):
    effect = EFFECTS[name]
    plain = write(tmp_path, finger, "force", [0.01], template).read_text()
    for place in effect.places()[:2]:
        nothing = {**MU, **effect.null(), **place}
        assert write(tmp_path, finger, "force", [0.01], template, nothing).read_text() == plain


def text_at(folder, mesh, numbers, template="fingertip.inp.j2", layers=LAYERS):
    return write(folder, mesh, "force", [0.01], template, {**MU, **numbers}, layers).read_text()


def test_present_it_changes_what_its_words_say(finger, tmp_path):
    plain, fixed = text_at(tmp_path, finger, {}), text_at(tmp_path, finger, {}, "fingertip_fixed.inp.j2")
    stiff = text_at(tmp_path, finger, {"layers.contrast": 0.5})
    mu = MU["mu_epidermis"] * np.exp(0.5)
    assert cards(stiff, "HYPERELASTIC")[0][0] == pytest.approx(mu)
    assert cards(stiff, "HYPERELASTIC")[1] == cards(plain, "HYPERELASTIC")[1]
    assert sets(stiff)["EPIDERMIS_1"] == (finger.element_sets["EPIDERMIS"] + 1).tolist()
    # of two layers none is a dermis, and bones that are not fixed cannot be let go
    assert text_at(tmp_path, finger, {"dermis.contrast": 0.5}) == plain
    assert text_at(tmp_path, finger, {"bone_mobility.freedom": 0.1}) == plain
    assert text_at(tmp_path, finger, {"bone_mobility.freedom": 1.0}, "fingertip_fixed.inp.j2") == plain
    loose = text_at(tmp_path, finger, {"bone_mobility.freedom": 0.1}, "fingertip_fixed.inp.j2")
    assert "BONE, 1, 3" in fixed and "BONE, 1, 3" not in loose
    count = len(finger.node_sets["BONE"])
    springs = [cards(loose, f"SPRING, ELSET=BONE_SPRINGS_{axis}") for axis in (1, 2, 3)]
    assert [own[0] for own in springs] == [1.0, 2.0, 3.0]
    assert [own[1] * count for own in springs] == pytest.approx([27.0] * 3, rel=1e-5)
    assert "*FRICTION" in text_at(tmp_path, finger, {"friction.coefficient": 0.2})


def test_a_dermis_is_the_layer_between(tmp_path):
    shape = Anatomy(dermis=0.8, bone_height=3.2)
    mesh = add_fixtures(finger_mesh(shape, size=4.0, element="C3D4"), (shape.pulp_centre, 0.0))
    three = ("epidermis", "dermis", "subcutaneous")
    found = cards(text_at(tmp_path, mesh, {"mu": 0.01, "dermis.contrast": 0.7}, layers=three), "HYPERELASTIC")
    assert [row[0] for row in found] == pytest.approx([MU["mu_epidermis"], 0.01 * np.exp(0.7), MU["mu_subcutaneous"]])


def test_an_inclusion_lies_below_the_indenter(finger):
    own = {"contrast": 1.0, "x": -5.0, "below": 2.0, "radius": 3.0}
    values = MU | {f"inclusion_in_space.{name}": value for name, value in own.items()}
    body = Body((Layer("epidermis"), Layer("subcutaneous")))
    study = Study(Path(), "finger", "force", (Step(1, force=0.01),), None, Noise(), body, "held", "slides")
    context = deck_context(study, finger, "mesh.inp", values, {"alpha": 1.4, "poisson": 0.45})
    change = np.zeros(finger.element_count)
    for piece in context["layers"]:
        own = piece["name"].split("_")[0].lower()
        change[np.array(piece["elements"], dtype=int) - 1] = np.log(piece["mu"] / MU[f"mu_{own}"])
    # an element has the mean of its eight points: by up to 0.044 that of the middles of 364 parts of it
    corner = np.indices((12, 12, 12)).reshape(3, -1).T
    share = (corner[corner.sum(axis=1) < 12] + 0.25) / 12
    share = np.column_stack([share, 1 - share.sum(axis=1)])
    soft = finger.element_sets["SOFT"]
    at = np.einsum("pk,eki->epi", share, finger.points[finger.blocks[0].nodes[soft]])
    touch = finger.points[finger.node_sets["INDENTER"][0]]
    distance = np.linalg.norm(at - touch - [-5.0, -4.0, -2.0], axis=2)
    inside = 0.5 * (1 - np.tanh(4 * (distance / 3.0 - 1)))
    assert change[soft] == pytest.approx(inside.mean(axis=1), abs=0.06)
    assert change[soft].max() > 0.9


def cards(text, keyword):
    """Numbers below each card of a keyword."""
    found = re.findall(rf"^\*{keyword}(?:,[^\n]*)?\n((?:[^*][^\n]*\n)*)", text, re.MULTILINE)
    rows = [[float(x) for x in line.split(",")] for block in found for line in block.splitlines()]
    return [row[0] for row in rows] if keyword.startswith("SPRING") else rows


def sets(text):
    found = re.findall(r"^\*ELSET, ELSET=(\w+)\n((?:[^*][^\n]*\n)*)", text, re.MULTILINE)
    return {name: [int(m) for m in re.findall(r"\d+", block)] for name, block in found}


@pytest.mark.slow
def test_calculix_agrees(finger, tmp_path, needs_ccx):
    forces = [0.01, 0.02]
    ours = solve(tmp_path, finger, "force", forces)
    deck = write(tmp_path, finger, "force", forces, "fingertip_meshed.inp.j2", {**MU, "establish": 0.1})
    theirs = CalculixSolver().solve(deck, tmp_path)
    assert theirs.status == CONVERGED
    assert theirs.displacement.shape == ours.displacement.shape
    assert np.allclose(theirs.reaction[:, 2], [-0.01, -0.02], rtol=1e-3)
    # the facets of their sphere, 0.22 mm, are up to 5 um within ours
    assert np.allclose(theirs.indenter[:, 2], ours.indenter[:, 2], atol=0.005)
    body = np.unique(finger.blocks[0].nodes)
    assert np.allclose(theirs.displacement[:, body], ours.displacement[:, body], atol=0.005)
    assert ours.indenter[-1, 2] < -0.1


def test_letting_go_is_read_and_written(finger, tmp_path):
    deck = read_deck(write(tmp_path, finger, "force", [0.01], "fingertip_meshed.inp.j2"))
    indenter = int(finger.node_sets["INDENTER"][0])
    first, second = (step.displacement for step in deck.steps)
    assert (indenter, 2) in first and (indenter, 2) not in second
    assert set(first) - set(second) == {(indenter, 2)}
    (tmp_path / "again.inp").write_text(format_deck(deck))
    again = read_deck(tmp_path / "again.inp")
    assert [step.displacement for step in again.steps] == [step.displacement for step in deck.steps]


@pytest.mark.parametrize("name, side", [("HALFTUBE", "DORSAL"), ("SPHERE", "PALMAR")])
def test_profiles_are_as_abaqus_wants_them(finger, tmp_path, name, side):
    """Arcs of less than 180 degrees, and the body to the left of the way along the profile."""
    deck = read_deck(write(tmp_path, finger, "displacement", [1.0]))
    surface = deck.surfaces[name]
    (_, start), (_, values) = surface.profile
    centre = np.array(values[2:])
    a, b = np.array(start) - centre, np.array(values[:2]) - centre
    angle = np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)
    assert 0.1 < abs(angle) < np.deg2rad(175)
    assert np.linalg.norm(a) == pytest.approx(np.linalg.norm(b), rel=1e-9)
    nodes = np.unique(finger.blocks[0].nodes[finger.surfaces[side][:, 0]])
    local = (finger.points[nodes] - surface.origin) @ surface.axes.T
    place = local[:, :2] if name == "HALFTUBE" else np.stack([np.hypot(local[:, 0], local[:, 1]), local[:, 2]], axis=1)
    beyond = np.linalg.norm(place - centre, axis=1) - np.linalg.norm(a)
    # turning to the left, the left is inside
    assert np.sign(np.median(beyond)) == -np.sign(angle)
    # the arc is where they touch: its middle looks at the nearest node
    nearest = place[np.abs(beyond).argmin()] - centre
    middle = a + b
    assert nearest @ middle > np.cos(abs(angle) / 2) * np.linalg.norm(nearest) * np.linalg.norm(middle)
    (tmp_path / "shown.inp").write_text(format_deck(deck))
    again = read_deck(tmp_path / "shown.inp").surfaces[name]
    assert np.allclose(again.axes[2], surface.axes[2])
    assert name == "SPHERE" or np.allclose(again.axes, surface.axes)


def test_abaqus_gets_the_same_finger(finger, pressed, tmp_path):
    for template in ("fingertip_meshed.inp.j2", "fingertip.inp.j2"):
        deck = write(tmp_path, finger, "displacement", [0.5, 1.0], template)
        assert "ROT NODE" in deck.read_text()
        AbaqusSolver(sys.executable).check(deck)
        lines = [line for card in to_abaqus(read_cards(deck), read_deck(deck)) for line in card.lines()]
        bodies = [line for line in lines if line.startswith("*RIGID BODY")]
        assert len(bodies) == 2
        assert not any("ROT NODE" in line or " NSET=" in line.replace("TIE NSET=", "") for line in bodies)
        assert not any(line.startswith("*INCLUDE") for line in lines)
        for name in ("INDENTER", "TUBE"):
            assert f"{finger.node_sets[name][0] + 1}, 4, 6" in lines
    (tmp_path / "abaqus.inp").write_text("\n".join(lines) + "\n")
    again = BuiltinSolver().solve(tmp_path / "abaqus.inp", tmp_path)
    assert np.allclose(again.displacement, pressed.displacement, atol=1e-9)
    assert np.allclose(again.reaction, pressed.reaction, atol=1e-9)
