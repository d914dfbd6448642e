"""A simulation that the solver ends without an answer costs a diagnosis the candidate that it shows, and no more."""

import json
import os
import shutil
from dataclasses import replace

import pytest
import yaml
from blocks import FIT, MESH, MODEL, STUDY

from fingerfit.core.errors import NoSolverError, SolverError
from fingerfit.core.files import write_json
from fingerfit.core.progress import Progress
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.report.findings import write_diagnosis
from fingerfit.report.page.words import unsolved
from fingerfit.settings.config import load_settings
from fingerfit.solvers.answer import ended
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.process import run

STEPS = "step,displacement,force\n1,0.2,4.7\n2,0.4,10.0\n3,0.6,16.0\n4,0.8,23.0\n5,1.0,31.0\n6,1.2,40.0\n"
SPRING = "*SPRING"
"""What a deck has that lets the base slip, and no other one here."""
KILLED = "ended by SIGKILL, perhaps out of memory"
SCRIPT = """#!/bin/sh
# CalculiX that the system ends for its memory, where a deck has springs
case "$1" in -v) exec "{ccx}" -v ;; esac
if [ -e "{on}" ] && grep -q -i "^{what}" deck.inp; then
    echo >> "{on}"
    if [ $(wc -l < "{on}") -gt {spared} ]; then kill -9 $$; fi
fi
exec "{ccx}" "$@"
"""


@pytest.fixture(params=["calculix", "builtin"])
def kill(request, tmp_path, monkeypatch):
    """Name of a solver, and what sets the keyword of decks whose simulations are killed; CalculiX where it is there."""
    on, chosen = tmp_path / "on", [SPRING, 0]

    def begin_with(what=SPRING, spared=0):
        chosen[:] = [what, spared]
        on.touch()
        if request.param == "calculix":
            script()

    def script():
        what, spared = chosen
        program = tmp_path / "ccx"
        program.write_text(SCRIPT.format(ccx=shutil.which("ccx"), on=on, what=what.replace("*", "[*]"), spared=spared))
        program.chmod(0o755)
        monkeypatch.setenv("FINGERFIT_CCX", str(program))

    if request.param == "calculix":
        request.getfixturevalue("needs_ccx")
        script()
    else:
        solve = BuiltinSolver.solve

        def killed(self, deck, workdir, *how, **named):
            if on.exists() and chosen[0] in deck.read_text(encoding="utf-8"):
                with on.open("a") as file:
                    file.write("\n")
            if on.exists() and chosen[0] in deck.read_text(encoding="utf-8") and on.stat().st_size > chosen[1]:
                code, _ = run(["/bin/sh", "-c", "kill -9 $$"], workdir, 60.0)
                raise SolverError(f"builtin: {deck}: {ended(code)}, no results")
            return solve(self, deck, workdir, *how, **named)

        monkeypatch.setattr(BuiltinSolver, "solve", killed)
        less = replace(BuiltinSolver.capabilities, first_order=False)
        monkeypatch.setattr(BuiltinSolver, "capabilities", less)
    return request.param, begin_with


def fitted(folder, solver, only, **more):
    (folder / "study").mkdir()
    write_json(folder / "study/study.yaml", STUDY)
    (folder / "study/steps.csv").write_text(STEPS)
    model = {**MODEL, "mesh": MESH, **more}
    given = {"study": str(folder / "study"), "solver": solver, "model": model, "fit": FIT, "diagnosis": {"only": only}}
    (folder / "config.yaml").write_text(yaml.safe_dump({**given, "results": str(folder / "results")}))
    problem, everything = begin(load_settings(folder / "config.yaml"), folder / "model")
    last, _ = run_fit(problem, 1)
    return problem, last, everything


@pytest.mark.parametrize("threads", [1, 2])
def test_other_candidates_go_on_without_it(tmp_path, kill, capsys, threads):
    solver, begin_to_kill = kill
    problem, last, everything = fitted(tmp_path, solver, ["base_slip", "stiffening"])
    begin_to_kill()
    with Progress(ticks=False).working("diagnose"):
        found = diagnose(problem, last, everything, threads)
    write_diagnosis(found, tmp_path / "diagnosis.json")
    diagnosis = json.loads((tmp_path / "diagnosis.json").read_text())
    assert [entry["effect"] for entry in diagnosis["ranking"]] == ["stiffening"]
    (lost,) = diagnosis["unsolved"]
    title = problem.effects["base_slip"].title
    assert lost["title"] == title
    assert lost["why"].startswith(f"{solver}: {tmp_path}/model/sims/")
    assert KILLED in lost["why"]
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "base_slip" in line]
    assert f"tried base_slip: {solver}: " in line
    assert line.endswith(f"{KILLED}, no results; does not count")
    assert diagnosis["sentence"].endswith(
        f"; tried, but solver {solver} gave no answer, so that it does not count: {title}"
    )
    assert f"does not count: {title} ({lost['why']})." in unsolved(diagnosis)
    # it is no answer: nothing is kept, and nothing counted
    assert all((problem.sims / sim / "solution.npz").exists() for sim in problem.asked)
    assert not problem.lost.noted
    # the next diagnosis, with memory enough, tries it again
    (tmp_path / "on").unlink()
    again = diagnose(begin(problem.settings, tmp_path / "model")[0], last, everything, threads)
    assert again.unsolved == {}
    assert {one.candidate.effect.name for one in again.ranking} == {"base_slip", "stiffening"}


@pytest.mark.parametrize("spared", [1, 2, 3])
def test_a_refit_that_is_ended_does_not_count(tmp_path, kill, capsys, spared):
    """Its first simulations have an answer, and with them its slopes; those of its refits have none."""
    solver, begin_to_kill = kill
    problem, last, everything = fitted(tmp_path, solver, ["base_slip", "stiffening"])
    begin_to_kill(spared=spared)
    with Progress(ticks=False).working("diagnose"):
        found = diagnose(problem, last, everything)
    assert list(found.unsolved) == [problem.effects["base_slip"].title]
    assert KILLED in found.unsolved[problem.effects["base_slip"].title]
    assert "base_slip" not in found.refits
    assert "stiffening" in {one.candidate.effect.name for one in found.ranking}
    assert capsys.readouterr().out.count("does not count") == 1


def test_without_the_fitted_model_there_is_no_diagnosis(tmp_path, kill):
    solver, begin_to_kill = kill
    problem, last, everything = fitted(tmp_path, solver, ["base_slip"], refined={**MESH, "across": 4})
    begin_to_kill("*STEP")  # the estimate on the finer mesh is known, on the mesh of the search it is not
    with pytest.raises(SolverError, match=KILLED):
        diagnose(problem, last, everything)


def test_a_solver_that_is_gone_stops_it(tmp_path, kill, monkeypatch):
    solver, _ = kill
    problem, last, everything = fitted(tmp_path, solver, ["base_slip", "stiffening"])
    if solver == "calculix":
        monkeypatch.setenv("FINGERFIT_CCX", os.devnull)
        expected = "no executable"
    else:

        def gone(*_, **__):
            raise NoSolverError("builtin: gone, as a licence may be")

        monkeypatch.setattr(BuiltinSolver, "solve", gone)
        expected = "gone"
    with pytest.raises(NoSolverError, match=expected):
        diagnose(problem, last, everything)
