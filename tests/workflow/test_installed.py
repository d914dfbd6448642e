"""The wheel, installed where no clone is: it has all that a clone has, fits a study, and serves as a Snakemake module."""

import ast
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest
import yaml

from fingerfit.solvers.registry import get_solver

ROOT = Path(__file__).resolve().parents[2]
STUDIES = ("studies/phantom", "studies/hidden-tilt", "studies/hidden-inclusion")
SHIPPED = ("workflow", "templates", *STUDIES, "Snakefile", "config.yaml")
OFFLINE = ("--quiet", "--no-deps", "--no-index", "--disable-pip-version-check")
ASKED = "argcomplete"
"""The smallest of our dependencies, to see whether an index answers."""
MODULE = """\
from fingerfit.core.folders import SHIPPED

configfile: "mine.yaml"

module fingerfit:
    snakefile:
        str(SHIPPED / "Snakefile")
    config:
        config

use rule * from fingerfit as fit_*

rule thesis:
    default_target: True
    input:
        rules.fit_all.input[1],
    output:
        "thesis.txt",
    shell:
        "cp {input} {output}"
"""


def called(folder, *command):
    """Run without anything of the clone: neither its path nor the programs of this environment are known."""
    known = {"PATH": "/usr/bin:/bin", "HOME": str(folder), "OMP_NUM_THREADS": "1"}
    return subprocess.run([*map(str, command)], cwd=folder, env=known, capture_output=True, text=True)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The sdist, and the wheel that is made from it."""
    folder = tmp_path_factory.mktemp("built")
    source = folder / "source"
    source.mkdir()
    for name in (*SHIPPED, "fingerfit", "setup.py", "pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, source / name)
    code = f"import setuptools.build_meta as b; print(b.build_sdist({str(folder)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=source, capture_output=True, text=True)
    sdist = folder / done.stdout.splitlines()[-1]
    shutil.unpack_archive(folder / sdist, folder)
    unpacked = folder / sdist.name.removesuffix(".tar.gz")
    command = [sys.executable, "-m", "pip", "wheel", *OFFLINE, "--no-build-isolation", "-w", str(folder), str(unpacked)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def programs(built, tmp_path_factory):
    """The programs of a fresh environment with the wheel, which sees what this environment has installed beside it."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    command = [sys.executable, "-m", "pip", "--python", str(folder / "bin/python"), "install", *OFFLINE, str(built)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "bin"


