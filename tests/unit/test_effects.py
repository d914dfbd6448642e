"""Effects: absent they leave no trace, present they do what their words say; formulas reach nothing but numbers."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import LAYERS, MU, ROOT, deck_text, phantom
from scipy.special import erf

from fingerfit.core.errors import InputError, Problems
from fingerfit.core.files import write_text
from fingerfit.core.folders import OURS
from fingerfit.deck.context import PATCH, deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.questions import areas
from fingerfit.deck.render import blocks
from fingerfit.forward.predict import as_seen, since_first_picture
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.catalogue import catalogue, chosen
from fingerfit.model.formulas import evaluate
from fingerfit.model.observation import Observation
from fingerfit.model.scales import bound
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver
from fingerfit.study.study import Step

MESH = layered_block(12.0, LAYERS, 4, 2, "CPE8H")
FORCES = [20.0, 40.0]
MATERIAL = {"alpha": 1.4, "poisson": 0.49}
SIZES = {"width": 12.0, "height": 12.0, "force": 66.0, "duration": 140.0}
EFFECTS = bound(catalogue(), SIZES, "force")
BY_DISPLACEMENT = bound(catalogue(), SIZES, "displacement")
UNSEEN_BY_THE_DECK = {name for name, e in EFFECTS.items() if not e.simulated}
OF_A_FINGERTIP = {"friction", "bone_mobility", "indenter_place"}
"""Effects that no block in the plane has: tests/verification/test_fingertip.py."""
IN_SPACE = {name for name, e in EFFECTS.items() if "space" in e.needs}
"""Those of bodies in space: tests/verification/test_fingertip.py and test_effects_in_space.py."""
IN_THE_DECK = sorted(set(EFFECTS) - UNSEEN_BY_THE_DECK - OF_A_FINGERTIP - IN_SPACE)


def study(control="force", values=FORCES):
    """The phantom with a time at each step, and the way of an indenter that is pushed by a force."""
    found = phantom(control, list(values))
    steps = tuple(replace(step, time=10.0 * step.number) for step in found.steps)
    if control == "force":
        steps = tuple(replace(step, displacement=0.02 * step.force) for step in steps)
    return replace(found, steps=steps)


def deck(values=(), effects=None, of=None, folders=(), mesh=MESH):
    return deck_text(of or study(), mesh, MU | dict(values), MATERIAL, effects, folders=folders)


def at_step(effect):
    """An effect at its first place and its trial sizes."""
    return effect.places()[0] | {effect.key(p.name): p.null + p.step for p in effect.parameters}


def solve(text, folder, mesh=MESH):
    write_text(folder / "mesh.inp", format_mesh(mesh))
    write_text(folder / "deck.inp", text)
    return get_solver("builtin").solve(folder / "deck.inp", folder)


PLAIN = deck()


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return solve(PLAIN, tmp_path_factory.mktemp("plain"))


def cards(text, keyword):
    """Lines of numbers below each card of a keyword; the indenter is its node."""
    found = re.findall(rf"^\*{keyword}(?:,[^\n]*)?\n((?:[^*][^\n]*\n)*)", text, re.MULTILINE)
    found = [block.replace("INDENTER", str(MESH.node_sets["INDENTER"][0] + 1)) for block in found]
    return [[[float(x) for x in line.split(",")] for line in block.splitlines()] for block in found]


# --- absent


def test_the_catalogue_is_whole():
    assert set(EFFECTS) == {path.stem for path in (OURS / "effects").glob("*.yaml")}
    assert len(EFFECTS) >= 18
    parts = {path.name for path in (OURS / "effects").glob("*.j2")}
    named = [*(e.part for e in EFFECTS.values() if e.part), *(p for e in EFFECTS.values() for p in e.fills.values())]
    assert parts == {Path(part).name for part in named}
    # each block that an effect fills or replaces is one of the templates
    used = {block for e in EFFECTS.values() for block in (*e.fills, *e.replaces)}
    assert used <= set(blocks([OURS]))


@pytest.mark.parametrize("name", EFFECTS)
def test_absent_it_leaves_the_deck_byte_for_byte(name):
    effect = EFFECTS[name]
    for place in effect.places():
        assert deck({**effect.null(), **place}) == PLAIN
    assert not effect.present(effect.null())
    assert effect.present(at_step(effect)) == bool(effect.parameters)


def test_absent_all_together_leave_the_deck():
    nothing = {key: value for effect in EFFECTS.values() for key, value in effect.null().items()}
    places = {key: value for effect in EFFECTS.values() for key, value in effect.places()[-1].items()}
    assert deck(nothing | places) == PLAIN
    # beside one that is present, too
    assert deck(nothing | places | {"tilt.slope": 0.01}) == deck({"tilt.slope": 0.01}) != PLAIN


# --- present in the deck


@pytest.mark.parametrize("name", IN_THE_DECK)
def test_at_its_step_the_deck_is_another_one_and_has_a_solution(name, tmp_path, plain):
    effect = EFFECTS[name]
    control = effect.control or "force"
    of = study() if control == "force" else study("displacement", [0.5, 1.0])
    if slides := {side for side in ("base", "indenter") if f"sliding_{side}" in effect.needs}:
        of = replace(of, **dict.fromkeys(slides, "slides"))
        plain = solve(deck(of=of), tmp_path / "free")
    text = deck(at_step(effect), of=of)
    assert text != deck(of=of)
    outcome = solve(text, tmp_path)
    assert outcome.status == CONVERGED
    if name == "load_step":  # what it changes depends on the path, and nothing here does
        assert since_first_picture(outcome, 2).displacement == pytest.approx(plain.displacement, abs=1e-5)
    else:
        change = np.abs(since_first_picture(outcome, 2).displacement - plain.displacement).max()
        assert 1e-4 < change < 1.0


@pytest.mark.parametrize("name", IN_THE_DECK)
def test_numbers_of_what_it_adds_are_free_and_just_above_those_of_the_mesh(name, tmp_path):
    """Solvers set memory aside up to the highest number: by millions, CalculiX took 10 GB for 24 elements."""
    effect, largest = EFFECTS[name], max(len(MESH.points), MESH.element_count)
    of = study() if (effect.control or "force") == "force" else study("displacement", [0.5, 1.0])
    for keyword, count in (("NODE", len(MESH.points)), ("ELEMENT", MESH.element_count)):
        text = deck(at_step(effect), of=of)
        added = [int(row[0]) for block in cards(text, keyword) for row in block]
        assert len(set(added)) == len(added)
        if "*INCLUDE" not in text:  # the mesh is in it
            assert set(range(1, count + 1)) < {0, *added}
            added = [number for number in added if number > count]
        assert all(count < number < 10 * 10 * largest + 2 * PATCH + 3 * MESH.element_count for number in added)


@pytest.mark.parametrize("name", sorted(UNSEEN_BY_THE_DECK))
def test_what_is_only_observed_leaves_the_deck(name):
    assert deck(at_step(EFFECTS[name])) == PLAIN


@pytest.mark.parametrize("name", [name for name in IN_THE_DECK if "field" in EFFECTS[name].changes])
def test_fields_split_each_layer_into_sets(name):
    effect = EFFECTS[name]
    for place in effect.places():
        values = at_step(effect) | place
        if place.get("split_layer.layer", 1) > len(LAYERS) or place.get("interface.border", 1) >= len(LAYERS):
            assert deck(values) == PLAIN
            continue
        if place.get("swollen.layer", 1) > len(LAYERS):
            with pytest.raises(
                InputError, match=r"effect swollen: layer: found \d; expected 1 to 3, or 0 for all layers"
            ):
                deck(values)
            continue
        context = deck_context(study(), MESH, "mesh.inp", MU | values, MATERIAL)
        for layer in LAYERS:
            own = layer[0].upper()
            pieces = [p for p in context["layers"] if p["name"].startswith(f"{own}_")]
            members = [m for piece in pieces for m in piece["elements"]]
            assert sorted(members) == sorted(int(m) + 1 for m in MESH.element_sets[own])
            assert len({p["name"] for p in pieces}) == len(pieces)
            assert all(p["elements"] for p in pieces)
    values = at_step(effect)
    written = [m for name, block in sets(deck(values)) for m in block if re.match(r"(TOP|MIDDLE|BOTTOM)_\d+$", name)]
    assert sorted(written) == list(range(1, MESH.element_count + 1))


def sets(text):
    found = re.findall(r"^\*ELSET, ELSET=(\w+)\n((?:[^*][^\n]*\n)*)", text, re.MULTILINE)
    return [(name, [int(m) for m in re.findall(r"\d+", block)]) for name, block in found]


def moduli(values, mesh=MESH):
    """mu of each element, from the context."""
    found = np.full(mesh.element_count, np.nan)
    for layer in deck_context(study(), mesh, "mesh.inp", MU | values, MATERIAL)["layers"]:
        found[np.array(layer["elements"], dtype=int) - 1] = layer["mu"]
    return found


def plain_moduli(mesh=MESH):
    found = np.empty(mesh.element_count)
    for name, *_ in LAYERS:
        found[mesh.element_sets[name.upper()]] = MU[f"mu_{name}"]
    return found


def centres(mesh=MESH):
    return np.concatenate([mesh.points[block.nodes].mean(axis=1) for block in mesh.blocks])


def test_gradient_is_linear_in_each_layer():
    # two elements over the height of a layer: a quarter of it above and below the middle
    change = np.log(moduli({"gradient.slope": 0.4}) / plain_moduli())
    depth = np.mod(12.0 - centres()[:, 1], 4.0) / 4.0
    assert change == pytest.approx(0.4 * (depth - 0.5), abs=1e-4)
    assert change.min() == pytest.approx(-0.1, abs=1e-4)
    # means over half of the height: of 6 s^2 it is 1/2, of 20 s^3 - 3 s on either side 1/8; elements have means of moduli
    bent, wavy = (np.log(moduli({f"gradient.{name}": 0.4}) / plain_moduli()) for name in ("bend", "third"))
    assert bent == pytest.approx(0.4 * 0.5, abs=0.01)
    assert wavy == pytest.approx(0.4 * -0.125 * np.sign(depth - 0.5), abs=0.01)


@pytest.mark.parametrize(("name", "axis"), [("body_gradient", 1), ("sideways_gradient", 0)])
def test_gradients_over_the_body_cross_its_layers_and_have_no_mean(name, axis):
    s = centres()[:, axis] / 12.0 - 0.5
    change = np.log(moduli({f"{name}.slope": 0.6}) / plain_moduli())
    assert change == pytest.approx(0.6 * s, abs=1e-4)
    bent = np.log(moduli({f"{name}.bend": 0.4}) / plain_moduli())
    # moduli are those at the centres or means of elements, which are a twelfth of the squared length apart
    assert bent == pytest.approx(0.4 * (6 * s**2 - 0.5), abs=0.02)
    assert abs(np.polyfit(s, bent, 2)[0] - 2.4) < 0.01
    wavy = np.log(moduli({f"{name}.third": 0.4}) / plain_moduli())
    assert np.polyfit(s, wavy, 3)[0] == pytest.approx(8.0, rel=0.01)
    assert wavy.mean() == pytest.approx(0.0, abs=1e-3)


def test_in_one_layer_a_gradient_is_one_inside_of_it():
    alone = layered_block(12.0, LAYERS[:1], 4, 2, "CPE8H")
    of = replace(study(), body=replace(study().body, layers=study().body.layers[:1]))
    values = {"body_gradient.slope": 0.6, "body_gradient.bend": 0.6}
    assert deck(values, of=of, mesh=alone) == deck(of=of, mesh=alone)


def test_split_layer_changes_its_layer_only():
    change = np.log(
        moduli({"split_layer.contrast": 0.6, "split_layer.layer": 2, "split_layer.share": 0.5}) / plain_moduli()
    )
    y = centres()[:, 1]
    wanted = np.where((y > 6) & (y < 8), 0.3, np.where((y > 4) & (y < 6), -0.3, 0.0))
    assert change == pytest.approx(wanted, abs=1e-4)


def test_an_element_has_the_mean_of_a_field():
    """With three elements over a layer the middle one lies half in either half of a layer of two materials."""
    mesh = layered_block(12.0, LAYERS, 6, 3, "CPE8")
    place = {"split_layer.contrast": 0.6, "split_layer.layer": 2, "split_layer.share": 0.5}
    change = np.log(moduli(place, mesh) / plain_moduli(mesh))
    y = centres(mesh)[:, 1]
    inside = (y > 4) & (y < 8)
    assert change[inside & (abs(y - 6) < 0.1)] == pytest.approx(0.0, abs=1e-4)
    assert change[inside].mean() == pytest.approx(0.0, abs=1e-4)
    assert change[inside].max() == pytest.approx(0.3, abs=1e-4)


def test_inclusion_is_round_and_skin_is_at_the_top():
    mesh = layered_block(12.0, LAYERS, 24, 8, "CPE4")
    x, y = centres(mesh).T
    place = {"inclusion.contrast": 1.0, "inclusion.across": 0.25, "inclusion.along": 0.5}
    change = np.log(moduli(place, mesh) / plain_moduli(mesh))
    # mean of the bump over an element of 0.5 mm: along each axis a difference of error functions
    along, across = (np.diff(erf((z[:, None] + [-0.25, 0.25]) / 1.5), axis=1)[:, 0] for z in (x - 3, y - 6))
    assert change == pytest.approx(1.5**2 * np.pi / 4 * along * across / 0.5**2, abs=2e-3)
    change = np.log(moduli({"skin.contrast": 1.0, "skin.thickness": 1.0}, mesh) / plain_moduli(mesh))
    assert change[y > 11.5] == pytest.approx(1.0, abs=0.01)
    assert change[y < 10.5] == pytest.approx(0.0, abs=0.01)


def test_a_band_has_its_angle_and_width():
    """All of the contrast inside, half of it on the edges; the points of an element lie up to 0.2 mm from its middle."""
    mesh = layered_block(12.0, LAYERS, 24, 8, "CPE4")
    x, y = centres(mesh).T - 6.0
    for angle in (0.0, 30.0, -60.0, 90.0):
        place = {"band.contrast": 1.0, "band.angle": angle, "band.above": 1.0, "band.wide": 3.0}
        change = np.log(moduli(place, mesh) / plain_moduli(mesh))
        away = abs(np.cos(np.deg2rad(angle)) * y - np.sin(np.deg2rad(angle)) * x - 1.0)
        assert change[away < 0.9].min() > 0.9
        assert change[away > 2.1].max() < 0.1
        if angle in (0.0, 90.0):
            assert change.sum() * 0.25 == pytest.approx(3.0 * 12.0, rel=0.02)


def test_an_ellipse_has_its_size_axes_and_turn():
    mesh = layered_block(12.0, LAYERS, 24, 8, "CPE4")
    x, y = centres(mesh).T - [[4.8], [7.2]]
    for flat, slant, turn in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 90.0), (0.0, 1.0, 45.0)):
        place = {"ellipse.across": 0.4, "ellipse.along": 0.6, "ellipse.radius": 2.5}
        place |= {"ellipse.contrast": 1.0, "ellipse.flat": flat, "ellipse.slant": slant}
        change = np.log(moduli(place, mesh) / plain_moduli(mesh))
        c, s, ratio = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn)), np.exp(np.hypot(flat, slant) / 2)
        far = np.hypot((c * x + s * y) / ratio, (c * y - s * x) * ratio) / 2.5
        assert change[far < 0.6].min() > 0.9
        assert change[far > 1.5].max() < 0.1
        assert change.sum() * 0.25 == pytest.approx(np.pi * 2.5**2, rel=0.1)


def test_fields_of_two_effects_add():
    one, two = {"gradient.slope": 0.4}, {"split_layer.contrast": 0.6, "split_layer.layer": 1, "split_layer.share": 0.5}
    together = np.log(moduli(one | two) / plain_moduli())
    apart = np.log(moduli(one) / plain_moduli()) + np.log(moduli(two) / plain_moduli())
    assert together == pytest.approx(apart, abs=2e-4)


def test_constants_of_the_layers():
    ogden = cards(deck({"stiffening.shift": 0.5}), "HYPERELASTIC")
    assert [block[0][1] for block in ogden] == pytest.approx([1.9] * 3)
    for block, before in zip(cards(deck({"compressibility.loss": 0.01}), "HYPERELASTIC"), MU.values(), strict=True):
        mu, alpha, d = block[0]
        bulk = 2 * before * (1 + 0.48) / (3 * (1 - 2 * 0.48))
        assert (mu, alpha, d) == pytest.approx((before, 1.4, 2 / bulk))


def test_second_term_keeps_the_shear_modulus():
    for block, before in zip(cards(deck({"second_term.share": 0.3}), "HYPERELASTIC"), MU.values(), strict=True):
        first, alpha, second, exponent, _, none = block[0]
        assert first == pytest.approx(0.7 * before)
        assert second == pytest.approx(0.3 * before)
        assert (alpha, exponent, none) == (1.4, -4.0, 0.0)


def test_relaxation_needs_times():
    text = deck({"relaxation.share": 0.3, "relaxation.time": 20.0})
    assert cards(text, "VISCOELASTIC") == [[[0.3, 0.3, 20.0]]] * 3
    shear_alone = deck({"relaxation.share": 0.3, "relaxation.time": 20.0, "relaxation.bulk": 0.0})
    assert cards(shear_alone, "VISCOELASTIC") == [[[0.3, 0.0, 20.0]]] * 3
    assert [block[0][1] for block in cards(text, "VISCO")] == [10.0, 10.0]
    assert "*VISCO" not in PLAIN


@pytest.mark.parametrize("element", ["CPE8H", "CPE4", "CPE3"])
@pytest.mark.parametrize(
    "beside", [{}, {"yeoh.c2": 0.5}, {"softening.change": -0.4}], ids=["alone", "yeoh", "softening"]
)
def test_one_layer_relaxes(tmp_path, element, beside):
    """So slowly that it is as stiff as under a fast load: more by 1 / (1 - share), with the same Poisson's ratio.

    What is beside the law relaxes with it.
    """
    share, mu, mesh = 0.3, MU["mu_middle"], layered_block(12.0, LAYERS, 4, 2, element)
    text = deck({"relaxation.share": share, "relaxation.time": 1e7, "relaxation.layer": 2} | beside, mesh=mesh)
    assert cards(text, "VISCOELASTIC") == [[[share, share, 1e7]]] * (1 + bool(beside))
    stiff = deck({"mu_middle": mu / (1 - share)} | beside, mesh=mesh)
    folders = [tmp_path / name for name in ("relaxing", "stiff")]
    relaxing, expected = (solve(one, folder, mesh) for one, folder in zip((text, stiff), folders, strict=True))
    assert relaxing.displacement == pytest.approx(expected.displacement, abs=2e-5)


def test_load_steps_are_made_smaller_where_time_counts_too():
    relaxing = {"relaxation.share": 0.3, "relaxation.time": 20.0}
    before, after = (cards(deck(relaxing | more), "VISCO") for more in ({}, {"load_step.refinement": 1.0}))
    assert [block[0] for block in before] == [[2.5, 10.0, 1e-5, 2.5]] * 2
    assert [block[0] for block in after] == [[pytest.approx(n) for n in (0.25, 10.0, 1e-5, 0.25)]] * 2


@pytest.mark.parametrize("name", ["tilt", "indenter_probe"])
def test_the_pressure_under_a_tilted_indenter_adds_up_to_the_force(name, tmp_path):
    """However far: here one edge goes three times as far as the other."""
    tested = study()
    steps = [replace(step, displacement=way) for step, way in zip(tested.steps, (1.0, 1.6), strict=True)]
    outcome = solve(deck({f"{name}.slope": 0.2}, of=replace(tested, steps=tuple(steps))), tmp_path)
    assert -outcome.reaction[:, 1] == pytest.approx(FORCES, rel=1e-6)
    top, centre = MESH.node_sets["TOP"], int(MESH.node_sets["INDENTER"][0])
    x, depth = MESH.points[top, 0] - MESH.points[centre, 0], -outcome.displacement[:, top, 1]
    # by the displacement, not by the force, which is a half
    assert depth - depth[:, x == 0] == pytest.approx(np.outer([0.2 * 1.0 / 1.6, 0.2], x), abs=1e-6)
    assert depth[-1].max() > 3 * depth[-1].min()


@pytest.mark.parametrize("control", ["force", "displacement"])
def test_a_tilt_that_comes_early(control, tmp_path):
    """At half the load it is as its power says, at the last step there is none."""
    top, centre = MESH.node_sets["TOP"], int(MESH.node_sets["INDENTER"][0])
    tested = study(control, [10.0, 20.0] if control == "force" else [0.5, 1.0])
    outcome = solve(deck({"tilt.early": 0.02, "tilt.power": 0.5}, of=tested), tmp_path)
    x, depth = MESH.points[top, 0] - MESH.points[centre, 0], -outcome.displacement[:, top, 1]
    assert depth[0] - depth[0, x == 0] == pytest.approx(0.02 * (np.sqrt(0.5) - 0.5) / 0.5 * x, abs=1e-6)
    assert depth[1] - depth[1, x == 0] == pytest.approx(0 * x, abs=1e-6)


def test_an_indenter_that_goes_sideways_late(tmp_path):
    """At half the load it is a quarter of the number away from where it would be, at the last step nowhere else."""
    tested = study("displacement", [0.5, 1.0])
    values = {"sideways.moved": 0.1, "sideways.early": 0.04, "sideways.power": 2.0}
    outcome = solve(deck(values, of=tested), tmp_path)
    aside = outcome.displacement[:, MESH.node_sets["TOP"], 0]
    assert aside[0] == pytest.approx(np.full(aside.shape[1], 0.05 + 0.25 * 0.04), abs=1e-6)
    assert aside[1] == pytest.approx(np.full(aside.shape[1], 0.1), abs=1e-6)


@pytest.mark.parametrize("element", ["CPE4", "CPE8H"])
@pytest.mark.parametrize("name", ["TOP", "BOTTOM"])
def test_tributary_areas(element, name):
    mesh = layered_block(12.0, LAYERS, 6, 2, element, 3.0)
    context = deck_context(study(), mesh, "mesh.inp", MU, MATERIAL)
    areas = context["areas"](name)
    assert sum(area for _, area in areas) == pytest.approx(12.0 * 70.0)
    # a linear traction keeps its moment, too
    assert sum(mesh.points[n - 1, 0] * area for n, area in areas) == pytest.approx(12.0**2 / 2 * 70.0)
    assert sorted(n - 1 for n, _ in areas) == sorted(mesh.node_sets[name])
    assert min(area for _, area in areas) > 0


@pytest.mark.parametrize(("name", "edge"), [("base_slip", "BOTTOM"), ("indenter_slip", "TOP")])
def test_springs_stand_for_their_areas(name, edge, tmp_path, plain):
    text = deck({f"{name}.share": 0.2})
    springs = cards(text, f"SPRING, ELSET={name.upper()}_\\d+")
    assert len(springs) == len(MESH.node_sets[edge])
    # 0.2 of what a layer lets go that is a tenth as high as the body is wide: four times its stiffness
    mu = MU["mu_bottom" if name == "base_slip" else "mu_top"]
    assert sum(block[1][0] for block in springs) == pytest.approx(12.0 * 70.0 * 4.0 * mu / 1.2)
    assert all(block[0] == [1.0] for block in springs)
    # nothing else holds that edge sideways, and nothing moves there without the effect
    outcome = solve(text, tmp_path)
    side = MESH.node_sets[edge]
    assert np.abs(plain.displacement[-1, side, 0]).max() == 0
    assert np.abs(outcome.displacement[-1, side, 0]).max() > 0.01


def test_a_bed_may_be_softer_to_one_side():
    """Its compliance grows from 0.5 to 1.5 times that in the middle, in the order of the places from left to right."""
    steady, leaning = (
        [
            block[1][0]
            for block in cards(deck({"soft_bed.share": 0.2, "soft_bed.side": side}), r"SPRING, ELSET=SOFT_BED_\d+")
        ]
        for side in (0.0, 0.5)
    )
    softer = np.divide(steady, leaning)
    assert (softer[0], softer[-1]) == pytest.approx((0.5, 1.5))
    assert softer == pytest.approx(np.linspace(0.5, 1.5, len(softer)))


def test_the_probe_of_the_base_gives_way_downwards_as_the_bed_does(tmp_path):
    for folder in ("bed", "probe"):
        (tmp_path / folder).mkdir()
    bed = solve(deck({"soft_bed.share": 0.2, "soft_bed.side": 0.0}), tmp_path / "bed")
    downwards = {f"base_probe.down_{where}": 0.2 for where in ("left", "middle", "right")}
    probe = solve(deck(downwards), tmp_path / "probe")
    assert np.abs(bed.displacement[-1, MESH.node_sets["BOTTOM"], 1]).max() > 0.1
    assert probe.displacement == pytest.approx(bed.displacement, abs=1e-6)


def test_the_probe_of_the_base_bends_as_a_plate_on_two_bars(tmp_path):
    side = MESH.node_sets["BOTTOM"]
    down = -solve(deck({"base_probe.down_middle": 0.3}), tmp_path).displacement[-1, side, 1]
    by_place = down[np.argsort(MESH.points[side, 0])]
    assert by_place == pytest.approx(by_place[::-1], abs=1e-6)
    assert by_place.argmax() == len(side) // 2
    assert by_place[0] < 0.01 * by_place.max()


@pytest.mark.parametrize(("name", "edge"), [("base_friction", "BOTTOM"), ("indenter_friction", "TOP")])
def test_shear_beyond_the_limit_slips(name, edge, tmp_path):
    """By the law along its table: traction limit u / sqrt(u^2 + u0^2), with u0 a five-hundredth of the height."""
    text, mu = deck({f"{name}.share": 0.5}), MU["mu_bottom" if name == "base_friction" else "mu_top"]
    springs = [np.array(block[1:]) for block in cards(text, f"SPRING, ELSET={name.upper()}_\\d+, NONLINEAR")]
    assert len(springs) == len(MESH.node_sets[edge])
    for table in springs:
        force, u = table.T
        assert np.all(np.diff(u) > 0) and u[-1] == pytest.approx(12.0) and u.min() == -u.max()
        assert force == pytest.approx(force[-1] * u / np.hypot(u, 0.024), rel=1e-5)
    assert sum(table[-1, 0] for table in springs) == pytest.approx(12.0 * 70.0 * 0.2 * mu, rel=1e-5)


@pytest.mark.parametrize(("name", "edge"), [("base", "BOTTOM"), ("indenter", "TOP")])
def test_from_held_to_free_by_the_limit_of_the_shear(name, edge, tmp_path, plain):
    """Next to nothing slips below it, and far above it the whole edge, as far as where springs hardly hold it."""

    def moved(effect, share):
        outcome = solve(deck({f"{name}_{effect}.share": share}), tmp_path)
        assert outcome.status == CONVERGED
        return outcome.displacement[-1, :, 0]

    side = MESH.node_sets[edge]
    assert moved("friction", 1e-4) == pytest.approx(plain.displacement[-1, :, 0], abs=1e-3)
    slips = [np.abs(moved("friction", share)[side]).max() for share in (0.05, 0.3, 0.6, 0.9)]
    free = np.abs(moved("slip", 0.999)[side]).max()
    assert slips == sorted(slips)
    # of a free edge in 40 N: a small part sticks, nearly all slips
    assert slips[0] < 0.03 * free and slips[-1] > 0.9 * free
    # at a share of a half neither near the one nor near the other, so that a search finds its way
    assert 0.25 * free < np.abs(moved("slip", 0.5)[side]).max() < 0.75 * free
    assert moved("friction", 0.99) == pytest.approx(moved("slip", 0.999), abs=0.02 * free)


def test_a_base_that_is_loose_everywhere_slips_and_one_that_is_loose_on_the_left_is_held_on_the_right(tmp_path):
    share, base, x = 0.75, MESH.node_sets["BOTTOM"], MESH.points[:, 0]
    everywhere = {"debonding.left": share, "debonding.right": share, "debonding.extent": 0.95}
    loose = cards(deck(everywhere), r"SPRING, ELSET=LOOSE_BASE_\d+")
    slips = cards(deck({"base_slip.share": share}), r"SPRING, ELSET=BASE_SLIP_\d+")
    assert [block[1][0] for block in loose] == pytest.approx([block[1][0] for block in slips], rel=1e-5)
    on_the_left = {"debonding.left": 0.99, "debonding.right": 0.0, "debonding.extent": 0.5}
    moved = np.abs(solve(deck(on_the_left), tmp_path).displacement[-1, :, 0])
    left, right = base[x[base] < 0.4 * 12.0], base[x[base] > 0.6 * 12.0]
    assert moved[left].max() > 100 * moved[right].max()


@pytest.mark.parametrize("across", [7, 24])
@pytest.mark.parametrize("element", ["CPE4", "CPE8H"])
def test_a_plate_comes_loose_over_a_width_of_its_own(across, element):
    """A node's spring is that of the mean share where it stands for; so all meshes are loose by the same, at any extent."""
    mesh, fades, extents = layered_block(12.0, LAYERS, across, 2, element, 3.0), (0.05, 0.4), np.arange(0.3, 0.4, 0.017)
    row = areas(mesh, mesh.node_sets["BOTTOM"], 70.0)
    parts = np.array([area for _, area in row])
    ends = np.concatenate([[0.0], np.cumsum(parts)]) / parts.sum()

    def shares(**values):
        own = {"debonding.left": 0.5, "debonding.right": 0.0, **{f"debonding.{key}": v for key, v in values.items()}}
        found = cards(deck(own, mesh=mesh), r"SPRING, ELSET=LOOSE_BASE_\d+")
        return 1 / (1 + np.array([block[1][0] for block in found]) / parts * 1.2 / MU["mu_bottom"])

    for fade in fades:
        for extent in extents:
            found = shares(extent=extent, fade=fade)
            fine = np.linspace(ends[:-1], ends[1:], 2001)
            seen = 0.5 * np.clip(0.5 + (extent - fine) / fade, 0, 1).mean(axis=0)
            assert found == pytest.approx(np.maximum(seen, 0.5 / 1000), abs=1e-4)
            assert found @ parts / parts.sum() == pytest.approx(0.5 * extent, abs=0.5 / 1000)
    assert shares(extent=0.5) == pytest.approx(shares(extent=0.5, fade=0.2))


