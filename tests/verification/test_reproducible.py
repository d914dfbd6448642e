"""The same digits again: with other processes on the machine, and with one and two threads."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fingerfit.testing.solver import write_block

ROOT = Path(__file__).resolve().parents[2]
SOLVE = """
import hashlib, sys
from pathlib import Path
from fingerfit.solvers.builtin import BuiltinSolver
for deck in map(Path, sys.argv[2:]):
    found = BuiltinSolver().solve(deck, deck.parent, int(sys.argv[1]))
    print(found.status, found.iterations, hashlib.sha256(found.displacement.tobytes() + found.reaction.tobytes()).hexdigest())
"""
BUSY = "import numpy as np\na = np.random.default_rng().normal(size=(400, 400))\nwhile True: a = a @ a / np.linalg.norm(a @ a)"


@pytest.fixture(scope="module")
def decks(tmp_path_factory):
    """A block in the plane, and a sphere on a finger with more unknowns than BLAS adds up in one thread."""
    folder = tmp_path_factory.mktemp("decks")
    (folder / "finger").mkdir()
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        from finger import write_finger
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
    assert 3 * write_finger(folder / "finger/deck.inp", "displacement", [0.5], "C3D4", (15, 15, 15), 0) > 12000
    return [write_block(folder, "displacement", [1.0, 2.0], "CPE8", cells=12), folder / "finger/deck.inp"]


def solve(threads, decks):
    limits = {name: str(threads) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    command = [sys.executable, "-c", SOLVE, str(threads), *map(str, decks)]
    environment = {**os.environ, **limits, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def alone(decks):
    found = solve(1, decks)
    assert [line.split()[0] for line in found.splitlines()] == ["converged"] * 2
    return found


def test_other_processes_change_no_digit(decks, alone):
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert solve(1, decks) == alone
        assert all(process.poll() is None for process in busy)
    finally:
        for process in busy:
            process.kill()
            process.wait()


def test_two_threads_change_no_digit(decks, alone):
    assert solve(2, decks) == alone
    assert solve(2, decks) == alone
