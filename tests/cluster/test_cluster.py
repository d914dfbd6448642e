"""Studies on a real SLURM of one node: the same results as here, whatever happens to the jobs."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from one_layer import DESCRIPTION, FEW, SHARED
from slurm import Cluster, NotStarted, processes, which, why_not

from fingerfit.core.files import read_json
from fingerfit.virtual.experiment import run_experiment

ROOT = Path(__file__).resolve().parents[2]
NO_PLUGIN = not importlib.util.find_spec("snakemake_executor_plugin_slurm")
WHY = why_not() or ("not installed: snakemake-executor-plugin-slurm: make cluster" if NO_PLUGIN else None)
pytestmark = [pytest.mark.slow, pytest.mark.skipif(WHY is not None, reason=f"{WHY} (docs/cluster.md)")]
PATIENCE = 480
"""Seconds that may pass before something happens that SLURM looks for every half a minute."""


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with contextlib.ExitStack() as stack:
        try:
            running = stack.enter_context(Cluster(tmp_path_factory.mktemp("slurm") / "one"))
        except NotStarted as error:
            pytest.skip(f"SLURM cannot run here: {error}")
        yield running


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """The study, fitted and diagnosed on this machine."""
    place = tmp_path_factory.mktemp("here")
    (place / "experiment.yaml").write_text(yaml.safe_dump(DESCRIPTION))
    run_experiment(place / "experiment.yaml", place / "studies/one")
    configure(place, "one")
    done = subprocess.run([*COMMAND, "--diagnose", "--cores", "2"], cwd=place, env=environment(os.environ), text=True,
                          capture_output=True)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return place


COMMAND = (sys.executable, "-P", "-m", "fingerfit", "run")
SLURM = (*COMMAND, "--profile", "slurm")
SOONER = "--slurm-init-seconds-before-status-checks"


def environment(known):
    return {**known, "PYTHONPATH": str(ROOT)}


def configure(place, *names):
    runs = [{"study": f"studies/{name}"} for name in names]
    config = {**SHARED, "diagnosis": {"only": FEW}, "runs": runs}
    (place / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))


def copied(here, place, *names):
    """A workspace with copies of the study, and no results."""
    for name in names:
        shutil.copytree(here / "studies/one", place / "studies" / name)
    configure(place, *names)


@contextlib.contextmanager
def started(cluster, place, command, **more):
    """The workflow beside the cluster."""
    with (place / "said").open("w") as said:
        running = subprocess.Popen(
            command, cwd=place, stdout=said, stderr=said, env=environment(cluster.environment) | more
        )
        try:
            yield running
        finally:
            if running.poll() is None:
                running.terminate()
                try:
                    running.wait(60)
                except subprocess.TimeoutExpired:
                    running.kill()
                    running.wait()


def wait(cluster, what):
    """Wait until something is true, and return it."""
    end = time.monotonic() + PATIENCE
    while not (found := what()):
        assert time.monotonic() < end, cluster.jobs()
        time.sleep(0.2)
    return found


def files(place, study="one"):
    """What a fit and a diagnosis found, by name: bytes, of JSON the content without the name of the study."""
    folder = place / "results" / study
    names = [*folder.glob("base/rounds/*.json"), *folder.glob("base/*.json"), *folder.glob("base/figures/*.png")]
    return {str(path.relative_to(folder)): content(path) for path in names if path.name != "settings.json"}


def same(fit, both):
    """Whether a fit is that of a fit with its diagnosis."""
    assert "base/estimate.json" in fit
    assert fit == {name: both[name] for name in fit}


def without_rounds(found):
    """The same without the files of the rounds and their number: one job makes several where simulations are short."""
    kept = {name: content for name, content in found.items() if "/rounds/" not in name}
    estimate = kept["base/estimate.json"]
    search = {key: value for key, value in estimate["search"].items() if key != "rounds"}
    return kept | {"base/estimate.json": estimate | {"search": search}}


def content(path):
    if path.suffix != ".json":
        return path.read_bytes()
    return {key: value for key, value in read_json(path).items() if key not in ("study", "checksum")}


def test_a_fit_and_a_diagnosis_are_those_of_this_machine(cluster, here, tmp_path):
    copied(here, tmp_path, "one")
    with started(cluster, tmp_path, [*SLURM, "--diagnose"]) as running:
        asked = wait(cluster, lambda: cluster.jobs())
        assert running.wait(PATIENCE) == 0, (tmp_path / "said").read_text()
    assert len(cluster.jobs()) == len(asked) == 1
    assert asked[0][5] == "2"
    names = {"base/estimate.json", "base/diagnosis.json", "base/rounds/0.json", "base/figures/force.png"}
    assert names < set(files(here)) == set(files(tmp_path))
    for name in [*files(here), "base/table.txt", "base/settings.json", "ladder.json"]:
        assert (tmp_path / "results/one" / name).read_bytes() == (here / "results/one" / name).read_bytes(), name
    said = (tmp_path / "said").read_text()
    assert "std. error" in said and "verdict:" in said and "page: results/one/report.html" in said


def test_long_simulations_are_jobs_of_their_own(cluster, here, tmp_path):
    before = len(cluster.jobs())
    copied(here, tmp_path, "one")
    # the state of jobs is asked for sooner than the profile says: each of them is waited for
    profile = ("--workflow-profile", str(ROOT / "workflow/profiles/slurm"), SOONER, "1")
    plain = [sys.executable, "-P", "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), *profile]
    with started(cluster, tmp_path, plain, FINGERFIT_LONG="0") as running:
        assert running.wait(PATIENCE) == 0, (tmp_path / "said").read_text()
    comments = [job[2] for job in cluster.jobs()[before:]]
    simulations = len(list((tmp_path / "results/one/sims").iterdir()))
    assert sum("rule_simulate" in comment for comment in comments) == simulations > 2
    assert not any("rule_study" in comment for comment in comments)
    same(without_rounds(files(tmp_path)), without_rounds(files(here)))


@pytest.fixture(scope="module")
def troubled(cluster, here, tmp_path_factory):
    """Three studies and a damaged one in a queue that is full, whose jobs are cancelled, ended and lose their node."""
    place = tmp_path_factory.mktemp("troubled")
    names = ("cancelled", "late", "damaged")
    copied(here, place, *names)
    picture = sorted((place / "studies/damaged/pictures").iterdir())[-1]
    picture.write_bytes(picture.read_bytes()[:200])
    first = len(cluster.jobs())
    sleep = ("sbatch", "--parsable", "--exclusive", "--output=/dev/null", "--wrap", "sleep 3600")
    other = cluster.ask(*sleep).stdout.strip()
    seen = {}

    def jobs(name, state):
        return [job for job in cluster.jobs(state) if int(job[0]) > first and f"results_{name}" in job[2]]

    with started(cluster, place, SLURM) as running:
        seen["waiting"] = wait(cluster, lambda: all(found := [jobs(name, "PENDING") for name in names]) and found)
        cluster.ask("scancel", other)
        seen["numbers"] = numbers = {name: seen["waiting"][n][0][0] for n, name in enumerate(names[:2])}
        for name, number in numbers.items():
            wait(cluster, (place / f"results/{name}/base/rounds/0.json").exists)
            cluster.ask("scancel", "--full", "--signal=STOP", number)  # its end is not told: it hangs until it is ended
        cluster.ask("scancel", numbers["cancelled"])
        cluster.ask("scontrol", "update", f"JobId={numbers['late']}", "EndTime=now+1seconds")
        seen["cancelled"] = wait(cluster, lambda: jobs("cancelled", "CANCELLED"))
        seen["late"] = wait(cluster, lambda: jobs("late", "TIMEOUT"))
        # the job that comes in its place loses its node
        again = wait(cluster, lambda: jobs("late", "RUNNING"))
        cluster.node_down()
        seen["lost"] = wait(cluster, lambda: [job for job in jobs("late", "PENDING") if job[0] == again[0][0]])
        cluster.node_up()
        seen["code"] = running.wait(PATIENCE)
    seen["said"] = (place / "said").read_text()
    return place, seen


def test_a_full_queue_is_waited_for(troubled):
    """Each of several short studies asks for one processor: they are what runs side by side."""
    waiting = troubled[1]["waiting"]
    assert len(waiting) == 3
    assert {job[5] for jobs in waiting for job in jobs} == {"1"}


@pytest.mark.parametrize("name", ["cancelled", "late"])
def test_a_job_that_was_cancelled_or_over_its_time_goes_on(troubled, here, name):
    """Snakemake sends another one in its place, which takes up what the first has made."""
    place, seen = troubled
    assert seen[name][0][0] == seen["numbers"][name]
    same(files(place, name), files(here))


def test_a_job_that_lost_its_node_goes_on(troubled, here):
    """SLURM itself puts it back into the queue: the job that was sent for `late` after its first one was ended."""
    place, seen = troubled
    (lost,) = seen["lost"]
    assert lost[0] != seen["numbers"]["late"]
    same(files(place, "late"), files(here))


def test_a_study_that_fails_stops_no_other_one(troubled):
    place, seen = troubled
    assert seen["code"] == 1
    assert not (place / "results/damaged/base/estimate.json").exists()
    assert "studies/damaged/pictures/step_1.nii.gz: picture: found gzip that ends in the middle" in seen["said"]
    assert "Traceback" not in seen["said"]
    for name in ("cancelled", "late"):
        assert f"table: results/{name}/base/table.txt" in seen["said"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_a_cluster_that_is_interrupted(tmp_path, number):
    """Its daemons, a job and its watcher, what waits for the job, and the folder of the socket."""
    command = [sys.executable, str(ROOT / "tests/cluster/slurm.py"), "srun", "sleep", "600"]
    known = {**os.environ, "TMPDIR": str(tmp_path)}
    running = subprocess.Popen(command, env=known, start_new_session=True)
    end = time.monotonic() + PATIENCE

    def names():
        return {name for folder in tmp_path.glob("slurm-*/one") for name in processes(folder).values()}

    try:
        while not names() >= {"munged", "slurmctld", "slurmd", "slurmstepd", "srun", "sleep"}:
            assert running.poll() is None and time.monotonic() < end, names()
            time.sleep(0.2)
        (folder,) = tmp_path.glob("slurm-*/one")
    finally:
        os.kill(running.pid, number)
    assert running.wait(60) in (128 + number, -signal.SIGKILL)
    while processes(folder) or list(tmp_path.glob("munge-*")):
        assert time.monotonic() < end
        time.sleep(0.2)


def test_a_slurm_of_the_machine_is_left_alone(tmp_path, monkeypatch):
    (tmp_path / "slurm.conf").write_text("ClusterName=theirs\n", encoding="utf-8")
    monkeypatch.setenv("SLURM_CONF", str(tmp_path / "slurm.conf"))
    assert why_not() == f"this machine has a SLURM, which is left alone: {tmp_path}/slurm.conf"
    done = subprocess.run([sys.executable, str(ROOT / "tests/cluster/slurm.py")], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", f"{why_not()}\n")


def test_a_program_that_does_not_start_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("slurm.which", lambda name: shutil.which("false") if name == "munged" else which(name))
    with pytest.raises(NotStarted, match="munged did not start"), Cluster(tmp_path / "one"):
        pass
    assert processes(tmp_path / "one") == {}