def test_an_indenter_that_is_loose_on_the_left_holds_on_the_right(tmp_path, plain):
    values = {"indenter_debonding.left": 0.99, "indenter_debonding.right": 0.0, "indenter_debonding.extent": 0.5}
    top, x = MESH.node_sets["TOP"], MESH.points[:, 0]
    moved = np.abs(solve(deck(values), tmp_path).displacement[-1, :, 0])
    left, right = top[x[top] < 0.4 * 12.0], top[x[top] > 0.6 * 12.0]
    assert moved[left].max() > 100 * moved[right].max()


def test_brightness_may_be_a_polynomial_of_second_degree():
    """The middle is as bright as before, the edges are brighter by a quarter of it, all by the gain."""
    seen = observation(bias_field__gain=0.1, bias_field__across_2=0.2)
    one, up = np.ones((1, 3)), np.full((1, 3), 3.0)
    assert seen.intensity(one, 2, np.array([[0.0, 6.0, 12.0]]), up) == pytest.approx(np.array([[1.15, 1.1, 1.15]]))


def side_moves(values, folder, name, **slides):
    """How far the left and the right of a side go aside, mm."""
    nodes = MESH.node_sets["TOP" if "indenter" in slides else "BOTTOM"]
    nodes = nodes[np.argsort(MESH.points[nodes, 0])]
    moved = solve(deck(values, of=replace(study(), **slides)), folder / name).displacement[-1, nodes, 0]
    return np.array([moved[0], moved[-1]])


