"""Eigenvalues and eigenvectors of many symmetric matrices, against LAPACK's."""

import numpy as np
import pytest
from seeds import generator

from fingerfit.fem.eigen import eigen


def stretched(rng, count, size):
    """Right Cauchy-Green tensors of deformations that are as far from none as a size."""
    f = np.eye(3) + size * rng.normal(size=(count, 3, 3))
    return np.swapaxes(f, 1, 2) @ f


def check(matrices):
    values, vectors = eigen(matrices)
    assert values.shape == matrices.shape[:-1]
    assert vectors.shape == matrices.shape
    scale = np.abs(matrices).max(axis=(-1, -2), initial=1e-300)
    again = np.einsum("...ij,...j,...kj->...ik", vectors, values, vectors)
    assert (np.abs(again - matrices).max(axis=(-1, -2)) <= 1e-14 * scale).all()
    assert np.swapaxes(vectors, -1, -2) @ vectors == pytest.approx(np.broadcast_to(np.eye(3), vectors.shape), abs=1e-14)
    known = np.linalg.eigvalsh(matrices)
    assert (np.abs(np.sort(values, axis=-1) - known).max(axis=-1) <= 1e-14 * scale).all()
    return values, vectors


@pytest.mark.parametrize("size", [0.5, 1e-3, 1e-8, 1e-12, 1e-16, 0.0])
def test_those_of_lapack_also_near_equal_ones(size):
    check(stretched(generator(1), 500, size))


def test_more_than_are_worked_on_at_once_in_any_shape():
    many = stretched(generator(2), 4096 + 700, 0.3)
    values, vectors = check(many)
    again = eigen(many.reshape(109, 44, 3, 3))
    assert np.array_equal(again[0].reshape(-1, 3), values)
    assert np.array_equal(again[1].reshape(-1, 3, 3), vectors)
    # of one matrix the same digits, whatever is beside it
    assert np.array_equal(eigen(many[:5])[0], values[:5])
    check(np.empty((0, 3, 3)))


@pytest.mark.parametrize("scale", [1e-140, 1e-20, 1e20, 1e140, 1e200])
def test_at_any_size(scale):
    check(stretched(generator(3), 50, 0.4) * scale)


def test_two_or_three_equal_ones():
    turn = np.linalg.qr(generator(4).normal(size=(100, 3, 3)))[0]
    for stretches in ([1.2, 1.2, 0.7], [0.7, 1.2, 1.2], [1.0, 1.0, 1.0], [2.0, 0.5, 0.5], [0.0, 0.0, 3.0]):
        whole = turn @ (np.array(stretches)[:, None] * np.swapaxes(turn, 1, 2))
        check((whole + np.swapaxes(whole, 1, 2)) / 2)
