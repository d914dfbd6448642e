"""One tree of errors. The library raises them; only the command line prints them and exits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


class FingerfitError(Exception):
    """Base of all errors a user may meet; its text is one line."""


class InputError(FingerfitError):
    """Something the user wrote cannot be used.

    Parameters
    ----------
    where : Path or str
        The file.
    field : str
        The key, column, keyword or line in it.
    found : object
        What stands there.
    expected : str
        What would be right.
    """

    def __init__(self, where: Path | str, field: str, found: object, expected: str) -> None:
        self.where, self.field, self.found, self.expected = str(where), field, found, expected
        super().__init__(f"{where}: {field}: found {_one_line(found)}; expected {expected}")

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        # else another process could not pass it on
        return type(self), (self.where, self.field, _one_line(self.found), self.expected)


class LimitError(InputError):
    """Something the user wrote is too large, too long or no regular file: it is not read further."""


class Problems(FingerfitError):
    """Several input errors at once, one line each."""

    def __init__(self, problems: Sequence[FingerfitError]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(p) for p in problems))

    def __reduce__(self) -> tuple[type, tuple[tuple[FingerfitError, ...]]]:
        return type(self), (self.problems,)


class SolverError(FingerfitError):
    """The solver could not be run at all (missing executable, licence, time limit), or what it left is damaged.

    Not a diverged guess, which is an answer and is kept: this stops the fit, and nothing is kept. A diagnosis goes on
    without the candidate whose simulation it was.
    """


class NoSolverError(SolverError):
    """The solver is not there, cannot be started or gets no licence: no deck would be answered, whatever is in it."""


class StateError(FingerfitError):
    """A result that should be there is missing, damaged or belongs to something else."""


def _one_line(value: object, limit: int = 200) -> str:
    text = " ".join(str(value).split())
    return text if len(text) <= limit else text[: limit - 3] + "..."
