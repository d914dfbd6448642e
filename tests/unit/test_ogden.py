"""Stress and tangent of Ogden against finite differences and closed forms."""

import numpy as np
import pytest

from fingerfit.material.ogden import Ogden
from fingerfit.material.spread import spread

MATERIAL = Ogden((0.02, 0.01), (1.4, -2.0), (0.8, 5.0))
STRETCHES = {
    "distinct": [0.8, 1.1, 1.3],
    "double": [0.9, 0.9, 1.25],
    "triple": [1.05, 1.05, 1.05],
    "none": [1.0, 1.0, 1.0],
}


@pytest.mark.parametrize("name", STRETCHES)
def test_first_derivative_is_that_of_the_energy(name):
    stretch, h = np.array(STRETCHES[name]), 1e-6
    first, _ = MATERIAL.derivatives(stretch)
    for axis in range(3):
        step = np.eye(3)[axis] * h
        slope = (MATERIAL.energy(stretch * np.exp(step)) - MATERIAL.energy(stretch * np.exp(-step))) / (2 * h)
        assert first[axis] == pytest.approx(slope, abs=2e-9)


@pytest.mark.parametrize("name", STRETCHES)
def test_second_derivative_is_that_of_the_first(name):
    stretch, h = np.array(STRETCHES[name]), 1e-6
    _, second = MATERIAL.derivatives(stretch)
    for axis in range(3):
        step = np.eye(3)[axis] * h
        ahead, behind = (
            MATERIAL.derivatives(stretch * np.exp(step)),
            MATERIAL.derivatives(stretch * np.exp(-step)),
        )
        assert second[:, axis] == pytest.approx((ahead[0] - behind[0]) / (2 * h), abs=2e-8)


def test_small_strain_moduli():
    first, second = MATERIAL.derivatives(np.ones(3))
    bulk, shear = 2 / MATERIAL.d[0], sum(MATERIAL.mu)
    assert first == pytest.approx(np.zeros(3), abs=1e-15)
    assert second[0, 1] == pytest.approx(bulk - 2 * shear / 3, rel=1e-12)
    assert second[0, 0] == pytest.approx(bulk + 4 * shear / 3, rel=1e-12)


def test_constants_by_point_agree_with_single_materials():
    soft, hard = Ogden((0.02,), (1.4,), (1.0,)), Ogden((0.2,), (3.0,), (0.1,))
    stretch = np.array([[0.8, 1.1, 1.2], [0.9, 1.0, 1.1], [0.7, 1.2, 1.3]])
    first, second = spread([soft, hard], [1, 2]).derivatives(stretch)
    for row, material in enumerate((soft, hard, hard)):
        alone = material.derivatives(stretch[row])
        assert first[row] == pytest.approx(alone[0], rel=1e-13)
        assert second[row] == pytest.approx(alone[1], rel=1e-13)
