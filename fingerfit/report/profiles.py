"""Profiles of a finished fit: computed, written beside its estimate, and drawn there and on the page."""

from __future__ import annotations

from pathlib import Path

from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import keep_json, read_record
from fingerfit.core.progress import Progress
from fingerfit.diagnosis.comparison import anchor_of
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.profiles import profile
from fingerfit.fit.finished import finished_fit
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.fit.simulate import measured
from fingerfit.provenance.results import model_folder, study_folder
from fingerfit.report.drawing import save
from fingerfit.report.page import profile_figure, write_page
from fingerfit.report.rungs import made_with
from fingerfit.settings.choices import KNOWN
from fingerfit.settings.config import Settings, load_settings


def profile_of(config: Path, name: str, threads: int = 1) -> str:
    """Make the profile of a constant of a finished fit; says what it found and where it is.

    Raises
    ------
    FingerfitError
        For another name than the model has, and without a fit by these settings.
    """
    settings = load_settings(config)
    names = [p.name for p in settings.parameters()]
    if name not in names:
        raise InputError(config, "constant", name, f"one of {', '.join(names)}")
    folder = model_folder(settings)
    problem, last = _fit(settings, config)
    with Progress(ticks=False).working(f"profile {name}"):
        solve_missing(problem, [anchor_of(problem, last)], threads)
        found = profile(comparison_of(problem, last, measured(problem)), name, threads)
    unit = next(p.unit for p in settings.parameters() if p.name == name)
    data = {
        "constant": name,
        "unit": unit,
        "interval95": found.interval,
        "ends": found.ends,
        "sentence": found.sentence,
        "points": [{"values": one, "rise": float(rise)} for one, rise in zip(found.guesses, found.rise, strict=True)],
        "made_with": made_with(settings.model_dump(mode="json")),
    }
    file = folder / f"profile_{name}.json"
    keep_json(file, data)
    picture = folder / f"figures/profile_{name}.png"
    save(profile_figure(data), picture)
    label = name if unit == "1" else f"{name} in {unit}"
    lines = [f"{label:<24}rise of the misfit"]
    lines += [f"{one[name]:<24.4g}{rise:.3g}" for one, rise in zip(found.guesses, found.rise, strict=True)]
    where = [str(file), str(picture)]
    if (page := study_folder(settings) / "report.html").exists():
        write_page(study_folder(settings), page)
        where.append(str(page))
    return "\n".join([*lines, "", found.sentence, f"written: {', '.join(where)}"])


def _fit(settings: Settings, config: Path) -> tuple[InverseProblem, Round]:
    """The fit by these settings, from its folder."""
    folder = model_folder(settings)
    if not (folder / "estimate.json").exists():
        raise StateError(f"{folder}: no estimate; make it: fingerfit run --config {config}")
    beside = (KNOWN, "time_limit")  # what changes no answer
    written, now = read_record(folder / "settings.json"), settings.model_dump(mode="json")
    if any(written.get(key) != now.get(key) for key in {*written, *now}.difference(beside)):
        raise StateError(f"{folder}: fitted with other settings; fit again: fingerfit run --config {config}")
    return finished_fit(folder, settings)
