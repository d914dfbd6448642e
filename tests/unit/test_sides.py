"""Sides that the first picture shows elsewhere: read from simulations, explained by a state, told from another form."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_outline import HIGH, LOW, MESH, PIXEL, pictured, study_in
from test_outline import sides as formed

from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.form_or_state import elsewhere, refuted, strained
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.score_tests import Finding
from fingerfit.diagnosis.sides import Sides, begun, sides_of, worth_of_form
from fingerfit.diagnosis.verdict import Verdict
from fingerfit.fit.rounds import Asked
from fingerfit.forward.patches import Patches, Reader
from fingerfit.forward.predict import Predictor, since_first_picture
from fingerfit.model.catalogue import catalogue
from fingerfit.model.observation import Observation
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.solvers.contract import CONVERGED, Outcome

LOWER = 0.6
"""How far the upper side lies below where it is stated, mm."""


@pytest.fixture(scope="module")
def flattened(tmp_path_factory):
    """What was prepared of a body that its first picture shows flatter than it is stated, and its mesh."""
    study = study_in(tmp_path_factory.mktemp("flat"), pictured(formed(lower=LOWER)))
    mesh = make_mesh(study, MESH)
    return prepare(study, mesh, None, 1.0, 0.3), mesh


def pressed(mesh, depth):
    """Displacements of a body whose upper side is pressed evenly by a depth, mm."""
    share = (mesh.points[:, 1] - LOW[1]) / (HIGH - LOW)[1]
    return np.stack([np.zeros(len(share)), -depth * share], axis=1)


def pulled(mesh, far):
    """The same of one whose sides lie further out by a distance, mm."""
    share = 2 * (mesh.points[:, 0] - LOW[0]) / (HIGH - LOW)[0] - 1
    return np.stack([far * share, np.zeros(len(share))], axis=1)


def asked(name):
    return Asked({}, name, "mesh", "deck", "search")


def compared(flattened, states):
    """A model against such a picture, whose simulations have these states in it, by their names."""
    data, mesh = flattened
    problem = SimpleNamespace(
        meshes={"search": mesh},
        mesh_of=lambda _: "search",
        outcome=lambda one: SimpleNamespace(begun=states[one.sim]),
        seen=lambda values: Observation.of(catalogue().values(), values, mesh.body, ()),
    )
    test = SimpleNamespace(data=data, problem=problem, base=asked("base"), anchor=asked("base"))
    test.every = (test,)
    return test


def ranked(name, sim):
    effect = catalogue()[name]
    nothing = Finding(1.0, np.zeros(len(effect.parameters)), 1.0, 1.0)
    return Ranked(Candidate(effect, {}, (asked(sim),)), nothing, np.ones((10, 1)))


def test_a_state_goes_out_from_where_it_brings_the_sides_nearest(flattened):
    """0.3 mm for each newton: 2 N; a stretch cannot do it, and skin is no state before the first picture."""
    mesh, effects = flattened[1], catalogue()
    force, stretch = (effects[name].parameters[0].step for name in ("preload", "prestretch"))
    states = {"base": None, "preload": pressed(mesh, 0.3 * force), "prestretch": pulled(mesh, stretch), "skin": None}
    comparison = compared(flattened, states)
    effects = [ranked(name, name) for name in ("skin", "prestretch", "preload")]
    found = begun(comparison, [*effects, ranked("state_probe", "preload")])
    assert [one.candidate.effect.name for one in found] == ["preload", "prestretch"]
    upper = effects[2].candidate.effect.parameters[0].upper
    assert found[0].finding.size == pytest.approx([min(2.0, upper)], abs=PIXEL / 0.3)
    # a stretch leaves the upper side where it is; with 1.5 mm for each newton the preload brings it all the way
    comparison = compared(flattened, states | {"preload": pressed(mesh, 1.5 * force)})
    near = begun(comparison, effects, most=LOWER / 2)
    assert [one.candidate.effect.name for one in near] == ["preload"]


def test_pixels_of_another_size_go_out_from_where_they_bring_the_sides(flattened):
    """Seen in the picture alone: without a simulation, and without a state."""
    comparison = compared(flattened, {"base": None})
    effect = catalogue()["pixel_size"]
    nothing = Finding(1.0, np.zeros(2), 1.0, 1.0)
    (found,) = begun(comparison, [Ranked(Candidate(effect, {}, ()), nothing, np.ones((10, 2)))])
    assert found.finding.size == pytest.approx([0.0, -LOWER / (HIGH - LOW)[1]], abs=0.005)
    values = {"pixel_size.across": 0.0, "pixel_size.along": float(found.finding.size[1])}
    comparison.base = replace(comparison.base, values=values)
    assert sides_of(comparison).off == 0.0


@pytest.mark.parametrize(("depth", "left"), [(0.0, LOWER), (LOWER, 0.0), (0.3, LOWER - 0.3), (0.9, 0.3)])
def test_a_model_says_where_the_sides_are(flattened, depth, left):
    states = {"base": pressed(flattened[1], depth)}
    assert sides_of(compared(flattened, states)).off == pytest.approx(left, abs=PIXEL)


def test_sides_that_bulge_are_where_they_lie_then(tmp_path):
    """A side that bulges most near its lower end keeps its form in the picture, while its material sinks by a tenth.

    Read at the places of the material it would be 0.2 mm off.
    """
    depth, taper = 1.0, -0.9
    study = study_in(tmp_path, pictured(formed(taper=taper, bulge=0.8, lower=depth)))
    mesh = make_mesh(study, MESH)
    data = prepare(study, mesh, None, 1.0, 0.3)
    begin = pressed(mesh, depth)
    x, y = ((mesh.points + begin - LOW) / (HIGH - LOW)).T
    along = 2 * y - 1
    begin[:, 0] += x * 0.8 * (1 - along**2) - (1 - x) * taper * along
    assert sides_of(compared((data, mesh), {"base": begin})).off == 0.0


def test_solutions_are_read_where_the_first_picture_has_the_body(flattened):
    """Material at a place of the picture came from higher up, and moves as it does there."""
    data, mesh = flattened
    begin, more = pressed(mesh, LOWER), pulled(mesh, 0.2) + pressed(mesh, 0.5)
    zero = np.zeros((2, 2))
    whole = Outcome(CONVERGED, np.stack([begin, begin + more]), zero, zero)
    outcome = since_first_picture(whole, 1, elsewhere=True)
    patches = Patches.over(mesh, 4)
    value = Reader(data, mesh, patches).read(outcome)[: 3 * len(patches.centre)].reshape(-1, 3)
    inside = patches.centre[:, 1] < 8.0
    height = (HIGH - LOW)[1]
    share = (patches.centre[inside, 1] - LOW[1]) / height
    expected = -0.5 * share / (1 - LOWER / height)
    assert value[inside, 1] == pytest.approx(expected, abs=1e-9)
    stated = since_first_picture(whole, 1)
    assert stated.begun is None
    assert Reader(data, mesh, patches).read(stated)[: 3 * len(patches.centre)].reshape(-1, 3)[
        inside, 1
    ] == pytest.approx(-0.5 * share, abs=1e-9)
    (way,) = Predictor(data, mesh).maps(
        since_first_picture(Outcome(CONVERGED, np.stack([begin, begin]), zero, zero), 1, True)
    )
    assert way.index.max(axis=0)[1] * PIXEL - 1.0 == pytest.approx(HIGH[1] - LOWER, abs=2 * PIXEL)


def refit(misfit, off=0.0, away=0.0):
    return Refit(misfit, 1000, 1.0, None, {}, numbers=1, sides=Sides(off, away))


WORTH = 80.0
"""Misfit that another form must explain to be worth its numbers."""
FORM = 1200.0 - WORTH
"""Misfit of another form that leaves 1200 with what its numbers are worth."""


@pytest.mark.parametrize(
    ("states", "named"),
    [
        ([], ("outline",)),
        ([refit(1000.0, off=0.3)], ("outline",)),
        ([refit(2000.0)], ("outline",)),
        ([refit(1000.0)], ("preload",)),
        ([refit(1195.0)], ("preload", "outline")),
        ([refit(1205.0)], ("outline", "preload")),
        ([refit(1000.0, off=0.1, away=195.0)], ("preload", "outline")),
        ([refit(1230.0)], ("outline",)),
        ([refit(1000.0, off=0.3), refit(1010.0)], ("preload",)),
    ],
    ids=["none", "sides elsewhere", "unexplained", "better", "alike", "form alike", "sides alike", "worse", "second"],
)
def test_another_form_or_a_state(states, named):
    """Those that cannot be told apart are named together, the likelier one first."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    form = refit(FORM)
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), form, [(ranked("preload", "preload"), one) for one in states])
    assert found.effects == named
    assert found.kind == ("missing" if len(named) == 1 else "indistinguishable")
    assert "0.6 mm" in found.sentence
    assert found.family == ("state" if named[0] == "preload" else "geometry")


