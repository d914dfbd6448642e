"""A body whose first picture shows other sides than its study states: by its form, or since it had swelled."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from small_body import SMALL, config_of, written

import fingerfit
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.diagnose import diagnose, errors
from fingerfit.diagnosis.second_pass import with_outline
from fingerfit.diagnosis.verdict import Verdict
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.forward.predict import in_first_picture, since_first_picture
from fingerfit.notebook import Found, Result
from fingerfit.settings.config import load_settings
from fingerfit.virtual import experiment

TRIED = [
    "outline", "swollen", "prestretch", "state_probe", "inclusion", "tilt", "base_slip", "compressibility", "wall",
    "interface", "geometry_probe", "misregistration", "stretched_pictures", "distorted_pictures", "observation_probe",
]  # fmt: skip
"""What moves sides or pictures, and one of each other family."""
LACKS = 0.8
"""mm of the height that the study does not state: four pixels."""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    place = written(tmp_path_factory.mktemp("made"), effects={})
    stated = yaml.safe_load((place / "study.yaml").read_text())
    stated["body"]["layers"][0]["height"] -= LACKS
    (place / "study.yaml").write_text(yaml.safe_dump(stated))
    return place


def fitted(study, folder, effects):
    config = config_of(study, SMALL)
    config["model"]["effects"] = effects
    config["diagnosis"] = {"only": TRIED}
    problem, everything = begin(load_settings(config), folder)
    last, _ = run_fit(problem, 2)
    return problem, last, everything


@pytest.mark.slow
def test_it_is_named_and_the_mesh_follows(study, tmp_path):
    problem, last, everything = fitted(study, tmp_path / "base", {})
    found = diagnose(problem, last, everything, 2)
    assert found.verdict.effects == ("outline",)
    assert found.refits
    assert all(refit.sides.off for refit in found.refits.values())
    before, _ = errors(found.comparison)
    followed = fitted(study, tmp_path / "followed", {"outline": {}})
    after, _ = errors(Comparison(*followed))
    # 4 seeds: from 1.69 with a standard deviation of 0.16 to 1.03 with 0.03; from 2.45 while the outline counted in full,
    # which misled the constants
    assert after < 1.2 < 1.3 < before


def test_it_is_added_as_any_other_effect(study, tmp_path):
    """On the mesh that the diagnosis followed the sides with: none of its simulations is run again."""
    few = {"score": "nmi", "bins": 16, "steps": [4], "stages": [{"name": "grid", "kind": "grid", "points": 2}]}
    config = config_of(study, {"mesh": {**SMALL["mesh"], "element": "CPE4"}}) | {"fit": few}
    problem, everything = begin(load_settings(config), tmp_path / "base")
    result = Result(problem, run_fit(problem, 1)[0], everything, 0)
    _, run = with_outline(problem, result.last, 1)
    named = Found(
        SimpleNamespace(verdict=Verdict("missing", ("outline",), "missing: sides", 10.0), refits={}, ranking=[])
    )
    better = fingerfit.add(result, named, "outline")
    assert run > better.run == 0
    assert better.problem.settings.model.full_name == "base+outline"
    height = {
        name: np.ptp(one.problem.meshes["search"].points[:, 1]) for name, one in (("stated", result), ("seen", better))
    }
    # a pixel is 0.2 mm
    assert height["seen"] - height["stated"] == pytest.approx(LACKS, abs=0.2)


SWELLED = -0.12
"""Share of the volume: its sides move by up to 0.9 mm, four pixels."""


@pytest.mark.slow
def test_what_swelled_before_is_told_from_another_form(tmp_path, monkeypatch):
    """The first picture shows the body as it is then; the study states it as it was before."""
    taken = experiment.take_pictures

    def as_shown(truth, mesh, outcome, seen):
        return taken(truth, in_first_picture(mesh, outcome), outcome, seen)

    with monkeypatch.context() as patched:
        patched.setattr(experiment, "since_first_picture", partial(since_first_picture, elsewhere=True))
        patched.setattr(experiment, "take_pictures", as_shown)
        study = written(tmp_path, effects={"swollen": {"volume": SWELLED}})
    found = diagnose(*fitted(study, tmp_path / "base", {}), 2)
    assert (found.verdict.effects, found.verdict.family) == (("swollen",), "state")
    assert found.refits["swollen"].values["swollen.volume"] == pytest.approx(SWELLED, abs=0.02)
