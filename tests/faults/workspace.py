"""A tiny study fitted by the workflow, what happens to it, and whether the next run heals it."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from battery import CLEAR, COLUMNS, NEITHER, ROWS
from one_layer import FEW
from places import EXPERIMENT, ROOT, dump

from fingerfit.virtual.experiment import run_experiment

HEALED = "healed"
LONG = 300.0
"""Seconds: fit and diagnosis of the study take up to 15 s of processor time each; what takes 20 times as long hangs."""
MODEL = "results/study/base"
MESH = {"element": "CPE4", "across": 2, "per_layer": 2, "grading": 1}
CONFIG: dict[str, Any] = {
    "study": "study",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.45},
        "mesh": MESH,
        "parameters": {"mu": {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2}},
    },
    # three rounds: a grid, a simplex, and one of what follows: slopes and the last guess
    "fit": {
        "score": "nmi",
        "bins": 8,
        "replicates": 20,
        "stages": [
            {"name": "grid", "kind": "grid", "points": 2},
            {"name": "independent", "kind": "independent", "tolx": 0.5, "tolf": 1},
        ],
    },
    "diagnosis": {"only": FEW},
}


class Workspace:
    """A folder with a study in which the workflow runs.

    Parameters
    ----------
    path : Path
    project : Path
        Where Snakefile and package are.
    """

    def __init__(self, path: Path, project: Path = ROOT) -> None:
        self.path, self.project = path, project
        self.environment: dict[str, str] = {}

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    def command(self, *targets: str) -> list[str]:
        """The workflow as README calls it, in this folder."""
        profile = str(self.project / "workflow/profiles/default")
        return [sys.executable, "-m", "snakemake", *targets, "-s", str(self.project / "Snakefile"), "--cores", "2",
                "--workflow-profile", profile]  # fmt: skip

    def start(self, *targets: str, command: Sequence[str] = (), limit: Callable[[], None] | None = None) -> Running:
        """Begin a run, in a group of processes of its own."""
        environment = {**os.environ, "PYTHONPATH": str(self.project), **self.environment}
        if limit is not None:  # Python cuts the modules that it compiles where no file may be larger, and keeps them
            environment["PYTHONDONTWRITEBYTECODE"] = "1"
        said = self.path.parent / f"said-{time.monotonic_ns()}"

        def become() -> None:
            signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by what a shell runs in the background
            if limit is not None:
                limit()

        with said.open("wb") as sink:
            process = subprocess.Popen(
                list(command) or self.command(*targets), cwd=self.path, stdout=sink, stderr=sink, env=environment,
                stdin=subprocess.DEVNULL, start_new_session=True, preexec_fn=become,
            )  # fmt: skip
        return Running(process, said)

    def run(self, *targets: str, **more: Any) -> tuple[int | None, str]:
        """Run to the end; exit code (None for a run that hangs) and what was said."""
        return self.start(*targets, **more).end()

    def estimate(self) -> str:
        """The text of the estimate; empty where there is none."""
        path = self / f"{MODEL}/estimate.json"
        return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""

    def sim(self) -> Path:
        """Folder of a simulation of the first round."""
        first = self / f"{MODEL}/rounds/0.json"
        return self / f"results/study/sims/{yaml.safe_load(first.read_text(encoding='utf-8'))['batch'][0]['sim']}"

    def configure(self, **changes: Any) -> None:
        """Write config.yaml with other values, whose keys have ``__`` for dots."""
        data = yaml.safe_load(yaml.safe_dump(CONFIG))
        for key, value in changes.items():
            *parents, last = key.split("__")
            at = data
            for parent in parents:
                at = at[int(parent) if parent.isdigit() else parent]
            at[last] = value
        dump(self / "config.yaml", data)


@dataclass
class Running:
    """A run that was begun."""

    process: subprocess.Popen[bytes]
    said: Path

    def end(self) -> tuple[int | None, str]:
        """Wait for its end."""
        try:
            code: int | None = self.process.wait(LONG)
        except subprocess.TimeoutExpired:
            code = None
        self.kill_all()
        return code, self.text()

    def text(self) -> str:
        """What was said so far."""
        return self.said.read_text(encoding="utf-8", errors="replace")

    def kill_all(self) -> None:
        """End it and what it began."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def until(self, path: Path, after: float = 0.0) -> None:
        """Wait until a file is there that is not older."""
        begun = time.monotonic()
        while not (path.exists() and path.stat().st_mtime >= after):
            assert self.process.poll() is None, self.text()[-2000:]
            assert time.monotonic() - begun < LONG, f"no {path}"
            time.sleep(0.02)


