"""Each of the four answers, from residuals and refits that are made for it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import chdtri
from scipy.stats import binom, chi2, norm
from seeds import generator

from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.effect_form import NO_FORM, Form
from fingerfit.diagnosis.evidence import Information
from fingerfit.diagnosis.ranking import Ranked, alike, confusions, summary
from fingerfit.diagnosis.refit import EXPLAINED, LEVEL, Refit, excess, explains
from fingerfit.diagnosis.reservations import by_settings, doubted, loud_by_mesh, perhaps, too_coarse
from fingerfit.diagnosis.score_tests import Finding, ScoreTest
from fingerfit.diagnosis.traces import small_part, traced
from fingerfit.diagnosis.verdict import RIVAL, Verdict, decide, half_explained, misses
from fingerfit.diagnosis.worth import TRIED, threshold, to_refit
from fingerfit.model.catalogue import catalogue
from fingerfit.settings.finer import HALVED

EFFECTS = catalogue()
VALUES, OWN, TESTS = 300, 3, 20
WIDE = np.array([np.inf])


class World:
    """Orthonormal signals of unit noise: the first belong to the model, each of the others to an effect."""

    def __init__(self, seed=4, size=VALUES):
        rng = generator(seed)
        self.size = size
        self.basis = np.linalg.qr(rng.normal(size=(size, size)))[0]
        # noise of exactly the expected size that no single effect explains
        self.noise = self.basis[:, OWN + 20 :] @ np.ones(size - OWN - 20)
        self.noise *= np.sqrt(size - OWN) / np.linalg.norm(self.noise)

    def signal(self, n):
        return self.basis[:, OWN + n]

    def score_test(self, residual):
        return ScoreTest(residual + self.noise, np.eye(self.size), self.basis[:, :OWN], np.zeros((self.size, 1)))

    def ranking(self, score_test, **columns):
        found = []
        for name, column in columns.items():
            column = np.atleast_2d(column.T).T
            wide = np.full(column.shape[1], np.inf)
            found.append(Ranked(Candidate(EFFECTS[name], {}), score_test.test(column, -wide, wide), column))
        return sorted(found, key=lambda one: -one.finding.fall)

    def refits(self, score_test, ranking, **misfits):
        """Refits as good as predicted, or with misfits of their own."""
        return {
            one.candidate.effect.name: Refit(
                misfits.get(one.candidate.effect.name, score_test.misfit - one.finding.fall),
                score_test.freedom - 1,
                1.0,
                1.0,
                {},
            )
            for one in to_refit(score_test, ranking, TESTS)
        }


@pytest.fixture
def world():
    return World()


def answer(world, residual, refits=None, **columns):
    score_test = world.score_test(residual)
    ranking = world.ranking(score_test, **columns)
    return decide(score_test, ranking, world.refits(score_test, ranking) if refits is None else refits, TESTS)


def test_noise_alone_is_adequate(world):
    found = answer(world, 0 * world.signal(0), tilt=world.signal(0), inclusion=world.signal(1))
    assert (found.kind, found.effects) == ("adequate", ())
    assert "to within their noise" in found.sentence


def test_adequate_says_what_these_data_would_not_show(world):
    """An effect that moves everything as a constant of the model does, but for a hundredth of its signal."""
    gain = 0.995 * world.basis[:, 0] + 0.1 * world.signal(2)
    found = answer(world, 0 * gain, tilt=world.signal(0), force_gain=gain)
    assert found.kind == "adequate"
    assert found.sentence.endswith("within their noise; these data would not show: wrong gain of the force sensor")


def test_one_effect_is_missing(world):
    found = answer(world, 30 * world.signal(0), tilt=world.signal(0), inclusion=world.signal(1), skin=world.signal(2))
    assert (found.kind, found.effects) == ("missing", ("tilt",))
    assert found.sentence == "missing: tilt of the indenter; it explains 100 % of the misfit beyond the noise"


def test_the_share_is_that_of_the_refit(world):
    residual = 30 * world.signal(0)
    score_test = world.score_test(residual)
    ranking = world.ranking(score_test, tilt=world.signal(0))
    refits = world.refits(score_test, ranking, tilt=score_test.misfit - 0.9 * (score_test.misfit - score_test.freedom))
    found = decide(score_test, ranking, refits, TESTS)
    assert found.kind == "missing"
    assert "explains 90 % of the misfit" in found.sentence


def test_what_the_refit_says_goes_before_the_first_look(world):
    """The effect that is ranked second is the better one once both are fitted."""
    between = 0.85 * world.signal(0) + np.sqrt(1 - 0.85**2) * world.signal(1)
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=between)
    assert [one.candidate.effect.name for one in ranking] == ["tilt", "inclusion"]
    refits = world.refits(score_test, ranking, tilt=score_test.freedom + 200.0, inclusion=score_test.freedom + 5.0)
    assert decide(score_test, ranking, refits, TESTS).effects == ("inclusion",)


def test_two_that_fit_as_well_are_indistinguishable(world):
    near = 0.9999 * world.signal(0) + np.sqrt(1 - 0.9999**2) * world.signal(1)
    found = answer(world, 30 * world.signal(0), tilt=world.signal(0), inclusion=near)
    assert found.kind == "indistinguishable"
    assert found.effects == ("tilt", "inclusion")
    assert "tilt of the indenter or inclusion in the plane; these data cannot tell them apart" in found.sentence


@pytest.mark.parametrize(("apart", "kind"), [(15.0, "indistinguishable"), (17.0, "missing")])
def test_odds_of_400_to_1_decide(world, apart, kind):
    """Twelve, scaled by the misfit that is left: refits that are not adequate themselves."""
    score_test = world.score_test(30 * world.signal(0))
    near = 0.9 * world.signal(0) + np.sqrt(1 - 0.9**2) * world.signal(1)
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=near)
    rest = 1.3 * score_test.freedom
    found = decide(score_test, ranking, world.refits(score_test, ranking, tilt=rest, inclusion=rest + apart), TESTS)
    assert found.kind == kind


@pytest.mark.parametrize(("share", "kind"), [(0.04, "indistinguishable"), (0.06, "missing")])
def test_what_an_error_of_the_mesh_may_decide_does_not_tell_two_adequate_refits_apart(world, share, kind):
    score_test = world.score_test(30 * world.signal(0))
    near = 0.9 * world.signal(0) + np.sqrt(1 - 0.9**2) * world.signal(1)
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=near)
    rest = score_test.freedom - 1.0
    worse = rest + share * score_test.freedom
    found = decide(score_test, ranking, world.refits(score_test, ranking, tilt=rest, inclusion=worse), TESTS)
    assert found.kind == kind


@pytest.mark.parametrize(
    ("numbers", "fitted", "held_out", "names"),
    [
        (2, 1.05, 1.06, ("skin", "tilt")),
        (6, 1.05, 1.06, ("tilt",)),  # with as many numbers the misfit decides
        (2, 1.05, 1.10, ("tilt",)),  # nearer on the fitted steps alone
        (2, 1.09, 1.09, ("tilt",)),  # by less than chance may make of it
    ],
)
def test_fewer_numbers_that_are_nearer_in_the_pictures_are_named_first(world, numbers, fitted, held_out, names):
    score_test = world.score_test(40 * (world.signal(0) + world.signal(1)))
    ranking = world.ranking(score_test, tilt=world.signal(0), skin=world.signal(1))
    many = Refit(1.0 * VALUES, VALUES, 1.1, 1.1, {}, numbers=6)
    few = replace(many, misfit=1.2 * VALUES, fitted=fitted, held_out=held_out, numbers=numbers)
    verdict = decide(score_test, ranking, {"tilt": many, "skin": few}, TESTS)
    assert verdict.effects == names
    assert verdict.kind == ("missing" if len(names) == 1 else "indistinguishable")


@pytest.mark.parametrize(("choices", "first"), [(1, "tilt"), (4, "tilt"), (5, "skin")])
def test_a_place_that_was_chosen_from_many_has_to_earn_it(world, choices, first):
    """Of five places each was as likely before: odds of exp(1.5), which is 4.5, are not enough for the best of them."""
    score_test = world.score_test(40 * (world.signal(0) + world.signal(1)))
    ranking = world.ranking(score_test, tilt=world.signal(0), skin=world.signal(1))
    number = Information(np.array([[900.0]]), np.array([0.1]), np.array([True]))
    chosen = Refit(VALUES, VALUES, 1.0, 1.0, {}, numbers=1, worth=number.worth(1.0, choices))
    plain = Refit(VALUES + 3.0, VALUES, 1.0, 1.0, {}, numbers=1, worth=number.worth(1.0))
    verdict = decide(score_test, ranking, {"tilt": chosen, "skin": plain}, TESTS)
    assert verdict.effects == (first, {"tilt": "skin", "skin": "tilt"}[first])


@pytest.mark.parametrize(
    ("other", "changed", "names"),
    [
        ("skin", {}, ("inclusion", "skin")),
        ("tilt", {}, ("inclusion",)),  # of another family
        ("skin", {"fitted": 1.06}, ("inclusion",)),  # a pixel can tell
        ("skin", {"held_out": 1.06}, ("inclusion",)),
        ("skin", {"misfit": 1.23 * VALUES}, ("inclusion",)),  # explains less than nine tenths
        ("skin", {"common_misfit": 13.0, "common_freedom": 9}, ("inclusion",)),  # the forces can tell
        ("skin", {"common_misfit": 11.0, "common_freedom": 9}, ("inclusion", "skin")),
    ],
)
def test_forms_of_one_family_that_no_pixel_tells_apart_are_named_together(world, other, changed, names):
    score_test = world.score_test(25 * world.signal(0))
    ranking = world.ranking(score_test, **{"inclusion": world.signal(0), other: world.signal(1)})
    best = Refit(1.0 * VALUES, VALUES, 1.0, 1.0, {}, numbers=1)
    assert 0.1 * VALUES > RIVAL  # so far behind that their odds would tell them apart
    second = replace(best, **{"misfit": 1.1 * VALUES, "fitted": 1.04, "held_out": 1.04, **changed})
    verdict = decide(score_test, ranking, {"inclusion": best, other: second}, TESTS)
    assert verdict.effects == names


@pytest.mark.parametrize(
    ("left", "fitted", "common", "names"),
    [
        (3.0, 2.09, 0.0, ("inclusion", "skin")),
        (3.0, 2.09, 19.0, ("inclusion", "skin")),
        (3.0, 2.09, 21.0, ("inclusion",)),  # of the forces, by more than a tenth of what the best one leaves of them
        (3.0, 2.11, 0.0, ("inclusion",)),  # by more than a twentieth of what it leaves in the pictures
        (1.2, 2.09, 0.0, ("inclusion",)),  # what explains the data is not mistaken for what does not
    ],
)
def test_forms_of_one_family_are_not_told_apart_by_a_part_of_what_both_leave(world, left, fitted, common, names):
    score_test = world.score_test(60 * world.signal(0))
    ranking = world.ranking(score_test, inclusion=world.signal(0), skin=world.signal(1))
    best = Refit(left * VALUES, VALUES, 2.0, 2.0, {}, 200.0 if left > 2.0 else 0.0, 0, numbers=1)
    changed = {"misfit": best.misfit + 0.5 * VALUES, "common_misfit": best.common_misfit + common}
    second = replace(best, fitted=fitted, **changed)
    assert best.gain(score_test.misfit) * 0.9 < second.gain(score_test.misfit)
    verdict = decide(score_test, ranking, {"inclusion": best, "skin": second}, TESTS)
    assert verdict.effects == names


@pytest.mark.parametrize(
    ("titles", "said"),
    [
        ([], "so it is; a trace: skin"),
        (["skin"], "so it is; a trace: skin"),
        (["skin", "tilt"], "so it is; a trace: skin; not excluded: tilt"),
        (
            ["tilt", "skin", "wall", "bed", "lens"],
            "so it is; a trace: skin; not excluded: tilt or wall or bed or 1 more",
        ),
    ],
)
def test_a_verdict_names_what_it_does_not_exclude(titles, said):
    assert perhaps(Verdict("adequate", (), "so it is; a trace: skin", 0.0), titles).sentence == said


@pytest.mark.parametrize(("error", "at_least", "told"), [(1.6, 1.2, True), (1.2, 1.1, False), (1.6, 1.3, False)])
def test_a_mesh_that_makes_the_pictures_differ_is_to_be_finer(error, at_least, told):
    verdict = Verdict("adequate", (), "so it is", 0.0)
    found = loud_by_mesh(verdict, error, at_least, EFFECTS["coarse_mesh"])
    made = (
        "; the pictures differ by 1.6 times the noise, by 1.2 without what the mesh makes of them; take a finer model."
    )
    assert found.sentence.startswith("so it is" + made * told)
    assert (found is verdict) is not told
    assert (found.kind, found.numerics) == ("adequate", "coarse_mesh" if told else "")
    missing = replace(verdict, kind="missing")
    assert loud_by_mesh(missing, error, at_least, EFFECTS["coarse_mesh"]) is missing
    # what is of no known form may be the mesh's: the answer is a finer one first
    found = loud_by_mesh(missing, error, at_least, EFFECTS["coarse_mesh"], set_aside=True)
    assert (found is missing) is not told
    if told:
        assert (found.kind, found.effects, found.family, found.numerics) == (
            "unexplained",
            (),
            "numerics",
            "coarse_mesh",
        )
        assert found.sentence.startswith("the mesh is too coarse: the pictures differ by 1.6 times the noise, by 1.2 ")


def test_nothing_known_explains_it(world):
    found = answer(world, 40 * world.signal(5), tilt=world.signal(0), inclusion=world.signal(1))
    assert (found.kind, found.effects) == ("unexplained", ())
    assert "no known effect explains the misfit beyond the noise" in found.sentence


def test_little_of_it_is_explained(world):
    residual = 40 * world.signal(5) + 25 * world.signal(0)
    found = answer(world, residual, tilt=world.signal(0), inclusion=world.signal(1))
    assert (found.kind, found.effects) == ("unexplained", ())
    share = 25**2 / (40**2 + 25**2)
    assert (
        f"tilt of the indenter comes nearest but explains only {100 * share:.0f} % of the misfit beyond the noise"
        in found.sentence
    )


def test_two_effects_together(world):
    """The larger of two is named first although alone it explains too little: with the other it explains all."""
    residual = 30 * world.signal(0) + 25 * world.signal(1)
    score_test = world.score_test(residual)
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=world.signal(1), skin=world.signal(2))
    refits = world.refits(score_test, ranking)
    half = half_explained(score_test, ranking, refits, TESTS)
    assert half is ranking[0]
    both = Refit(
        score_test.misfit - ranking[0].finding.fall - ranking[1].finding.fall, score_test.freedom - 2, 1.0, 1.0, {}
    )
    found = decide(score_test, ranking, refits, TESTS, (ranking[1], both))
    assert (found.kind, found.effects) == ("missing", ("tilt",))
    assert (
        f"with inclusion in the plane it explains the misfit beyond the noise, alone {100 * 900 / 1525:.0f} %"
        in found.sentence
    )
    # after it was added the other one is missing
    second = answer(world, 25 * world.signal(1), inclusion=world.signal(1), skin=world.signal(2))
    assert (second.kind, second.effects) == ("missing", ("inclusion",))


def test_a_pair_that_does_not_explain_it_when_fitted_names_nothing(world):
    """However much a pair is predicted to explain: the refit decides."""
    score_test = world.score_test(30 * world.signal(0) + 25 * world.signal(1))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=world.signal(1))
    refits = world.refits(score_test, ranking)
    both = Refit(1.4 * score_test.freedom, score_test.freedom - 2, 1.0, 1.0, {})
    for partner in (None, (ranking[1], both)):
        found = decide(score_test, ranking, refits, TESTS, partner)
        assert (found.kind, found.effects) == ("unexplained", ())
        assert (
            "tilt of the indenter comes nearest but explains only 59 % of the misfit beyond the noise" in found.sentence
        )


def test_with_a_partner_what_a_probe_imitates_is_named(world):
    """Alone it explains enough to need none; it is asked for one where a probe is likelier."""
    score_test = world.score_test(30 * world.signal(0) + 14 * world.signal(1))
    ranking = world.ranking(score_test, inclusion=world.signal(0), ellipse=world.signal(1))
    alone = {"inclusion": world.refits(score_test, ranking)["inclusion"]}
    assert not explains(alone["inclusion"]) and half_explained(score_test, ranking, alone, TESTS) is None
    both = Refit(score_test.freedom, score_test.freedom - 2, 1.0, 1.0, {})
    found = decide(score_test, ranking, alone, TESTS, (ranking[1], both))
    assert (found.kind, found.effects) == ("missing", ("inclusion",))
    assert "with inclusion of any size and shape it explains the misfit beyond the noise, alone" in found.sentence


def test_what_explains_enough_alone_needs_no_partner(world):
    score_test = world.score_test(30 * world.signal(0) + 8 * world.signal(1))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=world.signal(1))
    assert half_explained(score_test, ranking, world.refits(score_test, ranking), TESTS) is None
    assert half_explained(score_test, ranking, {}, TESTS) is None


STEPS = 7
"""Of which each has one common mode."""


def stepwise(far, size=2000):
    """A score_test of many values, one mode of each step among them, of which the last one is `far` off."""
    rng = generator(3)
    basis = np.linalg.qr(rng.normal(size=(size, OWN + STEPS + 1)))[0]
    own, modes = basis[:, :OWN], basis[:, OWN:-1]
    noise = rng.normal(size=size)
    noise -= modes @ (modes.T @ noise)
    noise *= np.sqrt(size - OWN - STEPS) / np.linalg.norm(noise)
    residual = noise + modes @ np.array([1.0] * (STEPS - 1) + [far])
    return ScoreTest(residual, np.eye(size), own, np.zeros((size, 1)), modes)


def test_a_step_that_is_far_off_is_not_drowned_by_thousands_of_values():
    near, far = stepwise(1.0), stepwise(8.0)
    assert decide(near, [], {}, TESTS).kind == "adequate"
    assert far.misfit / far.freedom < 1.05
    assert decide(far, [], {}, TESTS).kind == "unexplained"


def test_what_steps_have_in_common_may_differ_by_as_much_as_the_other_values():
    """An error of the mesh that the whole misfit allows is allowed in what steps have in common."""
    limit = chdtri(STEPS, LEVEL)
    alone = Refit(2000.0, 2000, 1.0, 1.0, {}, common_misfit=1.1 * limit, common_freedom=STEPS)
    assert not explains(alone)
    assert explains(replace(alone, misfit=1.2 * 2000.0))
    assert not explains(replace(alone, misfit=1.2 * 2000.0, common_misfit=1.3 * limit))
    assert not explains(replace(alone, misfit=1.3 * 2000.0))


def test_a_refit_that_leaves_a_step_far_off_is_no_rival():
    """Two refits that differ by what an error of the mesh may decide, of which one leaves a common mode."""
    wider = World(size=1000)
    score_test = wider.score_test(30 * wider.signal(0))
    near = 0.9 * wider.signal(0) + np.sqrt(1 - 0.9**2) * wider.signal(1)
    ranking = wider.ranking(score_test, tilt=wider.signal(0), inclusion=near)
    rest = score_test.freedom - 1.0
    refits = wider.refits(score_test, ranking, tilt=rest, inclusion=rest + 20.0)
    assert decide(score_test, ranking, refits, TESTS).kind == "indistinguishable"
    refits["inclusion"] = replace(refits["inclusion"], common_misfit=30.0, common_freedom=7)
    assert decide(score_test, ranking, refits, TESTS).kind == "missing"


def test_a_refit_that_does_not_keep_the_promise(world):
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0))
    found = decide(score_test, ranking, world.refits(score_test, ranking, tilt=score_test.misfit - 1.0), TESTS)
    assert (found.kind, found.effects) == ("unexplained", ())
    # where the model was good already nothing is missing
    score_test = world.score_test(5 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0))
    refits = world.refits(score_test, ranking, tilt=score_test.misfit - 1.0)
    assert set(refits) == {"tilt"}
    assert decide(score_test, ranking, refits, TESTS).kind == "adequate"
    # one that has missed its minimum, and so does not count, says nothing against that; untried it would
    assert decide(score_test, ranking, {}, TESTS).kind == "unexplained"
    found = decide(score_test, ranking, {}, TESTS, missed={"tilt"})
    assert found.kind == "adequate"
    assert "no minimum was found with tilt of the indenter" in found.sentence


def test_effects_worth_a_refit(world):
    residual = sum(size * world.signal(n) for n, size in enumerate((30, 28, 26, 24, 10)))
    score_test = world.score_test(residual)
    names = ("tilt", "inclusion", "skin", "gradient", "onset")
    ranking = world.ranking(score_test, **{name: world.signal(n) for n, name in enumerate(names)})
    assert [one.candidate.effect.name for one in to_refit(score_test, ranking, TESTS)] == list(names[:TRIED])
    # too small beside the first one; and what the data do not see is never named
    ranking = [ranking[0], ranking[-1]]
    assert to_refit(score_test, ranking, TESTS) == ranking[:1]
    blind = [replace(ranking[0], finding=replace(ranking[0].finding, visible=0.01))]
    assert to_refit(score_test, blind, TESTS) == []


def test_all_members_of_a_family_that_are_as_likely_are_refitted(world):
    """Of another family, or far less likely, no more than a few."""
    score_test = world.score_test(10 * world.signal(0))
    alike = {name: world.signal(0) for name in ("relaxation", "force_offset", "ageing", "onset", "guide_friction")}
    less = np.sqrt(0.5) * (world.signal(0) + world.signal(1))
    ranking = world.ranking(score_test, **alike, soft_frame=less, tilt=world.signal(0))
    chosen = {one.candidate.effect.name for one in to_refit(score_test, ranking, TESTS)}
    of_loading = {name for name in alike if EFFECTS[name].family == "loading"}
    assert len(of_loading) > TRIED
    assert of_loading <= chosen
    assert "soft_frame" not in chosen


def test_the_threshold_is_that_of_chance(world, rng):
    score_test = world.score_test(0 * world.signal(0))
    limit = threshold(score_test, [], TESTS)
    assert limit == pytest.approx(chi2.isf(LEVEL / TESTS, 1), rel=1e-9)
    assert threshold(score_test, [], 10 * TESTS) > limit
    assert threshold(score_test, [], TESTS, columns=2) == pytest.approx(chi2.isf(LEVEL / TESTS, 2), rel=1e-9)
    # a model that fits badly even with its best effect has to be convinced with more
    score_test = world.score_test(40 * world.signal(5))
    assert threshold(score_test, [], TESTS) == pytest.approx(limit * score_test.misfit / score_test.freedom, rel=1e-9)


def test_alarms_by_chance_are_rare(world, rng):
    """Noise only, 20 effects each: as often as `LEVEL` says, and much more often if one test were all that was made."""
    own, signals = world.basis[:, :OWN], world.basis[:, OWN : OWN + TESTS]
    models, rare, often = 400, 0, 0

    def named(residual, *tests):
        score_test = ScoreTest(residual, np.eye(VALUES), own, np.zeros((VALUES, 1)))
        tested = [score_test.test(signals[:, [n]], -WIDE, WIDE) for n in range(TESTS)]
        ranking = [Ranked(Candidate(EFFECTS["tilt"], {}), finding, signals[:, [n]]) for n, finding in enumerate(tested)]
        ranking.sort(key=lambda one: -one.finding.fall)
        return [bool(to_refit(score_test, ranking, number)) for number in tests]

    for _ in range(models):
        noise = rng.normal(size=VALUES)
        corrected, single = named(noise, TESTS, 1)
        rare, often = rare + corrected, often + single
        # 10 standard deviations of noise: the limit is at 3.5, and noise takes away 6 once in a thousand million
        assert named(noise + 10 * signals[:, 0], TESTS) == [True]
    # Bounds that a seed exceeds once in a million. Falls are independent chi squared of one degree of freedom, since the
    # signals are orthonormal. A misfit above its expectation raises the limit, in 84 of 100 by its deviation or less.
    spread = 1 + np.sqrt(2 / (VALUES - OWN))
    alone = chi2.sf(chi2.isf(LEVEL, 1) * spread, 1)
    assert rare <= binom.isf(1e-6, models, LEVEL)
    assert often >= binom.ppf(1e-6, models, norm.cdf(1) * (1 - (1 - alone) ** TESTS))
    assert often <= binom.isf(1e-6, models, 1 - (1 - LEVEL) ** TESTS)


def test_no_model_is_adequate_whose_pictures_differ_by_much_more_than_their_noise(world):
    found = answer(world, 0 * world.signal(0), tilt=world.signal(0))
    for held_out in (None, 0.9, 1.2):
        assert doubted(found, 1.2, held_out, 1000) is found
        assert doubted(found, 1.8, held_out, 1000).kind == "unexplained"
        assert "1.8 times the noise level, but" in doubted(found, 1.8, held_out, 1000).sentence
    assert doubted(found, 1.2, 1.4, 1000).kind == "unexplained"
    assert "1.4 times the noise level on held-out steps, but" in doubted(found, 1.2, 1.4, 1000).sentence
    assert doubted(found, 1.4, None, 5) is found  # chance alone leaves as much of so few values
    missing = answer(world, 30 * world.signal(0), tilt=world.signal(0))
    assert doubted(missing, 5.0, 5.0, 1000) is missing


def test_the_next_best_are_refitted_after_the_best(world):
    score_test = world.score_test(30 * world.signal(0) + 12 * world.signal(1) + 11 * world.signal(2))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=world.signal(1), skin=world.signal(2))
    assert [one.candidate.effect.name for one in to_refit(score_test, ranking, TESTS)] == ["tilt"]
    known = world.refits(score_test, ranking)
    assert known.keys() == {"tilt"}
    assert [one.candidate.effect.name for one in to_refit(score_test, ranking, TESTS, known)] == ["inclusion", "skin"]


def test_confusions_and_summary(world):
    near = 0.9 * world.signal(0) + np.sqrt(1 - 0.9**2) * world.signal(1)
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, compressibility=world.signal(0), inclusion=near, skin=world.signal(2))
    assert alike(score_test, ranking[0], ranking[1]) == pytest.approx(0.81)
    (pair,) = confusions(score_test, ranking)
    assert (pair["a"], pair["b"]) == ("compressibility", "inclusion")
    assert pair["likeness"] == pytest.approx(0.81)
    first, second, third = summary(score_test, ranking)
    assert (first["effect"], second["effect"], third["effect"]) == ("compressibility", "inclusion", "skin")
    assert first["size"] == {"loss": pytest.approx(30.0)}
    assert first["share_of_excess"] == pytest.approx(1.0)
    assert second["share_of_excess"] == pytest.approx(0.81)
    assert third["predicted_fall"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("worse", "named"), [(3.0, "intensity_drift"), (400.0, "jumping_brightness")])
def test_a_series_is_not_named_beside_a_member_that_says_it_with_fewer_numbers(world, worse, named):
    steps = np.stack([world.signal(0), world.signal(1)], axis=1)
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, intensity_drift=world.signal(0), jumping_brightness=steps)
    refits = world.refits(score_test, ranking, intensity_drift=score_test.freedom + worse)
    refits |= {
        name: replace(refits[name], numbers=n) for name, n in (("intensity_drift", 1), ("jumping_brightness", 2))
    }
    found = decide(score_test, ranking, refits, TESTS)
    assert (found.kind, found.effects) == ("missing", (named,))


@pytest.mark.parametrize(("after", "kind"), [(2.01, "missing"), (2.05, "unexplained"), (1.0, "missing")])
def test_a_refit_that_is_worse_on_held_out_steps_does_not_count(world, after, kind):
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0))
    refits = {name: replace(refit, held_out=after) for name, refit in world.refits(score_test, ranking).items()}
    found = decide(score_test, ranking, refits, TESTS, held_out=2.0)
    assert (found.kind, found.effects) == (kind, ("tilt",) if kind == "missing" else ())
    if kind == "unexplained":
        assert found.sentence.endswith("held-out steps; only on the fitted ones does: tilt of the indenter")
    # without held-out steps nothing can be said of them
    assert decide(score_test, ranking, refits, TESTS).kind == "missing"


def test_the_one_that_explains_held_out_steps_is_named_though_another_fits_better(world):
    between = 0.9 * world.signal(0) + np.sqrt(1 - 0.9**2) * world.signal(1)
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=between)
    refits = world.refits(score_test, ranking, tilt=score_test.freedom - 40.0, inclusion=score_test.freedom + 5.0)
    assert decide(score_test, ranking, refits, TESTS, held_out=2.0).effects[0] == "tilt"
    refits["tilt"] = replace(refits["tilt"], held_out=2.5)
    found = decide(score_test, ranking, refits, TESTS, held_out=2.0)
    assert (found.kind, found.effects) == ("missing", ("inclusion",))


def test_an_adequate_model_stays_so_when_its_only_candidate_is_worse_on_held_out_steps(world):
    score_test = world.score_test(5 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0))
    refits = {name: replace(refit, held_out=1.2) for name, refit in world.refits(score_test, ranking).items()}
    assert decide(score_test, ranking, refits, TESTS, held_out=1.0).kind == "adequate"


def test_a_pair_that_is_worse_on_held_out_steps_names_nothing(world):
    score_test = world.score_test(30 * world.signal(0) + 25 * world.signal(1))
    ranking = world.ranking(score_test, tilt=world.signal(0), inclusion=world.signal(1))
    refits = world.refits(score_test, ranking)
    both = Refit(score_test.freedom - 2.0, score_test.freedom - 2, 1.0, 2.5, {})
    assert decide(score_test, ranking, refits, TESTS, (ranking[1], both), 2.0).kind == "unexplained"
    both = replace(both, held_out=1.0)
    assert decide(score_test, ranking, refits, TESTS, (ranking[1], both), 2.0).effects == ("tilt",)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("coarse_mesh", "the mesh is too coarse: that explains 100 % of the misfit beyond the noise; take a finer model.mesh"),
        ("load_step", "the load steps are too large: that explains 100 % of the misfit beyond the noise; take smaller"),
    ],
)  # fmt: skip
def test_what_only_mesh_or_load_steps_explain_is_cured_by_settings(world, name, says):
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, **{name: world.signal(0), "tilt": world.signal(1)})
    found = by_settings(decide(score_test, ranking, {}, TESTS), score_test, ranking, TESTS)
    assert (found.kind, found.effects) == ("unexplained", ())
    assert found.sentence.startswith(says)


def test_a_coarse_mesh_is_held_against_the_noise_or_against_the_best_effect(world):
    """A model that leaves no more than the noise may still be one whose mesh says all that an effect would."""
    loud, quiet = world.score_test(30 * world.signal(0)), world.score_test(3 * world.signal(0))
    verdict = decide(loud, [], {}, TESTS)
    told = too_coarse(verdict, loud, (450.0, HALVED), 0.0, EFFECTS["coarse_mesh"], 1.0).sentence
    assert "half the element size explains 50 % of the misfit beyond the noise" in told
    told = too_coarse(verdict, quiet, (15.0, HALVED), 20.0, EFFECTS["coarse_mesh"], 1.1)
    assert "half the element size explains 75 % of what the best effect would explain" in told.sentence
    assert "take a finer model.mesh" in told.sentence
    assert (told.kind, told.family) == ("unexplained", "numerics")
    # that is no more than the noise in every pixel either: intervals know the mesh
    told = too_coarse(verdict, quiet, (15.0, HALVED), 20.0, EFFECTS["coarse_mesh"], 1.04)
    assert "half the element size explains 75 % of what the best effect would explain" in told.sentence
    assert (told.kind, told.family) == ("adequate", "")


def test_what_mesh_explains_in_part_or_beside_an_effect_is_not_named_on_it(world):
    part = world.score_test(30 * world.signal(5) + 20 * world.signal(0))
    ranking = world.ranking(part, coarse_mesh=world.signal(0))
    assert "no known effect explains" in by_settings(decide(part, ranking, {}, TESTS), part, ranking, TESTS).sentence
    score_test = world.score_test(30 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0), coarse_mesh=world.signal(0))
    found = decide(score_test, ranking, world.refits(score_test, ranking), TESTS)
    assert by_settings(found, score_test, ranking, TESTS) is found
    assert found.effects == ("tilt",)


@pytest.mark.parametrize(
    ("misfit", "fall", "kind"), [(1.1, 40.0, "missing"), (1.1, 5.0, "adequate"), (1.4, 40.0, "adequate")]
)
def test_a_fall_by_one_covariance_counts_where_the_refit_explains(world, misfit, fall, kind):
    """The model's own error of the mesh is large and hides its misfit; that of the refit is smaller."""
    score_test = world.score_test(5 * world.signal(0))
    ranking = world.ranking(score_test, friction=world.signal(0))
    refit = Refit(misfit * score_test.freedom, score_test.freedom - 1, 1.0, 1.0, {}, fall=fall)
    assert explains(score_test)
    found = decide(score_test, ranking, {"friction": refit}, TESTS)
    assert (found.kind, found.effects) == (kind, ("friction",) if kind == "missing" else ())
    assert "explains 100 %" in found.sentence or kind == "adequate"


