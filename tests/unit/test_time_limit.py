"""The time limit of a simulation: a setting that is no part of its identity, and an error that keeps nothing."""

import json

import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY

from fingerfit.cli import main
from fingerfit.provenance.runs import planned, time_limit
from fingerfit.provenance.stages import STAGES, settings_of
from fingerfit.settings.config import load_settings
from fingerfit.solvers.calculix import TIME_LIMIT
from fingerfit.solvers.registry import get_solver
from fingerfit.testing.solver import write_block


@pytest.fixture
def slow_ccx(tmp_path, monkeypatch):
    """A CalculiX that says its version and then sleeps."""
    program = tmp_path / "slow-ccx"
    program.write_text('#!/bin/sh\n[ "$1" = -v ] && echo "This is Version 2.20" && exit 0\nsleep 600\n')
    program.chmod(0o755)
    monkeypatch.setenv("FINGERFIT_CCX", str(program))
    monkeypatch.chdir(tmp_path)
    return program


def settings(folder, **changes):
    (folder / "study").mkdir(exist_ok=True)
    (folder / "study/study.yaml").write_text(yaml.safe_dump(STUDY))
    (folder / "study/steps.csv").write_text(STEPS)
    return {"study": "study", "solver": "calculix", "model": MODEL, "fit": FIT, **changes}


def test_the_limit_reaches_the_solver_and_nothing_is_kept(slow_ccx, tmp_path, capsys):
    deck = write_block(tmp_path, "displacement", [1.0])
    (tmp_path / "solver.json").write_text(json.dumps(get_solver("calculix").identity()))
    command = ["simulate", str(deck), "--solver", "solver.json", "--out", "solution.npz", "--time-limit", "1"]
    assert main(command) == 1
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"fingerfit: error: calculix: {deck}: {slow_ccx}: time_limit: not finished after 1 s, ended"]
    assert not (tmp_path / "solution.npz").exists()


def test_it_is_no_part_of_the_identity(slow_ccx, tmp_path):
    one, other = (load_settings(settings(tmp_path, time_limit=limit)) for limit in (10, 20))
    assert get_solver("calculix", 10).identity() == get_solver("calculix", 20).identity()
    for stage in STAGES:
        assert settings_of(one, stage) == settings_of(other, stage), stage
    assert get_solver("calculix").time_limit == TIME_LIMIT
    assert get_solver("calculix", 10).time_limit == 10
    assert not hasattr(get_solver("builtin", 10), "time_limit")


def test_inside_one_process_it_counts_too(slow_ccx, tmp_path, capsys):
    from fingerfit.core.errors import SolverError
    from fingerfit.fit.course import next_round
    from fingerfit.fit.jobs import solve_missing
    from fingerfit.fit.simulate import begin

    problem, _ = begin(load_settings(settings(tmp_path, time_limit=1)), tmp_path / "work")
    batch = next_round(problem, None).batch[:1]
    with pytest.raises(SolverError, match="not finished after 1 s"):
        solve_missing(problem, batch, 1)
    assert not list((tmp_path / "work").rglob("solution.npz"))


@pytest.mark.parametrize("limit", [0, -3, 1.5, True, "1 h"])
def test_what_is_no_limit_is_refused(tmp_path, limit):
    from fingerfit.core.errors import Problems

    with pytest.raises(Problems, match="time_limit: found"):
        load_settings(settings(tmp_path, time_limit=limit))


def test_each_of_several_models_has_its_own(tmp_path, monkeypatch):
    """A simulation, which several models may ask for, has the longest of theirs; without one the solver's own counts."""
    monkeypatch.chdir(tmp_path)
    shared = settings(tmp_path)
    for limits, of_models, of_all in (
        ((10, 7200), (10, 7200), 7200),
        ((None, 7200), (0, 7200), 7200),  # CalculiX has an hour of its own
        ((None, 10), (0, 10), int(TIME_LIMIT)),
        ((None, None), (0, 0), 0),
    ):
        own = [{"model": {"name": f"m{n}"}, "time_limit": limit} for n, limit in enumerate(limits)]
        runs = planned({**shared, "runs": own}, whole=False)
        assert [run.model for run in runs] == ["m0", "m1"]
        study = runs[0].study
        assert tuple(time_limit(runs, study, run.model) for run in runs) == of_models
        assert time_limit(runs, study) == of_all
