"""A project of one's own with the shipped profile: what fails is told in a line, nothing is stale, nothing damaged is used."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from one_layer import DESCRIPTION, SHARED

from fingerfit.core.checksums import intact
from fingerfit.core.files import read_json
from fingerfit.fit.rounds import NEARBY
from fingerfit.provenance.sources import reached
from fingerfit.virtual.experiment import run_experiment

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("Snakefile", "workflow", "profiles", "templates", "fingerfit")
CONFIG = {"study": "subject1/test", **SHARED}
RESULTS = "results/subject1/test"
# read by each Python that starts: it keeps the names of the modules that a command has loaded, or has it killed
WATCH = """
import atexit, os, signal, sys

def keep():
    ours = [name for name in sys.modules if name.partition(".")[0] == "fingerfit"]
    if len(sys.argv) > 1 and "fingerfit.commands" in ours:
        with open(os.path.join(os.environ["LOADED"], sys.argv[1]), "a") as file:
            print(*ours, sep="\\n", file=file)

if "LOADED" in os.environ:
    atexit.register(keep)
if os.environ.get("KILLED") in sys.orig_argv:
    os.kill(os.getpid(), signal.SIGKILL)
"""


def snakemake(place, *options, cores=1, **environment):
    """What plain `snakemake` says in a project, and how it ends; `fingerfit` is that of the project.

    Without `cores` those of the profile are taken.
    """
    paths = os.pathsep.join(map(str, (place, place / "watch")))
    done = subprocess.run(
        [str(Path(sys.executable).parent / "snakemake"), *(["--cores", str(cores)] if cores else []), *options],
        cwd=place, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", **environment},
    )  # fmt: skip
    return done.stdout, done.returncode


def fitted(place, **environment):
    said, code = snakemake(place, **environment)
    assert code == 0, said[-3000:]
    return said


def would_run(place, *options):
    """Rules that a dry run lists."""
    said, code = snakemake(place, "-n", "--quiet", "host", *options)
    assert code == 0, said[-3000:]
    found = set(re.findall(r"^(?:local)?(?:rule|checkpoint) (\w+):", said, re.MULTILINE)) - {"all", "default"}
    assert found or "Nothing to be done" in said
    return found


def configure(place, **changes):
    (place / "config.yaml").write_text(yaml.safe_dump({**CONFIG, **changes}, sort_keys=False), encoding="utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A project, fitted once by plain `snakemake`."""
    place = tmp_path_factory.mktemp("project")
    for name in PARTS:
        if (ROOT / name).is_dir() and not (ROOT / name).is_symlink():
            shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, place / name, follow_symlinks=False)
    (place / "watch").mkdir()
    (place / "loaded").mkdir()
    (place / "watch/sitecustomize.py").write_text(WATCH)
    (place / "experiment.yaml").write_text(yaml.safe_dump(DESCRIPTION))
    run_experiment(place / "experiment.yaml", place / "subject1/test")
    configure(place)
    fitted(place, LOADED=str(place / "loaded"))
    return place


@pytest.fixture
def place(made, tmp_path):
    """A copy of that project, times kept."""
    shutil.copytree(made, tmp_path / "copy", symlinks=True)
    return tmp_path / "copy"


def test_what_a_command_loads_is_what_its_stage_depends_on(made):
    for stage in ("prepare", "propose", "estimate", "plot"):
        loaded = set((made / "loaded" / stage).read_text(encoding="utf-8").split())
        assert "fingerfit.core.files" in loaded
        assert loaded - {"fingerfit.cli", "fingerfit.commands", "fingerfit.__main__"} <= set(
            reached("fingerfit.commands", stage).modules
        )


