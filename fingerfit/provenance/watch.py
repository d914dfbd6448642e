"""What the workflow says while it runs, instead of Snakemake's words: a line for each round."""

from __future__ import annotations

import logging
import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fingerfit.core.errors import FingerfitError
from fingerfit.core.journal import Journal
from fingerfit.core.progress import Progress, in_words
from fingerfit.fit.rounds import Round, simulations
from fingerfit.fit.took import Took

_ROUND = re.compile(r"/rounds/\d+\.json$")
_SENT = ".sent"
"""Ending of the mark of a job that fits a whole study on a cluster."""
_NOTHING = "Nothing to be done"
_FURTHER = 10
"""Times the way made so far that the way left may be for its time to be told; a choice."""


class Watch(logging.Handler):
    """Follows Snakemake's records of its jobs.

    Parameters
    ----------
    progress : Progress
    finished : callable
        Called where Snakemake finds nothing to do.
    several : bool
        Whether lines have to say whose they are.
    works : callable
        Whether jobs run; of a dry run Snakemake tells of them, too, and no page of a study is to change.
    """

    def __init__(
        self, progress: Progress, finished: Callable[[], object], several: bool, works: Callable[[], bool]
    ) -> None:
        super().__init__(logging.INFO)
        self._progress, self._finished, self._several, self._works = progress, finished, several, works
        self._jobs: dict[int, tuple[str, str, float, float]] = {}
        self._seconds: list[float] = []
        self._asked = self._solved = 0
        self._stages: dict[Path, tuple[str, int, float, float]] = {}
        self._journals: dict[Path, Journal] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Note the start of a job, tell what its end says, and leave the screen to errors."""
        event, job = str(getattr(getattr(record, "event", None), "value", "")), record.__dict__
        if event == "job_info":
            output, log = (str((job.get(name) or [""])[0]) for name in ("output", "log"))
            self._begin(int(job["jobid"]), output, log, str(job["rule_name"]))
        elif event == "job_finished" and job["job_id"] in self._jobs:
            self._end(*self._jobs.pop(job["job_id"]))
        elif record.levelno >= logging.WARNING:
            self._progress.stop()
        elif record.getMessage().startswith(_NOTHING):
            self._finished()

    def _begin(self, number: int, output: str, log: str, rule: str) -> None:
        self._jobs[number] = output, log, time.monotonic(), time.time()
        if output.endswith("diagnosis.json"):
            self._progress.stop()  # it has a bar of its own
        elif output.endswith("solution.npz"):
            self._progress.show("simulate", self._solved, self._asked or None)
        elif output.endswith(_SENT):
            self._tell_sent(output, "sent to the cluster")
        elif not _ROUND.search(output):
            self._progress.show(rule)
        elif self._works():
            path = Path(output)
            self._journal(path).now(f"{path.parents[1].name}: search, round {path.stem}")

    def _end(self, output: str, log: str, began: float, clock: float) -> None:
        if output.endswith("solution.npz"):
            self._seconds.append(time.monotonic() - began)
            self._solved += 1
            self._progress.show("simulate", self._solved, self._asked or None)
        elif output.endswith(_SENT):
            self._tell_sent(output, f"finished after {in_words(time.monotonic() - began)}")
        elif _ROUND.search(output):
            try:
                self._tell(Path(output), Round.load(Path(output)), clock, Took.read(Path(log)))
            except FingerfitError:
                return  # who reads it next says what is wrong with it

    def _tell_sent(self, output: str, what: str) -> None:
        now = in_words(time.monotonic() - self._progress.began)
        self._progress.line(f"{now:>8}  {Path(output).parent}: {what}; log: {output.removesuffix(_SENT)}.log")

    def _tell(self, path: Path, current: Round, clock: float, took: Took) -> None:
        sims = path.parents[2] / "sims"
        names = dict.fromkeys(asked.sim for asked in simulations(current.everything))
        there = [file for name in names if (file := sims / name / "solution.npz").exists()]
        # by the job of this round, since it began
        run = sum(file.stat().st_mtime >= clock for file in there)
        self._asked, self._solved = len(names) - len(there), 0
        # the time of those that this job ran; without any, of those that had jobs of their own before
        jobs = sum(self._seconds) / len(self._seconds) if self._seconds and not took.number else None
        counts = {"known": len(there) - run, f"run{_each(took.each)}": run, "to run": self._asked}
        best = current.best["score"] if current.best is not None else None
        parts = [
            f"{in_words(time.monotonic() - self._progress.began)}",
            f"simulations: {', '.join(f'{number} {what}' for what, number in counts.items() if number) or 'none'}"
            + _each(jobs),
            *([] if best is None else [f"best score {best:.6f}"]),
            *self._left(path.parent, current),
            *([f"stop: {current.stop}"] if current.stop else []),
        ]
        who = f"{path.parents[2].name}/{path.parents[1].name} " if self._several else ""
        line = f"round {current.number:3d}  {current.stage:<12} {', '.join(parts)}"
        self._progress.line(who + line)
        self._journal(path).add(f"{path.parents[1].name}: {line}")

    def _journal(self, path: Path) -> Journal:
        """The page of the study that a round belongs to."""
        return self._journals.setdefault(path.parents[2], Journal(path.parents[2]))

    def _left(self, where: Path, current: Round) -> list[str]:
        """Tolerances that were reached against those that are wanted, and the time that this leaves for the stage.

        The differences between the vertices of a simplex fall by a factor in each round, so the logarithm of the worst
        of them tells the time: that of one round at least, and nothing where hardly any of the way is made.
        """
        if not current.tolerances:
            return []
        told, worst = [], 0.0
        for name, (reached, wanted) in current.tolerances.items():
            told.append(f"{name} {reached:.2g} ({wanted:.2g})")
            worst = max(worst, reached / wanted)
        now, text = time.monotonic(), ", ".join(told)
        stage, number, first, began = self._stages.get(where, ("", 0, 0.0, now))
        if stage != current.stage:
            self._stages[where] = current.stage, current.number, worst, now
        elif 1 < worst < first and (further := math.log(worst) / math.log(first / worst)) <= _FURTHER:
            left = max(further, 1 / max(1, current.number - number)) * (now - began)
            text += f", {in_words(left)} left in this stage"
        return [text]


def _each(seconds: float | None) -> str:
    return "" if seconds is None else f" ({seconds:.2g} s each)"


def heard_by(logger: Any, watch: Watch, quiet: Callable[[], bool]) -> None:
    """Have a watch hear Snakemake's records before they are shown, and those that are no errors not shown while it is
    quiet."""
    handlers = list(logger.handlers)
    for handler in handlers:
        logger.removeHandler(handler)
    for handler in [watch, *handlers]:
        logger.addHandler(handler)
    for handler in handlers:
        handler.addFilter(lambda record: record.levelno >= logging.WARNING or not quiet())
