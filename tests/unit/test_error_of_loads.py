"""What the noise of a load makes of a picture is no error of the model, as far as chance makes it."""

from types import SimpleNamespace

import numpy as np
import pytest
import seeds

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.residual import Residual

PIXELS, NOISE = 40_000, 0.02
"""A root mean square of so many pixels varies by 0.35 %, that of two of them together by 0.5 %: 2 % are four times that."""
SHARE = 0.03
"""Noise of the load, as a share of it."""


def compared(off, rest=0.0, noise=SHARE):
    """A picture with noise in which the load is off by so many standard deviations, and a model by `rest` elsewhere."""
    rng = seeds.generator(0)
    along, across = (part.reshape(1, 200, 200) for part in rng.standard_normal((2, PIXELS)))
    left = NOISE * rng.standard_normal(along.shape) + SHARE * off * along + rest * across
    found = object.__new__(Comparison)
    found.last = SimpleNamespace(batch=[SimpleNamespace(role=sign + "control", sign=sign) for sign in "+-"])
    found.pictures = lambda asked: along * {"+": 0.03, "-": -0.03}[asked.sign]
    found.data = SimpleNamespace(picture_step=np.array([0]), measured=left, control_share=np.array([noise]))
    found.prediction = SimpleNamespace(pictures=np.zeros_like(left))
    way = SimpleNamespace(pixel=np.arange(PIXELS))
    nothing = np.zeros(0)
    error, floor = np.array([np.sqrt(np.mean(left**2))]), np.array([NOISE])
    found.residual = Residual(nothing, nothing, nothing, nothing, error, floor, (way,))
    return found


@pytest.mark.parametrize("off", [-2.9, -1.0, 0.0, 0.5, 2.9])
def test_a_load_that_is_off_by_chance_is_as_its_noise_on_average(off):
    found = compared(off)
    assert found.floor == pytest.approx(np.hypot(NOISE, SHARE), rel=0.02)
    assert found.error / found.floor == pytest.approx(1.0, abs=0.02)


def test_what_chance_does_not_make_counts():
    """Of five standard deviations 17 of 25 squares count; a pattern of another form counts as it is."""
    found = compared(5.0)
    assert found.error == pytest.approx(np.sqrt(NOISE**2 + 17 * SHARE**2), rel=0.02)
    assert compared(1.0, rest=0.05).error == pytest.approx(np.sqrt(NOISE**2 + SHARE**2 + 0.05**2), rel=0.02)


def test_a_load_without_noise_makes_nothing():
    found = compared(1.0, noise=0.0)
    assert found.floor == pytest.approx(NOISE) and found.error == pytest.approx(found.residual.error)