@pytest.mark.slow
def test_a_copy_recomputes_nothing_and_an_edit_what_depends_on_it(made, tmp_path):
    """Copied without times, file by file in an order that is the worst: each result is older than what it is made from."""
    place = tmp_path / "copy"
    shutil.copytree(made, place, symlinks=True, copy_function=shutil.copyfile)
    for time, path in enumerate(
        sorted(place.glob("results/**/*"), key=lambda path: -(made / path.relative_to(place)).stat().st_mtime_ns), 1
    ):
        os.utime(path, (time, time))
    # Snakemake compares the contents of small files; those of a real study are larger
    assert would_run(place, "--max-checksum-file-size", "0") == set()
    known = {path: path.stat().st_mtime_ns for path in place.glob(f"{RESULTS}/sims/*/solution.npz")}
    proposing = {"propose", "estimate", "plot"}
    table = "subject1/test/steps.csv"
    for names, rules in (
        ("fingerfit/deck/context.py", {"prepare", *proposing}),
        ("fingerfit/mesh/tetrahedra.py", {"prepare", *proposing}),
        ("fingerfit/report/plots.py", {"plot"}),
        ("templates/loading/displacement.inp.j2", proposing),
        ("fingerfit/diagnosis/designs.py templates/report/page.js", set()),
        (table, {"prepare", *proposing}),
    ):
        texts = {place / name: (place / name).read_text(encoding="utf-8") for name in names.split()}
        for path, text in texts.items():
            path.write_text(text + "\n", encoding="utf-8")
        # those of the solver have another name
        assert would_run(place) - {"simulate"} == rules, names
        for path, text in texts.items():
            path.write_text(text, encoding="utf-8")
    assert would_run(place) == set()
    # what was made anew before a run was stopped is noticed by what comes after it
    (place / table).write_text((place / table).read_text(encoding="utf-8") + "\n", encoding="utf-8")
    said, code = snakemake(place, f"{RESULTS}/base/prepared.npz")
    assert code == 0, said
    assert would_run(place) == proposing
    fitted(place)
    assert would_run(place) == set()
    assert {path: path.stat().st_mtime_ns for path in place.glob(f"{RESULTS}/sims/*/solution.npz")} == known


def told(said, rule):
    """Lines of a rule; there is no other word on what has failed."""
    for word in ("Traceback", "RuleException", "CalledProcessError", "non-zero", "Error in rule", "Killed  "):
        assert word not in said, said
    lines = said.splitlines()
    found = [line for line in lines if line.startswith(f"{rule}: ")]
    assert not [line for line in lines if "error" in line.lower() and line not in found], said
    return found


def test_a_job_that_fails_says_why_in_one_line(place):
    picture = place / "subject1/test/pictures/step_1.nii.gz"
    picture.write_bytes(b"no picture")
    said, code = snakemake(place)
    assert code == 1
    (line,) = told(said, "prepare")
    assert line.startswith("prepare: subject1/test/pictures/step_1.nii.gz: picture: found ")
    assert line.endswith(f"; expected a picture that SimpleITK reads; log: {RESULTS}/base/logs/prepare.log")


def test_jobs_that_are_killed_say_so(place):
    sims = sorted((place / RESULTS / "sims").iterdir())
    # those that wait for no other one
    alone = [sim for sim in sims if NEARBY not in read_json(sim / "solver.json", kept=False)]
    for sim in alone[:2]:
        (sim / "solution.npz").unlink()
    said, code = snakemake(place, cores=2, KILLED="simulate")
    assert code == 1
    lines = told(said, "simulate")
    # both were solved at once
    assert len(lines) == len(set(lines)) == 2
    for line in lines:
        assert re.fullmatch(
            rf"simulate: was killed \(signal 9\), perhaps out of memory; log: {RESULTS}/sims/\w{{20}}/solver.log", line
        )


def test_what_is_damaged_is_told_and_made_again(place):
    model = place / RESULTS / "base"
    sims = sorted((place / RESULTS / "sims").iterdir())
    meshes = (place / RESULTS / "meshes").iterdir()
    damaged = [model / "rounds/1.json", model / "estimate.json", model / "prepared.npz", model / "mesh.inp",
               sims[0] / "solution.npz", sims[1] / "solution.npz", sims[2] / "deck.inp", *meshes]  # fmt: skip
    before = {path: path.read_bytes() for path in [*damaged, model / "settings.json"]}
    for number, (path, content) in enumerate(before.items()):
        middle = len(content) // 2
        flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        path.write_bytes(flipped if number % 2 else content[:middle])
    said, code = snakemake(place, "-n")
    assert code == 1
    for path in damaged:
        assert f"\nfingerfit: error: {path.relative_to(place)}: is damaged; it will be removed and made again\n" in said
        assert path.read_bytes() != before[path]
    said = fitted(place)
    for path in damaged:
        assert f"{path.relative_to(place)}: is damaged; removed and made again\n" in said
    for path, content in before.items():
        assert path.read_bytes() == content or (path.suffix == ".npz" and intact(path))
    assert would_run(place) == set()


def test_studies_of_one_name_and_folders_that_are_no_place_for_results(place):
    shutil.copytree(place / "subject1", place / "subject2")
    configure(place, study="subject2/test")
    assert "prepare" in would_run(place)
    configure(place, results="/etc")
    said, code = snakemake(place, "-n")
    assert code == 1
    assert "config.yaml: results: found /etc, outside of this workspace" in said
    assert "Traceback" not in said
    configure(place)
    assert would_run(place) == set()
