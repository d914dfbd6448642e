"""Numbers of effects on the observation by least squares, against closed forms."""

import numpy as np
import pytest
from test_refine import one_picture

from fingerfit.fit.linear import LinearModel
from fingerfit.fit.observed import Observed
from fingerfit.forward.score import Prediction

NOISE = 0.01
ENDS = np.full(3, -0.5), np.full(3, 0.5)


def predicted(pictures):
    return Prediction(pictures, np.zeros(1), np.zeros((0, 2)))


def data_of(pictures):
    return one_picture(pictures, NOISE / np.sqrt(2.0))


@pytest.fixture
def body(rng):
    """A constant, a brightness, and a brightness of a picture that is not fitted."""
    base, moving, bright = rng.normal(size=(3, 1, 6, 8))
    model = LinearModel(
        predicted(base), (predicted(moving), predicted(bright), predicted(0 * base)), predicted(0 * base), {}
    )
    return model, data_of(base), np.array([False, True, True])


def test_they_are_found_and_what_changes_nothing_stays(body):
    model, data, which = body
    measured = data_of(model.at(np.array([0.0, 0.2, 0.0])).pictures)
    assert Observed(which, measured, model).moves(*ENDS, model.base) == pytest.approx([0.2, 0.0])
    assert Observed(which, data, model).repeated(predicted(0 * data.measured), measured) == pytest.approx([0.2, 0.0])


def test_bounds_hold(body):
    model, _, which = body
    measured = data_of(model.at(np.array([0.0, 0.8, 0.0])).pictures)
    assert Observed(which, measured, model).moves(*ENDS, model.base)[0] == pytest.approx(0.5)


def test_they_follow_the_constants(body):
    model, data, which = body
    moving, bright = (slope.pictures.ravel() for slope in model.slopes[:2])
    found = Observed(which, data, model).follow(np.array([[0.1, 9.0, 9.0], [-0.2, 9.0, 9.0]]))
    share = -(bright @ moving) / (bright @ bright)
    assert found == pytest.approx(np.array([[0.1 * share, 0.0], [-0.2 * share, 0.0]]))


def test_repetitions_spread_as_their_curvature_says(body, rng):
    """Of 400 draws a standard deviation is known to 3.5 %."""
    model, data, which = body
    squares = Observed(which, data, model)
    assert np.linalg.matrix_rank(squares.curvature) == 1
    noise = [rng.normal(0.0, NOISE, data.measured.shape) for _ in range(400)]
    found = [squares.repeated(predicted(0 * one), data_of(data.measured + one))[0] for one in noise]
    assert np.std(found) == pytest.approx(squares.curvature[0, 0] ** -0.5, rel=0.16)
