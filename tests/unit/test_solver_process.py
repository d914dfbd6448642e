"""Programs end with their children when this process ends, however that happens."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fingerfit.core.errors import SolverError
from fingerfit.solvers.process import run

RUNS = """
import signal, sys
from pathlib import Path
from fingerfit.solvers.process import run
signal.signal(signal.SIGINT, signal.default_int_handler)
folder = Path(sys.argv[1])
run([str(folder / "program")], folder, 100.0)
"""


def program(folder, body):
    path = folder / "program"
    path.write_text("#!/bin/sh\n" + body)
    path.chmod(0o755)
    return path


def runs(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL], ids=lambda number: number.name)
def test_no_grandchild_is_left(tmp_path, number):
    pids = tmp_path / "pids"
    program(tmp_path, f"sleep 600 &\necho $$ $! > {pids}.part\nmv {pids}.part {pids}\nwait\n")
    ours = subprocess.Popen([sys.executable, "-c", RUNS, str(tmp_path)], stderr=subprocess.DEVNULL)
    wait_for(pids.exists)
    found = [int(pid) for pid in pids.read_text().split()]
    assert all(map(runs, found))
    wait_for(lambda: watchers(found[0]))
    ours.send_signal(number)
    ours.wait(10)
    wait_for(lambda: not any(map(runs, found)))
    wait_for(lambda: not watchers(found[0]))


def watchers(group):
    """Processes that wait to end a group."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0] == b"/bin/sh" and words[-2:-1] == [str(group).encode()]:
            found.append(path)
    return found


def test_what_a_program_leaves_behind_is_ended(tmp_path):
    pids = tmp_path / "pids"
    path = program(tmp_path, f"sleep 600 &\necho $! > {pids}\necho said\nexit 3\n")
    assert run([str(path)], tmp_path, 30.0) == (3, "said\n")
    wait_for(lambda: not runs(int(pids.read_text())))


def test_what_cannot_be_started_is_told(tmp_path):
    with pytest.raises(SolverError, match=r"nothing: cannot be started: No such file"):
        run([str(tmp_path / "nothing")], tmp_path, 1.0)


def test_no_watcher_is_left(tmp_path):
    code, said = run([str(program(tmp_path, "echo $$\n"))], tmp_path, 30.0)
    assert code == 0
    assert not watchers(int(said))
