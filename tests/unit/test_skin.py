"""The example with skin between two pads, on files of the authors' format that are made here."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scripts import EXAMPLES, script_of
from seeds import generator

from fingerfit.core.errors import InputError
from fingerfit.core.folders import template_folders
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.deck.render import render_deck
from fingerfit.imaging.points import estimate_covariance
from fingerfit.model.catalogue import catalogue
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.start.measured import draft_from
from fingerfit.study.reader import load_study

DATA = Path(__file__).resolve().parents[3] / "shared/real/skin_extension"
SCRIPT, STUDY = script_of("skin", "make_mesh"), EXAMPLES / "skin"
GEO = "L0 = 100;\nH0 = 40;\nL = 100;\nH = 50;\nl_pad = 8.0; // length\nh_pad = 8.0;\ndL_pad = 32.0;\n"
NUMBERS = {"L0": 100.0, "H0": 40.0, "L": 100.0, "H": 50.0, "l_pad": 8.0, "h_pad": 8.0, "dL_pad": 32.0}
NOISE = 0.01
FRAMES = (6, 12, 18, 24, 30, 36, 42, 49)


def authors_files(folder):
    """Points between the pads that follow the moving one less the farther they are from it; noise of `NOISE` mm."""
    rng = generator(3)
    for name in ("displacement", "reactionforce"):
        (folder / name).mkdir(parents=True)
    (folder / "healthy_skin.geo").write_text(GEO)
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(11, 28, 18), np.linspace(-4, 4, 9)))
    pad = np.linspace(0, 4, 50)
    for frame, pull in enumerate(pad):
        moved = np.stack([x - pull * (1 - x / 36), y * (1 - 0.01 * pull)], axis=1)
        moved += rng.normal(0, NOISE, moved.shape) * (frame > 0)
        np.savetxt(folder / f"displacement/xt_dic_{frame:04d}.out", moved)
    np.savetxt(folder / "displacement/xt_pad_mov.out", np.stack([-pad, 0 * pad], axis=1))
    far = np.linspace(0, 8, 100)
    np.savetxt(folder / "reactionforce/ux_pad_mov.out", -far)
    np.savetxt(folder / "reactionforce/fx_pad_mov.out", -0.02 * far)
    return folder


def made(authors, out):
    """The study that README.md makes of the authors' files."""
    shutil.copy(STUDY / "data.yaml", authors)
    draft_from(out, [authors / "data.yaml"])
    SCRIPT.make_mesh(authors / "healthy_skin.geo", out)
    return load_study(out)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("skin")
    return made(authors_files(folder / "authors"), folder / "study")


def test_the_study_turns_the_pull_downwards(study):
    assert len(study.steps) == len(FRAMES)
    assert study.steps[0].displacement == pytest.approx(4 * FRAMES[0] / 49, abs=1e-4)
    assert study.steps[0].force == pytest.approx(0.02 * study.steps[0].displacement, abs=1e-5)
    data = prepare(study, make_mesh(study, None), None, 1.0, 0.3)
    last = data.points_step == len(FRAMES) - 1
    # the measured x, along the pull, is the study's y; all points move towards the moving pad, downwards
    assert data.points[last][:, 1].min() == pytest.approx(11.0, abs=1e-4)
    assert (data.points_displacement[last][:, 1] < 0).all()


def test_noise_is_what_no_smooth_field_can_do(study):
    data = prepare(study, make_mesh(study, None), None, 1.0, 0.3)
    # 5 standard errors: of n degrees of freedom a variance is off by sqrt(2 / n), a covariance by 1 / sqrt(n); those of
    # a step are two of each of 18 x 9 points less the 21 coefficients of a polynomial of fifth degree
    freedom = 2 * (18 * 9 - 21)
    assert data.points_noise == pytest.approx(NOISE, rel=5 / np.sqrt(2 * freedom * len(FRAMES)))
    between, own = data.between_steps / NOISE**2, np.eye(len(FRAMES), dtype=bool)
    assert between[own] == pytest.approx(1.0, abs=5 * np.sqrt(2 / freedom))
    assert between[~own] == pytest.approx(0.0, abs=5 / np.sqrt(freedom))


def test_only_some_steps_are_fitted(study):
    data = prepare(study, make_mesh(study, None), [1, 3], 1.0, 0.3)
    assert np.unique(data.points_step).tolist() == [0, 2]
    assert np.flatnonzero(np.isfinite(data.force)).tolist() == [0, 2]
    assert np.isfinite(data.displacement).all()