def likely(odds, name="tilt"):
    """An effect with a logarithm of the odds."""
    return SimpleNamespace(
        candidate=Candidate(EFFECTS[name], {}),
        finding=Finding(1.0, WIDE, 1.0, 1.0),
        refitted=None,
        odds=lambda spread, fall=None: odds,
    )


def as_likely_as_its_fall(name="tilt"):
    """An effect whose odds are half of what its refit lets the misfit fall by."""
    return SimpleNamespace(**vars(likely(0.0, name)) | {"odds": lambda spread, fall=None: 0.5 * (fall or 0.0) / spread})


@pytest.mark.parametrize(
    ("misfit", "value", "held_out", "kind"),
    [
        (1.0, 0.1019, 0.96, "adequate"),  # beyond chance, but neither constant nor error change by what matters
        (1.0, 0.1021, 0.96, "missing"),
        (1.0, 0.0979, 0.96, "missing"),
        (1.0, 0.1000, 0.94, "missing"),
        (9.0, 0.1019, 0.96, "missing"),  # a model that leaves much is not adequate, whatever its constants do
    ],
)
@pytest.mark.parametrize("found", ["missing", "indistinguishable"])
def test_what_does_not_matter_is_a_trace(found, misfit, value, held_out, kind):
    score_test = SimpleNamespace(misfit=100 * misfit, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100 * misfit, 100, 1.0, 1.0, {"mu_top": 0.1})
    refits = {"tilt": Refit(60.0, 99, 0.96, held_out, {"mu_top": value, "tilt.slope": 0.3})}
    verdict = traced(Verdict(found, ("tilt",), "", 12.0), score_test, [likely(20.0)], refits, base, 0.02, 20)
    assert verdict.kind == (found if kind == "missing" else kind)
    assert ("tilt of the indenter" in verdict.sentence) == (kind == "adequate")
    assert verdict.effects == (("tilt",) if kind == "missing" else ())


