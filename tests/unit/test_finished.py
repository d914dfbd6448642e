"""A fit that was left in its folder is opened as it ended there, and goes on from there."""

import copy
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from blocks import FIT, MODEL, STUDY
from conftest import all_rounds

import fingerfit
from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import keep_json, keep_text
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.fit.simulate import begin
from fingerfit.provenance.stages import write_settings
from fingerfit.report.profiles import profile_of
from fingerfit.settings.config import load_settings

ROWS = ((0.4, 12.0), (0.8, 27.0), (1.2, 46.0), (1.6, 71.0))


@pytest.fixture
def left(tmp_path, monkeypatch):
    """A workspace with a fit of forces as the workflow leaves it; the folder of its model."""
    monkeypatch.chdir(tmp_path)
    Path("study").mkdir()
    Path("study/study.yaml").write_text(yaml.safe_dump(STUDY))
    rows = [f"{n},{moved},{force}" for n, (moved, force) in enumerate(ROWS, 1)]
    Path("study/steps.csv").write_text("\n".join(["step,displacement,force", *rows]) + "\n")
    fit = {**FIT, "stages": [{"name": "descent", "kind": "least_squares"}]}
    config = {"study": "study", "model": copy.deepcopy(MODEL), "fit": fit}
    config["diagnosis"] = {"only": ["stiffening", "compressibility"]}
    Path("config.yaml").write_text(yaml.safe_dump(config))
    folder, settings = Path("results/study/base"), load_settings(Path("config.yaml"))
    began, _ = begin(settings, tmp_path)
    keep_text(folder / "mesh.inp", began.mesh_files[SEARCH].read_text())
    began.data.save(folder / "prepared.npz")
    problem = InverseProblem(settings, began.data, {SEARCH: folder / "mesh.inp"}, folder.parent / "sims")
    last, _ = all_rounds(problem, folder / "rounds")
    write_settings(settings, folder / "settings.json", with_study=True)
    keep_json(folder / "estimate.json", estimate_of(problem, last))
    return folder, last


def test_what_was_left_is_diagnosed_and_added_to(left):
    folder, last = left
    result = fingerfit.load_result(folder)
    assert result.last == last
    found = fingerfit.diagnose(result)
    assert set(found.candidates.index) == {"stiffening", "compressibility"}
    better = fingerfit.add(result, found, found.candidates.index[found.candidates.refitted][0])
    assert better.run == 0
    for name in ("stiffenin", "outline"):
        with pytest.raises(InputError, match=rf"^add: effect: found {name}; expected one that was refitted: \w+"):
            fingerfit.add(result, found, name)


def test_rounds_of_a_longer_fit_before_are_not_read(left):
    """Nothing removes them; the workflow reads from 0 to the first that says stop, and so does who opens its fit."""
    folder, last = left
    longer = replace(last, number=last.number + 1, best=None, history=[])
    longer.save(folder / f"rounds/{longer.number}.json")
    assert fingerfit.load_result(folder).last == last
    assert profile_of(Path("config.yaml"), "mu").startswith("mu in MPa")


def test_what_is_not_finished_or_damaged_is_one_line(left):
    folder, last = left
    replace(last, stop=None).save(folder / f"rounds/{last.number}.json")
    with pytest.raises(StateError, match="results/study/base: has no finished fit; make it: fingerfit run"):
        fingerfit.load_result(folder)
    last.save(folder / f"rounds/{last.number}.json")
    (folder / "mesh.inp").write_text((folder / "mesh.inp").read_text().replace("12", "13", 1))
    for opened in (lambda: fingerfit.load_result(folder), lambda: profile_of(Path("config.yaml"), "mu")):
        with pytest.raises(StateError, match=r"results/study/base/mesh\.inp: cannot be read: damaged"):
            opened()
