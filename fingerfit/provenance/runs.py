"""The models of one call of the workflow: what each is made from, and where its results are."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import IO, Any

from fingerfit.core.contents import Contents
from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import digest, read_record
from fingerfit.provenance import results, stages
from fingerfit.provenance.size import Size, size_of
from fingerfit.settings.config import CONFIG, RUNS, Settings
from fingerfit.settings.runs import load_runs
from fingerfit.solvers.registry import get_solver

Parts = dict[str, dict[str, str]]


class Run:
    """One model of one study.

    Parameters
    ----------
    settings : Settings
        As config.yaml says.
    where : Path or str
        Named in errors.
    contents : Contents
        What is known of the contents of files.
    """

    def __init__(self, settings: Settings, where: Path | str, contents: Contents) -> None:
        # another time limit changes no answer, so that nothing that is made knows it
        self.time_limit = settings.time_limit
        self.settings, self.where = settings.model_copy(update={"time_limit": None}), where
        self.study, self.model = str(results.study_folder(settings)), settings.model.full_name
        self.folder = f"{self.study}/{self.model}"
        self.below = f"{self.study}/{settings.model.path[-2]}" if settings.model.effects else ""
        self.contents = contents
        self.study_files = stages.study_files(Path(settings.study))
        self.figures = stages.figures(settings)
        self.refined = stages.has_refined(settings)
        self.tests = stages.tests_of(settings)
        self.waits = False  # for the estimate of the model below, which another run of the same call makes
        self._known: tuple[str, Settings, Parts] | None = None

    @cached_property
    def size(self) -> Size:
        """What the memory and the time of its jobs follow from."""
        return size_of(self.settings)

    def given(self) -> str:
        """The settings as JSON: what `fingerfit settings` is called with."""
        return json.dumps(self.settings.model_dump(mode="json"))

    def text(self) -> str:
        """Hash of ``settings.json``; empty while the model with one effect less has no estimate."""
        return "" if self._pending() else digest(stages.settings_text(self._now()[0], Path(self.folder)))

    def part(self, stage: str, which: str) -> str:
        """What a stage depends on: its ``settings``, its ``code``, and what it is ``made_from``.

        Empty while the model with one effect less has no estimate.
        """
        return "" if self._pending() else self._now()[1][which][stage]

    def _pending(self) -> bool:
        return self.waits and not Path(self.below, "estimate.json").exists()

    def _now(self) -> tuple[Settings, Parts]:
        """Settings whose search starts at the estimate that is there now, and what follows from them.

        Found anew where that estimate, the diagnosis beside it or another rung has changed since.
        """
        before = [Path(self.below) / name for name in ("estimate.json", "diagnosis.json")] if self.below else []
        key = self.contents.of([*before, *stages.other_rungs(self.settings)])
        if self._known is None or self._known[0] != key:
            settings = stages.warm(self.settings, self.where)
            parts = {
                "settings": {stage: stages.settings_of(settings, stage) for stage in stages.STAGES},
                "code": stages.fingerprints(self.contents),
                "made_from": stages.made_from(settings, self.contents),
            }
            self._known = key, settings, parts
        return self._known[1:]

    def begin(self) -> tuple[IO[str], list[str]]:
        """Make its results ready for a run: nobody else works on them, and what is damaged of them is removed.

        Returns
        -------
        file
            While it is open, no other run begins.
        list of str
            A line for each file that was removed.

        Raises
        ------
        StateError
            When another run works on them, or they cannot be written.
        """
        try:
            results.claim(self.settings)
            held = results.hold(self.settings)
            lines = results.mend(self.settings, self.contents, True)
            self.in_order()
        except OSError as error:
            where = error.filename or self.folder
            raise StateError(f"{where}: cannot be read or written: {error.strerror}") from error
        self.contents.save()
        return held, lines

    def in_order(self) -> None:
        """Give its results times in the order in which they are made, see `fingerfit.provenance.results.in_order`."""
        results.in_order(self.settings)


def studies(config: Mapping[str, Any], where: Path | str = CONFIG) -> list[str]:
    """The folders of results of all studies of a config.yaml; see `planned` for errors."""
    return list(dict.fromkeys(str(results.study_folder(settings)) for settings in load_runs(config, where)))


def planned(
    config: Mapping[str, Any], where: Path | str = CONFIG, study: str | None = None, whole: bool = True
) -> list[Run]:
    """All models of a config.yaml, checked; nothing is written.

    Parameters
    ----------
    config : mapping
        What was read.
    where : Path or str
        Named in errors.
    study : str or None
        The folder of results of the only study whose models are wanted.
    whole : bool
        Whether to find out now what all stages depend on, and what is wrong with that: not for a job of the workflow,
        whose call has done so.

    Raises
    ------
    FingerfitError
        For settings that are wrong or make no sense in their study, models with the same results, and a model with
        effects that has no estimate to start from.
    """
    runs: list[Run] = []
    contents: dict[str, Contents] = {}
    for n, settings in enumerate(load_runs(config, where)):
        if study and str(results.study_folder(settings)) != study:
            continue
        here = f"{where}: {RUNS}.{n}" if RUNS in config else where
        stages.check_model(settings, here)
        known = contents.setdefault(settings.results, Contents(Path(settings.results) / results.MARK))
        runs.append(Run(settings, here, known))
        _refuse_same_place(runs)
    if not runs:
        raise InputError(
            where, RUNS, f"nothing with results in {study}", "a study of that name, as FINGERFIT_STUDY says"
        )
    for run in runs:
        run.waits = run.below in {other.folder for other in runs}
        for which in ("settings", "code", "made_from") if whole else ():
            run.part("prepare", which)
    return runs


def _refuse_same_place(runs: Sequence[Run]) -> None:
    """Refuse the last model where its results would be those of another one, or lie in those of another study."""
    *others, last = runs
    for other in others:
        one, two = Path(other.study), Path(last.study)
        if Path(other.settings.study).resolve() == Path(last.settings.study).resolve():
            if other.folder == last.folder:
                expected = "another name for each model of a study, or other effects"
                raise InputError(last.where, "model.name", f"a second model {last.model} of {one}", expected)
        elif one == two or one in two.parents or two in one.parents:
            found = f"{two} for {last.settings.study}, and {one} for {other.settings.study}"
            raise InputError(last.where, "results", found, "folders of which none is or lies in the other one")


def time_limit(runs: Sequence[Run], study: str, model: str = "") -> int:
    """Time for one simulation of a model, s; without one that of a study's models, of which each may ask for it.

    A simulation that several models ask for is solved once: so the longest of their limits holds, that of the solver
    itself where a model has none. 0 is the solver's own.
    """
    asking = [run for run in runs if run.study == study and model in ("", run.model)]
    own = [getattr(get_solver(run.settings.solver), "time_limit", 0) for run in asking]
    limits = [limit if run.time_limit is None else run.time_limit for run, limit in zip(asking, own, strict=True)]
    return math.ceil(max(limits)) if any(run.time_limit is not None for run in asking) else 0


def damaged(runs: Sequence[Run]) -> list[str]:
    """A line for each result that is damaged; nothing is removed."""
    return list(dict.fromkeys(line for run in runs for line in results.mend(run.settings, run.contents, False)))


def shown(runs: Sequence[Run]) -> list[str]:
    """What to show of finished models: their tables, and what to open."""
    tables = [path for run in runs if (path := Path(run.folder, "table.txt")).exists()]
    lines = [path.read_text(encoding="utf-8") for path in tables]
    for path in tables:
        folder = path.parent / "figures"
        figures = ", ".join(sorted(file.stem for file in folder.glob("*.png")))
        lines.append(f"table: {path}" + (f"; figures: {folder} ({figures})" if figures else ""))
    for run in runs:
        page, made = Path(run.study, "report.html"), Path(run.folder, "diagnosis.json")
        # results have times in their order: a page before its diagnosis is of an earlier one
        if made.exists() and page.exists() and page.stat().st_mtime >= made.stat().st_mtime:
            with contextlib.suppress(StateError):  # of a diagnosis of before, not what this call has made
                rung = read_record(Path(run.folder, "rung.json"), "sentence")
                lines += [f"verdict: {rung['sentence']}\n{rung.get('family_sentence', '')}".rstrip(), f"page: {page}"]
        export = Path(run.folder, "export")
        lines += [f"export: {export}"] * export.is_dir()
    return list(dict.fromkeys(lines))
