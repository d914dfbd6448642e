"""Which member, or which probe, stands for a family, and the odds for it, from signals that are made for it."""

from dataclasses import replace

import numpy as np
import pytest
from test_verdict import TESTS, VALUES, World

from fingerfit.diagnosis import tested
from fingerfit.diagnosis.evidence import Information
from fingerfit.diagnosis.families import ENOUGH, SURE, by_refits, families, family_told, nominated
from fingerfit.diagnosis.partners import imitated
from fingerfit.diagnosis.ranking import Refitted
from fingerfit.diagnosis.refit import EXPLAINED, Refit
from fingerfit.diagnosis.reservations import largest_part, leave_mesh, of_family
from fingerfit.diagnosis.verdict import MATTERS, PART, Verdict, beside_probe, decide, nearest
from fingerfit.diagnosis.worth import FALLS_SHORT, LARGEST, blamed_on_mesh, most_of, to_refit, too_small
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import FAMILIES


def ranked(share, hidden=30.0, extra=1):
    """A world with something at the base, which the member explains by a share, and the probe whole with more numbers."""
    world = World()
    member = np.sqrt(share) * world.signal(0) + np.sqrt(1 - share) * world.signal(1)
    probe = np.stack([world.signal(0), *(world.signal(2 + n) for n in range(extra))], axis=1)
    score_test = world.score_test(hidden * world.signal(0))
    other = 0.5 * world.signal(0) + np.sqrt(0.75) * world.signal(9)
    return score_test, world.ranking(score_test, base_slip=member, base_probe=probe, tilt=other)


def names(ranking):
    return [one.candidate.effect.name for one in ranking]


def test_every_effect_has_a_family_and_a_family_one_probe_at_most():
    assert {effect.family for effect in catalogue().values()} == set(FAMILIES)
    # a side that slides has nothing that could give way, and one that holds nothing that could stick (unmet)
    for elsewhere, other in (("plane", "sliding"), ("space", "sliding"), ("space", "held")):
        of_body = [effect for effect in catalogue().values() if effect.probe and elsewhere not in effect.needs]
        slides = {effect.name for effect in of_body if {"sliding_base", "sliding_indenter"} & set(effect.needs)}
        holds = {effect.name for effect in of_body if effect.replaces and {"base", "indenter"} & set(effect.replaces)}
        left_out = slides if other == "sliding" else holds
        probes = [effect.family for effect in of_body if effect.name not in left_out]
        assert sorted(probes) == sorted(set(FAMILIES) - {"numerics"})


@pytest.mark.parametrize("extra", [1, 5])
def test_a_member_that_does_what_the_probe_does_stands_for_it(extra):
    score_test, ranking = ranked(1.0, extra=extra)
    assert names(nominated(score_test, ranking)) == ["base_slip", "tilt"]


def test_where_the_probe_is_likelier_all_the_same_refits_of_both_tell():
    """A member of another form, or at its bound, does most of what the probe does, but far from all."""
    score_test, ranking = ranked(ENOUGH + 0.05)
    assert sorted(names(nominated(score_test, ranking))) == ["base_probe", "base_slip", "tilt"]
    small, ranking = ranked(ENOUGH + 0.05, hidden=6.0)  # 3.6 of log odds, less than 100 to 1
    assert sorted(names(nominated(small, ranking))) == ["base_slip", "tilt"]


def test_else_the_probe_does():
    score_test, ranking = ranked(ENOUGH - 0.05)
    assert names(nominated(score_test, ranking)) == ["base_probe", "tilt"]
    assert names(to_refit(score_test, ranking, TESTS)) == ["base_probe"]


@pytest.mark.parametrize(("kept", "stays"), [(0.9, True), (0.4, False)])
def test_a_member_whose_refit_keeps_less_than_promised_gives_way(kept, stays):
    score_test, ranking = ranked(ENOUGH + 0.05)
    probe = next(one for one in ranking if one.candidate.effect.probe)
    found = names(nominated(score_test, ranking, {"base_slip": kept * probe.finding.fall}))
    assert "base_probe" in found
    assert ("base_slip" in found) == stays


def test_a_probe_that_only_has_more_numbers_does_not():
    """The member explains a little less, as much as seven idle numbers of the probe are not worth."""
    score_test, ranking = ranked(ENOUGH - 0.05, hidden=6.0, extra=7)
    assert names(nominated(score_test, ranking))[0] == "base_slip"


