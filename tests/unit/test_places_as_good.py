"""Layers and borders that the first pass cannot tell apart are refitted as well, where the best one falls short."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_verdict import VALUES, World

from fingerfit.core.errors import StateError
from fingerfit.diagnosis import second_pass, tested
from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.evidence import Information
from fingerfit.diagnosis.families import ENOUGH, SURE
from fingerfit.diagnosis.ranking import Ranked, Refitted
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.second_pass import refit_anywhere
from fingerfit.diagnosis.trials import _Trial, _Tried, _within
from fingerfit.model.catalogue import catalogue

EFFECT = catalogue()["interface"]
PROMISED = 100.0


def at_border(border, fall=PROMISED):
    score_test = World().score_test(np.zeros(VALUES))
    columns = World().basis[:, 3:7]
    wide = np.full(4, np.inf)
    finding = replace(score_test.test(columns, -wide, wide), fall=fall)
    known = Information(np.zeros((4, 4)), np.zeros(4), np.zeros(4, bool))
    refitted = Refitted({}, 1000.0 - fall, True, (), 1, 1000, known)
    return Ranked(Candidate(EFFECT, {"interface.border": float(border)}), finding, columns, refitted)


def refitted(monkeypatch, falls):
    """Borders 2, 1 and 3 with the falls of their refits; None has no solution."""
    asked = []

    def refit_of(before, one, *_):
        border = one.candidate.place["interface.border"]
        asked.append(border)
        if falls[border] is None:
            raise StateError("no solution")
        return Refit(0.0, VALUES, 1.0, 1.0, {}, fall=falls[border])

    monkeypatch.setattr(second_pass, "refit_of", refit_of)
    one = replace(at_border(2), also=(at_border(1), at_border(3)))
    refit, place = refit_anywhere(None, one, 1)
    return refit.fall, place, asked


def test_a_refit_that_does_what_was_promised_needs_no_other_place(monkeypatch):
    found = refitted(monkeypatch, {2: ENOUGH * PROMISED, 1: 300.0, 3: 300.0})
    assert found == (ENOUGH * PROMISED, 0, [2.0])


@pytest.mark.parametrize(
    ("falls", "expected"),
    [
        ({2: 55.0, 1: 120.0, 3: 300.0}, (120.0, 1, [2.0, 1.0])),
        ({2: 55.0, 1: 20.0, 3: 60.0}, (60.0, 2, [2.0, 1.0, 3.0])),
        ({2: None, 1: None, 3: 20.0}, (20.0, 2, [2.0, 1.0, 3.0])),
    ],
)
def test_one_that_falls_short_is_tried_at_the_others_and_the_best_one_stays(monkeypatch, falls, expected):
    assert refitted(monkeypatch, falls) == expected


def test_no_solution_at_any_place_is_said(monkeypatch):
    with pytest.raises(StateError, match="interface: no solution at any of its places"):
        refitted(monkeypatch, {2: None, 1: None, 3: None})


def test_the_effect_moves_in_the_ranking():
    one, other = replace(at_border(2), also=(at_border(1), at_border(3))), at_border(4)
    found = tested.Tested(None, None, [], [other, one], 1, 0, {}, None)
    there = found.moved(one, 2)
    assert there is one.also[1]
    assert found.ranking == [other, there]


@pytest.mark.parametrize(("behind", "count"), [(2.0 * SURE - 0.1, 1), (2.0 * SURE + 0.1, 0)])
def test_places_are_as_good_where_their_odds_do_not_tell(monkeypatch, behind, count):
    """The other one at the same border, from another start, is none."""
    best, other = at_border(2), at_border(1, PROMISED - behind)
    monkeypatch.setattr(_Trial, "_begun", lambda _, one: _Tried(one, frozenset(), 1.0))
    places = {"interface": [other, at_border(2, PROMISED - 1.0)]}
    begun = _Trial(None, best.refitted, places).begun(best)
    assert begun.ranked.candidate is best.candidate
    assert [one.candidate for one in begun.ranked.also] == [other.candidate] * count
    assert [one.ranked for one in begun.rivals] == [other] * count


def test_a_place_that_needs_fewer_numbers_may_be_likelier_than_one_that_leaves_less(monkeypatch):
    """By odds of four numbers against one, each known to a thirtieth of its likely size."""
    many, few = at_border(2), at_border(1, PROMISED - 8.0)
    some = np.full(4, True)
    many, few = (
        replace(one, refitted=replace(one.refitted, information=Information(900.0 * np.eye(4), far, some, True)))
        for one, far in ((many, np.full(4, 0.5)), (few, np.array([0.5, 0.0, 0.0, 0.0])))
    )
    monkeypatch.setattr(_Trial, "_begun", lambda _, one: _Tried(one, frozenset(), 1.0))
    begun = _Trial(None, many.refitted, {"interface": [few]}).begun(many)
    assert begun.ranked.candidate is few.candidate


@pytest.mark.parametrize(
    ("starts", "tried", "further"),
    [(100, "abc", [2, 1, 2]), (6, "abc", [2, 1, 0]), (3, "abc", [0, 0, 0]), (2, "ab", [0, 0])],
)
def test_so_many_starts_are_made_the_likeliest_effects_by_slopes_first(monkeypatch, starts, tried, further):
    """First the best place of each effect, then the further ones of the likeliest."""

    def promised(name, fall):
        return replace(at_border(2, fall), candidate=Candidate(replace(EFFECT, name=name), {}), refitted=None)

    every = [promised("b", 200.0), promised("c", 100.0), promised("a", 300.0)]
    others = {"a": [1, 2], "b": [1], "c": [1, 2]}
    monkeypatch.setattr("fingerfit.diagnosis.trials.other_places", lambda _, __, one: others[one.candidate.effect.name])
    seen, left_out, places = _within(starts, every, [], SimpleNamespace(misfit=1000.0, freedom=1000))
    assert "".join(sorted(one.candidate.effect.name for one in seen)) == tried
    assert [len(places[name]) for name in tried] == further
    assert len(left_out) == 3 - len(tried)
    assert all(places[name] == others[name][: len(places[name])] for name in tried)
