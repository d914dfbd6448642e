"""Our adapters against the suite that any adapter's tests subclass."""

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import phantom
from fil import FIL

from fingerfit.core.errors import InputError, SolverError
from fingerfit.deck.reader import read_deck
from fingerfit.solvers.abaqus import AbaqusSolver
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.calculix import CalculixSolver
from fingerfit.solvers.calculix_output import reason
from fingerfit.solvers.contract import Capabilities
from fingerfit.solvers.needs import FEATURES
from fingerfit.solvers.registry import get_solver, solver_names
from fingerfit.testing.damage import Format
from fingerfit.testing.solver import CHANGES, ExternalSolverConformance, SolverConformance, write_block


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

    def program(self):
        self.make()
        return [shutil.which("ccx")]

    def results(self):
        def row(line):
            found = re.fullmatch(r"\s+(\d+)((?:\s+\S+){3})\s*", line)
            return (int(found[1]), [float(cell) for cell in found[2].split()]) if found else None

        def piece(line, row):
            return f"{row[0]:10d}" + "".join(f"{value:14.6E}" for value in row[1]) + "\n"

        return Format("deck.dat", lambda text: text.splitlines(keepends=True), "".join, row, piece)


def test_a_full_disk_is_no_answer(tmp_path, needs_ccx, monkeypatch):
    """A limit of 4 kB for each file stands for it: CalculiX goes on, and ends with 0."""
    (tmp_path / "ccx").write_text(f"#!/bin/sh\ntrap '' XFSZ\nulimit -f 8\n{shutil.which('ccx')} \"$@\"\n")
    (tmp_path / "ccx").chmod(0o755)
    monkeypatch.setenv("FINGERFIT_CCX", str(tmp_path / "ccx"))
    work = tmp_path / "work"
    work.mkdir()
    with pytest.raises(SolverError, match=r"deck\.inp: (damaged|exit code 0)"):
        CalculixSolver().solve(write_block(tmp_path, "displacement", [0.5, 1.0, 1.5]), work)
    assert not list(work.iterdir())


def test_as_many_increments_as_a_deck_allows_are_an_answer(tmp_path, needs_ccx):
    deck = write_block(tmp_path, "force", [0.5, 5.0])
    deck.write_text(deck.read_text().replace("INC=1000", "INC=2"))
    outcome = CalculixSolver().solve(deck, tmp_path)
    assert (outcome.status, outcome.steps) == ("diverged", 1)


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


@pytest.mark.parametrize("module", ["abaqus", "calculix"])
def test_another_adapter_is_another_solver(monkeypatch, needs_ccx, module):
    """Answers that an older one read are not found again."""
    solver = AbaqusSolver(f"{sys.executable}") if module == "abaqus" else CalculixSolver()
    monkeypatch.setattr("fingerfit.solvers.abaqus._version", lambda program: "2024")
    before = solver.identity()
    monkeypatch.setattr(f"fingerfit.solvers.{module}.ADAPTER", 1)
    assert solver.identity() != before


def changed(tmp_path, *replacements):
    """The deck of the block with other lines."""
    deck = write_block(tmp_path, "displacement", [1.0])
    text = deck.read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    deck.write_text(text)
    return deck


RELAXING = ("*SOLID SECTION", "*VISCOELASTIC, TIME=PRONY\n0.3, 0., 10.\n*SOLID SECTION")
FIBRES = (
    "*HYPERELASTIC, OGDEN, N=1\n0.03, 1.4, 0.7",
    "*ANISOTROPIC HYPERELASTIC, HOLZAPFEL, LOCAL DIRECTIONS=1\n0.02, 0.7, 0.05, 0.9, 0.1",
)
STRESS = ("*BOUNDARY", "*INITIAL CONDITIONS, TYPE=STRESS\nALL_LAYERS, -0.01, 0., 0., 0., 0., 0.\n*BOUNDARY")
PLATE = (
    "*EQUATION",
    "*SURFACE, NAME=FACE\nALL_LAYERS\n*NODE\n9000, 0., 11.\n*SURFACE, NAME=T, TYPE=SEGMENTS\nSTART, 15., 11.\n"
    "LINE, -5., 11.\n*RIGID BODY, ANALYTICAL SURFACE=T, REF NODE=9000\n*SURFACE INTERACTION, NAME=I\n"
    "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR\n10.\n*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE\n"
    "FACE, T\n*BOUNDARY\n9000, 1, 2\n9000, 6, 6\n*EQUATION",
)


