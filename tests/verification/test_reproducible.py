"""The same digits again: with other processes on the machine, and with one and two threads.

numpy's BLAS has one thread, as in the workflow (`workflow/rules/common.smk`); threads are those that a solver is given.
"""

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
    """Two blocks in the plane, and a sphere on a finger with more unknowns than BLAS adds up in one thread.

    The small block is solved by levels of nearly the largest width, the other one by SuperLU.
    """
    folder = tmp_path_factory.mktemp("decks")
    for name in ("small", "finger"):
        (folder / name).mkdir()
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        from finger import write_finger
    finally:
        sys.path.remove(str(ROOT / "benchmarks"))
    assert 3 * write_finger(folder / "finger/deck.inp", "displacement", [0.5], "C3D4", (15, 15, 15), 0) > 12000
    blocks = [
        write_block(folder / name, "displacement", [1.0, 2.0], "CPE8", cells=n) for name, n in (("small", 10), ("", 12))
    ]
    return [*blocks, folder / "finger/deck.inp"]


def solve(threads, decks):
    command = [sys.executable, "-c", SOLVE, str(threads), *map(str, decks)]
    environment = {name: value for name, value in os.environ.items() if name != "MKL_NUM_THREADS"}
    environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def alone(decks):
    found = solve(1, decks)
    assert [line.split()[0] for line in found.splitlines()] == ["converged"] * 3
    return found


@pytest.mark.slow
def test_other_processes_change_no_digit(decks, alone):
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        assert solve(1, decks) == alone
        assert all(process.poll() is None for process in busy)
    finally:
        for process in busy:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_two_threads_change_no_digit(decks, alone):
    assert solve(2, decks) == alone
    assert solve(2, decks) == alone