@pytest.mark.parametrize("side", ["base", "indenter"])
def test_friction_and_sticking_hold_a_side_that_slides(side, tmp_path):
    """Both ends by the same amount; nearly wholly stuck hardly any of it moves."""
    slides = {side: "slides"}
    free = side_moves({}, tmp_path, "free", **slides)
    assert free[0] < 0 < free[1]
    even = dict.fromkeys(("left", "left_half", "middle", "right_half", "right"), 0.5)
    for n, values in enumerate(
        (
            {f"{side}_coulomb.coefficient": 0.1},
            {f"{side}_sticks.share": 0.5},
            {f"{side}_sticks_probe.{place}": share for place, share in even.items()},
        )
    ):
        moved = side_moves(values, tmp_path, f"held{n}", **slides)
        assert moved[0] == pytest.approx(-moved[1], rel=1e-6)
        assert 0.1 * free[1] < moved[1] < 0.9 * free[1]
    stuck = side_moves({f"{side}_sticks.share": 0.99}, tmp_path, "stuck", **slides)
    assert 0 < stuck[1] < 0.1 * free[1]
    left = side_moves({f"{side}_sticks_probe.left": 0.9}, tmp_path, "left", **slides)
    assert abs(left[0]) < 0.7 * left[1]


@pytest.mark.parametrize("side", ["base", "indenter"])
def test_friction_is_a_share_of_the_force_on_each_half(side):
    """But for the middle, which sticks: a row of nodes has 0.9 of it or so."""
    of = replace(study(), **{side: "slides"})
    name = "TOP" if side == "indenter" else "BOTTOM"
    nodes = {int(node) + 1: MESH.points[node, 0] for node in MESH.node_sets[name]}
    for step, force in zip(deck({f"{side}_coulomb.coefficient": 0.1}, of=of).split("*STEP")[1:], FORCES, strict=True):
        loads = [row for block in cards(step, "CLOAD") for row in block if row[1] == 1]
        left, right = (
            sum(load for node, _, load in loads if bool(nodes[int(node)] < 6.0) is before) for before in (True, False)
        )
        assert left == pytest.approx(-right)
        assert 0.8 * 0.1 * force / 2 < left < 0.1 * force / 2