@pytest.mark.parametrize(
    "change, keyword",
    [
        (RELAXING, "*VISCOELASTIC"),
        (FIBRES, "*ANISOTROPIC HYPERELASTIC"),
        (STRESS, "*INITIAL CONDITIONS"),
        (PLATE, "*SURFACE, TYPE=SEGMENTS"),
        (("*STATIC", "*STATIC, LONG TERM"), "*STATIC, LONG TERM"),
    ],
)
def test_what_calculix_lacks_is_refused(tmp_path, needs_ccx, change, keyword):
    deck = changed(tmp_path, change)
    BuiltinSolver().check(deck)
    for action in (CalculixSolver().check, lambda deck: CalculixSolver().solve(deck, tmp_path)):
        with pytest.raises(InputError) as caught:
            action(deck)
        assert str(caught.value).startswith(f"{deck}: ")
        assert keyword in str(caught.value)
        assert "solver calculix" in str(caught.value)


class CarelessCalculix(CalculixSolver):
    """As if nobody had known what CalculiX lacks."""

    capabilities = Capabilities(CalculixSolver.capabilities.elements, features=FEATURES)


@pytest.mark.parametrize(
    "change, told",
    [
        (RELAXING, r"it does not know \*VISCOELASTIC,TIME=PRONY, and went on without it"),
        (("*STATIC", "*STATIC, LONG TERM"), r"it does not know parameter LONGTERM of \*STATIC"),
    ],
)
def test_what_calculix_only_warns_of_is_no_answer(tmp_path, needs_ccx, change, told):
    with pytest.raises(SolverError, match=told):
        CarelessCalculix().solve(changed(tmp_path, change), tmp_path)


def test_what_changes_nothing_may_be_unknown_to_calculix(tmp_path, needs_ccx):
    plain = CalculixSolver().solve(write_block(tmp_path, "displacement", [1.0]), tmp_path)
    deck = changed(tmp_path, ("*MATERIAL", "*PREPRINT, ECHO=NO\n*MATERIAL"))
    outcome = CalculixSolver().solve(deck, tmp_path)
    assert outcome.status == "converged"
    assert np.array_equal(outcome.displacement, plain.displacement)


def test_calculix_gives_its_reason(tmp_path, needs_ccx):
    with pytest.raises(SolverError, match=r"\*ERROR reading \*INITIAL CONDITIONS. Card image: ALL_LAYERS,-0\.01"):
        CarelessCalculix().solve(changed(tmp_path, STRESS), tmp_path)
    with pytest.raises(SolverError, match=r"deck\.inp: it does not know \*ANISOTROPICHYPERELASTIC"):
        CarelessCalculix().solve(changed(tmp_path, FIBRES), tmp_path)


def test_the_reason_is_the_whole_first_error():
    said = " *INFO here\n *ERROR reading *BOUNDARY: node set BOTTO      \n        has not yet been defined. \n *ERROR reading"
    assert reason(said) == "*ERROR reading *BOUNDARY: node set BOTTO has not yet been defined."
    stop = " *ERROR in calinput: at least one fatal\n        error message while reading the\n"
    assert reason(stop) is None
    assert reason(stop + "\n *ERROR in nonlingeo: no\n        way\n\n   more") == "*ERROR in nonlingeo: no way"


def test_calculix_prints_what_a_deck_does_not(tmp_path, needs_ccx):
    deck = write_block(tmp_path, "displacement", [0.5, 1.0])
    printed, text, mesh = CalculixSolver().solve(deck, tmp_path), deck.read_text(), (tmp_path / "block.inp").read_text()
    prints = "*NODE PRINT, NSET=ALL, FREQUENCY=1000\nU\n*NODE PRINT, NSET=BOTTOM, FREQUENCY=1000\nRF\n"
    assert text.count(prints) == 2
    deck.write_text(text.replace(prints, ""))
    (tmp_path / "block.inp").write_text(mesh.replace("NSET=ALL\n", "NSET=EVERY\n"))
    outcome = CalculixSolver().solve(deck, tmp_path)
    assert np.array_equal(outcome.displacement, printed.displacement)
    assert np.array_equal(outcome.reaction, printed.reaction)