@pytest.mark.parametrize(
    ("constants", "odds", "kind"),
    [
        ((0.101, 0.103), (20.0, 3.0), "adequate"),  # one is likely, the other one would matter
        ((0.103, 0.101), (20.0, 3.0), "indistinguishable"),
        ((0.101, 0.103), (3.0, 20.0), "indistinguishable"),
        ((0.101, 0.101), (20.0, 20.0), "adequate"),
    ],
)
def test_of_effects_named_together_one_must_be_likely_and_matter(constants, odds, kind):
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    base, names = Refit(100.0, 100, 1.0, 1.0, {"mu_top": 0.1}), ("tilt", "friction")
    refits = {name: Refit(60.0, 99, 1.0, 1.0, {"mu_top": mu}) for name, mu in zip(names, constants, strict=True)}
    ranking = [likely(one, name) for one, name in zip(odds, names, strict=True)]
    verdict = traced(Verdict("indistinguishable", names, "", 12.0), score_test, ranking, refits, base, 0.02, 20)
    assert verdict.kind == kind
    only = "odds of only 1 to 1 for it after 20 tests: friction under the indenter; beyond chance, but a trace that"
    assert (only in verdict.sentence) == (kind == "adequate" and odds[1] == 3.0)


def test_where_pictures_surely_differ_nothing_is_a_trace():
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    named, refits = Verdict("missing", ("tilt",), "", 12.0), {"tilt": Refit(60.0, 99, 1.0, 1.0, {"mu_top": 0.1})}
    for fitted, kind in ((0.99 * EXPLAINED, "adequate"), (1.01 * EXPLAINED, "missing")):
        base = Refit(100.0, 100, fitted, 1.0, {"mu_top": 0.1})
        assert traced(named, score_test, [likely(20.0)], refits, base, 0.02, 20).kind == kind


