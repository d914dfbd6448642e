"""Calls beside each other: order, failures, and children that are ended."""

import os
import signal
import time

import pytest

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.processes import apart, side_by_side


@pytest.mark.parametrize("processes", [1, 2, 3, 9])
def test_results_come_in_order_from_as_many_processes(processes):
    found = side_by_side(lambda n: (n * n, os.getpid()), range(5), processes)
    assert [square for square, _ in found] == [0, 1, 4, 9, 16]
    assert len({process for _, process in found}) == min(processes, 5)
    assert found[0][1] == os.getpid()


def test_a_long_call_holds_no_other_up(tmp_path):
    """The first call ends when all others have; it would wait for ever for one that its own process keeps."""

    def call(n):
        while n == 0 and len(list(tmp_path.iterdir())) < 4:
            time.sleep(0.01)
        (tmp_path / str(n)).touch()
        return n

    assert side_by_side(call, range(5), 2) == [0, 1, 2, 3, 4]


def test_more_calls_than_a_pipe_can_number():
    assert side_by_side(lambda n: 2 * n, range(20000), 2) == list(range(0, 40000, 2))


def test_nothing_to_do():
    assert side_by_side(str, [], 2) == []


@pytest.mark.parametrize("wrong", [0, 1])
def test_what_a_call_raises_is_raised(wrong):
    def call(n):
        if n == wrong:
            raise Problems([InputError("here", "this", "that", "something else")])

    with pytest.raises(Problems, match="here: this: found that; expected something else") as caught:
        side_by_side(call, [0, 1], 2)
    assert caught.value.problems[0].field == "this"
    with pytest.raises(ChildProcessError):  # no child is left
        os.waitpid(-1, os.WNOHANG)


def test_a_child_that_is_killed_is_told():
    own = os.getpid()
    with pytest.raises(FingerfitError, match=r"was killed \(signal 9\), perhaps out of memory"):
        side_by_side(lambda n: os.getpid() == own or os.kill(os.getpid(), signal.SIGKILL), [0, 1], 2)


# --- a call with limits

ROOM = 2**28


def test_a_call_apart_answers_and_raises_as_any_other():
    assert apart(lambda: (os.getpid() != os.getppid(), "text"), 10, ROOM) == (True, "text")
    with pytest.raises(InputError, match="here: this: found that"):
        apart(lambda: _raise(InputError("here", "this", "that", "something else")), 10, ROOM)
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


def _raise(error):
    raise error


def test_a_call_apart_ends_at_its_limits():
    with pytest.raises(MemoryError):
        apart(lambda: len(bytearray(2 * ROOM)), 10, ROOM)
    assert apart(lambda: len(bytearray(ROOM // 2)), 10, ROOM) == ROOM // 2
    # what Python cannot interrupt by itself: one power of whole numbers
    with pytest.raises(TimeoutError):
        apart(lambda: 7 ** (10**8) > 0, 1, ROOM)


def test_a_call_apart_that_is_killed_is_told():
    with pytest.raises(FingerfitError, match="ended from outside"):
        apart(lambda: os.kill(os.getpid(), signal.SIGKILL), 10, ROOM)