@pytest.mark.parametrize("curve", [0.02, -0.02])
def test_the_pressure_under_a_curved_indenter_adds_up_to_the_force(curve, tmp_path):
    outcome = solve(deck({"indenter_probe.curve": curve}), tmp_path)
    assert -outcome.reaction[:, 1] == pytest.approx(FORCES, rel=1e-6)
    side, x = MESH.node_sets["TOP"], MESH.points[MESH.node_sets["TOP"], 0] - 6.0
    deep = -outcome.displacement[-1, side, 1]
    assert deep == pytest.approx(deep[np.abs(x).argmin()] + curve * x**2, abs=1e-6)


@pytest.mark.parametrize("crown", [0.3, -0.3])
def test_an_indenter_that_is_not_flat_touches_first_where_it_is_lowest(crown, tmp_path):
    """Elsewhere by the distance later: not at all at the first step, where it has come down by less at an edge."""
    way = np.array([0.2, 0.4])
    outcome = solve(deck({"curved_indenter.crown": crown}, of=study("displacement", way)), tmp_path)
    side = MESH.node_sets["TOP"]
    share = ((MESH.points[side, 0] - 6.0) / 6.0) ** 2
    rise = 0.3 * (share if crown > 0 else 1.0 - share)
    assert -outcome.displacement[:, side, 1] == pytest.approx(np.maximum(way[:, None] - rise, 0.0), abs=1e-9)


@pytest.mark.parametrize("crown", [0.3, -0.3])
def test_a_force_bends_the_body_as_a_curved_indenter_is(crown, tmp_path):
    """Read is the way of the face since it touched; of a hollow one the middle has gone less far."""
    outcome = solve(deck({"curved_indenter.crown": crown}), tmp_path)
    side = MESH.node_sets["TOP"]
    x, deep = MESH.points[side, 0] - 6.0, -outcome.displacement[-1, side, 1]
    assert deep - deep[np.abs(x).argmin()] == pytest.approx(-crown * (x / 6.0) ** 2, abs=1e-6)
    assert -outcome.reaction[:, 1] == pytest.approx(FORCES, rel=1e-6)
    seen = observation(curved_indenter__crown=crown)
    assert seen.response(np.array([1.0, 2.0]), "displacement") == pytest.approx(
        [1.0 + max(-crown, 0.0), 2.0 + max(-crown, 0.0)]
    )


def test_an_indenter_that_is_deeper_as_a_whole_is_read_less_deep(tmp_path, plain):
    """The body is as it was under a given force: what is read differs. Where a displacement is given it goes deeper."""
    lowered = {"indenter_probe.lowered": 0.3}
    outcome = solve(deck(lowered), tmp_path)
    assert outcome.displacement == pytest.approx(plain.displacement, abs=1e-6)
    seen = observation(indenter_probe__lowered=0.3)
    assert seen.response(np.array([1.0, 2.0]), "displacement") == pytest.approx([0.925, 1.85])
    deeper = solve(deck(lowered, of=study("displacement", [0.2, 0.4])), tmp_path)
    top = deeper.displacement[:, MESH.node_sets["TOP"], 1]
    assert top == pytest.approx(np.broadcast_to([[-0.35], [-0.7]], top.shape), abs=1e-9)


@pytest.mark.parametrize(
    "values", [{"indenter_slip.share": 0.02}, {"indenter_friction.share": 0.3}], ids=lambda v: min(v)
)
def test_the_last_node_of_a_slipping_indenter_does_not_run_ahead(tmp_path, values):
    """Alone it moved inwards, against all others, ten times as far as on the finest meshes."""
    mesh = layered_block(12.0, LAYERS, 8, 3, "CPE8H", 4.0)
    outcome = solve(deck(values, mesh=mesh), tmp_path, mesh)
    top = mesh.node_sets["TOP"][np.argsort(mesh.points[mesh.node_sets["TOP"], 0])]
    u = outcome.displacement[-1, top, 0]
    assert u[0] == pytest.approx(u[1], rel=1e-6)
    assert u[0] < 0 < u[-1]
    assert abs(u[0]) < 1.5 * np.abs(u[2:-2]).max()


def test_fibres_lie_at_their_angle(tmp_path, plain):
    """Along x they bulge less; slanted ones draw the indenter's side to where they are not stretched, mirrored by the sign."""
    assert deck({"fibres.stiffness": 0.05}) == deck({"fibres.stiffness": 0.05, "fibres.angle": 0})
    outcome = {a: solve(deck({"fibres.stiffness": 0.25, "fibres.angle": a}), tmp_path) for a in (0, 45, -45, 90)}
    x = MESH.points[:, 0]

    def mirrored(field):
        place = {tuple(np.round(p, 6)): n for n, p in enumerate(MESH.points.tolist())}
        return field[[place[tuple(np.round([12.0 - p[0], p[1]], 6))] for p in MESH.points.tolist()]] * [-1, 1]

    bulge = {a: one.displacement[-1, x == 12.0, 0].max() for a, one in outcome.items()}
    assert bulge[0] < 0.9 * plain.displacement[-1, x == 12.0, 0].max()
    assert outcome[45].displacement[-1] == pytest.approx(mirrored(outcome[-45].displacement[-1]), abs=1e-6)
    lean = outcome[45].displacement[-1] - mirrored(outcome[45].displacement[-1])
    assert np.abs(lean[:, 0]).max() > 0.02
    upright = outcome[90].displacement[-1]
    assert upright == pytest.approx(mirrored(upright), abs=1e-6)
    two = {a: {"fibres.stiffness": 0.25, "fibres.families": 2, "fibres.angle": a} for a in (0, 1e-3, 30, 45, -45, 90)}
    # along the axes, and mirrored, they are the same
    assert all(deck(two[a]) == deck(two[a] | {"fibres.families": 1}) for a in (0, 90))
    assert deck(two[45]) == deck(two[-45])
    crossed = {a: solve(deck(two[a]), tmp_path).displacement[-1] for a in (1e-3, 30)}
    assert crossed[1e-3] == pytest.approx(outcome[0].displacement[-1], abs=1e-4)
    assert crossed[30] == pytest.approx(mirrored(crossed[30]), abs=1e-6)
    assert bulge[0] < crossed[30][x == 12.0, 0].max() < bulge[90]


