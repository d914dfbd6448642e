"""Our adapters against the suite that any adapter's tests subclass."""

import shutil
import sys
from pathlib import Path

import pytest

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
    tolerance = 2e-5  # it stops iterating there

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
