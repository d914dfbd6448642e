"""Why a job of the workflow failed, in one line: Snakemake says only that it did."""

from __future__ import annotations

import logging
import re
import shutil
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from fingerfit.core.processes import perhaps_memory
from fingerfit.core.progress import say

MARK = "fingerfit: error: "
"""Before each error that the command line prints, and so the logs of jobs hold."""
_STATUS = re.compile(r"returned non-zero exit status (\d+)|died with <Signals\.\w+: (\d+)>")
_BEFORE = re.compile(
    r"^InputFunctionException.*?^Error:\n +\w*(?:FingerfitError|InputError|LimitError|StateError|Problems): ([^\n]+)",
    re.S | re.M,
)
"""An error of ours while Snakemake asks what a job needs: decks are written then."""
SMALL = 1 << 20
"""Bytes that are left on a disk where results no longer fit: those of the smallest studies are of this size."""
_DUMPS = ("RuleException:", "Exiting because a job execution failed", "WorkflowError:\nAt least one job")
_ASIDE = (
    *("Workflow defines that rule", "Assuming unrestricted shared filesystem"),
    *("No SLURM account given", "No account was given", "Unable to guess SLURM account"),
)
"""Beginnings of messages that say what is right for nearly everybody."""


def refused(text: object) -> SystemExit:
    """Say why nothing can run in lines as those of a command, and return what ends the workflow while it is read.

    Snakemake would put the place in the workflow around what its own exceptions say.
    """
    say(*(MARK + line for line in str(text).splitlines()), error=True)
    return SystemExit(1)


def why(rule: str, logs: Sequence[str], status: int = 0) -> list[str]:
    """Lines that say why a job failed and where its log is.

    Parameters
    ----------
    rule : str
        Its name.
    logs : sequence of str
        Its logs; the first one counts.
    status : int
        What its shell returned, negative or above 128 for a signal; 0 when that is not known.
    """
    path = Path(logs[0]) if logs else None
    text = path.read_text(encoding="utf-8", errors="replace") if path is not None and path.is_file() else ""
    written = [line for line in text.splitlines() if line.strip()]
    lines = [line.removeprefix(MARK) for line in written if line.startswith(MARK)]
    number = -status if status < 0 else status - 128
    if not lines and number > 0:
        lines = [f"was killed (signal {number}){perhaps_memory(number)}"]
    elif not lines and written:
        lines = [f"stopped unexpectedly: {written[-1].strip()}"]
    elif not lines:
        lines = ["ended without a message" + (f", exit status {status}" if status else ", perhaps killed")]
        if path is not None and path.parent.is_dir() and (free := shutil.disk_usage(path.parent).free) < SMALL:
            lines = [f"{lines[0]}; No space left on the disk? {free} bytes are free"]
    if path is not None:
        lines[-1] += f"; log: {path}"
    return [f"{rule}: {line}" for line in lines]


class Failures(logging.Handler):
    """Tells the reason of each job that fails, from Snakemake's record of it.

    Parameters
    ----------
    say : callable
        Given each line.
    """

    def __init__(self, say: Callable[[str], object]) -> None:
        super().__init__(logging.ERROR)
        self._say = say
        self._messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep what a shell returned, which comes first, and tell the reason when the record of the job comes."""
        if str(getattr(getattr(record, "event", None), "value", "")) != "job_error":
            self._messages.append(record.getMessage())
            if found := _BEFORE.search(record.getMessage()):
                self._say(MARK + found[1])
            return
        job = record.__dict__
        logs, command = list(job.get("log") or []), str(job.get("shellcmd") or "")
        status = _status([message for message in self._messages if logs and logs[0] in message])
        # a job whose output is shown as it comes has said why; who pressed Ctrl-C knows
        if "| tee " not in command and status not in (-signal.SIGINT, 128 + signal.SIGINT):
            for line in why(str(job.get("rule_name")), logs, status):
                self._say(line)

    @staticmethod
    def shown(record: logging.LogRecord) -> bool:
        """Whether a message of Snakemake's is still to be shown: the ends of commands that failed are not."""
        message = record.getMessage()
        return not (message.startswith(_DUMPS + _ASIDE) or _BEFORE.search(message))


def _status(messages: Sequence[str]) -> int:
    """What the shell returned of which Snakemake's messages tell; 0 when they do not."""
    for message in reversed(messages):
        found = _STATUS.search(message)
        if found:
            return int(found[1]) if found[1] else -int(found[2])
    return 0