@pytest.mark.parametrize(
    ("left", "kind"), [(None, "missing"), ((1.0, 1.02), "adequate"), ((1.0, 1.08), "missing"), ((1.6, 1.0), "missing")]
)
def test_what_only_makes_up_for_the_mesh_is_a_trace(left, kind):
    """The pictures of a model are 2.9 and 1.2 times their noise; the mesh leaves so much of that."""
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100.0, 100, 2.9, 1.2, {"mu_top": 0.1}, but_mesh=left)
    named, refits = Verdict("missing", ("tilt",), "", 12.0), {"tilt": Refit(60.0, 99, 1.0, 1.0, {"mu_top": 0.1})}
    assert traced(named, score_test, [likely(20.0)], refits, base, 0.02, 20).kind == kind


@pytest.mark.parametrize(
    ("misfit", "explained", "common", "kind"),
    [
        (1200.0, 0.45, 55.0, "adequate"),  # chance leaves at most 1106: what is left has a form that nobody knows
        (1200.0, 0.55, 55.0, "missing"),
        (1200.0, 0.45, 40.0, "missing"),  # more than half of what the steps have in common, 55 for 27
        (1090.0, 0.45, 55.0, "missing"),  # no more than chance
    ],
)
def test_a_small_part_of_what_is_left_beyond_chance_is_a_trace(misfit, explained, common, kind):
    score_test = SimpleNamespace(misfit=misfit, freedom=1000, common_misfit=55.0, common_freedom=27)
    base = Refit(misfit, 1000, 1.1, 1.1, {"mu_top": 0.1})
    left = misfit - explained * (misfit - 1000)
    refits = {"tilt": Refit(left, 1000, 1.1, 1.1, {"mu_top": 0.12}, common_misfit=common, common_freedom=27)}
    verdict = traced(Verdict("missing", ("tilt",), "", 12.0), score_test, [likely(20.0)], refits, base, 0.02, 20)
    assert verdict.kind == kind
    assert ("less than half of what is left beyond chance" in verdict.sentence) == (kind == "adequate")


