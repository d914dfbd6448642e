"""The workflow itself, on a small study: what runs, what does not run again, and that kills do no harm."""

from __future__ import annotations

import contextlib
import math
import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from figures import check_deformed, check_forces, check_pictures, check_search, recorded
from matplotlib.image import imread
from seeds import seed_of

import fingerfit
from fingerfit.core.errors import StateError
from fingerfit.core.files import read_json
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.report.plots import plot_fit
from fingerfit.settings.config import load_settings
from fingerfit.study.data import Data
from fingerfit.virtual.experiment import run_experiment

ROOT = Path(__file__).resolve().parents[2]
DESCRIPTION = {
    "title": "small",
    "body": {
        "width": 12,
        "thickness": 70,
        "layers": [
            {"name": "top", "height": 6, "mu": 0.03, "intensity": 0.5},
            {"name": "bottom", "height": 6, "mu": 0.06, "intensity": 0.9},
        ],
    },
    "material": {"alpha": 1.4, "poisson": 0.49},
    "mesh": {"element": "CPE8", "across": 4, "per_layer": 3, "grading": 1},
    "solver": "builtin",
    "displacement": [1.0, 2.0],
    "picture": {
        "pixels": 96,
        "side": 22,
        "texture": 0.15,
        "correlation": 0.6,
        "noise": 0.01,
        "pictured": [1, 2],
    },
    "noise": {"force": 0.001, "displacement": 0.01},
    "seed": seed_of(3),
}
CONFIG = {
    "study": "study",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.49},
        "mesh": {"element": "CPE8", "across": 3, "per_layer": 2},
        "refined": {"element": "CPE8", "across": 4, "per_layer": 3},
        "parameters": {
            f"mu_{n}": {"unit": "MPa", "start": 0.1, "lower": 0.005, "upper": 0.5} for n in ("top", "bottom")
        },
    },
    "fit": {
        "score": "nmi",
        "bins": 16,
        "replicates": 20,
        "seed": seed_of(1),
        "stages": [
            {"name": "grid", "kind": "grid", "points": 3},
            {"name": "independent", "kind": "independent", "tolx": 0.3, "tolf": 0.05},
        ],
    },
}
SHORT = [{"name": "grid", "kind": "grid", "points": 2}]
"""Stages of a workflow that is run for something else than its constants: two thirds of the simulations."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the study, fitted once."""
    place = tmp_path_factory.mktemp("made")
    (place / "experiment.yaml").write_text(yaml.safe_dump(DESCRIPTION))
    run_experiment(place / "experiment.yaml", place / "study")
    configure(place)
    assert snakemake(place) > 5
    return place


@pytest.fixture
def place(made, tmp_path):
    """A copy of that folder, times kept."""
    shutil.copytree(made, tmp_path / "w", symlinks=True)
    return tmp_path / "w"


def configure(place, **changes):
    data = yaml.safe_load(yaml.safe_dump(CONFIG))
    for key, value in changes.items():
        at = data
        *parents, last = key.split("__")
        for parent in parents:
            at = at[int(parent) if parent.isdigit() else parent]
        at[last] = value
    (place / "config.yaml").write_text(yaml.safe_dump(data, sort_keys=False))


def command(*options):
    profile = str(ROOT / "workflow/profiles/default")
    return [
        str(Path(sys.executable).parent / "snakemake"), "-s", str(ROOT / "Snakefile"), "--cores", "2",
        "--workflow-profile", profile, *options,
    ]  # fmt: skip


