"""What a stage depends on of our own sources: followed here once more, from the text and by other means."""

import ast
import re
import shutil
from functools import cache
from pathlib import Path

import pytest

from fingerfit.core.contents import Contents
from fingerfit.provenance import sources, stages
from fingerfit.provenance.inputs import page_files
from fingerfit.provenance.sources import reached
from fingerfit.solvers import builtin

ROOT = Path(__file__).resolve().parents[2]
# of commands.py, what a stage's command calls beside itself
HELPERS = {
    "prepare": ("prepare", "_checked"),
    **{stage: (stage, "_fit", "_checked") for stage in ("propose", "estimate", "plot", "diagnose")},
    "ladder": ("ladder",),
    "export": ("export",),
}


def blocks(text, start):
    """Lines that start so at the margin, each with what is indented below it."""
    return re.findall(rf"^{start}.*\n(?:(?:[ \t]+.*|\)[^\n]*)?\n)*", text, re.MULTILINE)


def names(text):
    """Modules of ours that the imports of a text may mean."""
    text = re.sub(r"^(\s*)if TYPE_CHECKING:\n(?:\1[ \t]+.*\n|\n)*", "", text, flags=re.MULTILINE)
    for module, names in re.findall(r"^\s*from (fingerfit[\w.]*) import (\([^)]*\)|.*)", text, re.MULTILINE):
        yield module
        yield from (f"{module}.{name}" for name in re.findall(r"\w+", names))
    yield from re.findall(r"^\s*import (fingerfit[\w.]*)", text, re.MULTILINE)


def files():
    found = {}
    for path in sorted((ROOT / "fingerfit").rglob("*.py")):
        name = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
        found[name.removesuffix(".__init__")] = path
    return found


def closure(text):
    """Modules that a text's imports lead to, with the packages they are in."""
    known, found, waiting = files(), set(), list(names(text))
    while waiting:
        name = waiting.pop()
        if name in known and name not in found:
            found.add(name)
            waiting += [*names(known[name].read_text(encoding="utf-8")), *[name.rpartition(".")[0]] * ("." in name)]
    return found


def expected(stage):
    text = (ROOT / "fingerfit/commands.py").read_text(encoding="utf-8")
    return closure("".join(block for name in HELPERS[stage] for block in blocks(text, rf"def {name}\(")))


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A copy of the package whose files can be edited; its fingerprints are those that `stages` finds."""
    shutil.copytree(ROOT / "fingerfit", tmp_path / "fingerfit", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(sources, "PACKAGE", tmp_path / "fingerfit")
    for cached in (sources._modules, sources._tree, sources._imports_of, stages.fingerprint):
        cached.cache_clear()
    yield tmp_path / "fingerfit"
    for cached in (sources._modules, sources._tree, sources._imports_of, stages.fingerprint):
        cached.cache_clear()


def fingerprints():
    stages.fingerprint.cache_clear()
    return {stage: stages.fingerprint(stage) for stage in stages.STAGES}


def test_an_edited_module_changes_the_stages_that_reach_it_and_no_others(project, monkeypatch):
    monkeypatch.setattr(stages, "reached", cache(reached))  # a comment changes no import
    wanted = {stage: expected(stage) for stage in stages.STAGES}
    assert all(len(modules) > 30 for modules in wanted.values())
    before = fingerprints()
    for name, path in files().items():
        if name == "fingerfit.commands":
            continue
        copy = project.parent / path.relative_to(ROOT)
        text = copy.read_text(encoding="utf-8")
        copy.write_text(text + "# another line\n", encoding="utf-8")
        after = fingerprints()
        copy.write_text(text, encoding="utf-8")
        assert {stage for stage in before if after[stage] != before[stage]} == {
            stage for stage in wanted if name in wanted[stage]
        }, name


@pytest.mark.parametrize(
    ("name", "affected"),
    [
        ("deck.context", {"prepare", "propose", "estimate", "plot", "diagnose", "ladder"}),
        ("mesh.tetrahedra", {"prepare", "propose", "estimate", "plot", "diagnose", "ladder"}),
        ("diagnosis.designs", {"diagnose"}),
        ("settings.config", {"prepare", "propose", "estimate", "plot", "diagnose", "ladder"}),
    ],
)
def test_modules_that_were_forgotten(name, affected):
    """Editing one of these ran nothing again when the sources were listed by hand."""
    found = {stage for stage in stages.STAGES if f"fingerfit.{name}" in reached("fingerfit.commands", stage).modules}
    assert found == affected


def test_a_command_changes_its_own_stage_alone(project):
    before, path = fingerprints(), project / "commands.py"
    text = path.read_text(encoding="utf-8")
    for old, affected in (
        ('"""Figures of a finished fit."""', {"plot"}),
        ('"""Bring a mesh to a subject."""', set()),
        ("    files = [", {"propose", "estimate", "plot", "diagnose"}),  # of a function that they call
    ):
        assert text.count(old) == 1
        path.write_text(
            text.replace(old, f"{old}  # edited" if old[0] == '"' else f"    # edited\n{old}"), encoding="utf-8"
        )
        for cached in (sources._tree, sources._imports_of):
            cached.cache_clear()
        after = fingerprints()
        assert {stage for stage in before if after[stage] != before[stage]} == affected


def test_the_built_in_solver_is_known_by_all_that_its_answer_comes_from():
    """No more either: every change of it throws all simulations away."""
    listed = set()
    for name in builtin._SOURCES:
        path = ROOT / "fingerfit" / name
        listed |= set(path.rglob("*.py")) if path.is_dir() else {path}
    text = (ROOT / "fingerfit/solvers/builtin.py").read_text(encoding="utf-8")
    start = text[text.index("    def first_order(") :]
    used = [line for line in text.splitlines() if line.startswith("from fingerfit")]
    bound = {name: line for line in used for name in re.findall(r"\w+", line.partition(" import ")[2])}
    text = start + "\n" + "\n".join(line for name, line in bound.items() if re.search(rf"\b{name}\b", start))
    assert {str(path) for path in listed} == {
        str(files()[name]) for name in {*closure(text), "fingerfit.solvers.builtin"}
    }


def test_imports_read_by_lines_are_those_of_the_trees():
    """All of them, and none that only stands in a text."""
    for name, path in sources._modules().items():
        tree, inside = ast.parse(path.read_text(encoding="utf-8")), f"{name}." * (path.name == "__init__.py")
        wanted = set(sources._imported(tree, inside or name, None))
        # the package's own text has an example
        assert sources._imports_of(name) - {"fingerfit"} == wanted - {"fingerfit"}, name
        assert sources._imports_of(name) >= wanted, name


def test_imports_are_followed_once_for_the_same_sources(tmp_path, monkeypatch):
    """Nothing is parsed when Snakemake starts and no source has changed since the last time."""
    first = Contents(tmp_path / "known.json")
    found = stages.fingerprints(first)
    first.save()
    monkeypatch.setattr(stages, "reached", None)
    stages.fingerprint.cache_clear()
    assert stages.fingerprints(Contents(tmp_path / "known.json")) == found


def test_the_page_depends_on_all_of_its_templates():
    names = {path.name for path in page_files()}
    assert {"page.html.j2", "page.js"} <= names
    assert names == {path.name for path in (ROOT / "templates/report").iterdir()}
