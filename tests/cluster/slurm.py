"""A SLURM of one node on this machine: `python tests/cluster/slurm.py COMMAND` runs a command beside it, and ends it.

It needs Debian's packages slurm-wlm and munge, no root and no configuration of the system: everything lies in a folder
of its own, with its own key, socket and ports. All processes that it started are ended by their numbers, also when it is
itself killed. A machine that has a SLURM already is left alone.
"""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol", "scancel")
CPUS = int(os.getenv("CLUSTER_CPUS", "4"))
"""Of the node, whatever the machine has: with 4 two jobs of two threads run side by side."""
START = 60.0
"""Seconds that a program may take to answer first."""
OTHERS = ("/etc/slurm/slurm.conf", "/etc/slurm-llnl/slurm.conf")
"""Where a SLURM of the machine is configured; Debian's package brings none of them."""


GUARD = "--guard"
STEPD = "slurmstepd"
"""What watches a job on its node."""


class NotStarted(Exception):
    """A program of SLURM did not start."""


def which(name: str) -> str | None:
    """The path of a program; daemons lie in folders that a user's PATH may lack."""
    return shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin")


def missing() -> list[str]:
    """Programs that are not installed."""
    return [name for name in PROGRAMS if which(name) is None]


def why_not() -> str | None:
    """Why there can be no SLURM of our own here, or none should be; None where there can."""
    if absent := missing():
        return f"not installed: {', '.join(absent)}: apt-get install slurm-wlm munge"
    there = [path for path in (os.getenv("SLURM_CONF"), *OTHERS) if path and Path(path).exists()]
    return f"this machine has a SLURM, which is left alone: {there[0]}" if there else None