def test_families_come_with_their_odds():
    score_test, ranking = ranked(0.5)
    found = families(score_test, ranking)
    assert list(found) == ["base", "indenter"]
    assert [one.candidate.effect.name for one, _ in found.values()] == ["base_probe", "tilt"]
    assert found["base"][1] > found["indenter"][1] > 0


def test_a_verdict_has_the_family_of_what_it_names():
    score_test, ranking = ranked(1.0)
    misfit = score_test.misfit - ranking[0].finding.fall
    refits = {"base_slip": Refit(misfit, score_test.freedom - 1, 1.0, 1.0, {})}
    verdict = of_family(decide(score_test, ranking, refits, TESTS), score_test, ranking, refits)
    assert (verdict.effects, verdict.family) == (("base_slip",), "base")
    assert verdict == replace(decide(score_test, ranking, refits, TESTS), family="base")


@pytest.mark.parametrize(
    ("refit", "tried", "said"),
    [
        (-12.0, "indenter", ", by odds of 10^5 to 1 against the indenter and other boundaries."),
        (12.0, "indenter", "; by the misfit alone the odds are 10^5 to 1 for the indenter and other boundaries."),
        (None, "indenter", "; the refits of others do not count."),
        (
            None,
            "base",
            "; no effect of another family was likely enough to be refitted"
            " (odds of 55 to 1 against the indenter and other boundaries before any refit).",
        ),
    ],
)
def test_the_family_is_told_with_its_odds(refit, tried, said):
    """By refits; where no other one counts, by what was known before: e^4 is 55."""
    other = {"family": "indenter", "log_odds": 3.0, "refit": refit and {"log_odds": refit}}
    found = {
        "family": "base",
        "effects": ["base_slip"],
        "families": [{"family": "base", "log_odds": 7.0, "refit": {"log_odds": 0.0}}, other],
        "ranking": [{"effect": "tilt", "family": tried, "refit": {"missed": True}}],
    }
    assert family_told(found) == f"The effect lies in the base{said}"
    assert family_told({**found, "effects": []}) == family_told({**found, "families": []}) == ""


@pytest.mark.parametrize(("second", "family"), [("tilt", "indenter"), ("outline", "geometry")])
def test_families_that_are_named_together_are_told_together(second, family):
    others = [(family, -2.0), ("state", -12.0)]
    found = {
        "family": "base",
        "effects": ["base_slip", second],
        "families": [
            {"family": "base", "log_odds": 7.0, "refit": {"log_odds": 0.0}},
            *({"family": name, "log_odds": 3.0, "refit": {"log_odds": behind}} for name, behind in others),
        ],
        "ranking": [{"effect": "tilt", "family": "indenter", "refit": {"misfit": 3.0}}],
    }
    told = family_told(found)
    assert (
        told == f"The effect lies in the base or {FAMILIES[family]}, by odds of 10^5 to 1 against {FAMILIES['state']}."
    )


def test_a_family_without_another_one_is_told_alone():
    only = [{"family": "base", "log_odds": 7.0, "refit": {"log_odds": 0.0}}]
    said = family_told({"family": "base", "effects": ["base_slip"], "families": only})
    assert said == "The effect lies in the base; no effect of another family was likely enough to be refitted."


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.4, "; of known effects slip or compliance at the base comes nearest (first pass: 40 %)"), (0.0, "")],
)
def test_of_a_probe_the_nearest_known_effect_is_said(share, said):
    score_test, ranking = ranked(share)
    verdict = of_family(Verdict("missing", ("base_probe",), "missing", 1.0), score_test, ranking, {})
    assert verdict.sentence == f"missing{said}"


def test_where_there_is_a_refit_its_number_is_told():
    score_test, ranking = ranked(0.4)
    kept = Refit(score_test.misfit - 0.2 * score_test.beyond_noise, score_test.freedom, 2.0, 2.0, {})
    verdict = of_family(Verdict("missing", ("base_probe",), "missing", 1.0), score_test, ranking, {"base_slip": kept})
    assert verdict.sentence.endswith(f"comes nearest (refit: {100 * kept.explained(score_test.misfit):.0f} %)")
    assert round(100 * kept.explained(score_test.misfit)) == 20
    verdict = of_family(Verdict("unexplained", (), "unexplained", 1.0), score_test, ranking, {"base_slip": kept})
    assert verdict.sentence == "unexplained; 20 % of the misfit beyond the noise may lie in the base (refit)"