def test_calculix_may_have_gaps_between_its_nodes(tmp_path, needs_ccx):
    deck = write_block(tmp_path, "displacement", [1.0])
    outcome, mesh = CalculixSolver().solve(deck, tmp_path), (tmp_path / "block.inp").read_text()
    last = int(read_deck(deck).mesh.node_sets["ALL"].max()) + 1
    for file in (deck, tmp_path / "block.inp"):
        file.write_text(re.sub(rf"\b{last}\b(?!\.)", "777", file.read_text()))
    assert mesh != (tmp_path / "block.inp").read_text()
    again = CalculixSolver().solve(deck, tmp_path)
    assert again.displacement.shape == outcome.displacement.shape
    assert again.displacement == pytest.approx(outcome.displacement, abs=1e-6)


class Deaf(BuiltinSolver):
    """Leaves one of the keywords out that the suite adds to its block, and refuses nothing."""

    def __init__(self, feature):
        super().__init__()
        self.feature = feature

    def check(self, deck):
        pass

    def solve(self, deck, workdir, threads=1):
        (workdir / "plain").mkdir(exist_ok=True)
        plain = write_block(workdir / "plain", "displacement", [1.0])
        deaf = CHANGES[self.feature](plain.read_text()) == deck.read_text()
        return super().solve(plain if deaf else deck, workdir, threads)


@pytest.mark.parametrize("feature", CHANGES)
def test_the_suite_hears_what_an_adapter_leaves_out(tmp_path, feature):
    suite, solver = SolverConformance(), Deaf(feature)
    with pytest.raises(AssertionError, match=re.escape(f"{feature} is left out")):
        suite.test_a_keyword_changes_the_answer_or_is_refused(solver, tmp_path)
    solver.capabilities = Capabilities(BuiltinSolver.capabilities.elements, features=FEATURES - {feature})
    with pytest.raises(pytest.fail.Exception, match="DID NOT RAISE"):
        suite.test_a_keyword_changes_the_answer_or_is_refused(solver, tmp_path)


STAND_IN = Path(__file__).with_name("stand_in_abaqus.py")


class TestAbaqus(ExternalSolverConformance):
    """With a stand-in for ABAQUS that writes the same kind of results file: its answers are the built-in solver's."""

    tolerance = 1e-7

    def make(self):
        return AbaqusSolver(f"{sys.executable} {STAND_IN} job={{job}} cpus={{threads}}")

    def make_with(self, program, time_limit):
        return AbaqusSolver(f"{program} job={{job}}", time_limit)

    def program(self):
        return [sys.executable, str(STAND_IN)]

    def results(self):
        return FIL

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

    def test_waiting_for_a_licence_is_told(self, tmp_path):
        deck = write_block(tmp_path, "displacement", [1.0])
        waits = "echo 'Licenses are queued: waiting for 5 tokens'\nsleep 60\n"
        with pytest.raises(SolverError, match=r"not finished after 1 s, .* waited for a licence: .* for 5 tokens$"):
            self.make_with(self._script(tmp_path, waits), 1.0).solve(deck, tmp_path)
        runs = f"{waits.splitlines()[0]}\necho 'Abaqus License Manager checked out the following licenses:'\nsleep 60\n"
        with pytest.raises(SolverError, match=r"not finished after 1 s, ended$"):
            self.make_with(self._script(tmp_path, runs), 1.0).solve(deck, tmp_path)

    def test_a_licence_that_was_there_is_no_reason(self, tmp_path):
        deck = write_block(tmp_path, "displacement", [1.0])
        says = "echo 'License Manager checked out 5 tokens'; echo ' ***ERROR: UNKNOWN ELEMENT'; exit 1\n"
        with pytest.raises(SolverError, match=r"deck\.inp: \*\*\*ERROR: UNKNOWN ELEMENT$"):
            self.make_with(self._script(tmp_path, says), 30.0).solve(deck, tmp_path)

    def test_pressures_are_refused(self, tmp_path):
        deck = changed(tmp_path, ("*NODE PRINT", "*DLOAD\n1, P2, 0.02\n*NODE PRINT"))
        with pytest.raises(InputError, match=r"\*DLOAD"):
            self.make().check(deck)

    def test_a_wrong_template_is_told(self, tmp_path):
        deck = write_block(tmp_path, "displacement", [1.0])
        with pytest.raises(SolverError, match="threads"):
            AbaqusSolver("abaqus job={jub}").check(deck)


def test_all_are_found_by_name():
    assert {"abaqus", "builtin", "calculix"} <= set(solver_names())
    for name in ("abaqus", "builtin", "calculix"):
        assert get_solver(name).name == name
