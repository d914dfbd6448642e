"""A study in space from its description to the constants: two layers, volumes of 40 x 36 x 32 voxels, measured forces."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import all_rounds
from figures import (
    check_file,
    check_forces,
    check_search,
    check_sections,
    check_slices,
    corners,
    images,
    recorded,
)
from seeds import seed_of

from fingerfit.cli import main
from fingerfit.core.files import read_json
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import InverseProblem
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import slices_through
from fingerfit.provenance.stages import figures
from fingerfit.report.volumes import chosen_slices
from fingerfit.settings.config import load_settings
from fingerfit.study.data import Data

pytestmark = pytest.mark.slow
TRUTH = {"mu_top": 0.03, "mu_bottom": 0.012}
DESCRIPTION = {
    "title": "a block of two layers with a dark cord in it",
    "body": {
        "brick": [16, 14, 12],
        "layers": [
            {"name": "top", "height": 5, "mu": TRUTH["mu_top"], "intensity": 0.6},
            {"name": "bottom", "height": 7, "mu": TRUTH["mu_bottom"], "intensity": 0.9},
        ],
        "drawn": [{"shape": "capsule", "from": [4, 7, 3], "to": [12, 7, 3], "radius": 1, "intensity": 0.1}],
    },
    "material": {"alpha": 1.4, "poisson": 0.45},
    "mesh": {"element": "C3D10", "across": 4, "per_layer": 2, "grading": 1},
    "solver": "builtin",
    "displacement": [0.6, 1.2],
    "picture": {
        "pixels": [40, 36, 32],
        "spacing": [0.55, 0.55, 0.55],
        "texture": 0.2,
        "correlation": 1.6,
        "noise": 0.02,
        "pictured": [1, 2],
    },
    "noise": {"force": 0.002, "displacement": 0.005},
    "seed": seed_of(3),
    "study": {"pictures": {"resize": [38, 36, 34], "gaussian": 0.8}},
}
CONFIG = {
    "study": "study",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.45},
        "mesh": {"element": "C3D8", "across": 5, "per_layer": 3},
        "parameters": {name: {"unit": "MPa", "start": 0.1, "lower": 0.002, "upper": 0.5} for name in TRUTH},
    },
    "fit": {
        "score": "ssd",
        "replicates": 20,
        "seed": seed_of(1),
        "max_evaluations": 14,
        "stages": [
            {"name": "grid", "kind": "grid", "points": 5},
            {"name": "independent", "kind": "independent", "tolx": 0.05, "tolf": 1e-5},
        ],
    },
}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A folder in which all commands of the workflow were called, in its order."""
    place = tmp_path_factory.mktemp("space")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        drawn = recorded(patch)
        Path("experiment.yaml").write_text(yaml.safe_dump(DESCRIPTION), encoding="utf-8")
        Path("config.yaml").write_text(yaml.safe_dump(CONFIG), encoding="utf-8")
        run("experiment", "experiment.yaml", "--out", "study")
        run("check", "study", "--picture", "place.png")
        run("prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp")
        problem = InverseProblem(
            load_settings(Path("config.yaml")), Data.load(Path("data.npz")), {"search": Path("mesh.inp")}, Path("sims")
        )
        last, _ = all_rounds(problem, Path("rounds"))
        path = f"rounds/{last.number}.json"
        common = ["config.yaml", "--data", "data.npz", "--mesh", "mesh.inp", "--sims", "sims", "--last", path]
        run("estimate", *common, "--out", "estimate.json", "--table", "table.txt")
        run("plot", *common, "--out", "figures")
        assert set(drawn) == {"place", *figures(problem.settings)}
    return place, drawn, problem, last


def run(*arguments):
    assert main(list(arguments)) == 0


def test_the_constants_are_found(fitted):
    place, *_ = fitted
    found = read_json(place / "estimate.json")
    (remark,) = found["remarks"]
    assert remark.startswith("no finer mesh was given (model.refined)")
    for name, truth in TRUTH.items():
        entry = found["parameters"][name]
        # the fit's 150 linear bricks are not the data's 384 quadratic tetrahedra: 3.7 and 3.4 %, with 0.3 % by the noise (4 seeds)
        assert entry["value"] == pytest.approx(truth, rel=0.05)
        assert 0 < entry["standard_error"] < 0.02 * truth


def test_what_is_left_is_little_more_than_noise(fitted):
    place, *_ = fitted
    data = Data.load(place / "data.npz")
    score = read_json(place / "estimate.json")["score"]["final"]
    # two noisy volumes; a Gaussian of s voxels leaves 1 / (4 pi s^2)^(3/2) of the variance
    noise = 2 * data.picture_noise**2 / (4 * np.pi * data.smooth**2) ** 1.5
    still = float(np.mean([np.mean((data.before - picture) ** 2) for picture in data.measured]))
    assert score < 0.04 * still
    assert 0.5 * noise < score < 6 * noise


def test_the_figures_show_the_fit(fitted, monkeypatch):
    place, drawn, problem, last = fitted
    monkeypatch.chdir(place)
    assert set(drawn) == {"force", "search", "deformed_mesh", "pictures", "place"}
    data, mesh, shown = problem.data, problem.meshes["search"], finest(problem, last)
    found, cuts = problem.prediction(shown), chosen_slices(data, mesh)
    check_forces(drawn["force"], data, found.response)
    check_search(drawn["search"], last)
    check_sections(drawn["deformed_mesh"], mesh, problem.outcome(shown), data, cuts)
    check_slices(drawn["pictures"], data, found.pictures, cuts)
    for name in set(drawn) - {"place"}:
        check_file(place / f"figures/{name}.png", drawn[name])


def test_the_place_of_the_mesh_is_shown_in_three_slices(fitted):
    place, drawn, problem, _ = fitted
    slices = slices_through(Picture.before(problem.data), np.array(DESCRIPTION["body"]["brick"]) / 2, (1, 0, 2))
    # the last row; above it the mesh and its sets from outside
    for axes, cut in zip(drawn["place"].axes[-3:], slices, strict=True):
        assert np.array_equal(images(axes)[0], cut.of(problem.data.before))
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) == (*cut.labels, cut.title)
        low, high = corners(axes)
        assert high - low == pytest.approx(np.delete(DESCRIPTION["body"]["brick"], cut.axis), abs=1e-6)
    check_file(place / "place.png", drawn["place"])