@pytest.mark.parametrize(
    ("probe", "member", "other", "nearest", "found"),
    [
        (0.9, ENOUGH + 0.05, ENOUGH + 0.1, "base_probe", "base_slip"),  # of the family of the probe
        (0.7, ENOUGH - 0.05, 0.5, "base_probe", "base_slip"),  # that leaves less
        (0.7, ENOUGH - 0.25, 0.6, "base_probe", "tilt"),
        (0.7, 0.1, PART + 0.05, "base_probe", "tilt"),
        (0.7, PART - 0.05, PART - 0.05, "base_probe", None),
        (1.0, ENOUGH + 0.05, 0.6, "base_probe", None),  # the probe explains the data: of no known form
        (0.9, ENOUGH + 0.05, 0.6, "base_slip", None),  # the member is named without a partner
    ],
)
def test_a_member_may_have_a_partner_where_a_probe_does_not_explain_the_data(probe, member, other, nearest, found):
    score_test, ranking = ranked(1.0, hidden=60.0)
    refits = {
        name: Refit(score_test.misfit - share * score_test.beyond_noise, score_test.freedom, 1.5, 1.5, {})
        for name, share in (("base_probe", probe), ("base_slip", member), ("tilt", other))
    }
    one = beside_probe(ranking, {nearest: refits[nearest]}, refits, score_test.misfit)
    assert (one and one.candidate.effect.name) == found


def test_what_is_unexplained_has_the_likeliest_family():
    score_test, ranking = ranked(0.5)
    unexplained = Verdict("unexplained", (), "unexplained", 1.0)
    verdict = of_family(unexplained, score_test, ranking, {})
    assert verdict.family == "base"
    assert verdict.sentence == "unexplained; 100 % of the misfit beyond the noise may lie in the base (first pass)"
    for share in (0.27, 0.49, 0.51):  # no other words on the other side of one half
        less = [replace(one, finding=replace(one.finding, fall=share * score_test.beyond_noise)) for one in ranking]
        said = f"{100 * share:.0f} % of the misfit beyond the noise may lie in the base (first pass)"
        assert of_family(unexplained, score_test, less, {}).sentence == f"unexplained; {said}"
    noise, ranking = ranked(0.5, hidden=0.0)
    assert of_family(unexplained, noise, ranking, {}).family == ""
    worse = {"base_slip": Refit(score_test.misfit + 9.0, score_test.freedom, 2.0, 2.0, {})}
    assert of_family(unexplained, score_test, ranking, worse) == unexplained  # no negative share is told
    assert of_family(Verdict("adequate", (), "adequate", 1.0), score_test, ranking, {}).family == ""


@pytest.mark.parametrize(("gain", "family"), [(0.6, "indenter"), (0.0, "base")])
def test_refits_decide_which_family_is_behind_it(gain, family):
    score_test, ranking = ranked(0.5)
    misfit = score_test.misfit - gain * (score_test.misfit - score_test.freedom)
    refits = {"tilt": Refit(misfit, score_test.freedom, 1.0, 1.0, {})}
    verdict = of_family(Verdict("unexplained", (), "unexplained", 1.0), score_test, ranking, refits)
    assert verdict.family == family
    assert (
        "; 60 % of the misfit beyond the noise may lie in the indenter and other boundaries (refit)" in verdict.sentence
    ) == (family == "indenter")


def test_refits_of_families_are_compared_with_the_best_of_all():
    """By half of what they leave more; those that do not count say nothing. Where none explains the data all weighs less."""
    _, ranking = ranked(0.5)

    def refit(misfit, **more):
        return Refit(misfit, 100, 1.0, 1.0, {}, **more)

    found = by_refits(ranking, {"base_slip": refit(90.0), "tilt": refit(110.0), "base_probe": refit(95.0)})
    assert found == {"base": ("base_slip", 0.0), "indenter": ("tilt", -10.0)}
    assert by_refits(ranking, {"base_slip": refit(400.0), "tilt": refit(440.0)})["indenter"] == ("tilt", -5.0)
    lost = {"base_slip": refit(10.0, missed=True), "base_probe": refit(20.0, absent=True)}
    assert by_refits(ranking, {**lost, "tilt": refit(110.0)}) == {"indenter": ("tilt", 0.0)}
    assert by_refits(ranking, lost) == {}


