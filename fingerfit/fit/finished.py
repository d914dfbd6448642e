"""A finished fit, read from the folder where the workflow left it."""

from __future__ import annotations

from pathlib import Path

from fingerfit.core.errors import StateError
from fingerfit.core.files import check_kept
from fingerfit.fit.joint import problem_of
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.settings.config import Settings, read_written
from fingerfit.study.data import Data
from fingerfit.study.several import file_ending


def finished_fit(folder: Path, settings: Settings | None = None) -> tuple[InverseProblem, Round]:
    """A finished fit: its problem and the round that says stop.

    Parameters
    ----------
    folder : Path
        ``results/{study}/{model}``.
    settings : Settings, optional
        Those that it was fitted with; else they are read there.

    Raises
    ------
    StateError
        When it is not there, not finished or damaged.
    Problems
        When its settings do not fit the study any more.
    """
    last = _stopped(folder)
    settings = settings or read_written(folder / "settings.json")
    data, files = list[Data](), list[dict[str, Path]]()
    for test in settings.read_study().every:
        ending = file_ending(test.test)
        names = {SEARCH: "mesh", **({REFINED: "refined"} if settings.finer(test) else {})}
        files.append({role: folder / f"{name}{ending}.inp" for role, name in names.items()})
        for path in files[-1].values():
            check_kept(path)
        data.append(Data.load(folder / f"prepared{ending}.npz"))
    return problem_of(settings, data, files, folder.parent / "sims"), last


def _stopped(folder: Path) -> Round:
    """The first round that says stop: what comes after it is of another fit, which was longer."""
    number, last = 0, None
    while last is None or last.stop is None:
        path = folder / f"rounds/{number}.json"
        if not path.exists():
            raise StateError(f"{folder}: has no finished fit; make it: fingerfit run")
        last, number = Round.load(path), number + 1
    return last