def said(place, *options, **environment):
    """Run the workflow and return what it says of its jobs."""
    done = subprocess.run(
        command(*options, "--quiet", "host"), cwd=place, capture_output=True, text=True, env={**os.environ, **environment}
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stderr


def solved(place):
    """Simulations that have a solution, with its time."""
    return {path: path.stat().st_mtime_ns for path in place.glob("results/study/sims/*/solution.npz")}


def snakemake(place, *options, **environment):
    """Run the workflow and return how many simulations it ran, in jobs of their own or of their rounds."""
    before = solved(place)
    said(place, *options, **environment)
    return len(solved(place).items() - before.items())


def estimate(place):
    return (place / "results/study/base/estimate.json").read_text(encoding="utf-8")


def test_the_constants_are_found(made):
    found = read_json(made / "results/study/base/estimate.json")
    # the finer mesh decides; what its 24 elements changed against 12 tells the error that is left
    changes = [math.log(entry["value"] / found["search_mesh"][name]) for name, entry in found["parameters"].items()]
    left = math.hypot(*changes) / math.sqrt(len(changes)) / (math.sqrt(24 / 12) ** 1.2 - 1)
    assert left > 0
    for name, truth in (("mu_top", 0.03), ("mu_bottom", 0.06)):
        entry = found["parameters"][name]
        assert entry["value"] == pytest.approx(truth, rel=0.03)
        assert 0 < entry["standard_error"] < 0.1 * truth
        assert entry["mesh_error"] == pytest.approx(entry["value"] * left, rel=1e-6)
        low, high = entry["interval95"]
        assert math.log(high / low) > 2 * left
    assert found["sim_mesh"] == "refined"
    assert found["remarks"] == []


def test_the_figures_show_the_fit(made, tmp_path, monkeypatch):
    """Drawn once more in this process: the same files, and in them what was measured and computed."""
    monkeypatch.chdir(made)
    model, drawn = made / "results/study/base", recorded(monkeypatch)
    last = Round.load(model / f"rounds/{read_json(model / 'estimate.json')['search']['rounds'] - 1}.json")
    meshes = {"search": model / "mesh.inp", "refined": model / "refined.inp"}
    problem = InverseProblem(
        load_settings(Path("config.yaml")), Data.load(model / "prepared.npz"), meshes, model / "../sims"
    )
    plot_fit(problem, last, tmp_path)
    assert set(drawn) == {"force", "search", "deformed_mesh", "pictures"}
    for name in drawn:
        assert np.array_equal(imread(model / f"figures/{name}.png"), imread(tmp_path / f"{name}.png")), name
    shown = finest(problem, last)
    prediction, mesh = problem.prediction(shown), problem.meshes["refined"]
    check_forces(drawn["force"], problem.data, prediction.response)
    check_search(drawn["search"], last)
    check_deformed(drawn["deformed_mesh"], mesh, problem.outcome(shown), problem.data)
    check_pictures(drawn["pictures"], problem.data, prediction.pictures)


def test_python_opens_what_the_command_line_fitted(made, monkeypatch):
    monkeypatch.chdir(made)
    result = fingerfit.load_result("results/study/base")
    written = read_json(made / "results/study/base/estimate.json")["parameters"]
    assert result.constants.value.to_dict() == {name: entry["value"] for name, entry in written.items()}
    steps = result.steps
    assert steps.model_displacement.to_numpy() == pytest.approx(steps.displacement.to_numpy(), abs=0.1)
    with pytest.raises(StateError, match="results/study/other: has no finished fit; make it: fingerfit run"):
        fingerfit.load_result("results/study/other")


def test_rules_are_in_good_condition(made):
    """Snakemake's own linter: environments, logs, names, nothing from outside of the rules."""
    done = subprocess.run(command("--lint"), cwd=made, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Congratulations" in done.stderr + done.stdout


def nothing_to_do(place):
    done = subprocess.run(command("-n", "--quiet", "host"), cwd=place, capture_output=True, text=True)
    return "Nothing to be done" in done.stderr + done.stdout


def test_another_time_limit_runs_nothing_again(place):
    configure(place, time_limit=7)
    assert nothing_to_do(place)
    sim = next((place / "results/study/sims").iterdir())
    (sim / "solution.npz").unlink()
    assert f"--solver {sim.relative_to(place)}/solver.json --time-limit 7 " in said(place, "-p")


def test_nothing_to_do_afterwards(place):
    assert nothing_to_do(place)
    # the fit has not read the truth; that it is the same without it: those that are killed do not have it
    shutil.rmtree(place / "study/sealed")
    assert nothing_to_do(place)


@pytest.mark.slow
def test_a_diagnosis_of_a_model_that_lacks_nothing(place):
    """`snakemake diagnose` with the shipped profile: no search again, a verdict, the ladder and its page."""
    before = estimate(place)
    assert not re.search(r"rule simulate:|checkpoint propose:", said(place, "diagnose"))
    assert estimate(place) == before
    found = read_json(place / "results/study/base/diagnosis.json")
    assert (found["verdict"], found["effects"]) == ("adequate", [])
    (rung,) = read_json(place / "results/study/ladder.json")["rungs"]
    assert (rung["model"], rung["verdict"]) == ("base", "adequate")
    assert "Model adequate: no missing effect detected" in (place / "results/study/report.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.slow
def test_tolerances_cost_only_new_simulations(place):
    before, known = estimate(place), solved(place)
    configure(place, fit__stages__1__tolx=0.15, fit__stages__1__tolf=1e-2)
    told = said(place)
    assert known.items() < solved(place).items()
    # they were solved by the jobs of their rounds
    assert "checkpoint propose:" in told and "rule simulate:" not in told
    configure(place)
    assert snakemake(place) == 0
    assert estimate(place) == before


def test_one_deleted_result_is_one_simulation(place):
    before = estimate(place)
    # of the first round: those of the slopes begin at another one, which is then solved before them
    grid = read_json(place / "results/study/base/rounds/0.json")["batch"]
    one, other, *_ = (place / "results/study/sims" / asked["sim"] for asked in grid)
    (one / "solution.npz").unlink()
    assert len(re.findall(r"rule simulate:", said(place))) == 1
    shutil.rmtree(other)
    assert snakemake(place) == 1
    assert estimate(place) == before


@pytest.mark.slow
def test_a_changed_mesh_runs_everything_and_back_nothing(place):
    configure(place, model__mesh__across=2)
    assert snakemake(place) > 5
    configure(place)
    assert snakemake(place) == 0


@pytest.mark.slow
def test_a_changed_template_runs_what_depends_on_it(place):
    own = place / "study/own.inp.j2"
    own.write_text((ROOT / "templates/block.inp.j2").read_text(encoding="utf-8"))
    configure(place, model__template="own.inp.j2")
    assert snakemake(place) == 0
    own.write_text(own.read_text(encoding="utf-8").replace("values are totals", "values are the totals"))
    assert snakemake(place) > 5


@pytest.mark.slow
def test_another_solver_and_back(place, needs_ccx):
    ours = read_json(place / "results/study/base/estimate.json")
    configure(place, solver="calculix")
    assert snakemake(place) > 5
    theirs = read_json(place / "results/study/base/estimate.json")
    for name, entry in ours["parameters"].items():
        assert theirs["parameters"][name]["value"] == pytest.approx(entry["value"], rel=5e-3)
    configure(place)
    assert snakemake(place) == 0


@pytest.mark.slow
def test_two_workspaces_share_simulations(made, tmp_path):
    counts = []
    (tmp_path / "cache").mkdir()
    for name in ("a", "b"):
        place = tmp_path / name
        shutil.copytree(made / "study", place / "study")
        configure(place, fit__stages=SHORT)
        counts.append(snakemake(place, "--cache", SNAKEMAKE_OUTPUT_CACHE=str(tmp_path / "cache")))
    sims = list((tmp_path / "b/results/study/sims").iterdir())
    assert counts[0] > 5
    assert all((sim / "solution.npz").is_symlink() for sim in sims)


@pytest.mark.parametrize("kills", [2, pytest.param(10, marks=pytest.mark.slow)])
def test_killed_at_random_moments_and_called_again(made, tmp_path, kills):
    """A moment is drawn as a round and a delay after it, so that it lies inside the run on any machine.

    The study is there without its sealed truth. Of two kills the first leaves the processes it started alone.
    """
    place = tmp_path / "killed"
    shutil.copytree(made / "study", place / "study", ignore=shutil.ignore_patterns("sealed"))
    configure(place)
    rng = random.Random(seed_of(kills))
    rounds = read_json(made / "results/study/base/estimate.json")["search"]["rounds"]
    groups = []
    try:
        for n, number in enumerate(sorted(rng.choices(range(-1, rounds), k=kills))):
            # what follows the last round is the start of two programs, half a second at least
            delay = rng.uniform(0.0, 0.4 if number == rounds - 1 else 1.5)
            kill(place, tmp_path / f"log{n}", number, delay, groups)
            if not (n == 0 or rng.random() < 0.3):
                _kill_group(groups[-1])
        snakemake(place)
        assert estimate(place) == estimate(made)
        assert sorted(p.name for p in (place / "results/study/sims").iterdir()) == sorted(
            p.name for p in (made / "results/study/sims").iterdir()
        )
    finally:
        for group in groups:
            _kill_group(group)


def kill(place, log, number, delay, groups):
    """Call the workflow and kill it some seconds after a round (-1: its start), but not what it started: its group."""
    with log.open("wb") as written:
        running = subprocess.Popen(command(), cwd=place, stdout=written, stderr=written, start_new_session=True)
    groups.append(running.pid)
    try:
        deadline = time.monotonic() + 120
        while number >= 0 and not (place / f"results/study/base/rounds/{number}.json").exists():
            assert running.poll() is None, log.read_text(encoding="utf-8")
            assert time.monotonic() < deadline
            time.sleep(0.02)
        time.sleep(delay)
        assert running.poll() is None, "the run ended before it was killed"
    finally:
        running.kill()
        running.wait()
    assert not (place / "results/study/base/figures/pictures.png").exists()


def _kill_group(group):
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def test_a_wrong_config_or_study_is_one_line(place):
    """As `fingerfit check` says it, without Snakemake's words around it."""
    for change, line in (
        (
            lambda: configure(place, fit__scor="nmi"),
            "config.yaml: fit.scor: found an unknown key; expected score (did you",
        ),
        (lambda: configure(place, model__name="sims"), "config.yaml: model.name: found sims; expected another name"),
        (
            lambda: (place / "study/steps.csv").write_text(""),
            "study/steps.csv: columns: found an empty table; expected",
        ),
    ):
        configure(place)
        change()
        done = subprocess.run(command("-n"), cwd=place, capture_output=True, text=True)
        assert done.returncode == 1
        (found,) = [one for one in done.stderr.splitlines() if not one.startswith("Using workflow specific profile")]
        assert found.startswith(f"fingerfit: error: {line}")


def test_a_folder_may_have_any_name(made, tmp_path):
    """Its path is in the commands of three rules: one is run here, and of the others it is seen what would be run."""
    place = tmp_path / "my disk (x) [a] 'b\" & {c} $d"
    place.mkdir()
    shutil.copytree(made / "study", place / "study")
    configure(place)
    config = str(place / "config.yaml")
    said(place, "results/study/base/settings.json", "--configfile", config)
    assert (place / "results/study/base/settings.json").exists()
    for target in ("results/study/fit.sent", "discover"):
        line = command("-n", "--printshellcmds", target, "--configfile", config, "--quiet", "host")
        shown = subprocess.run(line, cwd=place, capture_output=True, text=True, check=True)
        assert f"--config {shlex.quote(config)} " in shown.stdout + shown.stderr