def test_fibres_of_one_layer_keep_that_one_narrow(tmp_path, plain):
    """The middle of its side bulges less, of all layers the most."""
    side = MESH.points[:, 0] == 12.0
    middle = [np.abs(MESH.points[side, 1] - y).argmin() for y in (10.0, 6.0, 2.0)]
    before = plain.displacement[-1, side, 0][middle]
    for number in (1, 2, 3):
        text = deck({"fibres.stiffness": 0.25, "fibres.layer": number})
        assert text.count("*ANISOTROPIC HYPERELASTIC") == 1
        narrower = 1 - solve(text, tmp_path).displacement[-1, side, 0][middle] / before
        assert narrower.argmax() == number - 1
        assert narrower[number - 1] > max(0.02, 2 * np.delete(narrower, number - 1).max())


def test_what_is_beside_the_law_is_the_elements_of_each_layer_once_more():
    for prefix, values in (
        ("YEOH", {"yeoh.c2": 0.5, "yeoh.c3": 0.2}),
        ("EXP", {"exponential.b": 2.0}),
        ("SOFTENING", {"softening.change": -0.4}),
        ("FIBRES", {"fibres.stiffness": 0.05}),
    ):
        for more in ({}, {"gradient.slope": 0.4}):
            text = deck(values | more)
            twins = cards(text, f"ELEMENT, TYPE=CPE8H, ELSET={prefix}_\\w+")
            rows = sorted(row[1:] for block in twins for row in block)
            assert rows == sorted([n + 1.0 for n in row] for block in MESH.blocks for row in block.nodes.tolist())
            numbers = [row[0] for block in twins for row in block]
            assert len(set(numbers)) == len(numbers) == MESH.element_count
            assert min(numbers) > MESH.element_count
            assert text.count("*SOLID SECTION") == 2 * text.count("*HYPERELASTIC, OGDEN")
    # of one layer, where that is asked for, and not at all of one that is not there
    for name, number, prefix in (
        ("yeoh", "c2", "YEOH"),
        ("exponential", "b", "EXP"),
        ("softening", "change", "SOFTENING"),
    ):
        one = deck({f"{name}.{number}": 0.5, f"{name}.layer": 2.0})
        assert re.findall(rf"ELSET={prefix}_(\w+)\n", one) == ["MIDDLE"]
        assert one.count("*HYPERELASTIC") == len(LAYERS) + 1
        assert deck({f"{name}.{number}": 0.5, f"{name}.layer": 5.0}) == PLAIN
    both = deck({"yeoh.c2": 0.5, "fibres.stiffness": 0.05})
    numbers = [row[0] for block in cards(both, "ELEMENT, TYPE=CPE8H, ELSET=\\w+") for row in block]
    assert len(set(numbers)) == 2 * MESH.element_count


@pytest.mark.parametrize("layer", [0.0, 2.0])
def test_what_is_beside_the_law_swells_as_its_layer_does(layer):
    swollen = {"swollen.volume": 0.1, "swollen.layer": layer}
    alone = cards(deck(swollen), "EXPANSION, ZERO=0.")
    assert len(alone) == (1 if layer else 3)
    for beside in ({"yeoh.c2": 5.0}, {"exponential.b": 5.0}, {"softening.change": 1.0}):
        assert sorted(cards(deck(swollen | beside), "EXPANSION, ZERO=0.")) == sorted(2 * alone)


def test_the_series_is_that_of_the_exponential():
    """Of exp(x) the seventh power is left out, and what follows: x^7 / 7! times exp(x) at most."""
    b, strain = 2.0, 0.5
    for block, mu in zip(
        cards(deck({"exponential.b": b}), "HYPERELASTIC, REDUCED POLYNOMIAL"), MU.values(), strict=True
    ):
        constants = [x for line in block for x in line]
        assert len(constants) == 12
        energy = sum(c * strain**n for n, c in enumerate(constants[:6], 1)) - 1e-6 * mu * strain
        wanted = mu / 2 * ((np.exp(b * strain) - 1) / b - strain)
        assert energy == pytest.approx(wanted, abs=mu / (2 * b) * (b * strain) ** 7 / 5040 * np.exp(b * strain))
        assert energy == pytest.approx(wanted, rel=1e-3)


def test_they_stiffen_at_large_strain_only(tmp_path):
    def forces(values):
        return solve(deck(values, of=study("displacement", [0.2, 3.0])), tmp_path).reaction[:, 1]

    plain = forces({})
    for values in ({"yeoh.c2": 0.5}, {"yeoh.c3": 1.0}, {"exponential.b": 2.0}):
        small, large = forces(values) / plain
        assert 1.0 < small < 1.02
        assert large > 1.5


def test_it_softens_at_small_strain_and_then_no_more(tmp_path):
    """A body that softens to half of its modulus is half as stiff, once I1 - 3 is beyond 1 / rate.

    A little less at large strain: what is taken away is of I1, and so grows faster than the law of the body, alpha 1.4.
    """
    values, forces = study("displacement", [0.02, 1.5, 3.0]), {}
    for name, own in (("plain", {}), ("soft", {"softening.change": -0.5, "softening.rate": 50.0})):
        forces[name] = solve(deck(own, of=values), tmp_path).reaction[:, 1]
    small, middle, large = forces["soft"] / forces["plain"]
    assert 0.99 < small < 1.0
    assert 0.45 < large < 0.5 < middle < 0.6


def test_a_wall_stops_the_side_that_meets_it(tmp_path, plain):
    """Nearly rigid, its overclosure is that of a pressure of the order of the modulus: hundredths of the width."""
    outcome = {}
    for way in (-1, 0, 1):
        text = deck({"wall.share": 0.98, "wall.gap": 0.3, "wall.side": way})
        assert text.count("*CONTACT PAIR") == (2 if way == 0 else 1)
        outcome[way] = solve(text, tmp_path)
        assert outcome[way].displacement.shape == plain.displacement.shape
    left, right = MESH.points[:, 0] == 0, MESH.points[:, 0] == 12.0
    free = plain.displacement[-1, right, 0].max()
    for way, wall in ((-1, left), (0, left), (0, right), (1, right)):
        reached = np.abs(outcome[way].displacement[-1, wall, 0]).max()
        assert 0.3 < reached < 0.4 < 0.3 * free
    # away from one wall it bulges more, and between two it is stiffest
    assert outcome[-1].displacement[-1, right, 0].max() > 1.05 * free
    moved = {way: -one.indenter[-1, 1] for way, one in outcome.items()}
    assert moved[0] < 0.6 * moved[1] == pytest.approx(0.6 * moved[-1], rel=1e-6)
    # a wall that is never met changes nothing
    far = solve(deck({"wall.share": 0.98, "wall.gap": 2.5, "wall.side": 0}), tmp_path)
    assert far.displacement == pytest.approx(plain.displacement, abs=1e-6)


def test_loads():
    assert [block[0][2] for block in cards(PLAIN, "CLOAD")] == [-20.0, -40.0]
    gain = cards(deck({"force_gain.gain": 0.25}), "CLOAD")
    assert [block[0][2] for block in gain] == pytest.approx([-16.0, -32.0])
    offset = cards(deck({"force_offset.offset": 0.5}), "CLOAD")
    assert [block[0][2] for block in offset] == pytest.approx([-19.5, -39.5])
    assert [block[0][0] for block in cards(deck({"load_step.refinement": 1.0}), "STATIC")] == pytest.approx([0.1] * 2)


def test_preload_counts_from_the_first_picture(tmp_path, plain):
    text = deck({"preload.force": 20.0})
    assert [block[0][2] for block in cards(text, "CLOAD")] == [-20.0, -40.0, -60.0]
    outcome = solve(text, tmp_path)
    seen = since_first_picture(outcome, 2)
    assert seen.steps == 2
    # 20 N before the first picture: the body at 40 N is one step further than it was then
    assert outcome.displacement[:2] == pytest.approx(plain.displacement, abs=1e-6)
    assert seen.displacement[0] == pytest.approx(plain.displacement[1] - plain.displacement[0], abs=1e-6)
    assert seen.indenter[1] == pytest.approx(outcome.indenter[2] - outcome.indenter[0])
    assert since_first_picture(plain, 2) is plain


@pytest.mark.parametrize("control", ["force", "displacement"])
def test_a_body_that_was_sheared_before_leans_from_the_start(control, tmp_path):
    of = study() if control == "force" else study("displacement", [0.5, 1.0])
    outcome = solve(deck({"preshear.aside": 0.8}, of=of), tmp_path)
    assert outcome.steps == 3
    assert outcome.indenter[:, 0] == pytest.approx(0.8)
    assert outcome.reaction[0, 1] == pytest.approx(0.0, abs=1e-6)
    # to first order a layer is sheared in proportion to its height over its modulus
    compliance = {name: height / MU[f"mu_{name}"] for name, height in LAYERS}
    top = np.isclose(MESH.points[:, 1], 12.0)
    border = np.isclose(MESH.points[:, 1], 12.0 - LAYERS[0][1])
    middle = np.isclose(MESH.points[:, 0], 6.0)
    assert outcome.displacement[0, top, 0] == pytest.approx(0.8)
    expected = 0.8 * (1 - compliance["top"] / sum(compliance.values()))
    assert outcome.displacement[0, border & middle, 0] == pytest.approx(expected, rel=0.1)
    assert since_first_picture(outcome, 2).indenter[:, 0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "values",
    [{"preload.force": 4.0}, {"swollen.volume": 0.05}, {"prestretch.stretch": 0.05}, {"state_probe.swollen": 0.05}],
)
def test_under_displacements_it_goes_on_from_where_a_force_has_left_it(values, tmp_path):
    """The forces that are found, prescribed in its place, find the same displacements; so does CalculiX (next test)."""
    outcome = solve(deck(values, of=study("displacement", [0.5, 1.0])), tmp_path)
    assert (outcome.status, outcome.steps) == (CONVERGED, 3)
    assert outcome.indenter[1:, 1] - outcome.indenter[0, 1] == pytest.approx([-0.5, -1.0])
    assert -outcome.reaction[0, 1] == pytest.approx(values.get("preload.force", 0.0), abs=1e-6)
    forces = list(outcome.reaction[0, 1] - outcome.reaction[1:, 1])
    pushed = solve(deck(values, of=study("force", forces)), tmp_path)
    assert pushed.displacement == pytest.approx(outcome.displacement, abs=1e-6)


