"""Results of a study to look at: where its page is, and a browser that shows it."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path

from fingerfit.core.errors import InputError, StateError
from fingerfit.provenance.results import model_folder, study_folder
from fingerfit.settings.config import CONFIG, RUNS, Settings
from fingerfit.settings.runs import load_runs, settings_for


def page(study: Path | None, config: Path | None) -> Path:
    """The page of a study, or of the settings in this folder where none is named.

    Raises
    ------
    FingerfitError
        Without settings, and where no page was made yet.
    """
    if study is None:
        where = config or Path(CONFIG)
        every = load_runs(where)
        if len({study_folder(one) for one in every}) > 1:
            raise InputError(where, RUNS, "several studies", "fingerfit open STUDY, with one of them")
        settings: Settings | None = every[0]
    else:
        settings = settings_for(study, config)[0]
    if settings is None:
        raise InputError(study or CONFIG, "settings", "none", f"{study}/config.yaml, or --config FILE")
    found = study_folder(settings) / "report.html"
    if not found.exists():
        table = model_folder(settings) / "table.txt"
        has = f"; there is a table: {table}" if table.exists() else ""
        name = study or f"--config {config or CONFIG}"
        raise StateError(f"{found}: is not there yet; make it: fingerfit run {name} --diagnose{has}")
    return found.resolve()


def show(path: Path) -> None:
    """Open a page in the browser, where there is one with a screen."""
    screen = sys.platform == "darwin" or os.name == "nt" or os.getenv("DISPLAY") or os.getenv("WAYLAND_DISPLAY")
    if screen or os.getenv("BROWSER"):
        webbrowser.open(path.as_uri())
