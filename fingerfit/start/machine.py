"""A look at this machine: what a fit finds here, and a simulation of a known answer by each solver."""

from __future__ import annotations

import math
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

from fingerfit import __version__
from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import free_memory
from fingerfit.core.folders import SHIPPED
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver, solver_names
from fingerfit.testing.block import SIZE, homogeneous_force, write_block

PROGRAMS = ("numpy", "scipy", "SimpleITK", "snakemake")
PRESSED = 1.0
"""mm by which the block of the self test is pressed: a tenth of its height."""
CLOSE = 1e-3
"""Share by which its reaction may differ from the closed form: CalculiX prints seven digits of forces that it balances
to `fingerfit.solvers.calculix.RESIDUAL`, and the mesh has no error where all is homogeneous."""


def look(wrong: list[str]) -> Iterator[str]:
    """Lines on this machine, as they are found out; what makes fits impossible is added to `wrong`."""
    yield f"fingerfit {__version__} in {SHIPPED}"
    yield f"Python {platform.python_version()} in {sys.prefix}, {platform.platform()}"
    yield ", ".join(f"{name} {version(name)}" for name in PROGRAMS)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    threads = os.environ.get("OMP_NUM_THREADS", "1, as the workflow sets it")
    yield f"processors: {cores}; threads of linear algebra in each job: {threads}"
    disk = shutil.disk_usage(Path())
    yield f"free: {free_memory() / 1e9:.1f} GB of memory, {disk.free / 1e9:.1f} GB on the disk of this folder"
    yield _pardiso()
    for name in solver_names():
        yield _solver(name, wrong)


def _pardiso() -> str:
    try:
        from pypardiso import PyPardisoSolver

        PyPardisoSolver()
    except (ImportError, OSError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        return f"PARDISO: not found ({lines[0]}); only large systems in space need it: pip install pypardiso"
    return f"PARDISO: found, pypardiso {version('pypardiso')}"


def _solver(name: str, wrong: list[str]) -> str:
    """What is known of a solver, and how it did in the self test."""
    try:
        solver = get_solver(name)
        identity = solver.identity()
    except FingerfitError as error:
        if name == "builtin":
            wrong.append(str(error))
        return f"solver {name}: not found: {error}"
    told = f"solver {name} {identity.get('version', __version__)}"
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
        try:
            outcome = solver.solve(write_block(Path(folder), "displacement", [PRESSED], glued=False), Path(folder))
        except FingerfitError as error:
            wrong.append(f"solver {name}: {error}")
            return f"{told}: found, but its self test failed"
    seconds = time.monotonic() - began
    expected = abs(homogeneous_force(1 - PRESSED / SIZE, 2)[0])
    got = abs(float(outcome.reaction[-1][1])) if outcome.status == CONVERGED else math.nan
    if not abs(got - expected) <= CLOSE * expected:
        wrong.append(f"solver {name}: found a reaction of {got:.5g} N; expected {expected:.5g} N, the closed form")
        return f"{told}: found, but its self test failed"
    return f"{told}: self test passed in {seconds:.1f} s (reaction {got:.4g} N, closed form {expected:.4g} N)"
