"""Checked settings, read again without the checks, say the same."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from fingerfit.core.errors import StateError
from fingerfit.core.files import keep_json, read_json
from fingerfit.core.plain import from_plain, to_plain
from fingerfit.provenance.stages import write_settings
from fingerfit.settings.choices import read_checked
from fingerfit.settings.config import load_settings
from fingerfit.study.study import Body, Chain, Layer, Noise, Step, Study

ROOT = Path(__file__).resolve().parents[2]
EFFECTS = {"tilt": {"slope": 0.01}, "inclusion": {"across": 0.3}}


def plain(value):
    """Namespaces and models as dictionaries."""
    if hasattr(value, "model_dump"):
        return value.model_dump(mode="json")
    if hasattr(value, "__dict__"):
        value = vars(value)
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, list) else value


@pytest.mark.parametrize("effects", [{}, EFFECTS], ids=["none", "two"])
def test_they_say_the_same(tmp_path, monkeypatch, effects):
    monkeypatch.chdir(ROOT)
    data = yaml.safe_load((ROOT / "config.yaml").read_text())
    data["model"]["effects"] = effects
    checked = load_settings(data)
    read = read_checked(Path(write_settings(checked, tmp_path / "settings.json")))
    assert plain(read) == plain(checked)
    for name in ("parameters", "effects", "fixed", "plan"):
        assert getattr(read, name)() == getattr(checked, name)()
    assert read.model.full_name == checked.model.full_name


def test_a_time_is_searched_in_the_logarithm_and_a_place_is_not(monkeypatch):
    monkeypatch.chdir(ROOT)
    data = yaml.safe_load((ROOT / "config.yaml").read_text())
    data["model"]["effects"] = {"relaxation": {"share": 0.1}, "inclusion": {"across": 0.3}}
    log = {p.name: p.log for p in load_settings(data).parameters()}
    assert [name for name in log if "." in name and log[name]] == ["relaxation.time"]
    assert {"relaxation.share", "inclusion.across", "inclusion.contrast"} <= set(log)


def test_study_and_effects_are_those_that_the_workflow_read(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    data = yaml.safe_load((ROOT / "config.yaml").read_text())
    data["model"]["effects"] = EFFECTS
    checked = load_settings(data)
    path = write_settings(checked, tmp_path / "settings.json", with_study=True)
    monkeypatch.chdir(tmp_path)  # where there is no study
    read = read_checked(Path(path))
    assert {effect.name for effect in read.effects()} == set(EFFECTS)
    studies, effects = [read.read_study()], [read.known_effects()]
    monkeypatch.chdir(ROOT)
    assert studies == [checked.read_study()]
    assert effects == [checked.known_effects()]


def test_a_study_keeps_its_kinds():
    steps = (Step(1, 0.5, picture=Path("a/b.nii")), Step(2, force_noise=1e-300))
    body = Body((Layer("top", None, "TOP"),), mesh=Path("../m.inp"), thick=False)
    chain = Chain(trim=((0.0, 1.0), (2.0, 3.0)), resize=(8, 9), gaussian=0.0, scale=False)
    noise = Noise("estimated", 0.1, None, (Path("c"),))
    study = Study(Path("s.yaml"), "größe", "force", steps, None, noise, body, "held", "glued", chain=chain)
    kinds = (Study, Step, Layer, Body, Noise, Chain)
    assert from_plain(json.loads(json.dumps(to_plain(study))), *kinds) == study
    with pytest.raises(KeyError):
        from_plain(to_plain(study), Study)


DAMAGES = [
    lambda data: {**data, "fit": None},
    lambda data: {"model": {}},
    lambda data: {**data, "known": {"study": {"": "Popen"}}},
    lambda data: {**data, "known": {"study": {"": "Step"}}},
]


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_the_workflow_did_not_write_is_told(tmp_path, damage):
    path = tmp_path / "settings.json"
    write_settings(load_settings(ROOT / "config.yaml"), path)
    keep_json(path, damage(read_json(path)))
    with pytest.raises(StateError, match="is not what the workflow wrote"):
        read_checked(path)


def test_rounds_do_not_need_pydantic_scipy_or_yaml(tmp_path, monkeypatch):
    """Their import takes longer than the scores of a round."""
    monkeypatch.chdir(ROOT)
    path = write_settings(load_settings(ROOT / "config.yaml"), tmp_path / "settings.json", with_study=True)
    program = (
        "import sys, fingerfit.fit.course; from pathlib import Path; from fingerfit.settings.choices import read_checked\n"
        "read = read_checked(Path(sys.argv[1])); read.read_study(), read.known_effects(), read.effects()\n"
        "print(*{'pydantic', 'scipy', 'yaml'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program, path], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