def test_odds_are_those_of_the_integrated_likelihood(rng):
    """Of a linear effect with normal priors the integral is known: r'(1 + S S')^-1 r and the determinant of 1 + S S'.

    Laplace's approximation at the least misfit, not at the most likely size, differs by one over the information, of
    the part of the fall that it leaves.
    """
    world = World()
    columns = 100.0 * np.linalg.qr(rng.normal(size=(world.size, 2)))[0] @ rng.normal(size=(2, 2))
    residual = columns @ np.array([0.3, -0.5]) + rng.normal(size=world.size)
    size = np.linalg.lstsq(columns, residual, rcond=None)[0]
    fall, information = float(residual @ columns @ size), columns.T @ columns
    joint = np.eye(world.size) + columns @ columns.T
    wanted = 0.5 * (residual @ residual - residual @ np.linalg.solve(joint, residual) - np.linalg.slogdet(joint)[1])
    one = world.ranking(world.score_test(0 * world.signal(0)), tilt=columns)[0]
    known = Information(information, size, np.zeros(2, dtype=bool))
    fitted = Refitted({}, 0.0, True, (), 0, 1, known)
    one = replace(one, finding=replace(one.finding, fall=fall), refitted=fitted)
    left = float(size @ size) / np.linalg.eigvalsh(information)[0]
    assert one.odds(1.0) == pytest.approx(wanted, rel=1e-9, abs=left)
    # without a refit a hundred numbers that explain nothing are worth less than none
    assert replace(one, finding=replace(one.finding, fall=0.0), refitted=None).odds(1.0) < 0


def test_a_refit_whose_pictures_are_worse_is_no_answer():
    def refit(error):
        return Refit(100.0, 300, error, error, {})

    refits = {"tilt": refit(0.96), "onset": refit(0.96 + 0.9 * MATTERS), "relaxation": refit(0.97 + MATTERS)}
    assert set(nearest(refits)) == {"tilt", "onset"}
    assert nearest({}) == {}
    # a number for each step: nearer where it was fitted, farther where it was not
    steps, few = Refit(1.0, 1, 0.94, 1.08, {}), Refit(2.0, 1, 1.0, 1.0, {})
    assert set(nearest({"steps": steps, "few": few})) == {"steps", "few"}
    assert set(nearest({"steps": replace(steps, held_out=1.04), "few": few})) == {"steps"}
    # a twentieth of what is left, where that is more than the noise
    apart = {"near": replace(few, fitted=2.0), "as near": replace(few, fitted=2.09), "far": replace(few, fitted=2.11)}
    assert set(nearest(apart)) == {"near", "as near"}
    # what its mesh makes does not count against it, and makes nothing better than the noise
    left = (("yeoh", 1.16), ("skin", 0.97), ("bed", 1.0))
    coarse = {name: replace(refit(1.2), but_mesh=(error, None)) for name, error in left}
    assert set(nearest(refits | coarse)) == {"tilt", "onset", "skin", "bed"}


def test_a_brightness_that_changes_is_no_rival_of_what_moves_places():
    """An exposure that jumps explains most of the patches, a base that bends most of the pixels: both are there."""
    refits = {"bed": Refit(4100.0, 480, 1.34, None, {}), "bias_field": Refit(1800.0, 480, 1.60, None, {})}
    worse = {"skin": Refit(4300.0, 480, 1.50, None, {}), "drift": Refit(4700.0, 480, 1.71, None, {})}
    assert set(nearest(refits | worse)) == {"bed"}
    assert set(nearest(refits | worse, {"bias_field", "drift"})) == {"bed", "bias_field"}