@pytest.mark.parametrize(("odds", "kind"), [((8.0, 2.0), "adequate"), ((2.0, 8.0), "indistinguishable")])
def test_odds_of_what_explains_a_small_part_do_not_count_for_another_one(odds, kind):
    """Of 200 beyond the noise friction explains 55 %, tilt 45 %; 20 to 1 is asked of what explains half."""
    score_test = SimpleNamespace(misfit=1200.0, freedom=1000, common_misfit=0.0, common_freedom=0)
    base, names = Refit(1200.0, 1000, 1.1, 1.1, {"mu_top": 0.1}), ("tilt", "friction")
    refits = {
        name: Refit(1200.0 - 200.0 * share, 1000, 1.1, 1.1, {"mu_top": 0.12})
        for name, share in zip(names, (0.45, 0.55), strict=True)
    }
    ranking = [likely(np.log(20.0) + one, name) for one, name in zip(odds, names, strict=True)]
    named = Verdict("indistinguishable", names, "", 12.0)
    assert traced(named, score_test, ranking, refits, base, 0.02, 20).kind == kind


@pytest.mark.parametrize(
    ("name", "at_least", "fitted", "explained", "kind"),
    [
        ("tilt", 1.5, 1.4, 0.6, "unexplained"),  # a fourth of the squared error beyond the noise
        ("tilt", 1.5, 1.2, 0.3, "missing"),  # two thirds of it
        ("tilt", 1.5, 1.4, 0.8, "missing"),  # enough of what the patches show
        ("tilt", 1.2, 1.15, 0.3, "missing"),  # the pictures are near enough
        ("ageing", 1.5, 1.4, 0.6, "missing"),  # few values show the loading
        ("ageing", 1.5, 1.4, 0.4, "unexplained"),
    ],
)
def test_where_pictures_differ_by_much_an_effect_must_explain_half_of_that(name, at_least, fitted, explained, kind):
    score_test = SimpleNamespace(misfit=1200.0, freedom=1000, common_misfit=0.0, common_freedom=0)
    refits = {name: Refit(1200.0 - 200.0 * explained, 1000, fitted, fitted, {})}
    given = Verdict("missing", (name,), "so it is", 12.0)
    verdict = small_part(given, score_test, [likely(20.0, name)], refits, at_least)
    assert verdict.kind == kind
    assert verdict == given if kind == "missing" else "explains only 23 % of their squared error" in verdict.sentence


