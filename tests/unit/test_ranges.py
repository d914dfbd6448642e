"""How far constants may be off by leaving out one part of the data after the other."""

from types import SimpleNamespace

import numpy as np
import pytest
from seeds import generator

from fingerfit.diagnosis.ranges import left_out, parts_of_data

PATCHES, STEPS, FORCES = 16, 3, 8


def compared(vector, own):
    """Values at the places of a square, in three pictures, and forces; the noise is 1."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0))
    count = PATCHES * STEPS * 3 + FORCES
    one = SimpleNamespace(
        residual=SimpleNamespace(kept=np.ones(count, dtype=bool), value=np.zeros((STEPS, PATCHES, 3)), vector=vector),
        data=SimpleNamespace(step=np.arange(FORCES), response_step=np.arange(FORCES)),
        patches=SimpleNamespace(centre=np.stack([x.ravel(), y.ravel()], axis=1)),
        covariance=np.eye(count),
        own=lambda: own,
        nuisance=lambda: np.zeros((count, 0)),
        known=(np.zeros(0), np.zeros((0, 1))),
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
    half.residual.vector = np.where(parts_of_data(half) % 2 == 0, 1.0, -1.0)
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
