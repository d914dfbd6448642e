"""Predictions of many guesses: pictures of volumes lie on disk, those of the plane in memory."""

import tracemalloc

import numpy as np
import pytest

from fingerfit.fit.aside import predicted
from fingerfit.forward.predict import Synthesis
from fingerfit.forward.score import Prediction

VOLUMES = (2, 20, 24, 28)
PICTURES = (2, 200, 240)
NONE = (0, 20, 24, 28)
"""Of a body in space whose forces alone were measured."""
GUESSES = range(12)


def made(number, shape):
    """Pictures that say whose they are; one guess has no solution."""
    if number == 5:
        return None
    pictures = np.full(shape, float(number))
    pictures[-1:, -1] = np.arange(shape[-1])
    return Synthesis(Prediction(pictures, np.full(2, number / 3), np.zeros((0, 2))), [])


@pytest.mark.parametrize("processes", [1, 2])
@pytest.mark.parametrize("shape", [VOLUMES, PICTURES, NONE])
def test_each_guess_has_its_own_pictures(shape, processes, tmp_path):
    found = predicted(lambda n: made(n, shape), GUESSES, shape, tmp_path, processes)
    assert found[5] is None
    for number in set(GUESSES) - {5}:
        prediction, folds = found[number]
        wanted = made(number, shape).prediction
        assert not folds
        assert np.array_equal(prediction.pictures, wanted.pictures)
        assert np.array_equal(prediction.response, wanted.response)
        assert np.array_equal((prediction - wanted).pictures, np.zeros(shape))
    assert list(tmp_path.iterdir()) == []


def test_volumes_take_no_memory(tmp_path):
    """A fit of volumes by thirty numbers makes sixty predictions: with their slopes these took 22 GB, and it was killed."""

    def peak(count):
        tracemalloc.start()
        found = predicted(lambda n: made(n, VOLUMES), range(count), VOLUMES, tmp_path, 1)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert len(found) == count
        return most

    peak(1)
    pictures = made(0, VOLUMES).prediction.pictures.nbytes
    # in memory it would be all of their pictures
    assert peak(5) - peak(1) < 0.2 * 4 * pictures
