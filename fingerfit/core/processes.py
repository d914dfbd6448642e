"""Calls beside each other, in forked processes: the one way of forking here.

Python's own pools leave their processes behind, waiting, when the one that made them is ended from outside, and do not
tell which signal ended a child (docs/decisions/0014-libraries.md). Here a child ends with its share.
"""

from __future__ import annotations

import os
import pickle
import resource
import signal
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import address_space

_TOKENS, _BYTES = 8192, 4
"""Numbers of items that wait in a pipe, which holds 64 kB, and the bytes of each."""

Item = TypeVar("Item")
Result = TypeVar("Result")


def perhaps_memory(number: int) -> str:
    """What to add where a program was ended by a signal: the system ends so what takes too much memory."""
    return ", perhaps out of memory" if number == signal.SIGKILL else ""


def side_by_side(function: Callable[[Item], Result], items: Sequence[Item], processes: int) -> list[Result]:
    """Results of a function for all items, in order.

    Each process begins with one item, and takes the next one that nobody has taken when it is done.

    Parameters
    ----------
    function : callable
        Forked children see all that was read before; what they change stays with them, results are pickled.
    items : sequence
    processes : int
        This one included.

    Raises
    ------
    Exception
        What a call raised.
    FingerfitError
        When a child was ended from outside.
    """
    count = max(1, min(processes, len(items)))
    if count == 1:
        return [function(item) for item in items]
    waiting, behind = os.pipe()
    # runs of items, so that their numbers fit into a pipe
    run = 1 + len(items) // _TOKENS
    os.write(behind, b"".join(n.to_bytes(_BYTES) for n in range(count, len(items), run)))
    os.close(behind)

    def share(first: int) -> list[tuple[int, Result]]:
        found, numbers = list[tuple[int, Result]](), range(first, first + 1)
        try:
            while numbers:
                found += [(n, function(items[n])) for n in numbers]
                token = os.read(waiting, _BYTES)
                begin = int.from_bytes(token)
                numbers = range(begin, min(begin + run, len(items))) if token else range(0)
        except BaseException:
            os.read(waiting, _BYTES * _TOKENS)  # nothing that was not begun is of use
            raise
        return found

    pipes = [_fork(share, [n]) for n in range(1, count)]
    answers: list[Any] = []
    endings: list[int] = []
    try:
        shares = [[share(0)]]
    finally:
        os.close(waiting)
        # children are waited for in any case: none is left behind
        for child, pipe in pipes:
            with os.fdopen(pipe, "rb") as stream:
                answers.append(stream.read())
            endings.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    for answer, ending in zip(answers, endings, strict=True):
        if not answer:
            how = f"was killed (signal {-ending}){perhaps_memory(-ending)}" if ending < 0 else "ended without an answer"
            raise FingerfitError(f"a process that helped {how}")
        failed, found = pickle.loads(answer)
        if failed:
            raise found
        shares.append(found)
    by_number = dict(pair for (found,) in shares for pair in found)
    return [by_number[n] for n in range(len(items))]


def apart(function: Callable[[], Result], seconds: int, memory: int) -> Result:
    """Result of a call in a forked process that is ended when it takes too long or too much.

    What Python alone cannot interrupt is ended, too: a number of a billion digits, a text of a billion characters.

    Parameters
    ----------
    function : callable
    seconds : int
        Of processor time.
    memory : int
        Bytes beyond what this process has taken.

    Raises
    ------
    Exception
        What the call raised; MemoryError and TimeoutError at the limits.
    FingerfitError
        When the process crashed or was ended from outside.
    """

    def limited(_: None) -> Result:
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        limits = (
            (resource.RLIMIT_AS, address_space() + memory),
            (resource.RLIMIT_CPU, seconds),
            (resource.RLIMIT_CORE, 0),
        )
        for kind, wanted in limits:
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
        return function()

    child, pipe = _fork(limited, [None])
    with os.fdopen(pipe, "rb") as stream:
        answer = stream.read()
    status = os.waitpid(child, 0)[1]
    if answer:
        failed, found = pickle.loads(answer)
        if failed:
            raise found
        return found[0]  # type: ignore[no-any-return]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU:
        raise TimeoutError
    raise FingerfitError("a process that helped was ended from outside")


def _fork(function: Callable[[Item], Result], share: Sequence[Item]) -> tuple[int, int]:
    """A child that works on its share: its number and the end of the pipe where it answers."""
    ahead, behind = os.pipe()
    child = os.fork()
    if child:
        os.close(behind)
        return child, ahead
    try:
        os.close(ahead)
        try:
            answer = pickle.dumps((False, [function(item) for item in share]))
        except Exception as error:
            answer = pickle.dumps((True, error))
        with os.fdopen(behind, "wb") as stream:
            stream.write(answer)
    finally:
        os._exit(0)