@pytest.mark.parametrize(("worth", "named"), [(35.0, ("preload", "outline")), (25.0, ("outline", "preload"))])
@pytest.mark.parametrize("more", [-40.0, 40.0])
def test_what_patches_make_by_chance_does_not_say_which_of_both_comes_first(more, worth, named):
    """900 values, of which the state has 100 more: chance makes up to 3 (2 x 100)^1/2. It leaves 30 of the sides."""
    given = Verdict("missing", ("skin",), "missing: skin", 30.0, "structure")
    form, state = replace(refit(900.0 + more), freedom=900), refit(1000.0, off=0.1, away=30.0)
    assert elsewhere(given, Sides(LOWER, 500.0, worth), form, [(ranked("preload", "preload"), state)]).effects == named


def test_what_another_form_is_worth_against_sides_integrated_over_their_coefficients():
    """One side with two coefficients: none, the first one, or both are there."""
    away, size, fine = np.array([2.5, -0.4]), 4.0, np.linspace(-30.0, 30.0, 6001)
    density = np.exp(-0.5 * (fine / size) ** 2) / size / np.sqrt(2.0 * np.pi)
    there = [np.sum(density * np.exp(-0.5 * (one - fine) ** 2)) * (fine[1] - fine[0]) for one in away]
    absent = np.exp(-0.5 * away**2)
    found = 0.5 * absent.prod() + 0.25 * there[0] * absent[1] + 0.25 * there[0] * there[1]
    assert worth_of_form(away[None], np.array([size])) == pytest.approx(-2.0 * np.log(found))
    unseen = np.array([away, [np.nan, np.nan]])
    assert worth_of_form(unseen, np.array([size, size])) == pytest.approx(-2.0 * np.log(found))


