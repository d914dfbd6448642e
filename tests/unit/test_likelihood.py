"""Models are compared by one likelihood: a covariance of its own must not make a worse model look better."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import generator

from fingerfit.diagnosis.likelihood import Weighed, misfits
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.second_queue import by_one_likelihood
from fingerfit.diagnosis.verdict import MATTERS

COUNT = 200


def model(offset, noise, kept=None, seed=1):
    """A model of two numbers that leaves noise and a pattern that they cannot follow, and says how large the noise is."""
    rng = generator(seed)
    kept = np.ones(COUNT, dtype=bool) if kept is None else kept
    own, pattern = rng.normal(size=(COUNT, 2)), rng.normal(size=COUNT)
    vector = 0.1 * rng.normal(size=COUNT) + offset * pattern
    return Weighed(kept, vector[kept], own[kept], noise**2 * np.eye(kept.sum()), np.zeros((kept.sum(), 1)))


def test_a_worse_model_with_a_wider_covariance_is_worse():
    good, bad = model(0.0, 0.1), model(0.3, 1.0)
    own = {name: misfits({name: one}, name)[name] for name, one in (("good", good), ("bad", bad))}
    assert own["bad"] < own["good"]
    common = misfits({"good": good, "bad": bad}, "good")
    assert common["good"] == pytest.approx(own["good"])
    # the pattern adds 0.3^2 / 0.1^2 for each value that the two numbers leave free; five standard deviations
    added = (COUNT - 2) * 9.0
    assert common["bad"] - common["good"] == pytest.approx(added, abs=5 * np.sqrt(2 * (COUNT - 2)) * (9 + 2 * 3))


def test_only_values_that_all_know_count():
    few = np.arange(COUNT) % 2 == 0
    all_of_it, half = model(0.0, 0.1), model(0.0, 0.1, few)
    found = misfits({"all": all_of_it, "half": half}, "all")
    assert found["all"] == pytest.approx(found["half"])
    assert found["half"] == pytest.approx(misfits({"half": half}, "half")["half"])


def test_the_one_that_comes_nearest_weighs_all():
    good, bad = model(0.0, 0.1), model(0.3, 1.0)
    refits = {
        "bad": Refit(50.0, COUNT - 2, 2.5, 1.4, {}, weighed=bad),
        "good": Refit(198.0, COUNT - 2, 0.85, 0.84, {}, weighed=good),
        "unknown": Refit(300.0, COUNT - 2, 0.9, 0.9, {}),
    }
    without = model(0.6, 0.1)
    found = by_one_likelihood(refits, without)
    assert found["bad"].level > found["good"].level
    assert found["good"].level == pytest.approx(misfits({"good": good}, "good")["good"])
    assert found["unknown"].level == 300.0
    assert by_one_likelihood({}, without) == {}
    both = misfits({"good": good, "without": without}, "good")
    assert found["good"].gain(1.0) == pytest.approx(both["without"] - both["good"])


def test_of_several_that_come_as_near_no_one_decides_alone():
    """By the covariance of the one that forgives much both leave nearly the same."""
    good, forgiving = model(0.0, 0.1), model(0.3, 10.0)
    models = {"good": good, "forgiving": forgiving}
    refits = {
        "forgiving": Refit(1.0, COUNT - 2, 0.85, 0.84, {}, weighed=forgiving),
        "good": Refit(198.0, COUNT - 2, 0.85 + 0.9 * MATTERS, 0.84, {}, weighed=good),
    }
    each = [misfits(models, name) for name in models]
    alone = each[1]
    assert alone["forgiving"] - alone["good"] < 1.0
    found = by_one_likelihood(refits, model(0.6, 0.1))
    for name in models:
        assert found[name].level == pytest.approx(np.mean([one[name] for one in each]))
    assert found["forgiving"].level - found["good"].level > 100.0
    # one that is clearly nearer does
    far = {**refits, "good": replace(refits["good"], fitted=0.85 + 1.1 * MATTERS)}
    assert by_one_likelihood(far, model(0.6, 0.1))["good"].level == pytest.approx(alone["good"])


def test_a_better_mesh_is_not_held_against_an_effect():
    # by its own covariance, which forgives much, the model without the effect seems as good as the one with it
    without, better = model(0.3, 1.0), model(0.1, 0.1)
    own = {name: misfits({name: one}, name)[name] for name, one in (("without", without), ("better", better))}
    assert own["without"] < own["better"]
    refit = Refit(own["better"], COUNT - 2, 1.2, 1.2, {}, weighed=better)
    assert refit.gain(own["without"]) < 0
    refit = by_one_likelihood({"effect": refit}, without)["effect"]
    # a pattern of three times the noise leaves 10 for each value, one of the noise 2, the noise alone 1
    assert refit.explained(own["without"]) == pytest.approx(8 / 9, abs=0.1)


def test_an_effect_that_ends_at_its_absent_values_earns_nothing():
    """It is the model without it, better fitted: what another one explains counts from there."""
    without, nearer, other = model(0.6, 0.1), model(0.1, 0.1), model(0.2, 0.1)
    made = {
        name: Refit(198.0, COUNT - 2, 1.0, 1.0, {}, weighed=one, numbers=1, fall=fall, absent=absent)
        for name, one, fall, absent in (("second_term", nearer, 45.0, True), ("relaxation", other, 40.0, False))
    }
    found = by_one_likelihood(made, without)
    assert found["second_term"].gain(0.0) == found["second_term"].earned == 0.0
    assert found["relaxation"].gain(0.0) < 0.0
    assert found["relaxation"].earned == -5.0
    assert by_one_likelihood(found, without) == found
    # one that did not end there is an effect
    there = by_one_likelihood({name: replace(one, absent=False) for name, one in made.items()}, without)
    assert all(one.gain(0.0) > 0.0 and one.earned == one.fall for one in there.values())
