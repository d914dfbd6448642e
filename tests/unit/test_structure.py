"""The order of dependencies, and generated files that are up to date."""

import ast
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "fingerfit"
FILES = sorted(PACKAGE.rglob("*.py"))
# low to high: a module imports only from its own line and from lines above it
ORDER = (
    ("checksums", "errors"),
    ("beside", "described", "failures", "files", "keys", "sources", "templates", "units"),
    ("contents",),
    ("guess", "mesh", "material", "study"),
    ("effects",),
    ("fem",),
    ("study_file",),
    ("deck", "meshing", "mesh_io", "mesh_check", "tetrahedra", "anatomy"),
    ("solvers",),
    ("imaging", "data", "slices"),
    ("morph",),
    ("score", "search", "uncertainty"),
    ("truth",),
    ("predict", "estimate", "rounds", "scan"),
    ("choices",),
    ("settings", "pictured"),
    ("plausible",),
    ("decks", "prepare", "fit", "experiment", "settings_check", "truth_file", "truth_keys"),
    ("residual", "inputs"),
    ("refine",),
    ("course", "judge", "extend", "suspects"),
    ("diagnose",),
    ("verdict", "simulate"),
    ("designs",),
    ("examine",),
    ("report", "plots", "volumes", "fields", "overview", "expect", "recipes", "results", "testing", "page"),
    ("trial", "check"),
    ("findings", "climb", "export", "layout"),
    ("commands",),
    ("cli",),
    ("__main__",),
)
LEVEL = {name: level for level, names in enumerate(ORDER) for name in names}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            if node.module == "fingerfit":
                yield from (f"fingerfit.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_dependencies_run_one_way():
    wrong = []
    for path in FILES:
        own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        for module in imports(path):
            if module.split(".")[0] == "snakemake":
                wrong.append(f"{path} imports {module}")
            if module.startswith("fingerfit.") and own != "__init__" and not module.endswith("__version__"):
                other = module.split(".")[1]
                if other not in LEVEL or own not in LEVEL or LEVEL[other] > LEVEL[own]:
                    wrong.append(f"{path} imports {other}")
    assert wrong == []


def test_files_are_short():
    assert len(FILES) > 100
    long = [path for path in FILES if len(path.read_text(encoding="utf-8").splitlines()) > 400]
    assert long == []


def test_generated_files_are_up_to_date():
    from fingerfit import truth_keys
    from fingerfit.settings import describe, schema

    assert json.loads((ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8")) == schema()
    assert (ROOT / "docs/config.md").read_text(encoding="utf-8") == describe()
    assert (ROOT / "docs/experiment-keys.md").read_text(encoding="utf-8") == truth_keys.describe()


def test_the_lock_file_names_no_registry():
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


def test_a_fit_depends_on_what_was_measured_only(monkeypatch):
    from fingerfit.inputs import study_files
    from fingerfit.settings import load_settings

    monkeypatch.chdir(ROOT)
    names = {Path(path).name for path in study_files(Path(load_settings(ROOT / "config.yaml").study))}
    pictures = {"before.nii.gz", *(f"step_{n}.nii.gz" for n in (1, 3, 5, 7))}
    assert names == {"study.yaml", "steps.csv"} | pictures


def parts(config):
    from fingerfit.layout import STAGES, settings_of

    return {stage: settings_of(config, stage) for stage in STAGES}


@pytest.mark.parametrize(
    ("key", "value", "stages"),
    [
        ("study", "studies/hidden-tilt", {"prepare", "propose", "ladder"}),
        ("solver", "calculix", {"propose", "diagnose", "ladder"}),
        ("model.mesh.across", 5, {"prepare", "propose", "estimate", "diagnose", "ladder"}),
        ("model.material.alpha", 2.0, {"propose", "estimate", "diagnose", "ladder"}),
        ("fit.smooth", 2.0, {"prepare", "propose", "estimate", "diagnose", "ladder"}),
        ("fit.bins", 16, {"propose", "estimate", "diagnose", "ladder"}),
    ],
)
def test_a_setting_runs_the_parts_of_the_workflow_again_that_depend_on_it(key, value, stages):
    from fingerfit.keys import read_yaml
    from fingerfit.settings import load_settings

    config = read_yaml(ROOT / "config.yaml")
    before = parts(load_settings(config))
    *parents, last = key.split(".")
    at = config
    for parent in parents:
        at = at[parent]
    at[last] = value
    after = parts(load_settings(config))
    assert {stage for stage in before if before[stage] != after[stage]} == stages