@pytest.mark.parametrize(
    ("errors", "named"), [((0.96, 0.95), ("prestretch", "preload")), ((0.96, 0.99), ("preload",))], ids=["both", "one"]
)
def test_a_state_that_is_nearer_in_the_pictures_is_named_beside_the_one_that_patches_prefer(errors, named):
    """In those that were fitted and in those that were not."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    best, other = replace(refit(1000.0), held_out=1.0), replace(refit(1090.0), fitted=errors[0], held_out=errors[1])
    states = [(ranked("preload", "preload"), best), (ranked("prestretch", "prestretch"), other)]
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(2000.0), states)
    assert (found.effects, found.family) == (named, "state")
    assert found.kind == ("missing" if len(named) == 1 else "indistinguishable")
    assert "0.6 mm" in found.sentence


@pytest.mark.parametrize(
    ("misfit", "error", "away", "form", "named"),
    [
        (1500.0, 2.1, 40.0, 2200.0, "lens"),
        (1500.0, 2.5, 40.0, 2200.0, "outline"),  # no nearer in the pictures
        (1800.0, 2.1, 40.0, 2200.0, "outline"),  # less than half of what is beyond the noise, 1400
        (1500.0, 2.1, 600.0, 2200.0, "outline"),  # it leaves more of the sides
        (1500.0, 2.1, 40.0, 1400.0, "outline"),  # another form leaves no more
    ],
)
def test_where_neither_a_state_nor_another_form_explains_the_data_the_likelier_is_the_largest_part(
    misfit, error, away, form, named
):
    """A body of linear elements seen through a lens: what both leave is the error of the mesh."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    stated = SimpleNamespace(misfit=2400.0, freedom=1000, common_misfit=0.0, common_freedom=0)
    one = replace(refit(misfit, off=0.1, away=away), fitted=error, held_out=error)
    other = replace(refit(form), fitted=2.5, held_out=2.5)
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), other, [(ranked("lens", "lens"), one)], stated=stated)
    assert found.effects == (named,)
    assert ("more is missing" in found.sentence) == (named == "lens")
    assert found.family == {"lens": "observation", "outline": "geometry"}[named]


@pytest.mark.parametrize(("misfit", "named"), [(1008.0, ("preload", "prestretch")), (1012.0, ("preload",))])
def test_states_that_explain_as_much_are_named_together(misfit, named):
    """As much: by less than the threshold, 10 here; the one that explains most comes first."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    states = [(ranked("preload", "preload"), refit(1000.0)), (ranked("prestretch", "prestretch"), refit(misfit))]
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(2000.0), states)
    assert found.effects == named


@pytest.mark.parametrize(("away", "named"), [(4.0, ("preload", "prestretch")), (300.0, ("preload",))])
def test_a_state_that_is_as_likely_with_the_sides_it_leaves_is_not_excluded(away, named):
    """It leaves half of how far they are off: how surely, says the misfit of the sides."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    other = refit(1000.0, off=LOWER / 2, away=away)
    states = [(ranked("prestretch", "prestretch"), other), (ranked("preload", "preload"), refit(1000.0))]
    assert elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(2000.0), states).effects == named
    # alone it leaves too much to count
    assert elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(1100.0), states[:1]).effects == ("outline",)


