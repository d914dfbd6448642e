"""The blur of a camera stays where it is while the body is deformed: against textures that are known everywhere."""

import numpy as np
import pytest
from seeds import generator

from fingerfit.imaging.blur import blurred_in_place
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import backward_map, spline_coefficients, warp
from fingerfit.mesh.blocks import brick, layered_block

PIXEL = np.array([0.2, 0.25, 0.3])


def waves(dim, rng):
    """Wave vectors, 1/mm, of 8 to 20 pixels, and phases."""
    vectors = rng.normal(size=(12, dim))
    vectors *= (2 * np.pi / (PIXEL[0] * rng.uniform(8, 20, 12)) / np.linalg.norm(vectors, axis=1))[:, None]
    return vectors, rng.uniform(0, 2 * np.pi, 12)


def seen(points, vectors, phases, deformation, sigma):
    """The deformed texture, blurred by a Gaussian of `sigma` mm in the picture: each wave is dampened."""
    inside = vectors @ np.linalg.inv(deformation)
    dampened = np.exp(-0.5 * sigma**2 * (inside**2).sum(axis=1))
    return 1 + 0.1 * (dampened * np.cos(points @ inside.T + phases)).sum(axis=-1)


def pictures(dim, deformation, sigma, rng):
    """The measured picture, the warped one, its map, and where it is inside of the body."""
    size = 8.0
    mesh = brick((size, size, size), (3, 3, 3)) if dim == 3 else layered_block(size, [("a", size)], 3, 3)
    shape = tuple(np.ceil(size * 1.6 / PIXEL[:dim]).astype(int))[::-1]
    origin, pixel = np.full(dim, -0.3 * size), PIXEL[:dim]
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")[::-1], axis=-1)
    places, known = origin + index * pixel, waves(dim, rng)
    before = Picture(seen(places, *known, np.eye(dim), sigma), pixel, origin, np.eye(dim))
    way = backward_map(mesh, mesh.points @ (deformation - np.eye(dim)).T, before, 1.5)
    warped = warp(spline_coefficients(before.values), 0.0, way, 0.0)
    back = places @ np.linalg.inv(deformation).T
    inner = ((back > 3 * PIXEL[2]) & (back < size - 3 * PIXEL[2])).all(axis=-1)
    return seen(places, *known, deformation, sigma), warped, way, inner


@pytest.mark.parametrize("dim", [2, 3])
def test_what_the_warp_makes_of_the_blur_is_taken_back(dim):
    """To first order: what is left is about half the square of what the warp changes of a wave, here at most 0.1."""
    deformation = np.array([[1.08, 0.1, 0.0], [0.0, 0.85, 0.0], [0.0, 0.0, 1.08]])[:dim, :dim]
    measured, warped, way, inner = pictures(dim, deformation, 0.25, generator(3))
    made = blurred_in_place(warped, way, 0.25 / PIXEL[:dim])
    before, after = (np.sqrt(np.mean((one - measured)[inner] ** 2)) for one in (warped, made))
    assert before > 0.01 * measured[inner].std()
    assert after < 0.2 * before


@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_that_turns_or_stays_keeps_its_blur(dim):
    turned = np.eye(3)
    turned[:2, :2] = [[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]]
    for deformation in (np.eye(dim), turned[:dim, :dim]):
        _, warped, way, inner = pictures(dim, deformation, 0.25, generator(3))
        made = blurred_in_place(warped, way, np.full(dim, 0.25) / PIXEL[:dim])
        assert made[inner] == pytest.approx(warped[inner], abs=1e-9)
        assert np.array_equal(made.ravel()[np.setdiff1d(np.arange(made.size), way.pixel)],
                              warped.ravel()[np.setdiff1d(np.arange(made.size), way.pixel)])  # fmt: skip
