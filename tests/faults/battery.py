"""Bad inputs in a table: what is changed in a study that is fine, what is called then, and which words the answer needs."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import re
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from fingerfit.cli import main

CLEAR, ACCEPTED, NEITHER = "clear line", "accepted", "neither"
PROCESSOR_TIME = 10
"""Seconds for one command: `check` of the study that is changed takes 0.1 s in a fork; what takes 100 times as long hangs."""
SLEEP = 5.0
"""Seconds that a command may sleep: what works is running or waiting for the processor, however busy the machine is."""
MEMORY = 3 << 30
"""Bytes of address space: pytest with all libraries maps 1 GB, `check` of the study 0.6 GB."""
ROWS, COLUMNS = 6, 80
"""A line is short when it takes no more than six rows of a terminal: 200 characters of what was found, 200 of what was
expected, and a path of 80."""
LINES = 3
"""A mistake in one place is told at most where it stands, where it is used, and where it is missed."""
DUMP = re.compile(
    r"Traceback|\b[A-Za-z_.]*[A-Z]\w*(Error|Exception|Warning|Interrupt|Expired)\b|<class |object at 0x|pydantic"
)
"""What Python says, and no person."""
CHECK = ("check", "study", "--config", "config.yaml", "--picture", "mesh.png")


class _Gone:
    def __repr__(self) -> str:
        return "left out"


GONE: Any = _Gone()
NAN, INF = float("nan"), float("inf")
Change = Callable[[Path], object]


@dataclass(frozen=True)
class Case:
    """One bad input.

    Parameters
    ----------
    name : str
        Where it is wrong and what stands there.
    change : callable
        Makes it, given the folder of a study that is fine.
    says : tuple of str
        Regular expressions that must all be found in the answer: the file or the field.
    right : tuple of str
        Outcomes that are right.
    place : str
        Which of the studies of `places` is changed.
    command : sequence of str
        What is called after the change.
    first : sequence of commands
        What is called before it.
    environment : dict
        ``{place}`` in its values stands for the folder of the study.
    lines : int
        How many lines the answer may have: more than `LINES` where many things are wrong.
    """

    name: str
    change: Change
    says: tuple[str, ...] = ()
    right: tuple[str, ...] = (CLEAR,)
    place: str = "plane"
    command: Sequence[str] = CHECK
    first: Sequence[Sequence[str]] = ()
    environment: dict[str, str] = field(default_factory=dict)
    lines: int = LINES

    def __str__(self) -> str:
        return self.name


def bad(name: str, change: Change, *says: str, **more: Any) -> Case:
    """A change after which the answer must be one clear line with these words."""
    return Case(name, change, says, **more)


def fine(name: str, change: Change, *says: str, **more: Any) -> Case:
    """A change that is harmless: it must be accepted."""
    return Case(name, change, says, right=(ACCEPTED,), **more)


def either(name: str, change: Change, *says: str, **more: Any) -> Case:
    """A change that may be taken or refused, but not otherwise."""
    return Case(name, change, says, right=(ACCEPTED, CLEAR), **more)


def values(file: str, key: str, *found: Any, says: Sequence[str] = (), make: Any = bad, **more: Any) -> list[Case]:
    """A case for each value of a key of a YAML file; the answer must name the file and the key."""
    name = Path(file).name
    wanted = says or (re.escape(name), re.escape(key))
    where = f"{more['place']}, " if "place" in more else ""
    return [make(f"{where}{key}: {_short(value)}", put(file, key, value), *wanted, **more) for value in found]


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) < 50 else text[:47] + "..."


def put(file: str, key: str, value: Any) -> Change:
    """Set a key, by dots and numbers, or take it out."""

    def change(place: Path) -> None:
        path = place / file
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
        at, parts = data, [int(part) if part.isdigit() else part for part in key.split(".")]
        for part in parts[:-1]:
            at = at.setdefault(part, {}) if isinstance(at, dict) else at[part]
        if value is GONE:
            del at[parts[-1]]
        elif isinstance(at, list) and parts[-1] == len(at):
            at.append(value)
        else:
            at[parts[-1]] = value
        path.write_text(yaml.safe_dump(data), encoding="utf-8")

    return change


def swap(file: str, old: str, new: str) -> Change:
    """Replace a piece of text, which must be there."""

    def change(place: Path) -> None:
        path = place / file
        text = path.read_text(encoding="utf-8")
        assert old in text, f"{old!r} is not in {file}"
        path.write_text(text.replace(old, new), encoding="utf-8", newline="")

    return change


def holds(file: str, content: str | bytes) -> Change:
    """Give a file another content."""

    def change(place: Path) -> None:
        path = place / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    return change


def recoded(file: str, how: Callable[[bytes], bytes]) -> Change:
    """Change the bytes of a file."""

    def change(place: Path) -> None:
        path = place / file
        path.write_bytes(how(path.read_bytes()))

    return change


def instead(file: str, make: Callable[[Path], object]) -> Change:
    """Something else in the place of a file."""

    def change(place: Path) -> None:
        path = place / file
        path.unlink()
        make(path)

    return change


def all_of(*changes: Change) -> Change:
    """Several changes, in order."""

    def change(place: Path) -> None:
        for one in changes:
            one(place)

    return change


def nothing(place: Path) -> None:
    """The mistake is in the command."""


NOT_FILES: dict[str, Callable[[Path], object]] = {
    "no such file": lambda path: None,
    "a folder": lambda path: path.mkdir(),
    "a pipe": lambda path: os.mkfifo(path),
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "a link to itself": lambda path: path.symlink_to(path.name),
}


def assess(case: Case, place: Path, code: int | None, said: str, before: Iterable[Path]) -> tuple[str, str]:
    """Outcome of a case, and in one line what happened.

    Parameters
    ----------
    case : Case
    place : Path
    code : int or None
        Exit code; None for a command that was ended.
    said : str
        Standard error.
    before : iterable of Path
        Files that were there before the command.
    """
    lines = [line for line in said.splitlines() if line.strip()]
    own = [line for line in lines if not line.startswith(("usage:", " "))]  # usage that argparse prints
    last = " ".join((own or lines or ["nothing said"])[-1].split())[:160]
    dumped = DUMP.search(said)
    if code is None:
        return NEITHER, f"hangs: {last}"
    if code < 0 or code >= 128:
        return NEITHER, f"ended by signal {abs(code) % 128}: {last}"
    if dumped:
        return NEITHER, f"exit code {code}, says {dumped.group(0)}: {last}"
    if code == 0:
        if ACCEPTED not in case.right:
            return NEITHER, "accepted"
        return ACCEPTED, ""
    if CLEAR not in case.right:
        return NEITHER, f"refused: {last}"
    if not own or len(own) > case.lines or max(map(len, own)) > ROWS * COLUMNS:
        return NEITHER, f"{len(own)} lines, the longest of {max(map(len, own), default=0)} characters: {last}"
    for words in case.says:
        if not re.search(words, said):
            return NEITHER, f"does not say {words!r}: {last}"
    left = [path for path in place.rglob("*") if path not in set(before) and path.name.startswith((".", "tmp"))]
    if left:
        return NEITHER, f"left behind: {left[0].name}"
    return CLEAR, ""


def run(case: Case, place: Path) -> tuple[int | None, str]:
    """Call the command line in a forked process with limits; exit code (None when it hangs) and standard error."""
    code: int | None = None
    said = ""
    for number, command in enumerate([*case.first, case.command]):
        code, said = forked(lambda command=command: _called(command), place, placed(case.environment, place))
        assert number == len(case.first) or code == 0, said
    return code, said


def _called(command: Sequence[str]) -> int:
    """The command line, or a script; netgen waits forever in a fork of a process where other tests have used its threads."""
    if "finger" in command[:1]:
        os.execv(sys.executable, [sys.executable, "-m", "fingerfit", *command])
    if command and command[0].endswith(".py"):
        os.execv(sys.executable, [sys.executable, *command])
    return main(list(command))


def placed(environment: dict[str, str], place: Path) -> dict[str, str]:
    """Environment variables whose values name the folder of the study."""
    return {name: value.replace("{place}", str(place)) for name, value in environment.items()}


def forked(work: Callable[[], int], place: Path, environment: dict[str, str] | None = None) -> tuple[int | None, str]:
    """Run a function in a folder, in a process of its own with limits; exit code (None when it hangs) and standard error.

    A fork of this process has the libraries that take most of the time of a short command.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    with tempfile.TemporaryFile() as said:
        child = os.fork()
        if child == 0:
            _become(work, place, said.fileno(), environment or {})
        status = _wait(child)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        said.seek(0)
        text = said.read(1 << 22).decode(errors="replace")
    hangs = status is None or (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU)
    return None if hangs or status is None else os.waitstatus_to_exitcode(status), text


