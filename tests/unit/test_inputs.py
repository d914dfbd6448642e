"""The files that a fit reads are tracked by their content, wherever they are; nothing else is."""

import os
import shutil
from pathlib import Path

import pytest
import yaml

from fingerfit.core import folders
from fingerfit.core.contents import Contents
from fingerfit.core.files import write_text
from fingerfit.provenance import inputs, stages
from fingerfit.provenance.inputs import study_files, template_files
from fingerfit.settings.config import load_settings

ROOT = Path(__file__).resolve().parents[2]
MU = {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2}


def made_from(config="config.yaml"):
    return stages.made_from(load_settings(Path(config)), Contents())


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A study under a folder named sealed whose files are elsewhere."""
    place = tmp_path / "sealed/work"
    study = {
        "title": "elsewhere",
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": "displacement",
        "steps": "../shared/steps.csv",
        "pictures": {"before": "../shared/before.mhd", "noise": ["../shared/again.nii.gz"]},
        "body": {"mesh": str(tmp_path / "mesh/body.inp"), "layers": [{"name": "gel"}]},
        "boundary": {"base": "held", "indenter": "glued"},
    }
    config = {
        "study": "study",
        "model": {"template": "own.inp.j2", "material": {"alpha": 2, "poisson": 0.4}, "parameters": {"mu": MU}},
        "fit": {"score": "ssd", "stages": [{"name": "grid", "kind": "grid"}]},
    }
    for name, text in {
        place / "config.yaml": yaml.safe_dump(config),
        place / "study/study.yaml": yaml.safe_dump(study),
        place / "study/own.inp.j2": "{% include 'part.inc' %}\n*INCLUDE, INPUT=" + f"{tmp_path}/lab/law.inp\n",
        place / "study/part.inc": "one",
        place / "study/effects/mine.yaml": "title: mine",
        place / "study/notes.md": "not read",
        place / "study/sealed/truth.yaml": "not read",
        place / "shared/steps.csv": "step,displacement,force,picture,points\n1,1,2,../shared/series,../shared/p.csv\n",
        place / "shared/before.mhd": "ElementDataFile = numbers.raw\n",
        place / "shared/numbers.raw": "1",
        place / "shared/again.nii.gz": "1",
        place / "shared/p.csv": "x,y",
        place / "shared/series/1.dcm": "1",
        place / "shared/series/2.dcm": "1",
        place / "shared/other.csv": "not read",
        tmp_path / "mesh/body.inp": "*INCLUDE, INPUT=nodes.inp\n",
        tmp_path / "mesh/nodes.inp": '*Include,\n input = "deep/er.inp"\n',
        tmp_path / "mesh/deep/er.inp": "*NODE\n",
        tmp_path / "lab/law.inp": "*MATERIAL\n",
    }.items():
        write_text(name, text)
    monkeypatch.chdir(place)
    return place


READ = {
    "study/study.yaml", "shared/steps.csv", "shared/before.mhd", "shared/numbers.raw", "shared/again.nii.gz",
    "shared/p.csv", "shared/series/1.dcm", "shared/series/2.dcm", "../../mesh/body.inp", "../../mesh/nodes.inp",
    "../../mesh/deep/er.inp",
}  # fmt: skip
RENDERED = {"study/own.inp.j2", "study/part.inc", "study/effects/mine.yaml", "../../lab/law.inp"}


def test_all_that_a_study_names_is_found(place):
    assert {os.path.relpath(path) for path in study_files(Path("study"))} == READ
    own = {os.path.relpath(path) for path in template_files(Path("study")) if not path.is_relative_to(folders.OURS)}
    assert own == RENDERED


@pytest.mark.parametrize("name", sorted(READ | RENDERED))
def test_another_content_runs_the_right_stages_again(place, name):
    before = made_from()
    path = Path(name)
    text = path.read_text(encoding="utf-8")
    write_text(path, text + ("# one line more" if name.endswith(".yaml") else "\n"))
    after = made_from()
    changed = {stage for stage in before if before[stage] != after[stage]}
    every = set(stages.STAGES)
    assert changed == (every if name in READ else every - {"prepare"})
    write_text(path, text)
    assert made_from() == before


def test_what_no_fit_reads_runs_nothing_again(place):
    before = made_from()
    for name in ("study/notes.md", "study/sealed/truth.yaml", "shared/other.csv"):
        write_text(Path(name), "changed")
    assert made_from() == before


def test_neither_times_nor_the_place_count(place, tmp_path, monkeypatch):
    before = made_from()
    for path in tmp_path.rglob("*"):
        os.utime(path, (0, 0))
    assert made_from() == before
    shutil.copytree(place, tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert made_from() == before


def test_effects_of_installed_packages_count(place, tmp_path, monkeypatch):
    write_text(tmp_path / "lab_effects/effects/spring.yaml", "title: spring")
    write_text(tmp_path / "lab_effects/effects/spring.inp.j2", "*SPRING")
    monkeypatch.setattr(folders, "offered", lambda: (tmp_path / "lab_effects",))
    before = made_from()
    for name in ("spring.yaml", "spring.inp.j2"):
        write_text(tmp_path / "lab_effects/effects" / name, "title: another")
        after = made_from()
        assert after["propose"] != before["propose"]
        before = after


def test_our_templates_count_and_those_of_the_page_for_the_page_alone(place, tmp_path, monkeypatch):
    shutil.copytree(ROOT / "templates", tmp_path / "templates")
    for module in (folders, inputs):
        monkeypatch.setattr(module, "OURS", tmp_path / "templates")
    for name, affected in (
        ("block.inp.j2", set(stages.STAGES) - {"prepare"}),
        ("effects/tilt.yaml", set(stages.STAGES) - {"prepare"}),
        ("report/page.js", {"ladder"}),
        ("report/glance.html.j2", {"ladder"}),
    ):
        before = made_from()
        path = tmp_path / "templates" / name
        write_text(path, path.read_text(encoding="utf-8") + "\n")
        after = made_from()
        assert {stage for stage in before if before[stage] != after[stage]} == affected


def test_contents_are_read_again_when_a_file_may_have_changed(tmp_path):
    path, kept = tmp_path / "a", tmp_path / "known.json"
    path.write_text("one")
    first = Contents(kept)
    found = first.digest(path)
    first.save()
    # written less than a tick of the clock ago: size and times do not tell yet
    path.write_text("two")
    assert Contents(kept).digest(path) != found
    assert Contents(kept).digest(tmp_path / "none") == ""


def test_a_file_that_has_not_changed_is_not_read_again(tmp_path, monkeypatch):
    path, kept = tmp_path / "a", tmp_path / "known.json"
    path.write_text("one")
    monkeypatch.setattr("fingerfit.core.contents.SETTLED", -1.0)
    first = Contents(kept)
    found = first.digest(path)
    first.save()
    monkeypatch.setattr("fingerfit.core.contents.digest", None)
    assert Contents(kept).digest(path) == found
    monkeypatch.undo()
    path.write_text("longer")
    assert Contents(kept).digest(path) != found
