"""config.yaml as a whole: one model, or several that share settings; the source of its schema and of docs/config.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field

from fingerfit.core.described import HEAD, rows
from fingerfit.core.errors import InputError
from fingerfit.settings.config import CONFIG, RUNS, Settings, load_settings


class Config(Settings):
    """config.yaml with one model, or with several."""

    runs: list[dict[str, Any]] = Field(
        default_factory=list,
        description="Several studies and models in one call: for each of them a mapping with the keys that differ from"
        " those above (mappings are merged key by key, everything else is replaced). Left out: one model.",
    )


def load_runs(source: Mapping[str, Any], where: Path | str = CONFIG) -> list[Settings]:
    """Check the settings of all models of a config.yaml: of the one in it, or of those under ``runs``.

    Parameters
    ----------
    source : mapping
        What was read from config.yaml.
    where : Path or str
        Named in errors.

    Raises
    ------
    Problems
        With one line for each wrong key of the first model that has one.
    InputError
        For runs that are no list of mappings.
    """
    if RUNS not in source:
        return [load_settings(source, where)]
    shared, runs = {key: value for key, value in source.items() if key != RUNS}, source[RUNS]
    if not isinstance(runs, list) or not runs:
        raise InputError(where, RUNS, runs, "a list: for each model the keys that differ from those above")
    for n, run in enumerate(runs):
        if not isinstance(run, Mapping) or RUNS in run:
            raise InputError(where, f"{RUNS}.{n}", run, "the keys that differ from those above, or {} for none")
    return [load_settings(_merged(shared, run), f"{where}: {RUNS}.{n}") for n, run in enumerate(runs)]


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
