"""Checked settings, read again without the checks, say the same."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from fingerfit.core.errors import StateError
from fingerfit.core.files import keep_json, read_json
from fingerfit.provenance.stages import write_settings
from fingerfit.settings.choices import read_checked
from fingerfit.settings.config import load_settings

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


@pytest.mark.parametrize("damage", [lambda data: {**data, "fit": None}, lambda data: {"model": {}}])
def test_what_the_workflow_did_not_write_is_told(tmp_path, damage):
    path = tmp_path / "settings.json"
    write_settings(load_settings(ROOT / "config.yaml"), path)
    keep_json(path, damage(read_json(path)))
    with pytest.raises(StateError, match="is not what the workflow wrote"):
        read_checked(path)


def test_rounds_do_not_need_pydantic_or_scipy():
    """Their import takes longer than the scores of a round."""
    program = (
        "import sys, fingerfit.settings.choices, fingerfit.fit.course; print(*{'pydantic', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
