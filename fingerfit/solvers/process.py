"""Running external programs: no shell, a time limit, no orphans."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

from fingerfit.deck.cards import read_text
from fingerfit.errors import SolverError

_PR_SET_PDEATHSIG = 1


def _die_with_parent() -> None:
    """Ask Linux to end this process when its parent ends, however that happens (prctl(2))."""
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def run(
    command: Sequence[str], folder: Path, limit: float, environment: Mapping[str, str] | None = None
) -> tuple[int, str]:
    """Run a program to its end.

    Parameters
    ----------
    command : sequence of str
        Program and arguments; no shell is involved.
    folder : Path
        Where it runs; its output goes to ``output.log`` there.
    limit : float
        Seconds after which it and its children are ended.
    environment : mapping
        Added to this process's environment.

    Returns
    -------
    code : int
        Exit code.
    output : str
        What it printed.

    Raises
    ------
    SolverError
        When it cannot be started or exceeds the limit.
    """
    log = folder / "output.log"
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
        raise SolverError(f"{command[0]}: cannot be started: {error.strerror}") from error
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGTERM, lambda number, frame: _stop(number)) if main else None
    try:
        code = process.wait(timeout=limit)
    except subprocess.TimeoutExpired:
        raise SolverError(f"{command[0]}: not finished after {limit:g} s, ended") from None
    finally:
        # the whole group, also what a program that has ended left behind
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if main:
            signal.signal(signal.SIGTERM, handler)
    return code, log.read_text(errors="replace")


def _stop(number: int) -> None:
    raise SystemExit(128 + number)


def copy_deck(deck: Path, folder: Path) -> None:
    """Copy a deck as deck.inp, with the files it includes, which programs look up where they run."""
    lines = []
    for line in read_text(deck).splitlines():
        match = re.match(r"\*INCLUDE\s*,\s*INPUT\s*=\s*(.+)", line, re.IGNORECASE)
        if match:
            source = deck.parent / match.group(1).strip()
            shutil.copy(source, folder / source.name)
            line = f"*INCLUDE, INPUT={source.name}"
        lines.append(line)
    (folder / "deck.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
