"""The order of dependencies, and generated files that are up to date."""

import ast
import json
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CCX = pytest.mark.skipif(shutil.which("ccx") is None, reason="needs CalculiX")
PACKAGE = ROOT / "fingerfit"
FILES = sorted(PACKAGE.rglob("*.py"))
# low to high: a package imports only from itself and from packages above it in this list
PACKAGES = (
    ("core", "material"),
    ("mesh",),
    ("fem", "study"),
    ("model",),
    ("deck", "search"),
    ("anatomy", "imaging", "solvers"),
    ("readers", "segment", "settings"),
    ("morph", "prepare", "testing"),
    ("forward",),
    ("fit",),
    ("provenance", "virtual"),
    ("diagnosis",),
    ("report",),
    ("check",),
    ("start",),
    ("commands", "notebook"),
    ("cli",),
    ("__main__",),
)
LEVEL = {name: level for level, names in enumerate(PACKAGES) for name in names}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def modules():
    """Dotted names of all modules and their files."""
    found = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for path in FILES}
    return {name.removesuffix(".__init__"): path for name, path in found.items()}


def test_packages_import_from_lower_packages_only():
    wrong = []
    for path in FILES:
        own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        for module in imports(path):
            if module.split(".")[0] == "snakemake":
                wrong.append(f"{path} imports {module}")
            if module.startswith("fingerfit.") and own != "__init__" and not module.endswith("__version__"):
                other = module.split(".")[1]
                known = other in LEVEL and own in LEVEL
                if not known or LEVEL[other] > LEVEL[own] or (LEVEL[other] == LEVEL[own] and other != own):
                    wrong.append(f"{path} imports {other}")
    assert not wrong, "\n".join(wrong)


def test_no_modules_import_each_other_in_a_circle():
    known = modules()
    used = {name: set(imports(path)) & known.keys() - {name, "fingerfit"} for name, path in known.items()}
    while free := [name for name, others in used.items() if not others & used.keys()]:
        for name in free:
            del used[name]
    assert used == {}


def test_every_package_says_in_one_sentence_what_belongs_in_it():
    for folder in {path.parent for path in FILES} - {PACKAGE}:
        text = ast.get_docstring(ast.parse((folder / "__init__.py").read_text(encoding="utf-8")))
        assert text and len(text.splitlines()[0]) > 20, folder


def test_files_are_short():
    assert len(FILES) > 100
    long = [path for path in FILES if len(path.read_text(encoding="utf-8").splitlines()) > 400]
    assert long == []


def test_generated_files_are_up_to_date():
    from fingerfit.model import keys as effect_keys
    from fingerfit.readers import keys as data_keys
    from fingerfit.settings import runs
    from fingerfit.study import keys as study_keys
    from fingerfit.virtual import keys as truth_keys

    for name, source in (("config", runs), ("study", study_keys)):
        text = (ROOT / f"workflow/schemas/{name}.schema.json").read_text(encoding="utf-8")
        assert json.loads(text) == source.schema()
    tables = {"config": runs, "study-keys": study_keys, "effect-keys": effect_keys, "experiment-keys": truth_keys,
              "data-keys": data_keys}  # fmt: skip
    for name, source in tables.items():
        assert (ROOT / f"docs/{name}.md").read_text(encoding="utf-8") == source.describe()


def test_the_lock_file_names_no_registry():
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


def test_a_fit_depends_on_what_was_measured_only(monkeypatch):
    from fingerfit.provenance.inputs import study_files
    from fingerfit.settings.config import load_settings

    monkeypatch.chdir(ROOT)
    names = {Path(path).name for path in study_files(Path(load_settings(ROOT / "config.yaml").study))}
    pictures = {"before.nii.gz", *(f"step_{n}.nii.gz" for n in (1, 3, 5, 7))}
    assert names == {"study.yaml", "steps.csv"} | pictures


def parts(config):
    from fingerfit.provenance.stages import STAGES, settings_of

    return {stage: settings_of(config, stage) for stage in STAGES}


@pytest.mark.parametrize(
    ("key", "value", "stages"),
    [
        ("study", "studies/hidden-tilt", {"prepare", "propose", "ladder"}),
        pytest.param("solver", "calculix", {"propose", "diagnose", "ladder"}, marks=CCX),
        ("model.mesh.across", 5, {"prepare", "propose", "estimate", "diagnose", "ladder"}),
        ("model.material.alpha", 2.0, {"propose", "estimate", "diagnose", "ladder"}),
        ("fit.smooth", 2.0, {"prepare", "propose", "estimate", "diagnose", "ladder"}),
        ("fit.bins", 16, {"propose", "estimate", "diagnose", "ladder"}),
    ],
)
def test_a_setting_runs_the_parts_of_the_workflow_again_that_depend_on_it(key, value, stages):
    from fingerfit.core.keys import read_yaml
    from fingerfit.settings.config import load_settings

    config = read_yaml(ROOT / "config.yaml")
    before = parts(load_settings(config))
    *parents, last = key.split(".")
    at = config
    for parent in parents:
        at = at[parent]
    at[last] = value
    after = parts(load_settings(config))
    assert {stage for stage in before if before[stage] != after[stage]} == stages