def test_calculix_goes_on_from_there_as_well(tmp_path, needs_ccx):
    mesh = layered_block(12.0, LAYERS, 4, 2, "CPE8")
    text = deck({"preload.force": 4.0}, of=study("displacement", [0.5, 1.0]), mesh=mesh)
    ours = solve(text, tmp_path, mesh)
    theirs = get_solver("calculix").solve(tmp_path / "deck.inp", tmp_path)
    assert theirs.displacement == pytest.approx(ours.displacement, abs=2e-6)  # seven digits in its .dat


def test_a_wall_is_beside_it_then_too(tmp_path):
    values = {"swollen.volume": 0.05, "wall.share": 0.5, "wall.gap": 0.1}
    free, stopped = (
        solve(deck(given, of=study("displacement", [0.5, 1.0])), tmp_path)
        for given in ({"swollen.volume": 0.05}, values)
    )
    assert stopped.displacement[-1, :, 0].min() > 0.8 * free.displacement[-1, :, 0].min()  # its left side


def test_with_nothing_before_it_rests(tmp_path):
    """No force is known that a share could be of: the first step does nothing at all."""
    outcome = solve(deck({"state_probe.load": 0.1}, of=study("displacement", [0.5, 1.0])), tmp_path)
    assert (outcome.status, outcome.steps) == (CONVERGED, 3)
    assert np.abs(outcome.displacement[0]).max() < 1e-12


def test_swelling_follows_time_or_steps(tmp_path, plain):
    """Temperatures are stretches less 1: their cube is the change of volume."""
    text = deck({"swelling.volume": 0.05})
    assert "*EXPANSION, ZERO=0.\n1\n*SOLID SECTION" in text
    assert text.count("*EXPANSION") == len(LAYERS)
    found = [float(value) for value in re.findall(r"\*TEMPERATURE\nALL, (.*)", text)]
    assert [(1 + e) ** 3 for e in found] == pytest.approx([1.025, 1.05])
    late = replace(study(), steps=tuple(replace(s, time=t) for s, t in zip(study().steps, (5.0, 20.0), strict=True)))
    found = [float(e) for e in re.findall(r"\*TEMPERATURE\nALL, (.*)", deck({"swelling.volume": 0.05}, of=late))]
    assert [(1 + e) ** 3 for e in found] == pytest.approx([1.0125, 1.05])
    dries = deck({"swelling.volume": -0.05, "swelling.settling": 3.0})
    found = [(1 + float(e)) ** 3 - 1 for e in re.findall(r"\*TEMPERATURE\nALL, (.*)", dries)]
    assert found == pytest.approx([-0.05 * (1 - np.exp(-1.5)) / (1 - np.exp(-3)), -0.05])
    swelled, shrunk = (solve(deck({"swelling.volume": v}), tmp_path) for v in (0.03, -0.03))
    side = MESH.points[:, 0] == 12.0
    for outcome, way in ((swelled, 1), (shrunk, -1)):
        moved = way * (outcome.displacement - plain.displacement)
        assert moved[-1, side, 0].max() > moved[0, side, 0].max() > 0.03
        assert moved[-1, MESH.node_sets["TOP"], 1].min() > 0.1


def test_what_was_before_the_first_picture_is_a_step_of_its_own(tmp_path, plain):
    for values in ({"swollen.volume": 0.05}, {"prestretch.stretch": 0.05}, {"state_probe.load": 0.1}):
        outcome = solve(deck(values), tmp_path)
        assert outcome.steps == 3
        seen = since_first_picture(outcome, 2)
        change = np.abs(seen.displacement - plain.displacement).max(axis=(1, 2))
        assert change.min() > 2e-3
        if "state_probe.load" not in values:  # nothing but the body itself pushes
            assert outcome.reaction[0, 1] == pytest.approx(0.0, abs=1e-4)
            assert np.abs(outcome.displacement[0]).max() > 0.05
    assert "*TEMPERATURE" not in deck({"preload.force": 1.0})


def test_one_layer_alone_may_have_swelled(tmp_path):
    """Far from the sides a layer can only get higher, by (1 + nu) / (1 - nu) times the strain of free swelling."""
    volume, nu = 0.02, MATERIAL["poisson"]
    assert deck({"swollen.volume": volume, "swollen.layer": 2.0}).count("*EXPANSION") == 1
    wide = layered_block(120.0, [("top", 4.0), ("middle", 4.0), ("bottom", 4.0)], 20, 2, "CPE8H")
    higher = 4.0 * (1 + nu) / (1 - nu) * (np.cbrt(1 + volume) - 1)
    for layer, grown in ((2.0, [0, 1, 1]), (0.0, [1, 2, 3])):
        outcome = solve(deck({"swollen.volume": volume, "swollen.layer": layer}, mesh=wide), tmp_path, wide)
        levels = [np.isclose(wide.points, [60.0, level]).all(axis=1) for level in (4.0, 8.0, 12.0)]
        found = [outcome.displacement[0, level, 1].item() for level in levels]
        assert found == pytest.approx(higher * np.array(grown), abs=0.05 * higher * grown[-1])


def test_one_layer_alone_may_have_been_stretched():
    blocks = re.findall(r"TYPE=STRESS\n((?:[^*].*\n)*)", deck({"prestretch.stretch": 0.05, "prestretch.layer": 2.0}))
    assert [line.split(",")[0] for block in blocks for line in block.splitlines()] == ["MIDDLE"]
    with pytest.raises(InputError, match=r"effect prestretch: layer: found 4; expected 1 to 3, or 0 for all layers"):
        deck({"prestretch.stretch": 0.05, "prestretch.layer": 4.0})


def test_one_layer_that_swelled_is_alone_in_swelling():
    values = {"swollen.volume": 0.05, "swelling.volume": 0.03}
    assert "*EXPANSION" in deck(values | {"swollen.layer": 0.0})
    expected = r"effect swollen: layer: found 1; expected 0, all layers, beside effect swelling"
    with pytest.raises(InputError, match=expected):
        deck(values | {"swollen.layer": 1.0})


def test_a_body_that_was_stretched_draws_its_sides_in(tmp_path):
    """What was longer along x and is released gets shorter by as much where it is far from the glued edges."""
    wide = layered_block(36.0, [("top", 4.0), ("middle", 4.0), ("bottom", 4.0)], 12, 2, "CPE8H")
    outcome = solve(deck({"prestretch.stretch": 0.01}, mesh=wide), tmp_path, wide)
    side = np.isclose(wide.points[:, 0], 36.0) & np.isclose(wide.points[:, 1], 6.0)
    assert -0.01 * 18 < outcome.displacement[0, side, 0].item() < -0.01 * 4


def test_the_probe_of_the_state_does_what_its_members_do():
    def given(values):
        text = deck(values).replace("ALL, 0.\n", "")
        found = re.findall(r"\*TEMPERATURE\n((?:[^*].*\n)*)", text)
        loads, stress = cards(text, "CLOAD"), re.findall(r"TYPE=STRESS\n((?:[^*].*\n)*)", text)
        return [np.array([float(line.split(",")[1]) for line in block.splitlines()]) for block in found], loads, stress

    even = dict.fromkeys(("state_probe.lower", "state_probe.middle", "state_probe.upper"), 0.03)
    warm, loads, _ = given({"swelling.volume": 0.03})
    probed, more, _ = given(even)
    assert np.ravel(probed) == pytest.approx(np.ravel([[0.0], *warm]))
    assert [block[0][2] for block in more] == pytest.approx([0.0, *(block[0][2] for block in loads)], rel=1e-6)
    assert np.ravel(given({"swollen.volume": 0.03})[0]) == pytest.approx(
        np.ravel(given({"state_probe.swollen": 0.03})[0])
    )
    assert given({"prestretch.stretch": 0.03})[1:] == given({"state_probe.stretch": 0.03})[1:]
    assert given({"preload.force": 4.0})[1] == given({"state_probe.load": 0.1})[1]
    (rows, *_), _, _ = given({"state_probe.swollen": 0.01, "state_probe.upper": 0.03})
    assert np.ptp(rows) == 0
    halfway, last = ((1 + row[0]) ** 3 for row in given({"state_probe.midway": 0.03})[0][1:])
    assert (halfway, last) == pytest.approx((1.03, 1.0))
    last = (1 + given({"state_probe.lower": 0.03, "state_probe.upper": 0.09})[0][-1]) ** 3 - 1
    up = MESH.points[:, 1] / 12.0
    assert last == pytest.approx(np.interp(up, [0, 0.5, 1], [0.03, 0.0, 0.09]))


def test_what_shrinks_to_nothing_is_refused():
    with pytest.raises(InputError, match=r"effect swelling: changes\.swelling: found -1\.5; .*above -1"):
        deck({"swelling.volume": -1.5})


# --- observed


def course(count):
    """Of as many steps, equally far apart in time and in load."""
    return tuple({"k": float(k), "n": float(count), "now": k / count, "loaded": k / count} for k in range(1, count + 1))


COURSE = course(4)


def observation(**values):
    return Observation.of(EFFECTS.values(), {k.replace("__", "."): v for k, v in values.items()}, MESH.points, COURSE)


def test_nothing_observed_is_none():
    assert observation() is None
    assert observation(tilt__slope=0.1) is None
    assert observation(misregistration__x=0.0, misregistration__y=0.0) is None


def test_misregistration():
    seen = observation(misregistration__x=0.1, misregistration__y=-0.2)
    for k in (1, 4):
        assert seen.shift(k, MESH.points) == pytest.approx(np.broadcast_to([0.1, -0.2], MESH.points.shape))
    assert seen.response(np.array([1.0, 2.0]), "displacement") == pytest.approx([1.0, 2.0])


