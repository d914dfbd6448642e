"""Studies whose indenter goes aside: what is read of them, what is refused, what their decks have and tables tell."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STUDY

from fingerfit.check.check import check_study
from fingerfit.core.errors import Problems
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.check import check_effects
from fingerfit.forward.decks import make_deck
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.applicable import unmet
from fingerfit.model.catalogue import catalogue
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.settings.config import load_settings
from fingerfit.solvers.registry import get_solver
from fingerfit.study.reader import load_study

SHEAR = "step,displacement,displacement_x,force,force_x\n1,400,0,10,\n2,400,-300,10,-2\n"
OBLIQUE = {"base": "held", "indenter": {"kind": "glued", "direction": [3, -4]}}
BRICK = {"brick": [6000, 5000, 4000], "layers": [{"name": "gel"}]}


def written(folder, steps=SHEAR, **own):
    """A study in micrometres and its config; returns the study's folder."""
    study = copy.deepcopy(STUDY)
    study["units"]["length"] = "um"
    study["noise"] = {"force": 0.05}
    layers = [{"name": name, "height": 4000} for name in ("top", "bottom")]
    study["body"] = {"width": 12000, "thickness": 70000, "layers": layers}
    study |= own
    (folder / "study.yaml").write_text(yaml.safe_dump({k: v for k, v in study.items() if v is not None}))
    (folder / "steps.csv").write_text(steps)
    config = {"study": str(folder), "results": f"{folder}-results", "model": MODEL, "fit": FIT}
    (folder / "config.yaml").write_text(yaml.safe_dump(config))
    return folder


def deck_of(folder, effects=None):
    settings = load_settings(folder / "config.yaml")
    study = settings.read_study()
    mesh = make_mesh(study, settings.model.mesh)
    return make_deck(settings, study, mesh, "mesh", settings.starts(), effects or settings.known_effects())


def test_sideways_displacements_and_forces_are_read_in_the_units_of_the_study(tmp_path):
    study = load_study(written(tmp_path))
    assert [step.displacement_x for step in study.steps] == [0.0, -0.3]
    assert [step.force_x for step in study.steps] == [None, -2.0]
    assert study.moved_sideways == ["x"]
    data = prepare(study, make_mesh(study, load_settings(tmp_path / "config.yaml").model.mesh), None, 1.0, 0.3)
    measured, noise = data.response
    assert np.array_equal(measured, [10, 10, np.nan, -2], equal_nan=True)
    assert np.array_equal(noise, [0.05] * 4)
    assert data.response_step.tolist() == [0, 1, 0, 1]
    assert [data.response_name(n) for n in (0, 3)] == [("force", "N"), ("force_x", "N")]


def test_a_direction_is_a_unit_vector_and_straight_down_is_none(tmp_path):
    steps = "step,displacement,force\n1,400,10\n"
    assert load_study(written(tmp_path, steps, boundary=OBLIQUE)).direction == pytest.approx((0.6, -0.8))
    straight = {"base": "held", "indenter": {"kind": "glued", "direction": [0, -2]}}
    assert load_study(written(tmp_path, steps, boundary=straight)).direction == ()


def test_a_step_prescribes_what_the_table_says(tmp_path):
    deck = deck_of(written(tmp_path))
    assert deck.count("TOP, 1, 1, ") == 2
    assert "INDENTER, 2, 2, -0.4\n*BOUNDARY\nTOP, 1, 1, -0.3\n" in deck
    rows = "step,force,displacement_x,displacement\n1,400,0,10\n2,400,-300,10\n"
    forced = deck_of(written(tmp_path, rows, control="force"))
    assert "INDENTER, 2, -400\n*BOUNDARY\nTOP, 1, 1, -0.3\n" in forced
    # a direction under displacement control is a displacement aside
    oblique = deck_of(written(tmp_path, "step,displacement,force\n1,500,10\n", boundary=OBLIQUE))
    assert "INDENTER, 2, 2, -0.4\n*BOUNDARY\nTOP, 1, 1, 0.3\n" in oblique


def test_a_displacement_before_the_first_picture_goes_along_the_direction_beside_an_effect_that_goes_aside(tmp_path):
    folder = written(tmp_path, "step,displacement,force\n1,500,10\n", boundary=OBLIQUE)
    settings = load_settings(folder / "config.yaml")
    study = settings.read_study()
    mesh, known = make_mesh(study, settings.model.mesh), settings.known_effects()
    before = {**settings.starts(), "preload.force": 0.1}
    for beside in ({}, {"sideways.moved": 0.2}):  # in proportion to the load: there is none yet
        deck = make_deck(settings, study, mesh, "mesh", {**before, **beside}, known)
        assert "INDENTER, 2, 2, -0.08\n*BOUNDARY\nTOP, 1, 1, 0.06\n" in deck