@pytest.mark.parametrize(
    ("common", "tests", "kind"), [(50.0, 100, "adequate"), (50.0, 1, "unexplained"), (70.0, 100, "unexplained")]
)
def test_where_no_effect_explains_it_what_is_left_must_be_as_sure_as_an_effect(common, tests, kind):
    """Chance leaves 47 of 27 values once in a hundred times, 62 once in ten thousand."""
    score_test = SimpleNamespace(misfit=900.0, freedom=1000, common_misfit=common, common_freedom=27)
    assert decide(score_test, [], {}, tests).kind == kind


def test_the_excess_is_that_of_all_values_or_of_what_a_step_has_in_common():
    assert excess(SimpleNamespace(misfit=900.0, freedom=1000, common_misfit=50.0, common_freedom=27)) == 23.0
    assert excess(SimpleNamespace(misfit=1300.0, freedom=1000, common_misfit=50.0, common_freedom=27)) == 300.0


@pytest.mark.parametrize(("left", "behind", "rivals"), [(1150.0, 100.0, 2), (1150.0, 160.0, 1), (1005.0, 100.0, 1)])
def test_what_the_best_leaves_beyond_its_noise_is_an_error_as_large_as_a_difference(left, behind, rivals):
    world = World(size=1003)
    score_test = world.score_test(60.0 * world.signal(0))
    ranking = world.ranking(score_test, tilt=world.signal(0), split_layer=world.signal(0))
    refits = {
        "split_layer": Refit(left, 1000, 1.0, 1.0, {}, numbers=2),
        "tilt": Refit(left + behind, 1000, 1.0, 1.0, {}, numbers=2),
    }
    assert len(decide(score_test, ranking, refits, TESTS).effects) == rivals