def test_a_lens_of_all_pictures_moves_nothing_at_rest():
    """It shows material elsewhere in the first picture, and as much elsewhere where it is later."""
    seen = observation(lens__barrel=0.05, lens__across=0.4, lens__along=0.6)
    rest = np.zeros(MESH.points.shape)
    assert seen.moves_first and np.abs(seen.first(MESH.points)).max() > 0.3
    assert seen.moved(3, MESH.points, rest) == pytest.approx(rest, abs=1e-12)
    there = seen.origin(MESH.points)
    assert there + seen.first(there) == pytest.approx(MESH.points, abs=1e-3)
    shown, moved = as_seen(MESH, rest, seen, 2)
    assert shown.points == pytest.approx(MESH.points + seen.first(MESH.points))
    assert moved == pytest.approx(rest, abs=1e-12)


def test_pixels_of_another_size_scale_displacements():
    seen = observation(pixel_size__across=0.02, pixel_size__along=-0.01)
    displacement = 0.1 * MESH.points
    assert seen.moved(1, MESH.points, displacement) == pytest.approx(displacement * [1.02, 0.99])
    assert seen.origin(MESH.points + seen.first(MESH.points)) == pytest.approx(MESH.points, abs=1e-5)


def test_intensities(rng):
    picture = rng.uniform(size=(5, 6))
    x, y = np.meshgrid(np.linspace(0, 12, 6), np.linspace(0, 12, 5))
    drift = observation(intensity_drift__gain=0.2)
    assert drift.intensity(picture, 1, x, y) == pytest.approx(1.05 * picture)
    assert drift.intensity(picture, 4, x, y) == pytest.approx(1.2 * picture)
    contrast = observation(contrast_drift__power=0.4, contrast_drift__pivot=0.5)
    assert contrast.intensity(picture, 2, x, y) == pytest.approx(0.5 * (picture / 0.5) ** 1.2)
    assert contrast.intensity(-picture, 2, x, y) == pytest.approx(-picture)
    bias = observation(bias_field__across=0.1, bias_field__along=-0.3)
    wanted = picture * (1 + 0.1 * (x / 12 - 0.5) - 0.3 * (y / 12 - 0.5))
    assert bias.intensity(picture, 2, x, y) == pytest.approx(wanted)
    growing = observation(bias_field__across=0.2, bias_field__along=-0.6, bias_field__growing=1.0)
    assert growing.intensity(picture, 2, x, y) == pytest.approx(wanted)
    assert growing.intensity(picture, 4, x, y) == pytest.approx(2 * wanted - picture)
    both = observation(intensity_drift__gain=0.2, bias_field__across=0.1, bias_field__along=-0.3)
    assert both.intensity(picture, 4, x, y) == pytest.approx(1.2 * wanted)
    assert not both.shift(1, MESH.points).any()


def test_pictures_that_are_turned_stretched_and_wander():
    """About the middle of the body; what grows is whole at the last step."""
    middle = MESH.points.mean(axis=0)
    low, high = MESH.points.min(axis=0), MESH.points.max(axis=0)
    assert middle == pytest.approx((low + high) / 2)
    turned = observation(turned_pictures__angle=0.1).shift(2, MESH.points)
    turn = np.array([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]])
    assert turned == pytest.approx((MESH.points - middle) @ (turn - np.eye(2)), abs=1e-12)
    stretched = observation(stretched_pictures__across=0.01, stretched_pictures__along=-0.02).shift(2, MESH.points)
    assert stretched == pytest.approx((MESH.points - middle) * [0.01, -0.02])
    beside = np.array([[6.0, 0.0], [0.0, 3.0], [-6.0, 0.0]])
    barrel = observation(distorted_pictures__barrel=0.05).shift(3, middle + beside)
    assert barrel == pytest.approx(np.array([[-0.3, 0.0], [0.0, -0.3 / 8], [0.3, 0.0]]))
    for k in (1, 4):
        wandering = observation(wandering_pictures__x=0.4).shift(k, MESH.points)
        assert wandering == pytest.approx(np.broadcast_to([0.1 * k, 0.0], MESH.points.shape))


@pytest.mark.parametrize(
    ("effect", "number"),
    [("turned_pictures", "angle"), ("stretched_pictures", "lean"), ("distorted_pictures", "barrel"),
     ("wandering_pictures", "y"), ("bias_field", "along")],
)  # fmt: skip
def test_what_is_seen_may_grow_with_the_load(effect, number):
    """Where the load grows unevenly, here with the square of the step."""
    uneven = tuple({**step, "loaded": (step["k"] / step["n"]) ** 2} for step in COURSE)
    place, picture = np.array([[3.0, 10.0], [9.0, 2.0]]), np.ones((1, 2))

    def seen(growing, k):
        # so little that a turn is linear
        values = {f"{effect}.{number}": 1e-7, f"{effect}.growing": growing}
        one = Observation.of(EFFECTS.values(), values, MESH.points, uneven)
        return one.intensity(picture, k, *place.T[:, None]) - picture if one.lit else one.shift(k, place)

    for k in (1, 3, 4):
        assert np.abs(seen(2.0, k)).max() > 0.0
        assert seen(2.0, k) == pytest.approx((k / 4) ** 2 * seen(1.0, 4))
        assert seen(1.0, k) == pytest.approx(k / 4 * seen(1.0, 4))


def test_the_probe_of_the_observation_does_what_its_members_do():
    alike = {
        "misregistration": {"x": "aside", "y": "upwards"},
        "turned_pictures": {"angle": "turn"},
        "stretched_pictures": {"across": "across", "along": "along"},
        "wandering_pictures": {"x": "growing_x", "y": "growing_y"},
        "distorted_pictures": {"barrel": "barrel"},
    }
    for name, numbers in alike.items():
        for own, its in numbers.items():
            for k in (1, 4):
                member = observation(**{f"{name}__{own}": 0.01}).shift(k, MESH.points)
                probed = observation(**{f"observation_probe__{its}": 0.01}).shift(k, MESH.points)
                # a turn is to first order in the probe: half its square times half the diagonal is left
                left = 0.5 * 0.01**2 * np.linalg.norm(np.ptp(MESH.points, axis=0)) / 2 if its == "turn" else 1e-12
                assert probed == pytest.approx(member, abs=left)


def test_shifts_of_several_effects_add_up():
    alone = {"misregistration__x": 0.1, "turned_pictures__angle": 0.02, "stretched_pictures__across": 0.01}
    alone |= {"wandering_pictures__y": 0.05, "distorted_pictures__barrel": 0.01}
    parts = [observation(**{key: value}).shift(3, MESH.points) for key, value in alone.items()]
    assert observation(**alone).shift(3, MESH.points) == pytest.approx(sum(parts))


def test_a_frame_gives_way_in_proportion_to_the_force():
    """Whatever the steps are, and under a prescribed displacement by the forces that were measured."""
    uneven = study("displacement", np.array([0.5, 1.0]))
    uneven = replace(uneven, steps=tuple(replace(s, force=f) for s, f in zip(uneven.steps, (3.0, 30.0), strict=True)))
    assert [step["loaded"] for step in uneven.course] == pytest.approx([0.1, 1.0])
    read = [
        block[-1][-1] for block in cards(deck({"soft_frame.most": 0.2}, of=uneven).partition("*STEP")[2], "BOUNDARY")
    ]
    assert read == pytest.approx([-0.48, -0.8])
    unknown = study("displacement", np.array([0.25, 1.0]))
    assert [step["loaded"] for step in unknown.course] == pytest.approx([0.25, 1.0])


def test_after_rest_the_indenter_stays_where_it_came_to_rest_although_the_first_step_prescribes_nothing():
    resting = phantom("displacement", [0.0, 0.5])
    resting = replace(resting, steps=tuple(replace(s, force=f) for s, f in zip(resting.steps, (0.0, 9.0), strict=True)))
    text = deck({"swollen.volume": 0.05, "swollen.layer": 0.0}, of=resting)
    first, second, third = text.split("*STEP")[1:]
    assert "*CLOAD" in first
    assert ["*BOUNDARY, FIXED" in step for step in (first, second, third)] == [False, True, False]


def test_positions_count_from_the_body(rng):
    moved = Observation(
        (EFFECTS["bias_field"],),
        {"bias_field.across": 0.1},
        np.array([5.0, 7.0]),
        np.array([17.0, 19.0]),
        COURSE,
    )
    one = np.ones((1, 1))
    for x, factor in ((5.0, 0.95), (11.0, 1.0), (17.0, 1.05)):
        assert moved.intensity(one, 1, x * one, 9 * one) == pytest.approx(factor * one)


def test_onset():
    seen = observation(onset__offset=0.15)
    assert seen.response(np.array([1.0, 2.0]), "displacement") == pytest.approx([1.15, 2.15])
    assert seen.response(np.array([1.0, 2.0]), "force") == pytest.approx([1.0, 2.0])


def test_the_probe_of_loading_does_what_its_members_do():
    def given(values):
        seen = Observation.of(EFFECTS.values(), values, MESH.points, course(2))
        read = np.array([1.0, 2.0])
        return cards(deck(values), "CLOAD"), read if seen is None else seen.response(read, "displacement")

    for member, probe in (
        ({"onset.offset": 0.15}, {"loading_probe.reading": 0.15}),
        ({"soft_frame.most": 0.2}, {"loading_probe.growing": 0.2}),
        ({"force_offset.offset": 0.8}, {"loading_probe.load": -0.8}),
    ):
        ours, theirs = given(member), given(probe)
        assert ours[1] == pytest.approx(theirs[1])
        assert [b[0][2] for b in ours[0]] == pytest.approx([b[0][2] for b in theirs[0]])
    # whole half way, nothing at the end
    assert [b[0][2] for b in given({"loading_probe.midway": 4.0})[0]] == pytest.approx([-24.0, -40.0])


