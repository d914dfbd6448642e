"""The noise of measured points in the score: the covariance of the diagnosis, of all points at once."""

import numpy as np
import pytest

from fingerfit.forward.score import Prediction, chi_square, deviations
from fingerfit.study.data import Data

STEPS, FRAME, NOISE = 3, 0.03, 0.02


def data_of(rng, counts, covariance):
    """Points of a body at some steps, as many at each as `counts` says."""
    step = np.repeat(np.arange(STEPS), counts)
    places = rng.uniform(size=(max(counts), 2))
    points = np.concatenate([places[:count] for count in counts])
    none = np.zeros((0, 4, 4))
    return Data(
        np.arange(1, STEPS + 1), np.full(STEPS, 0.1), np.full(STEPS, np.nan), "force", 0.001, 0.0, 0.0, NOISE,
        none[:0], none[:0], none, np.zeros(0, dtype=int), np.ones(2), np.zeros(2), np.eye(2), 0.0, 1.0,
        points, rng.normal(size=points.shape), step, points_covariance=covariance, frame_noise=FRAME,
    )  # fmt: skip


def covariance_of(data):
    """Of one component of all points: rows and columns as the points are listed."""
    step = data.points_step
    place = np.concatenate([np.arange(count) for count in np.bincount(step)])
    between = data.between_steps[np.ix_(step, step)] * (place[:, None] == place)
    return between + FRAME**2 * (step[:, None] == step)


def alike(rng):
    """A covariance between steps: the errors of a point are alike by 0.9 and more."""
    root = NOISE * (1.0 + 0.2 * rng.normal(size=(STEPS, STEPS)))
    return root @ root.T + (0.2 * NOISE) ** 2 * np.eye(STEPS)


@pytest.mark.parametrize("counts", [(9, 9, 9), (1, 1, 1), (9, 0, 9)])
def test_a_point_that_is_off_alike_at_all_steps_counts_once(rng, counts):
    data = data_of(rng, counts, alike(rng))
    predicted = Prediction(np.zeros((0, 4, 4)), np.full(STEPS, np.nan), rng.normal(size=data.points.shape))
    away = predicted.points - data.points_displacement
    whole = np.sum(away * np.linalg.solve(covariance_of(data), away))
    assert chi_square(predicted, data)["points"] == pytest.approx(whole, rel=1e-9)


@pytest.mark.parametrize("counts", [(9, 9, 9), (9, 4, 7)])
def test_points_that_shift_together_count_as_one_shift(rng, counts):
    """With a stated noise steps may have different points."""
    data = data_of(rng, counts, np.zeros((0, 0)))
    predicted = Prediction(np.zeros((0, 4, 4)), np.full(STEPS, np.nan), rng.normal(size=data.points.shape))
    away = predicted.points - data.points_displacement
    whole = np.sum(away * np.linalg.solve(covariance_of(data), away))
    assert chi_square(predicted, data)["points"] == pytest.approx(whole, rel=1e-9)


def test_differences_that_rounding_makes_do_not_count_as_known(rng):
    """Errors of a point that are the same at all steps leave no noise of their difference."""
    data = data_of(rng, (5, 5, 5), np.full((STEPS, STEPS), NOISE**2))
    predicted = Prediction(np.zeros((0, 4, 4)), np.full(STEPS, np.nan), rng.normal(size=data.points.shape))
    assert np.isfinite(deviations(predicted, data)).all()
