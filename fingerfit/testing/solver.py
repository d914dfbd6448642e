"""What every solver adapter must do, as tests to subclass.

An adapter's own tests are three lines::

    class TestMySolver(SolverConformance):
        def make(self):
            return MySolver()

and, for one that runs an external program, `ExternalSolverConformance` with four methods more.
"""

from __future__ import annotations

import json
import re
import shutil
import time
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from fingerfit.core.errors import FingerfitError, InputError, SolverError
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.reader import read_deck
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Outcome, Solver, SolverNearby
from fingerfit.solvers.needs import FEATURES
from fingerfit.testing.block import CHANGES, SIZE, homogeneous_force, write_block
from fingerfit.testing.damage import DAMAGES, Format, recorder, replay, script


class SolverConformance:
    """Tests of the contract `fingerfit.solvers.contract.Solver`; subclass and give `make`."""

    tolerance = 1e-5
    """Relative agreement with closed forms and between ways of control: digits the program writes."""

    def make(self) -> Solver:
        """The solver under test; may call `pytest.skip` where it is not installed."""
        raise NotImplementedError

    @pytest.fixture
    def solver(self) -> Solver:
        return self.make()

    def elements(self, solver: Solver) -> list[str]:
        """Elements that are tried: those of the plane and of space that the solver declares."""
        wanted = ("CPE4", "CPE6", "CPE8", "CPE8R", "C3D8")
        return [element for element in wanted if element in solver.capabilities.elements]

    def test_it_says_what_it_is(self, solver: Solver) -> None:
        identity = solver.identity()
        assert identity["name"] == solver.name
        assert identity["version"]
        assert json.loads(json.dumps(identity)) == identity == self.make().identity()

    def test_it_declares_known_things(self, solver: Solver) -> None:
        assert solver.capabilities.elements
        assert solver.capabilities.elements <= set(ELEMENTS)
        assert solver.capabilities.control <= {"force", "displacement"}
        assert solver.capabilities.features <= FEATURES
        assert self.elements(solver)

    def test_it_accepts_what_it_declares(self, solver: Solver, tmp_path: Path) -> None:
        for element in self.elements(solver):
            solver.check(write_block(tmp_path, "displacement", [1.0], element))

    def test_it_refuses_before_a_run(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0], self.elements(solver)[0])
        text = deck.read_text(encoding="utf-8")
        deck.write_text(text.replace("*SOLID SECTION", "*SOLID SEKTION"))
        with pytest.raises(InputError, match=r"deck\.inp: line \d+"):
            solver.check(deck)
        for lacking in sorted(set(ELEMENTS) - solver.capabilities.elements)[:3]:
            block = write_block(tmp_path, "displacement", [1.0], lacking)
            with pytest.raises(InputError, match=lacking):
                solver.check(block)

    def test_shapes_and_boundary_conditions(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [0.5, 1.0])
        mesh = read_deck(deck).mesh
        outcome = solver.solve(deck, tmp_path)
        assert outcome.status == CONVERGED
        assert outcome.steps == 2
        assert outcome.displacement.shape == (2, len(mesh.points), 2)
        assert outcome.reaction.shape == outcome.indenter.shape == (2, 2)
        assert outcome.indenter[:, 1] == pytest.approx([-0.5, -1.0], rel=self.tolerance)
        assert np.abs(outcome.displacement[:, mesh.node_sets["BOTTOM"]]).max() < 1e-12
        assert outcome.displacement[:, mesh.node_sets["TOP"], 1] == pytest.approx(
            outcome.indenter[:, 1:] * np.ones(len(mesh.node_sets["TOP"])), rel=self.tolerance
        )
        assert (outcome.reaction[:, 1] < 0).all()
        outcome.save(tmp_path / "solution.npz")
        again = Outcome.load(tmp_path / "solution.npz")
        assert np.array_equal(again.displacement, outcome.displacement)

    def test_homogeneous_compression(self, solver: Solver, tmp_path: Path) -> None:
        for element in self.elements(solver):
            dim = ELEMENTS[element].dim
            outcome = solver.solve(write_block(tmp_path, "displacement", [1.0, 3.0], element, False), tmp_path)
            assert outcome.status == CONVERGED, element
            for step, depth in enumerate((1.0, 3.0)):
                force, wide = homogeneous_force(1 - depth / SIZE, dim)
                assert outcome.reaction[step, -1] == pytest.approx(force, rel=self.tolerance), element
                width = np.ptp(outcome.displacement[step, :, 0])
                assert width == pytest.approx((wide - 1) * SIZE, rel=self.tolerance), element

    def test_force_and_displacement_control_agree(self, solver: Solver, tmp_path: Path) -> None:
        if solver.capabilities.control != {"force", "displacement"}:
            pytest.skip("has one kind of control only")
        moved = solver.solve(write_block(tmp_path, "displacement", [0.7, 1.5]), tmp_path)
        pushed = solver.solve(write_block(tmp_path, "force", (-moved.reaction[:, 1]).tolist()), tmp_path)
        assert pushed.indenter[:, 1] == pytest.approx([-0.7, -1.5], rel=10 * self.tolerance)
        assert pushed.displacement == pytest.approx(moved.displacement, abs=15 * self.tolerance)

    def test_one_that_begins_nearby_has_the_answer_from_rest(self, solver: Solver, tmp_path: Path) -> None:
        if not solver.capabilities.nearby:
            return  # it is never given one
        near = solver.solve(write_block(tmp_path, "displacement", [0.97, 1.94]), tmp_path)
        deck = write_block(tmp_path, "displacement", [1.0, 2.0])
        rest, begun = solver.solve(deck, tmp_path), cast(SolverNearby, solver).solve(deck, tmp_path, 1, near)
        assert begun.displacement == pytest.approx(rest.displacement, abs=2 * 10 * self.tolerance)
        assert begun.reaction[:, 1] == pytest.approx(rest.reaction[:, 1], rel=10 * self.tolerance)

    def test_it_agrees_with_the_built_in_solver(self, solver: Solver, tmp_path: Path) -> None:
        from fingerfit.solvers.builtin import BuiltinSolver

        deck = write_block(tmp_path, "displacement", [1.0, 2.0])
        theirs, ours = solver.solve(deck, tmp_path), BuiltinSolver().solve(deck, tmp_path)
        assert theirs.displacement == pytest.approx(ours.displacement, abs=2 * 10 * self.tolerance)
        assert theirs.reaction[:, 1] == pytest.approx(ours.reaction[:, 1], rel=10 * self.tolerance)

    def test_a_keyword_changes_the_answer_or_is_refused(self, solver: Solver, tmp_path: Path) -> None:
        from fingerfit.solvers.builtin import BuiltinSolver

        plain = BuiltinSolver().solve(write_block(tmp_path, "displacement", [1.0]), tmp_path)
        for feature, change in CHANGES.items():
            deck = write_block(tmp_path, "displacement", [1.0])
            deck.write_text(change(deck.read_text(encoding="utf-8")), encoding="utf-8")
            if feature not in solver.capabilities.features:
                with pytest.raises(InputError, match=re.escape(feature[:6])):  # *VISCO is told of *VISCOELASTIC, too
                    solver.check(deck)
                continue
            solver.check(deck)
            theirs, ours = solver.solve(deck, tmp_path), BuiltinSolver().solve(deck, tmp_path)
            assert theirs.status == ours.status == CONVERGED, feature
            change_of = [np.ptp(each.displacement - plain.displacement) for each in (theirs, ours)]
            pushed = [abs(each.reaction[0, 1] / plain.reaction[0, 1] - 1) for each in (theirs, ours)]
            assert max(change_of[1], pushed[1]) > 1e-3, feature
            assert max(change_of[0], pushed[0]) > 1e-3, f"{feature} is left out"
            assert theirs.displacement == pytest.approx(ours.displacement, abs=2 * 10 * self.tolerance), feature
            assert theirs.reaction[:, 1] == pytest.approx(ours.reaction[:, 1], rel=10 * self.tolerance), feature

    def test_control_that_it_lacks_is_refused(self, solver: Solver, tmp_path: Path) -> None:
        for control in ("force", "displacement"):
            deck = write_block(tmp_path, control, [1.0], self.elements(solver)[0])
            if control in solver.capabilities.control:
                solver.check(deck)
            else:
                with pytest.raises(InputError, match=control):
                    solver.check(deck)

    def test_steps_may_last_any_time(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [0.5, 1.0])
        usual = solver.solve(deck, tmp_path)
        text = deck.read_text(encoding="utf-8")
        first, second = "*STATIC\n2.5, 5., 1e-5, 5.", "*STATIC\n0.1, 0.2, 1e-6, 0.2"
        text = text.replace("*STATIC\n0.5, 1., 1e-5, 1.", first, 1).replace("*STATIC\n0.5, 1., 1e-5, 1.", second, 1)
        deck.write_text(text, encoding="utf-8")
        outcome = solver.solve(deck, tmp_path)
        assert (outcome.status, outcome.steps) == (CONVERGED, 2)
        assert outcome.displacement == pytest.approx(usual.displacement, abs=10 * self.tolerance)

    def test_included_files_are_found_as_the_reader_finds_them(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        text, plain = deck.read_text(encoding="utf-8"), solver.solve(deck, tmp_path)
        start = text.index("*STEP")
        (tmp_path / "mesh").mkdir()
        (tmp_path / "mesh/block.inp").write_text(format_mesh(read_deck(deck).mesh), encoding="utf-8")
        (tmp_path / "mesh/outer.inp").write_text("*INCLUDE, INPUT=block.inp\n", encoding="utf-8")
        (tmp_path / "with blank.inp").write_text("*include,\n  input=mesh/outer.inp\n", encoding="utf-8")
        (tmp_path / "steps.inp").write_text(text[start:].replace("*END STEP", "*ENDSTEP"), encoding="utf-8")
        text = text[:start].replace("*INCLUDE, INPUT=block.inp", ' *Include , input = "with blank.inp"')
        (tmp_path / "other").mkdir()
        deck.write_text(text + "*INCLUDE, INPUT=steps.inp\n", encoding="utf-8")
        outcome = solver.solve(deck, tmp_path / "other")
        assert np.array_equal(outcome.displacement, plain.displacement)
        assert np.array_equal(outcome.reaction, plain.reaction)

    def test_the_same_deck_has_the_same_answer(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        first, second = solver.solve(deck, tmp_path), solver.solve(deck, tmp_path)
        assert np.array_equal(first.displacement, second.displacement)
        assert np.array_equal(first.reaction, second.reaction)
        parallel = solver.solve(deck, tmp_path, threads=2)
        assert parallel.displacement == pytest.approx(first.displacement, abs=10 * self.tolerance)
        assert parallel.reaction == pytest.approx(first.reaction, abs=10 * self.tolerance)

    def test_a_hopeless_guess_is_an_answer(self, solver: Solver, tmp_path: Path) -> None:
        outcome = solver.solve(write_block(tmp_path, "force", [0.5, 5000.0]), tmp_path)
        assert outcome.status == DIVERGED
        assert outcome.steps == 1
        assert "step 2" in outcome.message

    def test_it_leaves_nothing_behind(self, solver: Solver, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        work = tmp_path / "work"
        work.mkdir()
        here = sorted(Path.cwd().iterdir())
        solver.solve(deck, work)
        assert not list(work.iterdir())
        assert sorted(Path.cwd().iterdir()) == here

    def test_a_missing_deck_is_an_error(self, solver: Solver, tmp_path: Path) -> None:
        with pytest.raises(FingerfitError):
            solver.solve(tmp_path / "none.inp", tmp_path)


class ExternalSolverConformance(SolverConformance):
    """For adapters that run a program: one that is missing, hangs or fails is an error in one line.

    So is one that leaves damaged results: never an answer, which would be kept for good.
    """

    def make_with(self, program: str, time_limit: float) -> Solver:
        """The adapter with another program in place of its own, and a time limit in s."""
        raise NotImplementedError

    def program(self) -> list[str]:
        """The program itself, as its adapter starts it, without arguments."""
        raise NotImplementedError

    def results(self) -> Format:
        """How the file that the adapter reads its results from is taken apart."""
        raise NotImplementedError

    def _recorded(self, folder: Path, control: str, values: list[float]) -> tuple[Path, Solver]:
        """A deck that was solved once, and an adapter whose program leaves the same files again."""
        if not self.make().capabilities.control >= {control}:
            pytest.skip("has one kind of control only")
        deck = write_block(folder, control, values)
        self.make_with(recorder(folder, self.program()), 60.0).solve(deck, folder)
        return deck, self.make_with(replay(folder), 60.0)

    def _refuses(self, solver: Solver, deck: Path, work: Path, name: str) -> None:
        try:
            outcome = solver.solve(deck, work)
        except SolverError as error:
            assert "\n" not in str(error), name
            assert deck.name in str(error), name
        else:
            pytest.fail(f"{name}: taken for {outcome.status}, {outcome.message}")
        assert not list(work.iterdir()), f"{name}: files are left"

    @pytest.mark.parametrize("diverges", [False, True], ids=["converged", "diverged"])
    def test_damaged_results_are_no_answer(self, tmp_path: Path, diverges: bool) -> None:
        control, values = ("force", [0.3, 0.5, 5000.0]) if diverges else ("displacement", [0.5, 1.0])
        deck, solver = self._recorded(tmp_path, control, values)
        form, work = self.results(), tmp_path / "work"
        work.mkdir()
        file = tmp_path / "kept" / form.name
        whole = file.read_text(encoding="utf-8")
        assert solver.solve(deck, work).status == (DIVERGED if diverges else CONVERGED)
        for name, damage in DAMAGES.items():
            file.write_text(form.join(damage(form, form.split(whole))), encoding="utf-8")
            assert file.read_text(encoding="utf-8") != whole, name
            self._refuses(solver, deck, work, name)
        file.unlink()
        self._refuses(solver, deck, work, "no file of results")
        file.write_text(whole, encoding="utf-8")
        assert solver.solve(deck, work).steps == 2

    def test_whole_results_of_a_program_that_failed_are_no_answer(self, tmp_path: Path) -> None:
        deck, _ = self._recorded(tmp_path, "displacement", [0.5, 1.0])
        work = tmp_path / "work"
        work.mkdir()
        for ending, told in (("exit 3", "exit code 3"), ("kill -9 $$", "SIGKILL"), ("kill -11 $$", "SIGSEGV")):
            with pytest.raises(SolverError, match=told):
                self.make_with(replay(tmp_path, ending), 60.0).solve(deck, work)
            assert not list(work.iterdir())

    def test_a_program_that_says_and_does_nothing_is_an_error(self, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        work = tmp_path / "work"
        work.mkdir()
        self._refuses(self.make_with(self._script(tmp_path, "exit 0\n"), 30.0), deck, work, "nothing")
        shutil.rmtree(work)

    def test_its_time_limit_can_be_set(self, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        solver = self.make_with(self._script(tmp_path, "sleep 600\n"), 600.0)
        solver.time_limit = 0.5  # type: ignore[attr-defined]
        with pytest.raises(SolverError, match=r"not finished after 0\.5 s"):
            solver.solve(deck, tmp_path)

    def test_a_missing_program_is_an_error(self, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        solver = self.make_with(str(tmp_path / "no-such-program"), 5.0)
        for action in (solver.identity, lambda: solver.check(deck), lambda: solver.solve(deck, tmp_path)):
            with pytest.raises(SolverError) as caught:
                action()
            assert "no-such-program" in str(caught.value)
            assert "\n" not in str(caught.value)

    def test_a_program_that_hangs_is_ended_with_its_children(self, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        pids = tmp_path / "pids"
        solver = self.make_with(self._script(tmp_path, f"sleep 600 &\necho $$ $! > {pids}\nwait\n"), 1.0)
        start = time.monotonic()
        with pytest.raises(SolverError, match="not finished after 1 s") as caught:
            solver.solve(deck, tmp_path)
        assert "\n" not in str(caught.value)
        assert time.monotonic() - start < 10
        time.sleep(0.2)
        for pid in pids.read_text(encoding="utf-8").split():
            assert not _runs(int(pid)), f"process {pid} is left"

    def test_a_program_that_fails_is_an_error(self, tmp_path: Path) -> None:
        deck = write_block(tmp_path, "displacement", [1.0])
        solver = self.make_with(self._script(tmp_path, "echo no; exit 3\n"), 30.0)
        with pytest.raises(SolverError, match="exit code 3"):
            solver.solve(deck, tmp_path)

    @staticmethod
    def _script(folder: Path, body: str) -> str:
        return script(folder, body)


def _runs(pid: int) -> bool:
    """Whether a process is there and not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
