"""Predictions that are kept for the jobs that follow, and repetitions of volumes cut to what moves."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from seeds import generator, seed_of

from fingerfit.fit import kept as keeping
from fingerfit.fit import replicates
from fingerfit.fit.kept import Kept, forget
from fingerfit.fit.linear import LinearModel
from fingerfit.fit.replicates import Replicates
from fingerfit.forward.partial_volume import PartialVolume
from fingerfit.forward.score import Prediction
from fingerfit.imaging.warp import BackwardMap
from fingerfit.study.data import Data

SHAPE = (2, 12, 14, 16)
BODY = (slice(None), slice(3, 8), slice(4, 9), slice(2, 11))


def data_of(rng, shape=SHAPE, smooth=0.8):
    before = rng.normal(0.5, 0.1, shape[1:]).astype(np.float32)
    steps, dim = shape[0], len(shape) - 1
    return Data(
        np.arange(1, steps + 1), np.array([0.1, 0.2]), np.full(steps, np.nan), "force", 0.001, 0.0, 0.03, 0.0,
        before, before, np.zeros(shape, dtype=np.float32), np.arange(steps), np.ones(dim), np.zeros(dim), np.eye(dim),
        0.25, smooth, np.zeros((0, dim)), np.zeros((0, dim)), np.zeros(0, dtype=int),
    )  # fmt: skip


def pictures_of(rng, background=0.25):
    found = np.full(SHAPE, background, dtype=np.float32)
    found[BODY] = rng.normal(0.5, 0.1, found[BODY].shape)
    return found


def prediction_of(rng, background=0.25):
    return Prediction(pictures_of(rng, background), rng.normal(size=2), np.zeros((0, 3)))


@pytest.fixture
def prepared(tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "MANY", 1)
    data = data_of(generator(1))
    data.save(tmp_path / "prepared.npz")
    return tmp_path / "prepared.npz", data


def test_a_prediction_is_read_as_it_was_kept(prepared):
    file, data = prepared
    one = replace(prediction_of(generator(2)), partial=PartialVolume(np.arange(5), np.linspace(0.1, 0.5, 5)))
    kept = Kept.beside(file, data)
    assert kept.load("a") is None
    kept.save("a", one, True)
    found, folded = kept.load("a")
    assert folded
    for name in ("pictures", "response", "points"):
        ours, theirs = getattr(found, name), getattr(one, name)
        assert ours.dtype == theirs.dtype
        assert np.array_equal(ours, theirs)
    for name in ("pixel", "weight"):
        assert np.array_equal(getattr(found.partial, name), getattr(one.partial, name))
    # less than half of it is body
    assert next(kept.folder.iterdir()).stat().st_size < 0.5 * one.pictures.nbytes


def test_others_are_removed_and_in_the_end_all(prepared):
    file, data = prepared
    kept = Kept.beside(file, data)
    for key in "abc":
        kept.save(key, prediction_of(generator(2)), False)
    kept.only(["b", "d"])
    assert [kept.load(key) is not None for key in "abcd"] == [False, True, False, False]
    forget(file)
    assert not kept.folder.exists()
    assert kept.load("b") is None


def test_what_is_damaged_or_of_other_measurements_is_made_again(prepared):
    file, data = prepared
    kept = Kept.beside(file, data)
    kept.save("a", prediction_of(generator(2)), False)
    data_of(generator(3)).save(file)
    assert Kept.beside(file, data).load("a") is None
    one = next(kept.folder.iterdir())
    one.write_bytes(one.read_bytes()[:-200])
    assert kept.load("a") is None


def test_small_pictures_are_not_kept(prepared, monkeypatch):
    file, data = prepared
    monkeypatch.setattr(keeping, "MANY", data.measured.size + 1)
    assert Kept.beside(file, data) is None


def shifts(data, model, maps, seed, kind):
    """Best constants of repetitions, shape (repetitions, 2)."""
    drawn = Replicates(model, data, maps, kind, 16, seed_of(seed))
    return drawn, np.array([drawn.draw().gradient(np.zeros(2)) for _ in range(200)])


@pytest.mark.parametrize("kind", ["ssd", "likelihood"])
def test_volumes_are_cut_to_what_moves(monkeypatch, kind):
    """Noise elsewhere tells nothing: gradients have the same mean and spread."""
    rng = generator(4)
    data = data_of(rng)
    slopes = tuple(prediction_of(rng, 0.0) for _ in range(2))
    unsure = PartialVolume(np.sort(rng.choice(np.prod(SHAPE), 300, replace=False)), rng.uniform(0.01, 0.99, 300))
    model = LinearModel(replace(prediction_of(rng), partial=unsure), slopes, prediction_of(rng, 0.0), {})
    inside = np.zeros(SHAPE[1:], dtype=bool)
    inside[BODY[1:]] = True
    pixel = np.flatnonzero(inside)
    index = np.array(np.unravel_index(pixel, SHAPE[1:]))[::-1].T + 0.3
    maps = [BackwardMap(pixel, index, np.zeros(len(pixel), dtype=int), SHAPE[1:], np.zeros(len(pixel), dtype=bool))] * 2
    cut, ours = shifts(data, model, maps, 1, kind)
    assert cut.model.base.pictures.shape == (2, 11, 11, 14)
    monkeypatch.setattr(replicates, "IN_SPACE", 99)
    whole, theirs = shifts(data, model, maps, 2, kind)
    assert whole.model is model
    spread = theirs.std(axis=0)
    assert ours.std(axis=0) == pytest.approx(spread, rel=0.25)
    assert np.abs(ours.mean(axis=0) - theirs.mean(axis=0)).max() < 0.4 * spread.max()


def test_where_nothing_moves_a_pixel_is_left():
    rest = Prediction(np.zeros(SHAPE, dtype=np.float32), np.zeros(2), np.zeros((0, 3)))
    model = SimpleNamespace(base=rest, slopes=(rest,), control=None)
    assert replicates._window(model, 0) == (slice(0, 1),) * 3