def processes(folder: Path) -> dict[int, str]:
    """Programs of the cluster in a folder, its jobs and what was called beside it: their names by their numbers."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # of somebody else, or gone
            name = (path / "comm").read_text().strip()
            if name == STEPD:
                # it writes its title over its environment; it has the log of its slurmd open
                ours = any(str(file.readlink()).startswith(f"{folder}/") for file in (path / "fd").iterdir())
            else:
                # in the PATH of all others, and of nothing else
                ours = f"{folder}/bin".encode() in (path / "environ").read_bytes()
            if ours:
                found[int(path.name)] = name
    return found


def end_all(folder: Path) -> None:
    """End what is left of a cluster, and what that starts in the meantime."""
    end = time.monotonic() + 10
    while (left := processes(folder)) and time.monotonic() < end:
        for number in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        time.sleep(0.1)


class Cluster:
    """Starts and ends munged, slurmctld and slurmd.

    Parameters
    ----------
    folder : Path
        For everything; it is made, and kept.
    """

    def __init__(self, folder: Path) -> None:
        # the path of a socket has at most 107 bytes
        self._socket = Path(tempfile.mkdtemp(prefix="munge-")) / "socket"
        self.folder = folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        programs = folder / "bin"
        programs.mkdir(parents=True)
        self.conf = folder / "slurm.conf"
        self.environment = {
            **{name: value for name, value in os.environ.items() if not name.startswith("SLURM_")},
            "SLURM_CONF": str(self.conf),
            "PATH": os.pathsep.join([str(programs), os.environ["PATH"]]),
        }
        # the plugin takes all SLURM_* from the environment of a job's srun, which then looks in /etc/slurm
        srun = programs / "srun"
        srun.write_text(f'#!/bin/sh\nexec env "SLURM_CONF={self.conf}" {which("srun")} "$@"\n')
        srun.chmod(0o755)

    def __enter__(self) -> Cluster:
        self.conf.write_text(self._settings())
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        # reads a pipe that ends with this process, however it ends
        self._guard = subprocess.Popen(
            [sys.executable, __file__, GUARD, str(self.folder), str(self._socket.parent)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            # forced: a folder below /tmp is open to others, but not the key in it
            self._start("munged", "--foreground", "--force", f"--key-file={key}", f"--socket={self._socket}",
                        *(f"--{kind}-file={self.folder}/munged.{kind}" for kind in ("pid", "log", "seed")))  # fmt: skip
            self._wait("munged", self._socket.exists)
            self._start("slurmctld", "-D")
            self._wait("slurmctld", lambda: self.ask("scontrol", "ping").returncode == 0)
            self.node_up()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if "slurmctld" in self.running:
            self.ask("scancel", "--full", f"--user={_user()}")
            self._within(10, lambda: not self.ask("squeue", "--noheader").stdout)
        for name in ("slurmd", "slurmctld", "munged"):
            if name in self.running:
                self._end(name, signal.SIGTERM)
        self._guard.communicate()

    def node_up(self) -> None:
        """Start the node and wait until it takes jobs."""
        self._start("slurmd", "-D")
        self.ask("scontrol", "update", f"NodeName={socket.gethostname()}", "State=RESUME")
        self._wait("slurmd", lambda: self.node() in ("idle", "mixed", "allocated"))

    def node_down(self) -> None:
        """What a power cut does to the node: its daemon and all processes of its jobs end at once, without a word."""
        numbers = [self.running["slurmd"].pid]
        for number, name in processes(self.folder).items():
            with contextlib.suppress(OSError):
                # jobs know their number, and their watchers have that name
                if name == STEPD or b"SLURM_JOB_ID=" in Path(f"/proc/{number}/environ").read_bytes():
                    numbers.append(number)
        for number in numbers:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        self.running.pop("slurmd").wait()
        # slurmctld would notice that by itself, after half a minute
        self.ask("scontrol", "update", f"NodeName={socket.gethostname()}", "State=DOWN", "Reason=power cut")

    def node(self) -> str:
        """The node's state."""
        return self.ask("sinfo", "--noheader", "--format=%T").stdout.strip().rstrip("*~#!%$@^-+")

    def ask(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Call a program of SLURM."""
        return subprocess.run(command, env=self.environment, capture_output=True, text=True)

    def jobs(self, state: str = "all") -> list[list[str]]:
        """Number, state, comment, minutes and MB of jobs, in the order of their numbers."""
        said = self.ask("squeue", "--noheader", f"--states={state}", "--sort=i", "--format=%i|%T|%k|%l|%m|%C").stdout
        return [line.split("|") for line in said.splitlines()]

    def _settings(self) -> str:
        user, host, ports = _user(), socket.gethostname(), _free_ports(2)
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") >> 20
        return f"""\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
# a job that lost its node waits until its credential has expired, in seconds
AuthInfo=socket={self._socket},cred_expire=5
CredType=cred/munge
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd.log
PlugStackConfig={self.folder}/none
# the node has as many processors as said below
SlurmdParameters=config_overrides
# no control groups: containers have none of their own
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
# seconds: a node is soon noticed to be down, and one that is back takes jobs
SlurmdTimeout=5
ReturnToService=2
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={CPUS} RealMemory={memory} State=UNKNOWN
PartitionName=main Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""

    def _start(self, name: str, *options: str) -> None:
        with (self.folder / f"{name}.said").open("ab") as said:
            program = which(name)
            assert program is not None
            self.running[name] = subprocess.Popen(
                [program, *options],
                env=self.environment,
                stdout=said,
                stderr=said,
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for us, who end it
            )

    def _wait(self, name: str, ready: Callable[[], bool]) -> None:
        if not self._within(START, lambda: ready() or self.running[name].poll() is not None) or not ready():
            said = (self.folder / f"{name}.said").read_text(errors="replace")
            raise NotStarted(f"{name} did not start:\n{said[-2000:]}")

    @staticmethod
    def _within(seconds: float, done: Callable[[], bool]) -> bool:
        end = time.monotonic() + seconds
        while not done():
            if time.monotonic() > end:
                return False
            time.sleep(0.2)
        return True

    def _end(self, name: str, number: int) -> None:
        process = self.running.pop(name)
        process.send_signal(number)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _user() -> str:
    return pwd.getpwuid(os.getuid()).pw_name


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def guard(folder: Path, socket: Path) -> int:
    """Wait until the process that has a cluster is through with it, or gone; end what it left."""
    sys.stdin.buffer.read()
    end_all(folder)
    shutil.rmtree(socket, ignore_errors=True)
    return 0


def main(command: list[str]) -> int:
    """Run a command beside a cluster; its exit code."""
    if why := why_not():
        print(why, file=sys.stderr)
        return 1
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    with tempfile.TemporaryDirectory(prefix="slurm-") as folder, Cluster(Path(folder) / "one") as cluster:
        return subprocess.run(command or ["sinfo"], env=cluster.environment).returncode


if __name__ == "__main__":
    if sys.argv[1:2] == [GUARD]:
        sys.exit(guard(*map(Path, sys.argv[2:])))
    sys.exit(main(sys.argv[1:]))