Happens = Callable[[Workspace], object]


@dataclass(frozen=True)
class Fault:
    """Something that happens to a workspace.

    Parameters
    ----------
    name : str
    happens : callable
        Does it; what it says (str) of a run that it made must be a clear line, too.
    start : str
        What is there before: ``study``, ``fitted`` or ``diagnosed``.
    targets : tuple of str
        Of the run afterwards.
    says : tuple of str
        Regular expressions of a clear line: the file, and the command that mends.
    mends : callable, optional
        Does what that line says; then the run must give the estimate of an undisturbed one.
    damaged : callable, optional
        Files that the fault damaged: they must not be the same afterwards.
    other : bool
        The inputs are others afterwards, so that the estimate must be that of a run from nothing.
    """

    name: str
    happens: Happens
    start: str = "fitted"
    targets: tuple[str, ...] = ()
    says: tuple[str, ...] = ("fingerfit: error|WorkflowError",)
    mends: Happens | None = None
    damaged: Callable[[Workspace], list[Path]] | None = None
    other: bool = False
    needs: Callable[[], str] = field(default=lambda: "")

    def __str__(self) -> str:
        return self.name


def clear(said: str, words: Sequence[str]) -> str:
    """Why what a run says is not one clear line with these words; empty where it is."""
    if "Traceback" in said:
        at = said.rindex("Traceback")
        return f"says Traceback: {' '.join(said[at:].split())[-160:]}"
    lines = [line for line in said.splitlines() if all(re.search(word, line) for word in words)]
    last = " ".join(said.split())[-160:]
    if not lines:
        return f"no line with {' and '.join(words)}: {last}"
    if min(map(len, lines)) > ROWS * COLUMNS:
        return f"a line of {min(map(len, lines))} characters"
    return ""


def assess(fault: Fault, place: Workspace, expected: str, fresh: Callable[[Workspace], str]) -> tuple[str, str]:
    """Let a fault happen, run again, and tell the outcome and in one line what happened."""
    said_by_fault = fault.happens(place)
    if isinstance(said_by_fault, str) and (why := clear(said_by_fault, fault.says)):
        return NEITHER, f"under the fault: {why}"
    broken = {path: _content(path) for path in fault.damaged(place)} if fault.damaged else {}
    code, said = place.run(*fault.targets)
    if code is None:
        return NEITHER, "the next run hangs"
    outcome = HEALED
    if code != 0:
        if why := clear(said, fault.says):
            return NEITHER, f"the next run: {why}"
        outcome = CLEAR
        if fault.mends is None:
            return outcome, ""
        fault.mends(place)
        code, said = place.run(*fault.targets)
        if code != 0:
            return NEITHER, f"not mended by what the line says: {' '.join(said.split())[-160:]}"
    wanted = fresh(place) if fault.other else expected
    if place.estimate() != wanted:
        return NEITHER, "another estimate without a word" if place.estimate() else "no estimate"
    same = [path for path, content in broken.items() if _content(path) == content]
    return (NEITHER, f"{same[0].name} stays as it was damaged") if same else (outcome, "")


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def make_study(folder: Path) -> Workspace:
    """The study and its config; the model lacks a drift of the pictures alone, so that a diagnosis refits one effect."""
    layers = [{"name": "gel", "height": 12, "mu": 0.05, "intensity": 0.5}]
    dump(folder / "experiment.yaml", {
        **EXPERIMENT, "body": {**EXPERIMENT["body"], "layers": layers}, "mesh": MESH, "displacement": [0.6, 1.2],
        "effects": {"intensity_drift": {"gain": 0.2}}, "picture": {**EXPERIMENT["picture"], "pixels": 32},
    })  # fmt: skip
    run_experiment(folder / "experiment.yaml", folder / "study")
    place = Workspace(folder)
    place.configure()
    return place


def copied(place: Workspace, folder: Path, project: Path | None = None) -> Workspace:
    """A copy of a workspace, times kept."""
    shutil.copytree(place.path, folder, symlinks=True)
    return Workspace(folder, project or place.project)
