"""Processes that are killed, as by the system when memory is short, end the job with a line and leave nothing waiting."""

import os
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest

from fingerfit.core.errors import FingerfitError
from fingerfit.fit import simulate


def test_a_killed_solve_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(simulate, "_solve", _killed)
    monkeypatch.setattr(simulate, "write_folders", lambda *_: ["one", "two", "three"])
    problem = SimpleNamespace(
        asked=set(),
        sims=tmp_path,
        mesh_names={},
        mesh_files={},
        solver={},
        settings=SimpleNamespace(solver="builtin", time_limit=None),
    )
    signal.alarm(60)  # the default action ends a test that waits for ever; seconds, many times what it takes
    try:
        with pytest.raises(FingerfitError, match="a process that solved was killed, perhaps out of memory"):
            simulate.solve_missing(problem, [], 2)
    finally:
        signal.alarm(0)
    assert not list(Path(tmp_path).iterdir())


def _killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)
