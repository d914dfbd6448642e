"""Processes that are killed, as by the system when memory is short, end the job with a line and leave nothing waiting."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fingerfit.core.errors import FingerfitError
from fingerfit.fit import jobs
from fingerfit.fit.lost import Lost
from fingerfit.fit.rounds import Asked


def test_a_killed_solve_is_told(tmp_path, monkeypatch):
    own = os.getpid()
    monkeypatch.setattr(jobs, "_solve", lambda *_: os.getpid() == own or os.kill(os.getpid(), signal.SIGKILL))
    monkeypatch.setattr(jobs, "write_folders", lambda study, asked, *_: [one.sim for one in asked])
    problem = SimpleNamespace(
        asked=set(),
        sims=tmp_path,
        mesh_paths={},
        solver={},
        is_solved=lambda asked: False,
        lost=Lost(),
        settings=SimpleNamespace(solver="builtin", time_limit=None),
    )
    signal.alarm(60)  # the default action ends a test that waits for ever; seconds, many times what it takes
    try:
        with pytest.raises(
            FingerfitError, match=r"a process that helped was killed \(signal 9\), perhaps out of memory"
        ):
            jobs.solve_missing(problem, [Asked({}, name, "mesh", "deck") for name in ("one", "two", "three")], 2)
    finally:
        signal.alarm(0)
    assert not list(Path(tmp_path).iterdir())


@pytest.mark.parametrize("ending", [signal.SIGKILL, signal.SIGTERM])
def test_no_child_outlives_the_process_that_forked_it(ending):
    """Those of Python's own pool wait for ever."""
    program = (
        "import os, time\nfrom fingerfit.core.processes import side_by_side\n"
        "side_by_side(lambda n: os.write(1, b'%d\\n' % os.getpid()) and time.sleep(1), range(2), 2)"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert {int(parent.stdout.readline()) for _ in range(2)} > {parent.pid}
        parent.send_signal(ending)
        # the pipe ends with the last process that can write to it; seconds, many times what the child sleeps
        assert parent.communicate(timeout=60) == (b"", None)
    assert parent.returncode == -ending
