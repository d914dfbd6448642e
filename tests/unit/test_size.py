"""What jobs of a cluster are asked for."""

from dataclasses import replace
from pathlib import Path

from fingerfit.provenance.size import LEAST, LONG, Size, size_of
from fingerfit.settings.config import load_settings

ROOT = Path(__file__).resolve().parents[2]
FINGERTIP = Size(nodes=8000, dim=3, pixels=256 * 128 * 128, pictures=6, guesses=400, replicates=20)


def phantom(monkeypatch, **changes):
    monkeypatch.chdir(ROOT)
    return size_of(load_settings(ROOT / "config.yaml").model_copy(update=changes))


def test_the_phantom_is_measured(monkeypatch):
    size = phantom(monkeypatch)
    assert (size.dim, size.pixels, size.pictures) == (2, 256 * 256, 5)
    # 14 x 15 quadratic elements of the finer mesh
    assert size.nodes == 15 * 16 + 14 * 16 + 15 * 15
    assert size.simulation < 1
    assert size.short
    assert 1000 < size.memory(2) < size.memory_of_study(2) < 2000
    # three moduli, and the stiffness field with its 30 modes, its correlation lengths and their number
    assert (size.numbers, size.tried) == (3, 35)
    # 500 MB were measured in such a job of a smaller study
    assert 600 < size.memory_of_study(1) < size.memory_of_study(2)
    assert LEAST < size.minutes("study") < 60


def test_volumes_need_more_memory_than_a_job_had_before():
    """Five full volumes and the one before compression took 1.2 GB and more, where 1 GB was asked for."""
    assert FINGERTIP.memory(1) > 1200
    assert FINGERTIP.memory(2) > 2 * 1200
    assert FINGERTIP.memory(1, pictures=False) < FINGERTIP.memory(1)


def test_a_refit_of_many_numbers_needs_the_pictures_of_all_their_slopes():
    """A probe of 25 numbers of six volumes of a fingertip was killed at 22 GB, with its predictions, which lie on disk now."""
    fitted, diagnosed = (replace(FINGERTIP, numbers=2, tried=27).memory(1, diagnosed=yes) for yes in (False, True))
    volumes = 8e-6 * FINGERTIP.pixels * FINGERTIP.pictures
    assert 25 * volumes <= diagnosed - fitted + 1 < 2 * 25 * volumes


def test_memory_and_time_grow_with_mesh_and_pictures():
    for change in ({"nodes": 16000}, {"pixels": 2 * FINGERTIP.pixels}, {"pictures": 12}):
        larger = replace(FINGERTIP, **change)
        assert larger.memory(1) > FINGERTIP.memory(1)
        assert larger.minutes("study") > FINGERTIP.minutes("study")


def test_what_is_a_job_of_its_own(monkeypatch):
    """All in the plane, also by another program, is short; benchmarks/indentation.md has 20 s and 383 s for the others."""
    assert phantom(monkeypatch).simulation < phantom(monkeypatch, solver="calculix").simulation < LONG
    assert 10 < FINGERTIP.simulation < LONG
    assert not FINGERTIP.short
    assert not phantom(monkeypatch, solver="calculix").short
    assert LONG < replace(FINGERTIP, nodes=50653).simulation < 800


def test_a_study_that_cannot_be_read_needs_nothing(monkeypatch):
    assert phantom(monkeypatch, study="nowhere").nodes == 0