@pytest.mark.parametrize(
    "values",
    [
        {"force_offset.offset": 0.8},
        {"onset.offset": 0.15},
        {"soft_frame.most": 0.2},
        {"nonlinear_sensor.bend": 0.1},
        {"nonlinear_sensor.bend": 0.1, "nonlinear_sensor.power": 1.5},
        {"guide_friction.most": 0.8},
        {"ageing.change": 0.2},
    ],
)
def test_what_instruments_show_is_the_same_whichever_of_both_is_prescribed(values):
    """The true values of a prescribed quantity, seen through the same instrument, are those that were prescribed."""
    for prescribed, effects in (("force", EFFECTS), ("displacement", BY_DISPLACEMENT)):
        other = BY_DISPLACEMENT if prescribed == "force" else EFFECTS
        read = np.array([20.0, 40.0]) if prescribed == "force" else np.array([0.5, 1.0])
        (name,) = {key.partition(".")[0] for key in values}
        card = "CLOAD" if prescribed == "force" else "BOUNDARY"
        text = deck(values, of=study(prescribed, read))
        true = -np.array([block[-1][-1] for block in cards(text.partition("*STEP")[2], card) if block[-1][1] == 2])
        seen = Observation.of([other[name]], values, MESH.points, course(2))
        shown = true if seen is None else seen.response(true, prescribed)
        assert shown == pytest.approx(read, rel=1e-9)
        changes = prescribed in effects[name].changes
        assert (text != deck(of=study(prescribed, read))) == changes == effects[name].simulated


def test_an_effect_that_a_control_leaves_nothing_changes_no_deck_and_shows_nothing():
    """So it is refused as any other that changes nothing, and is no effect on the observation."""
    gain = BY_DISPLACEMENT["force_gain"]
    assert not gain.changes and not gain.observes
    assert gain.acts == EFFECTS["force_gain"].acts
    assert gain.simulated


# --- formulas


def test_formulas():
    assert evaluate("a * 2 ** 3 - 1", {"a": 2.0}) == 15.0
    assert evaluate("1 if a > 1 else 0", {"a": 2.0}) == 1
    assert evaluate("where(a > 1, sqrt(a), 0.0)", {"a": np.array([0.0, 4.0])}) == pytest.approx([0.0, 2.0])


@pytest.mark.parametrize(
    "formula",
    [
        "x.real", "x.__class__", "x['__class__']", "().__class__.__bases__", "''.join(x)", "exp.__globals__", "exp.at(x)",
        "__import__('os')", "__builtins__", "__name__", "open('f')", "range(3)", "dict(a=1)", "lipsum()", "cycler('a')",
        "namespace(a=1)", "x()", "self", "self.x", "exp", "unknown", "exp(unknown)", "x | list", "x is number", "'text'",
        "[x, x]", "{}", "none", "1 / 0", "10.0 ** 400", "exp(", "x +", "", "x; x", "{{ x }}",
    ],
)  # fmt: skip
def test_formulas_reach_nothing_else(formula):
    with pytest.raises(ValueError, match=r".") as caught:
        evaluate(formula, {"x": 2.0})
    assert "\n" not in str(caught.value)
    assert repr(formula) in str(caught.value)


def test_an_unknown_name_lists_those_that_are_known():
    with pytest.raises(ValueError, match="it may name alpha, shift"):
        evaluate("alfa", {"shift": 1.0, "alpha": 2.0})


# --- effects of one's own

OWN = """\
title: a spring under the indenter
acts: boundary
words: A soft sensor sits between indenter and frame.
look: The indenter moves further than the body is compressed.
confirm: Load the sensor alone.
parameters:
  rate: {unit: N/mm, absent: 0, lower: 0, upper: 100, step: 5}
scan: {axis: [1, 2]}
"""
PART = """\
** a spring of {{ effects.sensor.rate | number }} N/mm along {{ effects.sensor.axis }}
*ELEMENT, TYPE=SPRING1, ELSET=SENSOR
5000000, {{ indenter }}
*SPRING, ELSET=SENSOR
{{ effects.sensor.axis }}
{{ effects.sensor.rate | number }}
"""


@pytest.fixture
def own(tmp_path):
    """A study's folder with an effect of its own."""
    write_text(tmp_path / "effects/sensor.yaml", OWN)
    write_text(tmp_path / "effects/sensor.inp.j2", PART)
    return tmp_path


def test_an_effect_of_ones_own(own, plain):
    known = catalogue(own)
    assert set(known) == {*EFFECTS, "sensor"}
    effect = known["sensor"]
    assert effect.part == "effects/sensor.inp.j2"
    assert [place["sensor.axis"] for place in effect.places()] == [1.0, 2.0]
    assert deck(effect.null(), known, folders=[own]) == PLAIN
    values = {"sensor.rate": 5.0, "sensor.axis": 2}
    text = deck(values, known, folders=[own])
    assert "** a spring of 5 N/mm along 2\n" in text
    outcome = solve(text, own)
    assert outcome.status == CONVERGED
    # it carries its share of the prescribed force: the body is compressed as by the rest of it
    moved = -outcome.indenter[:, 1]
    assert (moved < -plain.indenter[:, 1]).all()
    rest = solve(deck(of=study(values=list(np.array(FORCES) - 5.0 * moved))), own)
    assert rest.displacement == pytest.approx(outcome.displacement, abs=1e-6)


def test_an_effect_of_the_study_goes_before_ours(own):
    write_text(own / "effects/tilt.yaml", OWN.replace("a spring under the indenter", "our own tilt"))
    assert catalogue(own)["tilt"].title == "our own tilt"
    assert EFFECTS["tilt"].title == catalogue()["tilt"].title == "tilt of the indenter"


def test_an_effect_is_read_again_after_a_change(own):
    assert catalogue(own)["sensor"].parameters[0].step == 5.0
    write_text(own / "effects/sensor.yaml", OWN.replace("step: 5", "step: 7"))
    assert catalogue(own)["sensor"].parameters[0].step == 7.0


def lines(own, text):
    write_text(own / "effects/sensor.yaml", text)
    with pytest.raises(Problems) as caught:
        catalogue(own)
    where = f"{own / 'effects/sensor.yaml'}: "
    found = str(caught.value).splitlines()
    assert all(line.startswith(where) for line in found)
    return [line.removeprefix(where) for line in found]


@pytest.mark.parametrize(
    ("old", "new", "wanted"),
    [
        ("acts: boundary", "acts: bondary", "acts: found bondary; expected one of material, structure, boundary, loading, numerics, observation"),
        ("acts: boundary\n", "", "acts: found nothing; expected a value: Where it acts: one of material, structure"),
        ("look:", "loks:", "loks: found an unknown key; expected look (did you mean that?)"),
        ("absent: 0", "absent: none", "parameters.rate.absent: found none; expected a number"),
        ("step: 5", "step: 0", "parameters.rate.step: found 0; expected a number from absent that stays within"),
        ("step: 5", "step: 500", "parameters.rate.step: found 500"),
        ("step: 5", "stepp: 5", "parameters.rate.stepp: found an unknown key; expected step (did you mean that?)"),
        ("[1, 2]", "[]", "scan.axis: found []; expected a list of finite numbers"),
        ("scan: {axis: [1, 2]}", "refine: {axis: [1, 2]}", "refine.axis: found an unknown key"),
        ("scan: {axis: [1, 2]}", "needs: times", "needs: found times; expected time"),
        ("scan: {axis: [1, 2]}", "control: moment", "control: found moment; expected force or displacement"),
        ("scan: {axis: [1, 2]}", "changes: {alpa: alpha}", "changes.alpa: found an unknown key; expected alpha (did you mean that?)"),
        ("scan: {axis: [1, 2]}", "observes: {intensiti: 1}", "observes.intensiti: found an unknown key; expected intensity (did you mean that?)"),
    ],
)  # fmt: skip
def test_a_wrong_effect_says_what(own, old, new, wanted):
    assert old in OWN
    assert any(line.startswith(wanted) for line in lines(own, OWN.replace(old, new)))


def test_each_problem_is_one_line(own):
    text = OWN.replace("acts: boundary", "acts: bondary").replace("absent: 0", "absent: x").replace("[1, 2]", "[a]")
    assert [line.split(":")[0] for line in lines(own, text + "needs: times\nmore: 1\n")] == [
        "more", "acts", "parameters.rate.absent", "scan.axis", "needs"
    ]  # fmt: skip


def test_a_wrong_formula_names_effect_and_key(own):
    text = OWN.replace("scan: {axis: [1, 2]}", 'changes: {alpha: "alfa + rate"}')
    write_text(own / "effects/sensor.yaml", text)
    with pytest.raises(InputError, match=r"effect sensor: changes\.alpha: found 'alfa \+ rate'"):
        deck({"sensor.rate": 1.0}, catalogue(own), folders=[own])


def test_an_unknown_effect_gives_the_nearest():
    with pytest.raises(InputError, match=r"c\.yaml: model\.effects\.tlit: found an unknown key; expected tilt \(did"):
        chosen(["tlit"], EFFECTS, "c.yaml")
    assert [effect.name for effect in chosen(["tilt", "onset"], EFFECTS, "c.yaml")] == ["tilt", "onset"]


def test_steps_may_lack_times():
    plain = replace(study(), steps=(Step(1, force=20.0), Step(2, force=40.0)))
    assert "*VISCO," not in deck({"relaxation.share": 0.3}, of=plain)


def test_the_documentation_lists_the_catalogue(own):
    text = (ROOT / "docs/diagnosis.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (.*) \| (\w+) \|$", text, re.MULTILINE)
    assert rows == [(e.name, e.title, e.family) for e in EFFECTS.values()]
    # its example can be used as it stands
    write_text(own / "effects/example.yaml", re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[0])
    known = catalogue(own)
    values = at_step(known["example"])
    assert deck(values, known) != PLAIN == deck(known["example"].null(), known)


@pytest.mark.parametrize("formula", ["exp(x, x)", "exp(x, out=x)", "where(x > 0)"])
def test_a_formula_cannot_write_into_its_inputs(formula):
    x = np.array([1.0, 2.0])
    with pytest.raises(ValueError, match=re.escape(formula)):
        evaluate(formula, {"x": x})
    assert x.tolist() == [1.0, 2.0]
