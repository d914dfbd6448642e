"""Running external programs: no shell, a time limit, no orphans."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from fingerfit.core.errors import InputError, NoSolverError, SolverError
from fingerfit.core.files import check_regular, free_memory, read_bytes
from fingerfit.deck.cards import Card

LOG = "output.log"
"""Where a program's output goes, in the folder that it runs in."""
_COPIES = 10
"""Of a file of results in memory while it is read: its bytes, its text, its lines, and each number of some ten
characters as a float of 24 bytes in a list."""
_EXPECTED = "a file that the program wrote"
_PR_SET_PDEATHSIG = 1
_WATCH = "read nothing; kill -9 -$0"
"""Waits until the pipe it reads is closed, which only the end of its writer does, and ends a group of processes."""


def _die_with_parent() -> None:
    """Ask Linux to end this process when its parent ends, however that happens (prctl(2))."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@contextlib.contextmanager
def _ended_at_last(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """End the whole group of a process, also what it left behind; when this process is killed, a watcher does it.

    Linux ends the direct child alone: its own children know nothing of us.
    """
    watcher = None
    try:
        watcher = subprocess.Popen(
            ["/bin/sh", "-c", _WATCH, str(process.pid)],
            cwd="/",
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if watcher is not None:
            watcher.kill()
            watcher.communicate()


def run(
    command: Sequence[str],
    folder: Path,
    limit: float,
    environment: Mapping[str, str] | None = None,
    what: str = "solver",
) -> tuple[int, str]:
    """Run a program to its end.

    Parameters
    ----------
    command : sequence of str
        Program and arguments; no shell is involved.
    folder : Path
        Where it runs; its output goes to `LOG` there.
    limit : float
        Seconds after which it and its children are ended; as they are when this process ends before them, even killed.
        A child that makes itself a session of its own is not followed.
    environment : mapping
        Added to this process's environment.
    what : str
        Solver and deck, for the message.

    Returns
    -------
    code : int
        Exit code.
    output : str
        What it printed.

    Raises
    ------
    NoSolverError
        When it cannot be started.
    SolverError
        When it exceeds the limit, or takes its output away.
    """
    log = folder / LOG
    try:
        with log.open("wb") as sink:
            process = subprocess.Popen(
                list(command),
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=subprocess.STDOUT,
                env={**os.environ, **(environment or {})},
                start_new_session=True,
                preexec_fn=_die_with_parent,
            )
    except OSError as error:
        raise NoSolverError(f"{what}: {command[0]}: cannot be started: {error.strerror}") from error
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGTERM, lambda number, frame: _stop(number)) if main else None
    try:
        with _ended_at_last(process):
            code = process.wait(timeout=limit)
    except subprocess.TimeoutExpired:
        raise SolverError(f"{what}: {command[0]}: time_limit: not finished after {limit:g} s, ended") from None
    finally:
        if main:
            signal.signal(signal.SIGTERM, handler)
    return code, read_left(log, f"{what}: {command[0]}", needed=True)


def read_left(path: Path, what: str, needed: bool = False) -> str:
    """Text of a file that a program left; empty where it left none, unless it is needed.

    Parameters
    ----------
    path : Path
    what : str
        Program or solver, and deck, for the message.
    needed : bool
        Whether that it is missing is an error.

    Raises
    ------
    SolverError
        For what is no regular file, cannot be read, or is larger than the memory that is free.
    """
    if not needed and not has_left(path, what):
        return ""
    try:
        return read_bytes(path, path.name, most_results(), _EXPECTED).decode("utf-8", errors="replace")
    except InputError as error:
        raise SolverError(f"{what}: {error.field}: found {error.found}; expected {error.expected}") from None


def has_left(path: Path, what: str) -> bool:
    """Whether a program left a file, and something in it; errors as of `read_left`."""
    if not os.path.lexists(path):
        return False
    try:
        check_regular(path, path.name, most_results(), _EXPECTED)
        return path.stat().st_size > 0
    except InputError as error:
        raise SolverError(f"{what}: {error.field}: found {error.found}; expected {error.expected}") from None


def most_results() -> int:
    """Bytes of the largest file of results that can be read."""
    return free_memory() // _COPIES


def _stop(number: int) -> None:
    raise SystemExit(128 + number)


def write_cards(cards: Iterable[Card], path: Path) -> None:
    """Write a deck as one file: keywords from several files, as `fingerfit.deck.cards.read_cards` finds them."""
    with path.open("w", encoding="utf-8") as file:
        file.writelines(f"{line}\n" for card in cards for line in card.lines())
