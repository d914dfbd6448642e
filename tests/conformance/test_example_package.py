"""The example of a solver in a package of its own: installed, found by its entry point, conforming."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fingerfit.testing.solver import SolverConformance, write_block

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "examples/solver-package"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the package installed as pip does it, without a network, and the environment that finds it."""
    folder = tmp_path_factory.mktemp("package")
    shutil.copytree(PACKAGE, folder / "source", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--disable-pip-version-check"]
    command = [sys.executable, "-m", "pip", "install", *options, "--target", str(folder / "site")]
    done = subprocess.run([*command, str(folder / "source")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder / "site"), str(ROOT)])}


def ask(code, environment):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)


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