@pytest.mark.parametrize(
    ("error", "rival", "kind"), [(3.0, 0.3, "missing"), (4.5, 0.3, "unexplained"), (3.0, 0.999, "unexplained")]
)
def test_the_largest_part_is_named_where_its_family_leads(error, rival, kind):
    """Much of what is hidden is nowhere in the catalogue; a slip explains the rest, a tilt a share of it as well."""
    world = World()
    score_test = world.score_test(30.0 * world.signal(0) + 25.0 * world.signal(9))
    other = rival * world.signal(0) + np.sqrt(1 - rival**2) * world.signal(8)
    probe = np.stack([world.signal(0), world.signal(2)], axis=1)
    ranking = world.ranking(score_test, base_slip=world.signal(0), base_probe=probe, tilt=other)
    refits = {"base_slip": Refit(score_test.misfit - 900.0, score_test.freedom - 1, error, 1.0, {}, numbers=1)}
    nearest = decide(score_test, ranking, refits, TESTS)
    assert nearest.kind == "unexplained"
    verdict = largest_part(nearest, score_test, ranking, refits, 5.0)
    assert verdict.kind == kind
    assert verdict.effects == (("base_slip",) if kind == "missing" else ())
    assert ("the error falls from 5 to 3 times the noise level), more is missing" in verdict.sentence) == bool(
        verdict.effects
    )
    # refits of both decide where there are some: half of the difference, over what the better one leaves for each value
    spread = refits["base_slip"].level / refits["base_slip"].freedom
    for far, leads in ((3 * SURE, True), (SURE / 3, False)):
        misfit = refits["base_slip"].level + 2 * spread * far
        tried = refits | {"tilt": Refit(misfit, score_test.freedom, error, 1.0, {})}
        again = largest_part(nearest, score_test, ranking, refits, 5.0, tried)
        assert again.kind == ("missing" if leads and error < 4.0 else "unexplained")
    # one that leaves more in every pixel is behind, whatever its patches say
    tried = refits | {"tilt": Refit(0.5 * refits["base_slip"].misfit, score_test.freedom, error + 2 * MATTERS, 1.0, {})}
    again = largest_part(nearest, score_test, ranking, refits, 5.0, tried)
    assert again.kind == ("missing" if error < 4.0 else "unexplained")
    # beside effects that are some of it already a part is enough, where it lowers the error on held-out steps as well
    for held_out, beside, named in (
        (1.0 + 2 * MATTERS, True, True),
        (1.0 + MATTERS / 2, True, False),
        (2.0, False, False),
    ):
        part = largest_part(nearest, score_test, ranking, refits, 5.0, None, held_out, beside)
        assert part.kind == ("missing" if kind == "missing" or (named and rival < 0.5) else "unexplained")
        if part.effects:
            share = refits["base_slip"].explained(score_test.misfit)
            fell = (
                f"it explains {100 * share:.0f} % of the misfit beyond the noise (the error falls from 5 to {error:.2g}"
            )
            assert fell in part.sentence
    # nobody knows what else a family has that no probe stands for
    known = [one for one in ranking if not one.candidate.effect.probe]
    assert largest_part(nearest, score_test, known, refits, 5.0) is nearest


def first_pass(ranking, share, surprise=0.0):
    """The ranking with refits of the first pass that explain a share of what there is."""
    known = Information(np.zeros((1, 1)), np.array([surprise**0.5]), np.zeros(1, dtype=bool))
    refit = Refitted({}, float(VALUES), True, (), 4, VALUES, known, share)
    return [replace(one, refitted=refit) for one in ranking]


def test_a_probe_may_imitate_two_of_its_members():
    """Where one of them explains a part of it; a member of another family is none of them."""
    score_test, ranking = ranked(0.6)

    def found(share, but="", explained=ENOUGH, elsewhere=PART):
        probe, *others = ranking
        assert probe.candidate.effect.name == "base_probe"
        kin, others = ([one for one in others if (one.candidate.effect.name == "tilt") == far] for far in (0, 1))
        tried = [*first_pass([probe], explained), *first_pass(kin, share), *first_pass(others, elsewhere)]
        left = [one for one in tried if one.candidate.effect.name != but]
        return imitated(tested.Tested(None, score_test, [], left, TESTS, 0, {}, None))

    assert found(PART).candidate.effect.name == "base_slip"
    assert found(PART - 0.01) is None
    assert found(PART, explained=ENOUGH - 0.01) is None
    assert found(PART, "base_slip") is None
    assert found(PART, "base_probe") is None
    # what another family explains alone comes before two of one
    assert found(PART, elsewhere=ENOUGH - 0.01).candidate.effect.name == "base_slip"
    assert found(PART, elsewhere=ENOUGH) is None


