"""Our adapters against the suite that any adapter's tests subclass."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import phantom

from fingerfit.errors import SolverError
from fingerfit.solvers.abaqus import AbaqusSolver
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.registry import get_solver, solver_names
from fingerfit.testing.solver import ExternalSolverConformance, SolverConformance, write_block


class TestBuiltin(SolverConformance):
    tolerance = 1e-7

    def make(self):
        return BuiltinSolver()


class TestCalculix(ExternalSolverConformance):
    tolerance = 1e-6  # digits in its .dat; by itself it stops iterating at 2e-5

    def make(self):
        if shutil.which("ccx") is None:
            pytest.skip("CalculiX (ccx) is not installed")
        return CalculixSolver()

    @pytest.fixture(autouse=True)
    def patch(self, monkeypatch):
        self.monkeypatch = monkeypatch

    def make_with(self, program, time_limit):
        self.monkeypatch.setenv("FINGERFIT_CCX", program)
        return CalculixSolver(time_limit)


def test_calculix_iterates_as_far_as_it_is_told(write_deck, tmp_path, needs_ccx):
    """The adapter's own residual, CalculiX's, and that of a deck that says so itself."""
    deck, _ = write_deck(phantom("displacement", [0.5, 1.5, 2.5, 3.5]))
    force = -BuiltinSolver().solve(deck, tmp_path).reaction[:, 1]
    deck, _ = write_deck(phantom("force", force.tolist()))
    exact = BuiltinSolver().solve(deck, tmp_path).displacement

    def error(solver):
        return np.abs(solver.solve(deck, tmp_path).displacement - exact).max() / 3.5

    assert error(CalculixSolver()) < 3e-7
    assert error(CalculixSolver(residual=None)) > 1e-6
    assert CalculixSolver().identity() != CalculixSolver(residual=None).identity()
    deck.write_text(deck.read_text().replace("*STATIC", "*CONTROLS, PARAMETERS=FIELD\n5e-3\n*STATIC"))
    assert error(CalculixSolver()) > 1e-6


STAND_IN = Path(__file__).with_name("stand_in_abaqus.py")


class TestAbaqus(ExternalSolverConformance):
    """With a stand-in for ABAQUS that writes the same kind of results file: its answers are the built-in solver's."""

    tolerance = 1e-7

    def make(self):
        return AbaqusSolver(f"{sys.executable} {STAND_IN} job={{job}} cpus={{threads}}")

    def make_with(self, program, time_limit):
        return AbaqusSolver(f"{program} job={{job}}", time_limit)

    def test_it_says_what_it_is(self, tmp_path):
        solver = AbaqusSolver(self._script(tmp_path, "echo Abaqus 2024.HF1\n"))
        assert solver.identity()["version"] == "2024.HF1"
        assert solver.identity()["command"] == solver.command
        with pytest.raises(SolverError, match="names no release"):
            AbaqusSolver("true").identity()

    def test_a_licence_that_is_missing_is_told(self, tmp_path):
        deck = write_block(tmp_path, "displacement", [1.0])
        solver = self.make_with(self._script(tmp_path, "echo 'Abaqus License Manager checkout failed'; exit 1\n"), 30.0)
        with pytest.raises(SolverError, match="License Manager checkout failed"):
            solver.solve(deck, tmp_path)

    def test_a_wrong_template_is_told(self, tmp_path):
        deck = write_block(tmp_path, "displacement", [1.0])
        with pytest.raises(SolverError, match="threads"):
            AbaqusSolver("abaqus job={jub}").check(deck)


def test_all_are_found_by_name():
    assert {"abaqus", "builtin", "calculix"} <= set(solver_names())
    for name in ("abaqus", "builtin", "calculix"):
        assert get_solver(name).name == name