@pytest.mark.parametrize(
    ("errors", "named"),
    [((0.97, 0.96), ("preload", "outline")), ((0.97, 0.99), ("outline",)), ((1.0, 1.0), ("outline",))],
    ids=["nearer", "on fitted steps only", "no nearer"],
)
def test_a_state_that_is_nearer_in_the_pictures_than_another_form_comes_first(errors, named):
    """Patches prefer the other form: of a stretch before gluing, say, which is modelled to first order."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    state = replace(refit(1230.0), fitted=errors[0], held_out=errors[1])
    form = replace(refit(FORM), held_out=1.0)
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), form, [(ranked("preload", "preload"), state)])
    assert found.effects == named


@pytest.mark.parametrize(("away", "named"), [(450.0, ("preload",)), (550.0, ("outline",))], ids=["nearer", "no nearer"])
def test_where_another_form_explains_nothing_a_state_may_leave_the_sides_far_off(away, named):
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    states = [(ranked("preload", "preload"), refit(1000.0, 0.3, away))]
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(2000.0), states)
    assert found.effects == named
    assert ("0.3 mm from where this model has it" in found.sentence) == (named == ("preload",))


@pytest.mark.parametrize(("misfit", "named"), [(1000.0, ("outline",)), (1100.0, ("preload",))], ids=["as much", "less"])
def test_a_state_that_explains_no_more_than_the_model_without_it_is_none(misfit, named):
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    states = [(ranked("preload", "preload"), refit(1000.0, LOWER, 490.0))]
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(2000.0), states, None, refit(misfit))
    assert found.effects == named


@pytest.mark.parametrize(
    ("own", "named"),
    [(refit(600.0, 0.3, 250.0), ("skin",)), (refit(900.0, 0.3, 250.0), ("preload",)), (refit(2000.0), ("preload",))],
    ids=["surely more", "no more", "unexplained"],
)
def test_what_surely_explains_more_than_a_state_comes_first(own, named):
    """What the sides are off by counts for it, too."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    found = elsewhere(
        given, Sides(LOWER, 500.0, WORTH), refit(FORM), [(ranked("preload", "preload"), refit(1000.0))], own
    )
    assert found.effects == named
    assert "0.6 mm" in found.sentence


@pytest.mark.parametrize(
    ("state", "named"),
    [
        (refit(600.0, 0.3, 100.0), ("preload",)),
        (refit(750.0, 0.3, 95.0), ("preload", "skin")),
        (refit(750.0, 0.3, 105.0), ("skin", "preload")),
        (refit(900.0, 0.3, 100.0), ("skin",)),
    ],
    ids=["surely likelier", "likelier", "as likely", "less likely"],
)
def test_a_state_that_leaves_some_of_the_sides_counts_where_another_form_is_out(state, named):
    """The other form leaves 200, the skin -150: a state is judged against that, with what it leaves of the sides."""
    given = Verdict("missing", ("skin",), "missing: skin", 10.0, "structure")
    states, own, titles = [(ranked("preload", "preload"), state)], refit(600.0, 0.6, 250.0), {"skin": "skin"}
    found = elsewhere(given, Sides(LOWER, 500.0, WORTH), refit(FORM), states, own, titles=titles)
    assert found.effects == named
    assert found.kind == ("missing" if len(named) == 1 else "indistinguishable")
    assert found.family == ("state" if named[0] == "preload" else "structure")
    assert ("0.3 mm from where this model has it" in found.sentence) == (named == ("preload",))
    assert "0.6 mm" in found.sentence
    also = replace(given, effects=("skin", "preload"))
    found = elsewhere(
        also,
        Sides(LOWER, 500.0, WORTH),
        refit(FORM),
        states,
        own,
        titles={**titles, "preload": catalogue()["preload"].title},
    )
    assert sorted(found.effects) == sorted({*named, *also.effects} if "skin" in named else named)


@pytest.mark.parametrize(
    ("shown", "stated", "so"), [(5000.0, 1000.0, True), (5000.0, 9000.0, False), (1100.0, 1000.0, False)]
)
def test_a_shape_that_explains_less_than_the_stated_one_was_no_shape_at_rest(shown, stated, so):
    assert refuted(refit(shown), refit(stated)) is so


@pytest.mark.parametrize(
    ("misfit", "kind", "named"), [(1000.0, "missing", ("state_probe",)), (2000.0, "unexplained", ())]
)
def test_a_body_that_was_strained_in_no_known_way(misfit, kind, named):
    given = Verdict("missing", ("outline",), "missing: sides", 10.0, "geometry")
    found = strained(given, Sides(LOWER, 500.0, WORTH), (ranked("state_probe", "preload"), refit(misfit)))
    assert (found.kind, found.effects, found.family) == (kind, named, "state")
    assert "0.6 mm" in found.sentence
    assert strained(given, Sides(LOWER, 500.0, WORTH), None).kind == "unexplained"