def test_forces_across_the_load_alone_change_no_deck(tmp_path):
    """A study that only measures them has the decks of one that does not."""
    rows = "step,displacement,force,force_x\n1,400,10,1\n"
    assert deck_of(written(tmp_path, rows)) == deck_of(written(tmp_path, "step,displacement,force\n1,400,10\n"))


BAD = {
    "a gap": ({}, "step,displacement,displacement_x,force\n1,400,0,10\n2,400,,10\n",
              "steps: found step 2 without displacement_x; expected the displacement_x of every step"),
    "both": ({"boundary": OBLIQUE}, SHEAR,
             "boundary.indenter.direction: found a direction, and displacement_x in the table of the steps; expected one"),
    "a base that slides": ({"boundary": {"base": "slides", "indenter": "glued"}}, SHEAR,
                           "boundary.base: found slides; expected held, since the indenter does not go straight down"),
    "y in the plane": ({}, "step,displacement,displacement_y,force\n1,400,0,10\n", "steps: found displacement_y; expected a body in space"),
    "two numbers in space": ({"boundary": OBLIQUE, "body": BRICK}, "step,displacement,force\n1,400,10\n",
                             "boundary.indenter.direction: found 2 numbers; expected 3 numbers, one for each axis"),
    "upwards": ({"boundary": {"base": "held", "indenter": {"kind": "glued", "direction": [1, 0]}}}, SHEAR,
                "direction: found .1, 0.; expected 2 or 3 numbers, the last one below 0"),
    "a rail": ({"boundary": OBLIQUE, "control": "force"}, "step,force,displacement,force_x\n1,10,400,1\n",
               "steps: found force_x with control: force; expected control: displacement"),
    "no number": ({}, SHEAR.replace("-300", "left"), "row 3, displacement_x: found left; expected a finite number"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_does_not_fit_together_is_refused(tmp_path, case):
    own, steps, message = BAD[case]
    with pytest.raises(Problems, match=message) as found:
        load_study(written(tmp_path, steps, **own))
    assert len(found.value.problems) == 1


def test_axes_of_a_mesh_of_the_users_own_are_known_when_it_is_read(tmp_path):
    text = "*NODE\n1,0,0\n2,2,0\n3,2,1\n4,0,1\n*NSET,NSET=BOTTOM\n1,2\n*NSET,NSET=TOP\n3,4\n"
    (tmp_path / "body.inp").write_text(text + "*ELEMENT,TYPE=CPE4,ELSET=GEL\n1,1,2,3,4\n")
    body = {"mesh": "body.inp", "thickness": 1, "layers": [{"name": "gel"}]}
    study = load_study(written(tmp_path, SHEAR.replace("_x", "_y").replace("10,\n", "10,1\n"), body=body))
    with pytest.raises(Problems, match="found displacement_y; expected a body in space"):
        make_mesh(study, None)


@pytest.mark.parametrize("own", [{}, {"boundary": OBLIQUE}], ids=["shear", "direction"])
def test_an_indenter_that_slides_cannot_take_the_body_along(tmp_path, own):
    boundary = {**OBLIQUE, "indenter": {**OBLIQUE["indenter"], "kind": "slides"}} if own else {
        "base": "held", "indenter": "slides"}  # fmt: skip
    steps = "step,displacement,force\n1,400,10\n" if own else SHEAR
    settings = load_settings(written(tmp_path, steps, boundary=boundary) / "config.yaml")
    study = settings.read_study()
    with pytest.raises(Problems, match="with indenter: slides; expected indenter: glued"):
        check_effects(settings, study, make_mesh(study, settings.model.mesh))


def test_forces_across_the_load_need_a_noise(tmp_path):
    from fingerfit.fit.check import check_against_study

    settings = load_settings(written(tmp_path, noise={"displacement": 1}, control="force") / "config.yaml")
    with pytest.raises(
        Problems, match=r"noise\.force: found nothing; expected a number or estimated, since force_x is"
    ):
        check_against_study(settings, settings.read_study())


def test_effects_in_place_of_a_glued_indenter_need_one_that_is_not_on_a_rail(tmp_path):
    slip, steps = catalogue()["indenter_slip"], "step,displacement,force\n1,400,10\n"
    needed = "an indenter that is not on a rail"
    studies = {
        "aside": load_study(written(tmp_path)),
        "down": load_study(written(tmp_path, steps)),
        "oblique": load_study(written(tmp_path, steps, boundary=OBLIQUE)),
    }
    mesh = layered_block(12.0, [(name, 1.0) for name in studies["down"].layer_names], 4, 2, "CPE4")
    assert not any(needed in unmet(slip, study, mesh, False) for study in studies.values())
    railed = replace(studies["oblique"], control="force")
    assert needed in unmet(slip, railed, mesh, False)
    for axis in "xy":
        aside = replace(catalogue()["sideways"], changes={f"displacement_{axis}": f"displacement_{axis} + moved"})
        assert needed in unmet(aside, railed, mesh, False)
        assert needed not in unmet(aside, studies["oblique"], mesh, False)


def moved_aside(folder, **effects):
    """Displacements of the last step and the indenter's force along x, of a study whose indenter goes aside."""
    settings = load_settings(written(folder) / "config.yaml")
    study = settings.read_study()
    mesh = make_mesh(study, settings.model.mesh)
    work = folder / "sims" / "one"
    write_text(folder / "meshes" / "mesh.inp", format_mesh(mesh))
    deck = make_deck(settings, study, mesh, "mesh", {**settings.starts(), **effects}, settings.known_effects())
    write_text(work / "deck.inp", deck)
    outcome = get_solver("builtin").solve(work / "deck.inp", work)
    return outcome.displacement[-1], outcome.reaction[-1, 0], mesh.node_sets["TOP"]


def probe_of(share):
    """Alike at all of its places."""
    return {f"indenter_probe.{place}": share for place in ("left", "left_half", "middle", "right_half", "right")}


def loose_by(share):
    """From both edges on, nearly all of the width."""
    return {
        f"indenter_debonding.{name}": value for name, value in (("left", share), ("right", share), ("extent", 0.95))
    }


@pytest.mark.parametrize(
    ("firm", "loose"),
    [
        ({"indenter_slip.share": 1e-5}, {"indenter_slip.share": 0.99}),
        ({"indenter_friction.share": 1e-5}, {"indenter_friction.share": 0.99}),
        (probe_of(1e-5), probe_of(0.99)),
        (loose_by(1e-5), loose_by(0.99)),
    ],
    ids=["slip", "friction", "probe", "debonding"],
)  # fmt: skip
def test_a_slipping_indenter_takes_the_body_along_as_far_as_it_holds_it(tmp_path, firm, loose):
    glued, _, top = moved_aside(tmp_path)
    assert glued[top, 0] == pytest.approx(np.full(len(top), -0.3))
    held, _, _ = moved_aside(tmp_path, **firm)
    assert held == pytest.approx(glued, abs=1e-3)  # tractions of 0.02 MPa and, at the singular edge, a few times that
    left, _, _ = moved_aside(tmp_path, **loose)
    assert np.abs(left[top, 0].mean()) < 0.1


@pytest.mark.parametrize("effect", ["slip", "friction"])
def test_springs_that_go_aside_with_the_indenter_give_its_force(tmp_path, effect):
    """Hardly slipping as much as one that is glued, and less the more it slips: all that the base holds."""
    _, glued, _ = moved_aside(tmp_path)
    forces = [moved_aside(tmp_path, **{f"indenter_{effect}.share": share})[1] for share in (1e-5, 0.6, 0.99)]
    assert forces[0] == pytest.approx(glued, rel=1e-4)
    assert abs(glued) > abs(forces[1]) > 3 * abs(forces[2])


@pytest.mark.parametrize("probe", [False, True], ids=["member", "probe"])
def test_an_indenter_that_moves_sideways_is_one_that_was_said_to(tmp_path, probe):
    """Of two equal steps the first has the whole displacement: the share is 1 at both."""
    name = "indenter_probe" if probe else "sideways"
    course = {} if probe else {"sideways.power": 0.5}
    _, force, _ = moved_aside(tmp_path)
    more, pushed, top = moved_aside(tmp_path, **{f"{name}.moved": 0.1}, **course)
    assert more[top, 0] == pytest.approx(np.full(len(top), -0.2))
    assert abs(pushed) < abs(force)
    back, none, _ = moved_aside(tmp_path, **{f"{name}.moved": 0.3}, **course)
    assert back[top, 0] == pytest.approx(np.zeros(len(top)), abs=1e-12)
    assert none == pytest.approx(0.0, abs=1e-6 * abs(force))


def test_check_tells_them(tmp_path):
    text = check_study(written(tmp_path), solve=False)
    assert "displacement_x mm" in text and "force_x N" in text and "-0.3" in text
    steps = "step,displacement,force\n1,400,10\n"
    assert "direction of the indenter 0.6, -0.8" in check_study(written(tmp_path, steps, boundary=OBLIQUE), solve=False)