@pytest.fixture(scope="module")
def resolved(built, tmp_path_factory):
    """The programs of an empty environment with the wheel and what pip finds for it in the index of this machine."""
    folder = tmp_path_factory.mktemp("resolved")
    environment, pip = folder / "environment", [sys.executable, "-m", "pip"]
    quiet = ["--quiet", "--disable-pip-version-check"]
    try:
        ask = [*pip, "download", *quiet, "--no-deps", "--no-cache-dir", "--retries", "0", "--timeout", "10", ASKED]
        asked = subprocess.run([*ask, "--dest", str(folder)], capture_output=True, text=True, timeout=60)
        said = asked.stderr if asked.returncode else ""
    except subprocess.TimeoutExpired:
        said = "no answer in a minute"
    if said:
        pytest.skip(f"pip finds no package index here: {said.strip().splitlines()[-1]}")
    try:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
        into = [*pip, "--python", str(environment / "bin/python"), "install", *quiet, "--no-compile"]
        done = subprocess.run([*into, str(built)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        yield environment / "bin"
    finally:
        shutil.rmtree(folder)  # 700 MB


def coarse(path, **others):
    """Settings of a fit of seconds."""
    config = yaml.safe_load(path.read_text(encoding="utf-8"))
    config["model"] |= {"parameters": {"mu": {"unit": "MPa", "start": 0.035, "lower": 0.01, "upper": 0.1}}}
    config["model"]["mesh"] |= {"across": 4, "per_layer": 1}
    del config["model"]["refined"]
    stage = {"name": "one", "kind": "independent", "step": 0.1, "tolx": 0.5, "tolf": 1.0}
    config["fit"] |= {"stages": [stage], "replicates": 20, "steps": [3, 7]}
    return yaml.safe_dump({**config, **others}, sort_keys=False)


def test_it_has_what_a_clone_has(built):
    with zipfile.ZipFile(built) as archive:
        inside = {name: archive.read(name) for name in archive.namelist()}
    expected = {f"fingerfit/{p.relative_to(ROOT / 'fingerfit')}": p for p in (ROOT / "fingerfit").rglob("*.py")}
    for name in SHIPPED:
        found = [ROOT / name] if (ROOT / name).is_file() else [p for p in (ROOT / name).rglob("*") if p.is_file()]
        expected |= {f"fingerfit/shipped/{p.relative_to(ROOT)}": p for p in found if "__pycache__" not in p.parts}
    assert len(expected) > 300
    # setuptools takes the module beside what is shipped, too
    assert {name for name in inside if "/shipped/" in name} <= {*expected, "fingerfit/shipped/setup.py"}
    (listed,) = re.findall(r"^STUDIES = (.+)$", (ROOT / "setup.py").read_text(encoding="utf-8"), re.MULTILINE)
    studies = {name.split("/")[3] for name in inside if name.startswith("fingerfit/shipped/studies/")}
    assert studies == set(ast.literal_eval(listed))
    assert [name for name, path in expected.items() if inside.get(name) != path.read_bytes()] == []
    assert {name.split("/")[0] for name in inside} == {"fingerfit", "fingerfit-0.1.0.dist-info"}


@pytest.mark.slow
def test_a_study_is_fitted_where_no_clone_is(programs, tmp_path):
    made = called(tmp_path, programs / "fingerfit", "new", "mine", "--example", "phantom")
    assert made.returncode == 0, made.stderr
    config = tmp_path / "mine/config.yaml"
    config.write_text(coarse(config), encoding="utf-8")
    done = called(tmp_path, programs / "fingerfit", "run", "mine", "--cores", "2")
    assert done.returncode == 0, done.stderr
    assert re.search(r"^round +0  one .*simulations: \d run \([\d.]+ s each\)", done.stdout, re.MULTILINE)
    *_, last = done.stdout.splitlines()
    assert last == (
        "table: results/mine/base/table.txt; figures: results/mine/base/figures (deformed_mesh, force, pictures, search)"
    )
    assert len((done.stdout + done.stderr).splitlines()) < 30
    # asked again, it shows the same
    again = called(tmp_path, programs / "fingerfit", "run", "mine")
    table = (tmp_path / "results/mine/base/table.txt").read_text(encoding="utf-8")
    assert again.stdout == f"{table}\n{last}\n", again.stderr
    # what names simulations is the same as in a clone, so both make and find the same ones
    made = [
        yaml.safe_load(path.read_text(encoding="utf-8")) for path in tmp_path.glob("results/mine/sims/*/solver.json")
    ]
    assert made
    for solver in made:  # beside it stands what the deck includes, and of a slope the simulation that it lies beside
        kept = {key: solver[key] for key in solver.keys() - {"includes", "nearby", "first_order"}}
        assert kept == get_solver("builtin").identity()


@pytest.mark.slow
def test_an_empty_environment_needs_nothing_that_pyproject_does_not_name(resolved, tmp_path):
    """Where nothing else is installed: not even what the tests need."""
    assert "No module named 'pytest'" in called(tmp_path, resolved / "python", "-c", "import pytest").stderr
    doctor = called(tmp_path, resolved / "fingerfit", "doctor")
    assert doctor.returncode == 0, doctor.stdout + doctor.stderr
    assert re.search(r"^solver builtin .*self test passed", doctor.stdout, re.MULTILINE)
    for name in (study.removeprefix("studies/") for study in STUDIES):
        made = called(tmp_path, resolved / "fingerfit", "new", name, "--example", name)
        assert made.returncode == 0, made.stderr
    config = tmp_path / "phantom/config.yaml"
    config.write_text(coarse(config), encoding="utf-8")
    done = called(tmp_path, resolved / "fingerfit", "run", "phantom", "--cores", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "mu " in (tmp_path / "results/phantom/base/table.txt").read_text(encoding="utf-8")
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_it_is_a_module_of_another_workflow(programs, tmp_path):
    made = called(tmp_path, programs / "fingerfit", "new", "mine", "--example", "phantom")
    assert made.returncode == 0, made.stderr
    (tmp_path / "mine.yaml").write_text(coarse(tmp_path / "mine/config.yaml"), encoding="utf-8")
    (tmp_path / "Snakefile").write_text(MODULE, encoding="utf-8")
    done = called(tmp_path, programs / "python", "-m", "snakemake", "--cores", "2")
    assert done.returncode == 0, done.stderr
    assert "mu " in (tmp_path / "thesis.txt").read_text(encoding="utf-8")


def test_the_module_is_the_one_of_the_documentation():
    assert MODULE in (ROOT / "docs/install.md").read_text(encoding="utf-8")
