"""What a long command says while it works: plain lines, and on a terminal a bar below them."""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from fingerfit.core.journal import Journal

_LOG = logging.getLogger("fingerfit.progress")


def tell(text: str) -> None:
    """Say what was done, to whoever listens: see `Progress.working`."""
    _LOG.info(text)


def begin(text: str) -> None:
    """Say what is being done from now on: on the bar and on the page of the study."""
    _LOG.info(text, extra={"begins": True})


def counted(number: int, what: str) -> str:
    """So many of something.

    >>> counted(1, "simulation"), counted(0, "simulation")
    ('1 simulation', '0 simulations')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def say(*lines: str, error: bool = False) -> None:
    """Print lines on the standard output, or that of errors, and go on without a word once nobody reads it any more.

    A handler of messages that raises would leave Snakemake waiting for ever.
    """
    stream = sys.stderr if error else sys.stdout
    try:
        print(*lines, sep="\n", end="\n" * bool(lines), file=stream, flush=True)
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def say_in(journal: Journal) -> Callable[[str], None]:
    """What says a line, and notes it on the page of a study."""

    def both(line: str) -> None:
        say(line)
        journal.add(line)

    return both


class Progress:
    """Lines on the standard output; on a terminal also a bar that counts the time since it was shown first.

    Parameters
    ----------
    ticks : bool
        Whether the bar moves by itself. That takes a thread, which a process that forks must not have.
    """

    def __init__(self, ticks: bool = True) -> None:
        self._bar: Any = None
        self._ticks = ticks
        self.began = time.monotonic()

    def line(self, text: str) -> None:
        """Say something, above the bar."""
        if self._bar is None:
            say(text)
        else:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def show(self, text: str, done: float = 0.0, total: float | None = None) -> None:
        """Say what is being done, on the bar only; without a total it is not known how much is left."""
        if not sys.stdout.isatty():
            return
        if self._bar is None:
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
            self._bar = Progress(*columns, transient=True, auto_refresh=self._ticks)
            self._bar.add_task(text)
            self._bar.start()
        self._bar.update(self._bar.task_ids[0], description=text, completed=done, total=total, refresh=True)

    def stop(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None

    @contextmanager
    def working(self, text: str, journal: Journal | None = None) -> Iterator[None]:
        """Say what `tell` is told, with a bar, until the work is done; a journal is told that, and what has begun."""
        process = os.getpid()

        def said(record: logging.LogRecord) -> None:
            line, begins = f"{text}: {record.getMessage()}", getattr(record, "begins", False)
            if not begins:
                self.line(f"{in_words(time.monotonic() - self.began):>8}  {line}")
            elif os.getpid() == process:  # a forked process has no bar
                self.show(line)
            if journal is not None:
                (journal.now if begins else journal.add)(line)

        handler = logging.Handler()
        handler.emit = said  # type: ignore[method-assign]
        _LOG.addHandler(handler)
        _LOG.setLevel(logging.INFO)
        self.show(text)
        if journal is not None:
            journal.now(text)
        try:
            yield
        finally:
            _LOG.removeHandler(handler)
            self.stop()


def in_words(seconds: float) -> str:
    """A time: 9 s, 2:10 min, 1.5 h.

    >>> in_words(9.3), in_words(130), in_words(5400)
    ('9 s', '2:10 min', '1.5 h')
    """
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds // 60:.0f}:{int(seconds % 60):02} min" if seconds < 5400 else f"{seconds / 3600:.2g} h"
