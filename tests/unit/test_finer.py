"""What a finer mesh changes, where its body goes through itself from some step on."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.diagnosis.finer import continued

SIZE = np.array([1.0, 2.0, 4.0, 5.0])


def measured(pictures, points):
    """Steps with pictures and with points, by their indices."""
    found = {"picture_step": np.array(pictures, dtype=int), "points_step": np.repeat(points, 3)}
    return SimpleNamespace(step=np.arange(1, 5), controlled=SIZE, **found)


def test_a_change_is_continued_with_the_prescribed_quantity(rng):
    data = measured([0, 2, 3], [1, 3])
    pattern = rng.normal(size=(6, 3))
    value = np.array([SIZE[step] * pattern for step in (0, 2, 3, 1, 3)])
    response = np.concatenate([0.1 * SIZE, -0.3 * SIZE])  # along the load, and aside
    broken = value.copy(), response.copy()
    broken[0][[1, 2, 4]] += 1e3
    broken[1][[2, 3, 6, 7]] += 1e3
    found = continued(*broken, data, 2)
    assert found[0] == pytest.approx(value)
    assert found[1] == pytest.approx(response)
    assert continued(value, response, data, 4)[0] == pytest.approx(value)


def test_nothing_is_known_of_a_body_that_goes_through_itself_from_the_first_picture_on(rng):
    value, response = rng.normal(size=(2, 6, 3)), rng.normal(size=4)
    found = continued(value, response, measured([1, 3], []), 1)
    assert not found[0].any()
    assert found[1] == pytest.approx(response[0] * SIZE)