@pytest.mark.parametrize(
    ("fall", "left", "kind"),
    [(40.0, 40.0, "missing"), (40.0, 12.3, "missing"), (40.0, 11.7, "adequate"), (11.7, 40.0, "adequate")],
)
def test_what_the_form_of_the_models_own_effects_explains_does_not_speak_for_another_one(fall, left, kind):
    """Odds of 20 to 1 after 20 tests, 400 to 1 before, are half of a fall of 12."""
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100.0, 100, 1.0, 1.0, {"mu_top": 0.1})
    refits = {"tilt": Refit(60.0, 99, 0.9, 0.9, {"mu_top": 0.2}, fall=fall)}
    named = Verdict("missing", ("tilt",), "", 12.0)
    form = Form(True, True, {"tilt": left})
    verdict = traced(named, score_test, [as_likely_as_its_fall()], refits, base, 0.02, 20, form)
    assert verdict.kind == kind
    assert ("hardly more than what the form of its own effects" in verdict.sentence) == (left == 11.7)
    assert ("for it after 20 tests" in verdict.sentence) == (fall == 11.7)


@pytest.mark.parametrize(
    ("name", "control", "beside", "after", "constant", "kind"),
    [
        ("tilt", "force", True, 1.06, 0.101, "adequate"),
        ("misregistration", "force", True, 1.06, 0.101, "adequate"),
        ("tilt", "force", False, 1.06, 0.101, "missing"),  # the model has no effects
        ("tilt", "force", True, 1.04, 0.101, "missing"),  # it lowers the error
        ("tilt", "force", True, 1.06, 0.103, "missing"),  # it moves a constant
        # these act on the loading or on its reading alone, where few values are
        ("onset", "displacement", True, 1.06, 0.101, "missing"),
        ("onset", "force", True, 1.06, 0.101, "missing"),
        ("force_offset", "displacement", True, 1.06, 0.101, "missing"),
    ],
)
def test_beside_effects_what_does_not_matter_is_a_trace_also_where_the_data_are_not_explained(
    name, control, beside, after, constant, kind
):
    one = likely(20.0, name)
    one.candidate = Candidate(EFFECTS[name].under(control), {})
    score_test = SimpleNamespace(misfit=1300.0, freedom=1000, common_misfit=27.0, common_freedom=27)
    base = Refit(1300.0, 1000, 1.1, 1.1, {"mu_top": 0.1})
    refits = {name: Refit(1000.0, 999, after, after, {"mu_top": constant}, fall=300.0)}
    given = Verdict("missing", (name,), "", 12.0)
    found = traced(given, score_test, [one], refits, base, 0.02, 20, Form(beside))
    assert found.kind == kind
    assert ("leaves little beside its effects" in found.sentence) == (kind == "adequate")


