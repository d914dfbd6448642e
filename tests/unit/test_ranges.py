"""How far constants may be off by leaving out one part of the data after the other, and by effects not excluded."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from seeds import generator
from test_verdict import VALUES, World

from fingerfit.diagnosis.evidence import Information
from fingerfit.diagnosis.ranges import EXCLUDED, left_out, not_excluded, parts_of_data, ranges, with_effects
from fingerfit.diagnosis.ranking import Refitted
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.score_tests import Known
from fingerfit.model.parameters import Parameter

PATCHES, STEPS, FORCES = 16, 3, 8


def compared(vector, own):
    """Values at the places of a square, in three pictures, and forces; the noise is 1."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0))
    count = PATCHES * STEPS * 3 + FORCES
    one = SimpleNamespace(
        kept=np.ones(count, dtype=bool),
        vector=vector,
        residual=SimpleNamespace(value=np.zeros((STEPS, PATCHES, 3))),
        data=SimpleNamespace(step=np.arange(FORCES), response_step=np.arange(FORCES)),
        patches=SimpleNamespace(centre=np.stack([x.ravel(), y.ravel()], axis=1)),
        covariance=np.eye(count),
        own=lambda: own,
        nuisance=lambda: np.zeros((count, 0)),
        known=Known.nothing(1),
    )
    one.every = (one,)
    return one


def test_four_corners_of_the_body_and_four_parts_of_the_forces():
    count = PATCHES * STEPS * 3 + FORCES
    parts = parts_of_data(compared(np.zeros(count), np.ones((count, 1))))
    assert np.bincount(parts).tolist() == [36, 36, 36, 36, 2, 2, 2, 2]


def test_a_residual_that_is_alike_everywhere_moves_nothing_and_one_that_is_not_moves_all():
    count = PATCHES * STEPS * 3 + FORCES
    own = np.ones((count, 1))
    assert left_out(compared(np.ones(count), own))[0] == pytest.approx(0.0, abs=1e-12)
    half = compared(np.zeros(count), own)
    half.vector = np.where(parts_of_data(half) % 2 == 0, 1.0, -1.0)
    spread, groups = left_out(half)
    # the mean of all is 0; without a part of n values of +-1 it is -+n / (count - n)
    moves = np.repeat([36 / (count - 36), 2 / (count - 2)], 4) * np.tile([-1, 1], 4)
    assert groups == 8
    assert spread == pytest.approx(np.sqrt(7 / 8 * np.sum((moves - moves.mean()) ** 2)))


def test_noise_alone_gives_the_standard_error():
    rng, count = generator(4), PATCHES * STEPS * 3 + FORCES
    own = np.ones((count, 1))
    found = [left_out(compared(rng.standard_normal(count), own))[0][0] ** 2 for _ in range(400)]
    # parts of unlike size: expected 1.13 times the variance of the mean
    sizes = np.repeat([36, 2], 4)
    moves = sizes / (count - sizes) / count  # variance of what leaving out a part moves, about its mean over parts
    assert np.mean(found) == pytest.approx(7 / 8 * moves.sum(), rel=0.3)


def test_one_part_of_the_data_has_no_spread_but_the_interval_is_told():
    """As one force beside a prior that contradicts it: there is nothing to leave out."""
    one = SimpleNamespace(
        kept=np.array([True]),
        vector=np.array([9.0]),
        residual=SimpleNamespace(value=np.zeros((0, PATCHES, 3))),
        data=SimpleNamespace(step=np.arange(1), response_step=np.arange(1)),
        patches=SimpleNamespace(centre=np.zeros((PATCHES, 2))),
        covariance=np.eye(1),
        own=lambda: np.ones((1, 1)),
        nuisance=lambda: np.zeros((1, 0)),
        known=Known(np.array([9.0]), np.ones((1, 1)), np.zeros(1, dtype=bool)),
        score_test=SimpleNamespace(freedom=1, misfit=81.0),
        problem=SimpleNamespace(
            settings=SimpleNamespace(parameters=lambda: (Parameter("mu", "MPa", 0.01, 10.0, 1.0),))
        ),
    )
    one.every = (one,)
    found = ranges(one, [], {"mu": {"value": 1.0, "interval95": [0.9, 1.1]}})
    assert found["mu"] == pytest.approx((0.9, 1.1))


TESTS = 400
LIKELY = 2 * np.log(EXCLUDED * TESTS)
"""Fall of the misfit from which an effect is not excluded, where its numbers are as sure before as after."""


def falls_by(fall, converged=True, found=None):
    """An effect that lowers the misfit by as much, refitted; what the second pass found of it."""
    world = World()
    score_test = world.score_test(0.0 * world.signal(0))
    (one,) = world.ranking(score_test, tilt=np.sqrt(fall) * world.signal(0))
    one = replace(one, finding=replace(one.finding, fall=fall))
    known = Information(np.zeros((1, 1)), np.zeros(1), np.zeros(1, bool))
    refitted = Refitted({"mu": 1.5}, float(VALUES), converged, (), 0, VALUES, known)
    ranking = [replace(one, refitted=refitted)]
    refits = {} if found is None else {"tilt": Refit(200.0, VALUES, 1.0, 1.0, {"mu": 1.2}, fall=found)}
    return ranking, refits, not_excluded(ranking, score_test, refits, TESTS)


@pytest.mark.parametrize(
    ("fall", "converged", "found", "count"),
    [
        (1.1 * LIKELY, True, None, 1),
        (0.9 * LIKELY, True, None, 0),
        (1.1 * LIKELY, False, None, 0),
        (1.1 * LIKELY, True, 0.9 * LIKELY, 0),  # the second pass explains less than the first one promised
        (1.1 * LIKELY, True, 2.0 * LIKELY, 1),
    ],
)
def test_an_effect_is_excluded_as_surely_as_a_constant_outside_of_its_interval(fall, converged, found, count):
    assert len(falls_by(fall, converged, found)[2]) == count


@pytest.mark.parametrize(("found", "highest"), [(None, 1.5 * 1.1), (2 * LIKELY, 1.2 * 1.1)])
def test_intervals_reach_to_constants_with_an_effect_that_is_not_excluded(found, highest):
    ranking, refits, maybe = falls_by(1.1 * LIKELY, found=found)
    assert maybe == ranking
    estimate = {"mu": {"value": 1.0, "interval95": [0.9, 1.1]}}
    parameters = (Parameter("mu", "MPa", 0.01, 10.0, 1.0, True),)
    assert with_effects(parameters, maybe, refits, estimate)["mu"] == pytest.approx((0.9, highest))
    assert with_effects(parameters, [], refits, estimate) == {}
