"""config.yaml as a whole: one model, or several that share settings; the source of its schema and of docs/config.md."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from fingerfit.core.described import HEAD, rows
from fingerfit.core.errors import InputError
from fingerfit.core.keys import read_yaml
from fingerfit.settings.config import CONFIG, RUNS, Settings, load_settings
from fingerfit.study.reader import study_path


class Config(Settings):
    """config.yaml with one model, or with several."""

    runs: list[dict[str, Any]] = Field(
        default_factory=list,
        description="Several studies and models in one call: for each of them a mapping with the keys that differ from"
        " those above (mappings are merged key by key, everything else is replaced). Left out: one model.",
    )


def load_runs(source: Mapping[str, Any] | Path, where: Path | str = CONFIG) -> list[Settings]:
    """Check the settings of all models of a config.yaml: of the one in it, or of those under ``runs``.

    Parameters
    ----------
    source : mapping or Path
        What was read from config.yaml, or the file.
    where : Path or str
        Named in errors.

    Raises
    ------
    Problems
        With one line for each wrong key of the first model that has one.
    InputError
        For runs that are no list of mappings.
    """
    if isinstance(source, Path):
        where, source = source, read_yaml(source)
    if not isinstance(source, Mapping) or RUNS not in source:
        return [load_settings(source, where)]
    shared, runs = {key: value for key, value in source.items() if key != RUNS}, source[RUNS]
    if not isinstance(runs, list) or not runs:
        raise InputError(where, RUNS, runs, "a list: for each model the keys that differ from those above")
    for n, run in enumerate(runs):
        if not isinstance(run, Mapping) or RUNS in run:
            raise InputError(where, f"{RUNS}.{n}", run, "the keys that differ from those above, or {} for none")
    return [load_settings(_merged(shared, run), f"{where}: {RUNS}.{n}") for n, run in enumerate(runs)]


def settings_for(path: Path, config: Path | None) -> tuple[Settings | None, Path, str]:
    """Settings for a study, their file, and where they are from in words.

    Parameters
    ----------
    path : Path
        Study.
    config : Path or None
        Their file, if it is another one than in the study's folder, or else in this one.

    Raises
    ------
    InputError
        For a study that is not there, and settings of another study that were asked for, or that lie in this one's
        folder.
    """
    if not path.exists():
        raise InputError(path, "study", "no such folder", "the folder of a study")
    folder, own, here = study_path(path).parent, study_path(path).parent / CONFIG, Path(CONFIG)
    if config is None and not os.path.lexists(own):
        named = _studies(read_yaml(here)) if os.path.lexists(here) else None
        if named is None or not any(_same(Path(study), folder) for study in named):
            found = "there is no config.yaml" if named is None else f"config.yaml is for {', '.join(named) or 'none'}"
            return None, here, f"none: {found}, so mesh, constants, template and solver are not checked"
        config = here
    config = config or own
    every = load_runs(config)
    ours = [settings for settings in every if _same(Path(settings.study), folder)]
    if not ours:
        raise InputError(config, "study", every[0].study, f"{path}, the study that is checked, or other settings")
    which = f"; of its {len(ours)} models of this study the first, {ours[0].model.name}" if len(ours) > 1 else ""
    return ours[0], config, f"{config}{which}"


def _studies(source: Any) -> list[str]:
    """Studies that a config.yaml names, whatever else is wrong with it."""
    runs = source.get(RUNS) if isinstance(source, dict) else None
    given = [source, *(runs if isinstance(runs, list) else [])]
    found = [one["study"] for one in given if isinstance(one, dict) and isinstance(one.get("study"), str)]
    return list(dict.fromkeys(found))


def _same(study: Path, folder: Path) -> bool:
    """Whether a study is the one in a folder."""
    return os.path.realpath(study_path(study).parent) == os.path.realpath(folder)


def _merged(shared: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    inner = {
        key: _merged(shared[key], value)
        for key, value in own.items()
        if isinstance(value, Mapping) and isinstance(shared.get(key), Mapping)
    }
    return {**shared, **own, **inner}


def schema() -> dict[str, Any]:
    """JSON schema of config.yaml; with runs, each of them may have what is needed."""
    found = Config.model_json_schema()
    needed = found.pop("required")
    return {**found, "anyOf": [{"required": needed}, {"required": [RUNS]}]}


def describe() -> str:
    """Markdown table of all keys, for docs/config.md."""
    return (
        "\n".join(["# Keys of config.yaml", "", "Made by `fingerfit docs`; do not edit.", "", *HEAD, *rows(Config)])
        + "\n"
    )