def test_errors_of_a_point_at_two_steps_are_alike():
    rng = generator(1)
    count = 1600
    points = rng.uniform(0, 10, (count, 2))
    common, own = rng.normal(0, 0.02, (count, 2)), rng.normal(0, 0.01, (2, count, 2))
    moved = np.concatenate([points @ [[0.1, 0], [0.02, -0.05]] + common + part for part in own])
    found = estimate_covariance(np.tile(points, (2, 1)), moved, np.repeat([0, 2], count), 3)
    # 5 standard errors with n degrees of freedom: v sqrt(2 / n) of a variance, sqrt((v^2 + c^2) / n) of a covariance
    freedom = 2 * (count - 21)
    assert found[0, 0] == pytest.approx(5e-4, abs=5 * 5e-4 * np.sqrt(2 / freedom))
    assert found[0, 2] == pytest.approx(4e-4, abs=5 * np.hypot(5e-4, 4e-4) / np.sqrt(freedom))
    assert not found[1].any()
    with pytest.raises(ValueError, match="different points"):
        estimate_covariance(points, points, np.repeat([0, 1], count // 2), 2)
    with pytest.raises(ValueError, match="4 points"):
        estimate_covariance(points[:4], points[:4], np.zeros(4, int), 1)


def test_membrane_has_a_hole_for_each_pad():
    mesh = SCRIPT.membrane(NUMBERS, 2.0, 6.0)
    corners = mesh.points[mesh.blocks[0].nodes]
    x, y = np.moveaxis(corners, -1, 0)
    area = 0.5 * (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    assert area.min() > 0
    assert area.sum() == pytest.approx(100 * 50 - 2 * 8 * 8)
    moving, fixed = (mesh.points[mesh.node_sets[name]] for name in ("TOP", "BOTTOM"))
    assert moving.min(axis=0) == pytest.approx([-4, -6])
    assert moving.max(axis=0) == pytest.approx([4, 2])
    assert fixed.min(axis=0) == pytest.approx([-4, 34])
    # nodes of the mesh beside each other on the border, none within a pad
    assert len(mesh.node_sets["BORDER"]) == 2 * (len(np.unique(x)) + len(np.unique(y))) - 4


def deck(study, mesh, values):
    effects = catalogue(STUDY)
    context = deck_context(study, mesh, "mesh.inp", {"mu": 0.01, **values}, {"alpha": 2, "poisson": 0.495}, effects)
    return render_deck("block.inp.j2", context, template_folders(STUDY))


@pytest.mark.parametrize("name", sorted(path.stem for path in (STUDY / "effects").glob("*.yaml")))
def test_effects_of_the_study(study, name, tmp_path):
    mesh = SCRIPT.membrane(NUMBERS, 4.0, 10.0)
    mesh.node_sets["INDENTER"] = mesh.node_sets["TOP"][:1]
    effect = catalogue(STUDY)[name]
    place = effect.places()[0]
    assert deck(study, mesh, {**effect.null(), **place}) == deck(study, mesh, {})
    first = effect.parameters[0]
    changed = deck(study, mesh, {**effect.null(), **place, effect.key(first.name): first.null + first.step})
    assert changed != deck(study, mesh, {})
    (tmp_path / "mesh.inp").write_text(format_mesh(mesh))
    (tmp_path / "deck.inp").write_text(changed)
    assert len(read_deck(tmp_path / "deck.inp").steps) >= len(FRAMES)


def test_what_is_wrong_is_told(tmp_path):
    with pytest.raises(InputError, match=r"healthy_skin.geo"):
        SCRIPT.make_mesh(tmp_path / "healthy_skin.geo", tmp_path / "out")
    (tmp_path / "healthy_skin.geo").write_text("L0 = 100;\n")
    with pytest.raises(InputError, match="dL_pad"):
        SCRIPT.read_numbers(tmp_path / "healthy_skin.geo")
    folder = authors_files(tmp_path / "authors")
    (folder / "displacement/xt_dic_0006.out").write_text("1 2\n1 2\n")
    with pytest.raises(InputError, match=r"xt_dic_0006.out: rows: found 2; expected 162, as in xt_dic_0000.out"):
        made(folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_user_writes_ten_lines():
    lines = (STUDY / "data.yaml").read_text(encoding="utf-8").splitlines()
    assert sum(not line.startswith("#") for line in lines) <= 10


def test_the_authors_files(tmp_path):
    if not DATA.is_dir():
        pytest.skip("the measured data (shared/real/skin_extension) are not here")
    study = made(Path(shutil.copytree(DATA, tmp_path / "authors")), tmp_path / "study")
    data = prepare(study, make_mesh(study, None), None, 1.0, 0.3)
    assert len(data.points) == 8 * 531  # of 537; the others move otherwise than all around them
    assert 0.015 < data.points_noise < 0.025
    assert study.steps[-1].displacement == pytest.approx(3.82341, abs=1e-5)
    assert study.steps[-1].force == pytest.approx(0.07299, abs=1e-5)
    fine = make_mesh(study, None, finer=True)
    assert len(fine.points) > 2 * len(read_mesh(study.body.mesh).points)
