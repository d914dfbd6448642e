"""Calls beside each other, in forked processes.

What `multiprocessing` does, without its import: that takes longer than what a round of a search saves by two processes.
"""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from fingerfit.errors import FingerfitError

Item = TypeVar("Item")
Result = TypeVar("Result")


def side_by_side(function: Callable[[Item], Result], items: Sequence[Item], processes: int) -> list[Result]:
    """Results of a function for all items, in order.

    Parameters
    ----------
    function : callable
        Forked children see all that was read before; what they change stays with them, results are pickled.
    items : sequence
    processes : int
        This one included; it does its own share.

    Raises
    ------
    Exception
        What a call raised.
    FingerfitError
        When a child was ended from outside.
    """
    count = max(1, min(processes, len(items)))
    pipes = [_fork(function, items[n::count]) for n in range(1, count)]
    answers: list[Any] = []
    endings: list[int] = []
    try:
        shares = [[function(item) for item in items[::count]]]
    finally:
        # children are waited for in any case: none is left behind
        for child, pipe in pipes:
            with os.fdopen(pipe, "rb") as stream:
                answers.append(stream.read())
            endings.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    for answer, ending in zip(answers, endings, strict=True):
        if not answer:
            memory = ", perhaps out of memory" if ending == -signal.SIGKILL else ""
            how = f"was killed (signal {-ending}){memory}" if ending < 0 else "ended without an answer"
            raise FingerfitError(f"a process that helped {how}")
        failed, found = pickle.loads(answer)
        if failed:
            raise found
        shares.append(found)
    results: list[Any] = [None] * len(items)
    for n, share in enumerate(shares):
        results[n::count] = share
    return results


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
