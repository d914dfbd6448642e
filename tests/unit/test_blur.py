"""The blur of a camera stays where it is while the body is deformed: against textures that are known everywhere."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import generator

from fingerfit.diagnosis.camera_blur import camera_blur
from fingerfit.forward.patches import Patches
from fingerfit.forward.predict import Synthesis
from fingerfit.forward.score import Prediction
from fingerfit.imaging.blur import blurred_in_place
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import backward_map, spline_coefficients, warp
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.study.data import Data

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


SIZE = 8.0


def body(dim):
    return brick((SIZE, SIZE, SIZE), (3, 3, 3)) if dim == 3 else layered_block(SIZE, [("a", SIZE)], 3, 3)


def pictures(dim, deformation, sigma, rng):
    """The measured picture, the warped one, its map, and where it is inside of the body."""
    size, mesh = SIZE, body(dim)
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


def test_no_more_than_the_blur_itself_is_taken_back():
    """Where a map is all but singular, as at the corner of a glued edge, first order would be a hundred times as much."""
    _, warped, way, inner = pictures(2, np.eye(2), 0.25, generator(3))
    made = blurred_in_place(warped, replace(way, index=way.index * [0.1, 1.0]), 0.25 / PIXEL[:2])
    within = np.where(inner, warped, np.nan)
    second = [np.nanmax(np.abs(np.diff(within, n=2, axis=axis))) for axis in (0, 1)]
    most = 0.5 * np.linalg.norm(np.square(0.25 / PIXEL[:2])) * sum(second)
    assert 0.0 < np.abs(made - warped)[inner].max() < most


NOISE = 0.01
DEFORMATIONS = [
    np.array([[1.0 + 0.5 * c, 0.1, 0.0], [0.0, 1.0 - c, 0.0], [0.0, 0.0, 1.0]])[:2, :2] for c in (0.1, 0.15)
]


def photographed(sigma, rng, off=0.0, noise=NOISE):
    """Two pictures of a body during compression, and a model of them that moves it wrongly by `off` pixels."""
    size, pixel = SIZE, PIXEL[:2]
    shape = tuple(np.ceil(size * 1.6 / pixel).astype(int))[::-1]
    origin = np.full(2, -0.3 * size)
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")[::-1], axis=-1)
    places, known = origin + index * pixel, waves(2, rng)
    before, *measured = (
        seen(places, *known, deformation, sigma) + rng.normal(0.0, noise, shape)
        for deformation in (np.eye(2), *DEFORMATIONS)
    )
    none = np.empty((0, 2))
    data = Data(
        np.array([1, 2]), np.array([10.0, 20.0]), np.array([0.6, 1.2]), "force", 0.1, 0.01, noise, 0.0, before,
        spline_coefficients(before), np.array(measured), np.array([0, 1]), pixel, origin, np.eye(2), 0.0, 0.0,
        none, none, np.empty(0, dtype=int),
    )  # fmt: skip
    mesh, frame = body(2), Picture(before, pixel, origin, np.eye(2))
    wrong = off * pixel * np.sin(mesh.points / 2)
    maps = [backward_map(mesh, mesh.points @ (one - np.eye(2)).T + wrong, frame, 1.5) for one in DEFORMATIONS]
    made = np.array([warp(data.coefficients, 0.0, way, 0.0) for way in maps])
    return data, Synthesis(Prediction(made, np.zeros(2), none), maps), Patches.over(mesh, 5)


@pytest.mark.parametrize("off", [0.0, 0.7])
def test_the_blur_is_found_in_what_a_model_leaves_also_where_it_moves_the_body_wrongly(off):
    """The mean of six, to 4 of its standard errors and a tenth, by which first order is off in these waves."""
    blurs = [camera_blur(*photographed(0.25, generator(n), off)) for n in range(3, 9)]
    assert sum(one.sure for one in blurs) >= 5
    error = np.linalg.norm([one.error for one in blurs]) / len(blurs)
    assert np.mean([one.variance for one in blurs]) == pytest.approx(0.25**2, abs=4 * error + 0.1 * 0.25**2)
    assert error < 0.2 * 0.25**2


def test_noise_alone_is_no_blur():
    """The second derivatives of a picture go with its noise: taken for texture, that would be one of 0.1 mm."""
    blurs = [camera_blur(*photographed(0.0, rng, noise=4 * NOISE)) for rng in map(generator, range(3, 7))]
    assert np.mean([one.variance / one.error for one in blurs]) == pytest.approx(0.0, abs=2.0)
    assert sum(one.by_optics for one in blurs) <= 1


def test_a_blur_without_deformation_is_not_to_be_seen():
    data, made, patches = photographed(0.25, generator(3))
    frame = Picture(data.before, data.spacing, data.origin, np.eye(2))
    still = backward_map(body(2), np.zeros_like(body(2).points), frame, 1.5)
    warped = warp(data.coefficients, 0.0, still, 0.0)
    same = replace(data, measured=np.array([data.before] * 2))
    found = camera_blur(same, replace(made, prediction=replace(made.prediction, pictures=np.array([warped] * 2)),
                                      maps=[still] * 2), patches)  # fmt: skip
    assert not found.sure and found.size == 0.0


def test_without_pictures_there_is_none():
    data, made, patches = photographed(0.25, generator(3))
    nothing = replace(made, prediction=replace(made.prediction, pictures=made.prediction.pictures[:0]), maps=[])
    found = camera_blur(replace(data, measured=data.measured[:0], picture_step=data.picture_step[:0]), nothing, patches)
    assert not found.sure and not found.by_optics
