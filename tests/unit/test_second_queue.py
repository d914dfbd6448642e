"""Which effects are refitted with pictures, and in which order: what earlier refits say decides the rest."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from test_likelihood import COUNT, model

from fingerfit.core.errors import StateError
from fingerfit.diagnosis import families, second_queue
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.likelihood import misfits
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.second_queue import by_one_likelihood, instead_of
from fingerfit.model.catalogue import catalogue


def queue(monkeypatch, odds, made):
    """Effects with their odds in the first pass, all worth a refit, and the refits that they would have."""
    ranking = [
        SimpleNamespace(candidate=SimpleNamespace(effect=catalogue()[name]), refitted=SimpleNamespace(share=1.0))
        for name in odds
    ]
    for one, value in zip(ranking, odds.values(), strict=True):
        one.odds, one.finding = lambda _, value=value: value, SimpleNamespace(fall=2.0 * value)
    without = model(0.6, 0.1)
    score_test = SimpleNamespace(misfit=misfits({"without": without}, "without")["without"], freedom=COUNT - 2)
    found = SimpleNamespace(score_test=score_test, ranking=ranking, tests=1, made=dict(made))
    problem = SimpleNamespace(asked=set(), settings=SimpleNamespace(model=SimpleNamespace(effects={})))
    found.but_mesh = 3.0, 3.0  # larger than what any refit here leaves, but of those that miss their minimum
    found.comparison = SimpleNamespace(problem=problem, weighed=without)
    monkeypatch.setattr(second_queue, "spread_of", lambda *_: 1.0)
    monkeypatch.setattr(second_queue, "in_space", lambda _: False)
    monkeypatch.setattr(second_queue, "worth_a_refit", lambda *_: ranking)
    monkeypatch.setattr(second_queue, "to_refit", lambda *_: ranking)
    return found


def refit(offset, misfit=198.0, error=1.0, absent=False):
    """The refit of an effect of one number that leaves so much of a pattern."""
    return Refit(misfit, COUNT - 2, error, error, {}, weighed=model(offset, 0.1), numbers=1, absent=absent)


def test_the_log_tells_of_a_refit_what_verdict_and_page_will(monkeypatch):
    """A refit with a wider covariance forgives itself much: its share is by the likelihood that is nearest so far."""
    good, forgiving, without = model(0.0, 0.1), model(0.3, 10.0), model(0.6, 0.1)
    made = {
        "tilt": Refit(198.0, COUNT - 2, 0.85, 0.84, {}, weighed=good, numbers=1),
        "skin": Refit(1.0, COUNT - 2, 1.4, 1.4, {}, weighed=forgiving, numbers=1),
    }
    misfit = misfits({"without": without}, "without")["without"]
    found = queue(monkeypatch, dict.fromkeys(made, 1.0), made)
    found.comparison.problem.settings.model.effects["outline"] = {}
    said = []
    monkeypatch.setattr(second_queue, "tell", said.append)
    list(second_queue.refits_of(found, 1))
    common, own = by_one_likelihood(made, without), made["skin"].explained(misfit)
    shares = {name: 100 * one.explained(misfit) for name, one in common.items()}
    assert 100 * own > shares["skin"] + 20
    assert said == [
        f"refit beside outline: {name} ({catalogue()[name].title}) explains {shares[name]:.0f} %; 0 simulations run"
        for name in made
    ]


@pytest.mark.parametrize(
    ("first", "second", "count"), [(17.7, 12.7, 2), (17.7, 11.0, 1), (40.0, 31.0, 2), (40.0, 29.0, 1)]
)
def test_members_that_refits_may_not_tell_apart_are_both_refitted(monkeypatch, first, second, count):
    """Log odds of 6 are what refits must differ by, and a quarter of small odds is less."""
    names = ("split_layer", "interface")
    made = {name: refit(0.0) for name in names}
    found = queue(monkeypatch, dict(zip(names, (first, second), strict=True)), made)
    assert len(list(second_queue.refits_of(found, 1))) == count


@pytest.mark.parametrize(
    ("second", "fall", "refitted"),
    [
        ("interface", 0.91, True),  # as much as the best one, though with more numbers
        ("interface", 0.89, False),
        ("gradient", 0.91, False),  # the best one's family has explained it
        ("geometry_probe", 0.91, False),  # it would say that there is something of no known form
    ],
)
def test_another_family_that_explains_as_much_is_refitted(monkeypatch, second, fall, refitted):
    made = {name: refit(0.0) for name in ("split_layer", second)}
    found = queue(monkeypatch, {"split_layer": 56.0, second: 40.0}, made)
    for one, much in zip(found.ranking, (1.0, fall), strict=True):
        one.finding.fall = 100.0 * much
    assert names(one for one, _ in second_queue.refits_of(found, 1)) == ["split_layer", second][: 1 + refitted]


@pytest.mark.parametrize(
    ("share", "error", "explains", "refitted"),
    [
        (0.24, 1.2, False, False),
        (0.26, 1.2, False, True),  # a refit that explains twice as much is half of it
        (0.24, 1.3, False, True),  # the first pass does not see all that pictures show
        (0.24, 1.2, True, True),  # of what is no more than chance there are no shares
    ],
)
def test_what_explains_far_too_little_in_the_first_pass_is_not_refitted(monkeypatch, share, error, explains, refitted):
    made = {name: refit(0.3) for name in ("gradient", "tilt")}
    found = queue(monkeypatch, dict.fromkeys(made, 50.0), made)
    found.but_mesh = error, error
    found.ranking[1].refitted.share = share
    monkeypatch.setattr("fingerfit.diagnosis.worth.explains", lambda _: explains)
    assert names(one for one, _ in second_queue.refits_of(found, 1)) == ["gradient", "tilt"][: 1 + refitted]


@pytest.mark.parametrize(("share", "count"), [(0.76, 2), (0.74, 1)])
def test_effects_that_only_slopes_speak_for_are_compared_by_slopes(monkeypatch, share, count):
    """What the first pass refitted is compared by another measure."""
    made = dict.fromkeys(("contrast_drift", "intensity_drift"), refit(0.0, error=1.1))
    found = queue(monkeypatch, {"contrast_drift": 100.0, "intensity_drift": 100.0 * share}, made)
    for one in found.ranking:
        one.refitted = None
    assert len(list(second_queue.refits_of(found, 1))) == count
    tilt = queue(monkeypatch, {"tilt": 1000.0, **dict.fromkeys(made, 100.0)}, {"tilt": refit(0.1, error=1.1), **made})
    for one in tilt.ranking[1:]:
        one.refitted = None
    assert len(list(second_queue.refits_of(tilt, 1))) == 3


def test_simulations_of_a_refit_that_comes_to_nothing_count(monkeypatch, tmp_path):
    found = queue(monkeypatch, {"tilt": 100.0}, {})
    problem = found.comparison.problem
    problem.sims, problem.lost, found.ended = tmp_path, SimpleNamespace(why=lambda _: ""), lambda *_: None

    def lost(*_):
        for name in ("asked", "of_somebody_else"):
            (tmp_path / name).mkdir()
            (tmp_path / name / "solution.npz").touch()
        problem.asked.add("asked")
        raise StateError("no solution")

    monkeypatch.setattr(second_queue, "refit_anywhere", lost)
    refits = {}
    assert (second_queue.refit_best(found, refits, 1), refits) == (1, {})


def names(found):
    return [one.candidate.effect.name for one in found]


@pytest.mark.parametrize(
    "lost",
    [{"base_slip": refit(0.6, absent=True)}, {}, {"base_slip": replace(refit(0.6), missed=True)}],
    ids=["absent", "no solution", "missed"],
)
def test_where_a_refit_is_lost_the_likeliest_of_its_family_takes_its_place(monkeypatch, lost):
    odds = {"gradient": 110.0, "base_slip": 100.0, "soft_bed": 80.0, "debonding": 90.0, "tilt": 99.0}
    done = {"gradient": refit(0.1), **lost}
    found = queue(monkeypatch, odds, done)
    tried = {"gradient", "base_slip"}
    assert names(instead_of(found, tried, done)) == ["debonding"]
    # what else is lost of that family leaves room for the next one, and what has ended for none
    assert names(instead_of(found, {*tried, "debonding"}, done)) == ["soft_bed"]
    assert not instead_of(found, {*tried, "debonding"}, {**done, "debonding": refit(0.2)})


@pytest.mark.parametrize(("other", "count"), [(59.0, 1), (61.0, 0)])
def test_a_member_that_would_have_had_a_place_without_the_lost_one_takes_it(monkeypatch, other, count):
    """Much less likely than that, but likelier than one of another family that was refitted."""
    done = {"gradient": refit(0.1)}
    found = queue(monkeypatch, {"base_slip": 100.0, "gradient": other, "debonding": 60.0}, done)
    assert names(instead_of(found, {"gradient", "base_slip"}, done)) == ["debonding"] * count


def test_a_lost_probe_does_not_stand_for_its_members_any_more(monkeypatch):
    done = {"gradient": refit(0.1)}
    found = queue(monkeypatch, {"base_probe": 100.0, "gradient": 59.0, "debonding": 60.0}, done)
    monkeypatch.setattr(families, "spread_of", lambda *_: 1.0)
    monkeypatch.setattr(second_queue, "worth_a_refit", lambda score, ranking, *_: families.nominated(score, ranking))
    assert names(families.nominated(found.score_test, found.ranking)) == ["base_probe", "gradient"]
    assert names(instead_of(found, {"gradient", "base_probe"}, done)) == ["debonding"]


def test_a_refit_that_missed_its_minimum_says_so_and_makes_no_other_one_needless(monkeypatch):
    """It leaves more than the model without it, whatever its own covariance says."""
    made = {"tilt": refit(0.0, error=3.1), "skin": refit(0.0)}
    found, said = queue(monkeypatch, {"tilt": 100.0, "skin": 10.0}, made), []
    monkeypatch.setattr(second_queue, "tell", said.append)
    assert names(one for one, _ in second_queue.refits_of(found, 1)) == ["tilt", "skin"]
    assert said[0] == "refit: tilt (tilt of the indenter) found no minimum, and does not count; 0 simulations run"
    found = queue(monkeypatch, {"tilt": 100.0, "skin": 10.0}, {**made, "tilt": refit(0.0)})
    assert names(one for one, _ in second_queue.refits_of(found, 1)) == ["tilt"]


@pytest.mark.parametrize(("share", "count"), [(ENOUGH + 0.01, 1), (ENOUGH - 0.01, 0)])
def test_nothing_that_was_much_less_likely_does(monkeypatch, share, count):
    found = queue(monkeypatch, {"base_slip": 100.0, "debonding": 100.0 * share}, {})
    assert len(instead_of(found, {"base_slip"}, {})) == count


def test_places_of_lost_refits_are_taken_after_the_others(monkeypatch):
    made = {"base_slip": refit(0.6, 400.0, absent=True), "gradient": refit(0.3, 400.0), "debonding": refit(0.1, 300.0)}
    found = queue(monkeypatch, {"base_slip": 100.0, "gradient": 90.0, "debonding": 90.0}, made)
    monkeypatch.setattr(second_queue, "to_refit", lambda *_: found.ranking[:2])
    assert names(one for one, _ in second_queue.refits_of(found, 1)) == list(made)
