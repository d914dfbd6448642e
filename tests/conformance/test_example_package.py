"""The examples of a solver and of effects in packages of their own: installed, found by their entry points."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fingerfit.testing.solver import SolverConformance, write_block

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "examples/solver-package"
EFFECTS = ROOT / "examples/effects-package"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The environment that finds the solver."""
    return install(PACKAGE, tmp_path_factory.mktemp("solver"))


@pytest.fixture(scope="module")
def effects(tmp_path_factory):
    """The environment that finds the effects."""
    return install(EFFECTS, tmp_path_factory.mktemp("effects"))


def install(package, folder):
    """Installs as pip does it, without a network; the environment that finds it."""
    shutil.copytree(package, folder / "source", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--disable-pip-version-check"]
    command = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder / "site")]
    done = subprocess.run([*command, str(folder / "source")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)])}


def ask(code, environment):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)


def fingerfit(environment, *arguments):
    command = [sys.executable, "-m", "fingerfit", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)


def test_it_is_found_by_its_entry_point(installed):
    code = "from fingerfit.solvers.registry import get_solver; print(get_solver('smallfem').identity())"
    done = ask(code, installed)
    assert done.stdout.strip() == "{'name': 'smallfem', 'version': '1.0'}", done.stderr
    lost = ask(code, {**installed, "PYTHONPATH": str(ROOT)})
    assert "found smallfem; expected one of abaqus, builtin, calculix" in lost.stderr


def test_it_passes_the_conformance_suite(installed):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(PACKAGE / "tests")]
    done = subprocess.run(command, capture_output=True, text=True, env=installed, cwd=ROOT)
    assert done.returncode == 0, done.stdout
    # one dot for each: none was skipped
    assert "." * sum(name.startswith("test_") for name in dir(SolverConformance)) in done.stdout


def test_what_the_example_lacks_is_refused(installed, tmp_path):
    deck = write_block(tmp_path, "displacement", [1.0], "CPE4")
    code = f"from smallfem.adapter import SmallFem; from pathlib import Path; SmallFem().check(Path({str(deck)!r}))"
    assert "CPE4" in ask(code, installed).stderr.splitlines()[-1]
    deck = write_block(tmp_path, "displacement", [1.0], "CPE8")
    text = deck.read_text()
    deck.write_text(text.replace("*HYPERELASTIC, OGDEN, N=1\n0.03, 1.4, 0.7", "*ELASTIC\n1., 0.3"))
    assert "*HYPERELASTIC, OGDEN" in ask(code, installed).stderr.splitlines()[-1]


def test_effects_of_a_package_are_known_without_running_it(effects):
    code = (
        "import sys; from fingerfit.model.catalogue import catalogue; catalogue(); print('lab_effects' in sys.modules)"
    )
    assert ask(code, effects).stdout.strip() == "False"
    listed = fingerfit(effects, "effects")
    assert "return_spring: a spring that draws the indenter back" in listed.stdout
    lost = {**effects, "PYTHONPATH": str(ROOT)}
    listed = fingerfit(lost, "effects")
    assert "tilt" in listed.stdout
    assert "return_spring" not in listed.stdout


def test_its_part_goes_into_the_deck_of_any_study(effects, tmp_path):
    """An effect that leaves the deck as it is would be refused."""
    config = tmp_path / "config.yaml"
    shutil.copyfile(ROOT / "config.yaml", config)
    command = ["add", "return_spring", "--config", str(config)]
    lost = {**effects, "PYTHONPATH": str(ROOT)}
    done = fingerfit(lost, *command)
    assert "return_spring" in done.stderr
    assert config.read_bytes() == (ROOT / "config.yaml").read_bytes()
    done = fingerfit(effects, *command)
    assert done.stdout.startswith(f"{config}: added return_spring (a spring that draws the indenter back)"), done.stderr


def test_it_is_the_one_of_the_documentation():
    text = (ROOT / "docs/diagnosis.md").read_text(encoding="utf-8")
    for path in (EFFECTS / "lab_effects/effects").iterdir():
        assert path.read_text(encoding="utf-8") in text


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("return_spring", "tilt"), "effects/tilt.yaml: name: found tilt; expected one that no other effect has"),
        (("", ""), "entry point lab: fingerfit.effects: found lab_effects; expected the name of an installed package"),
    ],
)
def test_a_package_that_is_wrong_is_one_line(effects, tmp_path, change, says):
    site = tmp_path / "site"
    shutil.copytree(effects["PYTHONPATH"].split(os.pathsep)[0], site)
    folder, (old, new) = site / "lab_effects/effects", change
    if old:
        (folder / f"{old}.yaml").rename(folder / f"{new}.yaml")
    else:
        shutil.rmtree(folder)
    environment = {**effects, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    done = fingerfit(environment, "effects")
    assert done.returncode == 1
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
