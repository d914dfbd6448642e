"""The order of dependencies, and generated files that are up to date."""

import ast
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "fingerfit"
# low to high: a module imports only from its own line and from lines above it
ORDER = (
    ("errors",),
    ("beside", "files", "keys", "templates", "units"),
    ("guess", "mesh", "material", "study"),
    ("effects",),
    ("fem",),
    ("study_file",),
    ("deck", "meshing", "mesh_io", "mesh_check", "tetrahedra", "anatomy"),
    ("solvers",),
    ("imaging", "data", "slices"),
    ("morph",),
    ("score", "search", "uncertainty"),
    ("truth", "truth_check"),
    ("predict", "estimate", "rounds", "scan"),
    ("choices",),
    ("settings", "pictured"),
    ("decks", "prepare", "fit", "experiment", "settings_check"),
    ("residual",),
    ("refine",),
    ("course", "judge", "extend", "suspects"),
    ("diagnose",),
    ("verdict", "simulate"),
    ("designs",),
    ("examine",),
    ("report", "plots", "volumes", "fields", "check", "recipes", "layout", "testing", "page"),
    ("findings", "climb", "export"),
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


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_dependencies_run_one_way(path):
    own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    for module in imports(path):
        assert module.split(".")[0] != "snakemake"
        if module.startswith("fingerfit.") and own != "__init__" and not module.endswith("__version__"):
            other = module.split(".")[1]
            assert LEVEL[other] <= LEVEL[own], f"{own} imports {other}"


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_files_are_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400


def test_generated_files_are_up_to_date():
    from fingerfit.settings import describe, schema

    assert json.loads((ROOT / "workflow/schemas/config.schema.json").read_text(encoding="utf-8")) == schema()
    assert (ROOT / "docs/config.md").read_text(encoding="utf-8") == describe()


def test_the_lock_file_names_no_registry():
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


def test_a_fit_depends_on_what_was_measured_only(monkeypatch):
    from fingerfit.layout import study_files
    from fingerfit.settings import load_settings

    monkeypatch.chdir(ROOT)
    names = {Path(path).name for path in study_files(Path(load_settings(ROOT / "config.yaml").study))}
    pictures = {"before.nii.gz", *(f"step_{n}.nii.gz" for n in (1, 3, 5, 7))}
    assert names == {"study.yaml", "steps.csv"} | pictures


def test_every_part_of_the_workflow_knows_its_settings_and_sources():
    from fingerfit.layout import SOURCES, fingerprint, settings_of
    from fingerfit.settings import load_settings

    settings = load_settings(ROOT / "config.yaml")
    for stage in SOURCES:
        assert json.loads(settings_of(settings, stage)) is not None
        assert len(fingerprint(stage)) == 20
