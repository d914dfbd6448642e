"""Several tests in one study: each is a study of its own, but for what all of them share."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.study.study import Study

Read = TypeVar("Read")
"""What is read of a test: a study, or the description of an experiment."""
Array = TypeVar("Array")
TESTS = "tests"
"""Key of study.yaml and experiment.yaml."""
AT = "@"
"""Between the name of a number and that of the test that has it for itself, as ``mu_top@wide``."""
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def of_test(values: Mapping[str, float], test: str) -> dict[str, float]:
    """What a guess of all tests is in one of them: what they share, and its own numbers by their plain names.

    >>> of_test({"mu": 1.0, "onset.gap@wide": 0.1, "onset.gap@narrow": 0.2}, "narrow")
    {'mu': 1.0, 'onset.gap': 0.2}
    """
    split = [(*name.partition(AT), value) for name, value in values.items()]
    return {name: value for name, _, own, value in split if own in ("", test)}


def file_ending(test: str) -> str:
    """End of the names of files that a test has for itself; empty where the study has one test."""
    return f"-{test}" if test else ""


def array_ending(test: str) -> str:
    """The same of the names of arrays and of numbers, as ``force@wide``."""
    return f"{AT}{test}" if test else ""


def arrays_of_test(arrays: Mapping[str, Array], test: str) -> dict[str, Array]:
    """Arrays of one test by their plain names; all of them for no name."""
    ending = array_ending(test)
    return {name.removesuffix(ending): values for name, values in arrays.items() if name.endswith(ending)}


def several(data: Mapping[str, Any], file: Path, load: Callable[[Any, Path], Study]) -> Study:
    """A study of several tests: the first of them, which has all of them.

    Parameters
    ----------
    data : mapping
        What was read from study.yaml.
    file : Path
    load : callable
        Makes the study of one test.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    shared = {"title": file.parent.name, **data}
    tests = tuple(replace(test, test=name) for name, test in each(shared, file, load).items())
    return replace(tests[0], title=str(shared["title"]), test="", tests=tests)


def each(data: Mapping[str, Any], file: Path, load: Callable[[Any, Path], Read]) -> dict[str, Read]:
    """What is read of each test, by its name. A key of a test takes the place of the same key at the top.

    Raises
    ------
    Problems
        With one line for everything that is wrong; what is wrong with shared keys is told once.
    """
    tests, shared = data[TESTS], {key: value for key, value in data.items() if key != TESTS}
    if not isinstance(tests, dict) or len(tests) < 2:
        found = f"{len(tests)} of them" if isinstance(tests, dict) else "nothing" if tests is None else tests
        raise Problems([InputError(file, TESTS, found, "two or more, each with a name")])
    problems: list[FingerfitError] = []
    read: dict[str, Read] = {}
    for name, own in tests.items():
        field = f"{TESTS}.{name}"
        if not isinstance(name, str) or not NAME.fullmatch(name):
            problems.append(InputError(file, field, "this name", "a name of letters, digits and _, a letter first"))
        elif name.lower() in map(str.lower, read):
            problems.append(InputError(file, field, "the name of another test but for capitals", "a name of its own"))
        elif not isinstance(own, dict):
            found = "nothing" if own is None else own
            problems.append(InputError(file, field, found, "keys and values in which the test differs"))
        elif TESTS in own:
            problems.append(InputError(file, f"{field}.{TESTS}", "tests within a test", "no such key"))
        else:
            try:
                read[name] = load({**shared, **own}, file)
            except Problems as error:
                problems += [_of_test(problem, file, field, own) for problem in error.problems]
    if problems:
        raise Problems(list({str(problem): problem for problem in problems}.values()))
    return read


def _of_test(problem: FingerfitError, file: Path, field: str, own: Mapping[str, Any]) -> FingerfitError:
    """A problem with the test that it is in; one of a shared key or of another file says where it is already."""
    if not isinstance(problem, InputError) or problem.where != str(file):
        return problem
    key = problem.field.partition(".")[0]
    missing = problem.found == "nothing" and "." not in problem.field
    if key not in own and not missing:
        return problem
    return InputError(file, f"{field}.{problem.field}", problem.found, problem.expected)