@pytest.mark.parametrize(("odds", "kind"), [(6.1, "indistinguishable"), (5.9, "adequate")])
def test_there_an_effect_that_matters_must_be_likely_by_itself(odds, kind):
    """Not by the odds of another one that cannot be told from it, and matters to nothing: 20 to 1 after 20 tests."""
    quiet, matters = likely(20.0, "prestretch"), likely(odds, "stiffening")
    score_test = SimpleNamespace(misfit=1300.0, freedom=1000, common_misfit=72.0, common_freedom=28)
    base = Refit(1300.0, 1000, 0.93, 0.85, {"mu_top": 0.1})
    refits = {
        name: Refit(1260.0, 999, 0.92, 0.85, {"mu_top": constant}, fall=40.0)
        for name, constant in (("prestretch", 0.1), ("stiffening", 0.103))
    }
    given = Verdict("indistinguishable", tuple(refits), "", 12.0)
    found = traced(given, score_test, [quiet, matters], refits, base, 0.02, 20, Form(True))
    assert found.kind == kind
    assert ("moves no constant by more than 2 % with the odds for it" in found.sentence) == (kind == "adequate")


@pytest.mark.parametrize(
    ("found", "form", "fitted", "kind"),
    [
        ("missing", Form(True, True, {"tilt": 9.0}), 1.1, "adequate"),
        ("unexplained", Form(True, True), 1.1, "adequate"),
        ("missing", Form(True, True, {"tilt": 90.0}), 1.1, "missing"),  # it explains more than that form
        ("unexplained", Form(True, False), 1.1, "unexplained"),  # it leaves more than that
        ("missing", Form(True, True, {"tilt": 9.0}), 1.3, "missing"),  # the pictures say that more is wrong
        ("missing", NO_FORM, 1.1, "missing"),  # a model without effects has no form of them
    ],
)
def test_what_a_model_leaves_may_be_the_form_of_its_own_effects(found, form, fitted, kind):
    score_test = SimpleNamespace(misfit=1000.0, freedom=1000, common_misfit=127.0, common_freedom=27)
    base = Refit(1000.0, 1000, fitted, 1.0, {"mu_top": 0.1})
    refits = {"tilt": Refit(800.0, 999, 1.0, 1.0, {"mu_top": 0.2}, fall=200.0)}
    given = Verdict(found, ("tilt",) if found == "missing" else (), "", 12.0)
    verdict = traced(given, score_test, [as_likely_as_its_fall()], refits, base, 0.02, 20, form)
    assert verdict.kind == kind
    assert ("no more than what the form" in verdict.sentence) == (kind == "adequate")


def test_without_held_out_steps_the_fitted_ones_tell():
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100.0, 100, 1.0, None, {"mu_top": 0.1})
    for fitted, kind in ((0.96, "adequate"), (0.94, "missing")):
        refits = {"tilt": Refit(60.0, 99, fitted, None, {"mu_top": 0.1})}
        verdict = traced(Verdict("missing", ("tilt",), "", 12.0), score_test, [likely(20.0)], refits, base, 0.02, 20)
        assert verdict.kind == kind


@pytest.mark.parametrize(
    ("misfit", "tests", "kind"), [(1.0, 12, "missing"), (1.0, 13, "adequate"), (9.0, 13, "missing")]
)
def test_what_is_not_likely_after_as_many_tests_is_a_trace(misfit, tests, kind):
    """Odds of 245 to 1 for one effect are 19 to 1 for the best of thirteen, and 20 are needed; a model that leaves much needs none."""
    score_test = SimpleNamespace(misfit=100.0 * misfit, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100.0 * misfit, 100, 1.0, 1.0, {"mu_top": 0.1})
    refits = {"tilt": Refit(60.0, 99, 0.9, 0.9, {"mu_top": 0.2})}
    verdict = traced(Verdict("missing", ("tilt",), "", 12.0), score_test, [likely(5.5)], refits, base, 0.02, tests)
    assert verdict.kind == kind
    assert ("odds of only 19 to 1 for it after 13 tests" in verdict.sentence) == (kind == "adequate")


@pytest.mark.parametrize(("tests", "kind"), [(13, "missing"), (24, "missing"), (25, "adequate")])
def test_the_odds_of_effects_that_are_named_together_add_up(tests, kind):
    """One of two is there with twice the odds of each of them."""
    score_test = SimpleNamespace(misfit=100.0, freedom=100, common_misfit=0.0, common_freedom=0)
    base = Refit(100.0, 100, 1.0, 1.0, {"mu_top": 0.1})
    refits = {name: Refit(60.0, 99, 0.9, 0.9, {"mu_top": 0.2}) for name in ("tilt", "wall")}
    given = Verdict("indistinguishable", ("tilt", "wall"), "", 12.0)
    ranking = [likely(5.5), likely(5.5, "wall")]
    assert (
        traced(given, score_test, ranking, refits, base, 0.02, tests).kind.replace("indistinguishable", "missing")
        == kind
    )


@pytest.mark.parametrize(
    ("count", "fitted", "counts"), [(1000, 2.54, True), (1000, 2.56, False), (20, 2.7, True), (20, 2.8, False)]
)
def test_a_refit_that_ends_worse_on_what_it_fitted_has_missed_its_minimum(count, fitted, counts):
    """Its misfit may have fallen all the same: its own covariance forgives a worse model more."""
    score_test = SimpleNamespace(misfit=9.0 * count, freedom=count)
    assert misses(score_test, Refit(0.8 * count, count - 1, fitted, 1.0, {}), 2.53) != counts
