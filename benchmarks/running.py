"""Runs of one solver on one deck, each in a process of its own: its time, its peak memory and what it found.

The time is that of `solve`, from the deck on disk to the displacements: on the clock, and of the processor, which says
more where other programs run beside it. The built-in solver loads its libraries in the
first solve of a process: `first` has that, `seconds` is a second solve where the first was short.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from fingerfit.solvers.builtin import BuiltinSolver  # noqa: E402
from fingerfit.solvers.calculix import CalculixSolver  # noqa: E402
from fingerfit.solvers.calculix_output import read_dat  # noqa: E402
from fingerfit.solvers.contract import Outcome  # noqa: E402
from fingerfit.solvers.process import run  # noqa: E402

_SHORT = 5.0
"""Seconds of a first solve up to which a second one is timed."""


@dataclass(frozen=True)
class Run:
    """One run: seconds, those of the first solve, processor times of both, peak memory in MB, and the outcome."""

    seconds: float
    first: float
    busy: float
    cpu: float
    memory: float
    outcome: Outcome


def run_solver(name: str, deck: Path, threads: int, limit: float = 3600.0) -> Run:
    """Run a solver in a new process.

    `builtin`, `calculix` (the adapter), `default` (the adapter, where CalculiX stops by itself) or `ccx` (any deck).
    """
    out = deck.parent / f"{name}.npz"
    limits = {key: str(threads) for key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    command = [sys.executable, __file__, name, str(deck), str(out), str(threads), str(limit)]
    found = subprocess.run(command, env={**os.environ, **limits}, capture_output=True, text=True)
    if found.returncode:
        raise RuntimeError(f"{name}: {deck}: {found.stderr.strip().splitlines()[-1]}")
    measured = json.loads(found.stdout.splitlines()[-1])
    times = [measured[key] for key in ("seconds", "first", "busy", "cpu", "memory")]
    return Run(*times, Outcome.load(out))


def machine() -> str:
    """Processor and programs in one line."""
    cpu = next(
        (
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
            if "model name" in line
        ),
        platform.machine(),
    )
    try:
        from importlib.metadata import version

        direct = f"pypardiso {version('pypardiso')}"
    except ImportError:
        direct = "SuperLU"
    ccx = CalculixSolver().identity()["version"]
    return f"{os.cpu_count()} cores of {cpu}; Python {platform.python_version()}, {direct}; CalculiX {ccx}"


def _peak(pid: int | str) -> float:
    """Peak resident memory of a process so far, MB."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
            if line.startswith("VmHWM"):
                return float(line.split()[1]) / 1024
    except OSError:
        pass
    return 0.0


def _watch(peak: list[float], done: threading.Event) -> None:
    """Keep the peak of this process's children."""
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    while not done.wait(0.02):
        for pid in children.read_text(encoding="utf-8").split():
            peak[0] = max(peak[0], _peak(pid))


class _Ccx:
    """CalculiX on decks that only it reads; every step lasts 1 s and prints U of ALL and INDENTER, RF of BOTTOM."""

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def solve(self, deck: Path, workdir: Path, threads: int) -> Outcome:
        count = str(threads)
        environment = {"OMP_NUM_THREADS": count, "CCX_NPROC_EQUATION_SOLVER": count}
        run(["ccx", "-i", deck.stem], workdir, self.limit, environment)
        ends = [step + 1.0 for step in range(deck.read_text(encoding="utf-8").count("*END STEP"))]
        wanted = ("U ALL", "U INDENTER", "RF BOTTOM")
        text = (workdir / f"{deck.stem}.dat").read_text(encoding="utf-8")
        # the first step may only find the contact, and print nothing
        tables = [table for table in read_dat(text, ends, wanted, f"ccx: {deck}") if table.keys() >= set(wanted)]
        moved = np.array([table["U ALL"][:, 1:] for table in tables])
        force = np.array([-table["RF BOTTOM"][:, 1:].sum(axis=0) for table in tables])
        indenter = np.array([table["U INDENTER"][0, 1:] for table in tables])
        return Outcome("converged", moved, force, indenter, f"{len(tables)} steps")


def _work() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("name", choices=("builtin", "calculix", "default", "ccx"))
    parser.add_argument("deck", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("threads", type=int)
    parser.add_argument("limit", type=float)
    args = parser.parse_args()
    solvers = {
        "builtin": BuiltinSolver(averaged=False),
        "calculix": CalculixSolver(args.limit),
        "default": CalculixSolver(args.limit, residual=None),
        "ccx": _Ccx(args.limit),
    }
    solver = solvers[args.name]
    peak, done = [0.0], threading.Event()
    if args.name != "builtin":
        threading.Thread(target=_watch, args=(peak, done), daemon=True).start()
    start, begun = time.perf_counter(), sum(os.times()[:4])
    outcome = solver.solve(args.deck, args.deck.parent, args.threads)
    first = seconds = time.perf_counter() - start
    cpu = busy = sum(os.times()[:4]) - begun
    done.set()
    if args.name == "builtin" and first < _SHORT:
        start, begun = time.perf_counter(), sum(os.times()[:4])
        outcome = solver.solve(args.deck, args.deck.parent, args.threads)
        seconds, busy = time.perf_counter() - start, sum(os.times()[:4]) - begun
    outcome.save(args.out)
    measured = {"seconds": seconds, "first": first, "busy": busy, "cpu": cpu, "memory": peak[0] or _peak("self")}
    print(json.dumps(measured))


def difference(ours: Outcome, theirs: Outcome) -> float:
    """Largest difference of displacements at the end of all steps that both reached, mm."""
    steps = min(ours.steps, theirs.steps)
    return float(np.abs(ours.displacement[:steps] - theirs.displacement[:steps]).max()) if steps else float("nan")


if __name__ == "__main__":
    _work()