def test_where_nothing_explains_nearly_enough_nothing_is_refitted():
    score_test, ranking = ranked(1.0)
    limit = FALLS_SHORT * LARGEST
    assert too_small(score_test, first_pass(ranking, limit - 0.01), 1.2)
    assert not too_small(score_test, first_pass(ranking, limit + 0.01), 1.2)
    assert not too_small(score_test, first_pass(ranking, limit - 0.01), 1.3)  # the first pass does not see all
    assert not too_small(score_test, ranking, 1.2)  # there was none
    quiet, ranking = ranked(1.0, hidden=2.0)
    assert not too_small(quiet, first_pass(ranking, 0.1), 1.0)  # the model explains the data


@pytest.mark.parametrize(("surprise", "count"), [(0.0, 1), (23.0, 1), (26.0, 0)])
def test_a_model_that_explains_the_data_needs_odds_for_a_refit(surprise, count):
    """Half of the fall of 36 is 18, less half of the surprise and the logarithm of 20 tests, 3.0; 3.0 are needed, and
    there is another effect with the same odds, which adds 0.7."""
    score_test, ranking = ranked(1.0, hidden=6.0)
    assert len(to_refit(score_test, first_pass(ranking, 1.0, surprise), TESTS)) == count


def test_a_refit_that_explains_less_lowers_the_odds():
    _, ranking = ranked(1.0, hidden=6.0)
    one = first_pass(ranking, 1.0)[0]
    assert one.odds(2.0) - one.odds(2.0, one.finding.fall - 8.0) == pytest.approx(2.0)
    assert one.odds(2.0, one.finding.fall + 8.0) == one.odds(2.0)


def test_a_mesh_comes_before_effects_where_none_explains_as_much():
    score_test, ranking = ranked(1.0)
    left = score_test.misfit - score_test.freedom
    part = FALLS_SHORT * LARGEST

    def tried(share):
        return [replace(one, finding=replace(one.finding, fall=share * left)) for one in first_pass(ranking, share)]

    for share in (1.2 * part, 0.9 * LARGEST):
        assert most_of(tried(share)) == pytest.approx(share * left)
        assert blamed_on_mesh(1.01 * share * left, score_test, tried(share))
        assert not blamed_on_mesh(0.99 * share * left, score_test, tried(share))
    assert not blamed_on_mesh(0.9 * part * left, score_test, tried(0.8 * part))  # something else is missing
    assert blamed_on_mesh(1.01 * LARGEST * left, score_test, tried(0.9))  # more than half
    assert not blamed_on_mesh(0.0, score_test, ranking)


@pytest.mark.parametrize(
    ("errors", "left"),
    [
        ({"tilt": (EXPLAINED + 0.1, 1.0)}, True),
        ({"tilt": (EXPLAINED, 1.0)}, False),  # with it the pictures differ by little
        ({"tilt": (EXPLAINED + 0.2, EXPLAINED + 0.1)}, False),  # and not because of the mesh
        ({"tilt": (EXPLAINED + 0.1, 1.0), "skin": (EXPLAINED - 0.1, 1.0)}, False),  # one of two does more
        ({}, False),
    ],
)
def test_effects_that_leave_what_the_mesh_makes_are_told_from_those_that_do_not(errors, left):
    refits = {
        name: Refit(1.0, 1, error, None, {}, but_mesh=(at_least, None)) for name, (error, at_least) in errors.items()
    }
    assert leave_mesh(tuple(errors), refits) == left


def test_a_brightness_however_large_keeps_no_other_effect_from_its_refit():
    """Slopes see it in all pixels, while the first pass sees displacements alone; one that is small beside these waits."""
    score_test, ranking = ranked(1.0)
    slip, tilt = (next(one for one in ranking if one.candidate.effect.name == name) for name in ("base_slip", "tilt"))
    (known,) = first_pass([slip], 1.0)
    for times, wanted in ((10.0, ["tilt", "base_slip"]), (0.1, ["base_slip"])):
        seen = replace(tilt, finding=replace(tilt.finding, fall=times * known.finding.fall), refitted=None)
        assert names(to_refit(score_test, [seen, known], TESTS)) == wanted