def _become(work: Callable[[], int], place: Path, said: int, environment: dict[str, str]) -> None:
    """In the fork: limits, folder, environment and standard error of its own; never returns."""
    code = 1
    try:
        faulthandler.disable()
        os.setsid()
        os.dup2(said, 2)
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        os.dup2(0, 1)
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)  # noqa: SIM115
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_TIME, PROCESSOR_TIME + 5))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.chdir(place)
        os.environ.update(environment)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with _warnings_said():
            code = work()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # what Python does
        traceback.print_exc()
    finally:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()
            sys.stdout.flush()
        os._exit(code)


def _wait(child: int) -> int | None:
    """Status of a child at its end; None for one that was ended, since it slept."""
    ends = os.pidfd_open(child)
    try:
        slept, last = time.monotonic(), -1
        while not select.select([ends], [], [], SLEEP / 20)[0]:
            state, worked = _at_work(child)
            if state != "S" or worked != last:
                slept, last = time.monotonic(), worked
            elif time.monotonic() - slept > SLEEP:
                os.killpg(child, signal.SIGKILL)
                os.waitpid(child, 0)
                return None
        return os.waitpid(child, 0)[1]
    finally:
        os.close(ends)


def _at_work(child: int) -> tuple[str, int]:
    """State of a process, and processor time of its group in ticks."""
    state, total = "S", 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == child:
            total += int(fields[11]) + int(fields[12])
            state = "R" if fields[0] not in "SZ" else state
    return state, total


@contextmanager
def _warnings_said() -> Any:
    """Warnings go to standard error, as in a process of its own; pytest keeps them for its summary."""

    def show(message: Any, category: type[Warning], *_: Any) -> None:
        print(f"{category.__name__}: {message}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.resetwarnings()
        for kind in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", kind)
        warnings.showwarning = show
        yield


def copy(base: Path, place: Path) -> None:
    """A study to be changed."""
    shutil.copytree(base, place, symlinks=True, dirs_exist_ok=True)
