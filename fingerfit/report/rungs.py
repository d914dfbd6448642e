"""The ladder of a model: which rungs are on it, by the settings that they were made with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fingerfit.core.files import digest, read_json
from fingerfit.report.compared import by_the_last
from fingerfit.settings.choices import read_checked
from fingerfit.settings.finer import are_finer
from fingerfit.settings.parts import MeshSettings
from fingerfit.solvers.registry import get_solver

KEYS = ("mesh", "refined")
"""Of the meshes in the settings of a model."""
COMPARED = ("score", "steps", "smooth", "crop", "bins")
"""Settings of a fit that its errors depend on; those of the search only say how it is found."""


def made_with(settings: Mapping[str, Any]) -> str:
    """Hash of the settings that rungs of one ladder share: all that errors depend on, but effects and starts."""
    model, fit = settings["model"], settings["fit"]
    shared = {key: value for key, value in model.items() if key not in ("effects", "rivals", "parameters")}
    bounds = {name: {**entry, "start": None} for name, entry in model["parameters"].items()}
    chosen = [settings["study"], settings["solver"], shared, bounds, [fit[key] for key in COMPARED]]
    return digest(json.dumps(chosen, sort_keys=True))


def ladder(study: Path, settings: Path) -> dict[str, Any]:
    """The ladder of a model: the rungs on the way to it, from the model without effects.

    Parameters
    ----------
    study : Path
        Results of the study.
    settings : Path
        ``settings.json`` of the model.

    Returns
    -------
    dict
        ``study``, ``rungs`` and under ``others`` the models that are not on this ladder, with the reason: a side
        branch, or a rung that was made with other settings, whose errors are not comparable. A rung of the coarser mesh
        that this model was begun with is on the ladder, with ``coarser`` true. Misfits, AIC and BIC are those by the
        likelihood of the last rung.
    """
    own, path = read_json(settings), read_checked(settings).model.path
    now = made_with(own)
    there = {file.parent.name: read_json(file) for file in sorted(study.glob("*/rung.json"))}
    same = {name for name, rung in there.items() if rung.get("made_with") == now}
    for name in [name for name in path if name in there and name not in same]:
        if _on_coarser_mesh(study / name / "settings.json", there[name].get("made_with"), own):
            there[name] |= {"coarser": True}
            same.add(name)
    reasons = {
        name: "not on the way to this model" if name in same else "made with other settings"
        for name in there
        if name not in same or name not in path
    }
    others = [{"model": name, "why": why} for name, why in reasons.items()]
    rungs = by_the_last([there[name] for name in path if name in same])
    return {"study": study.name, "rungs": rungs, "others": others}


def _on_coarser_mesh(file: Path, made: str | None, now: Mapping[str, Any]) -> bool:
    """Whether a rung, made with the settings in a file, differs from a model's settings by a coarser mesh alone.

    That is one from which the model's meshes were made.
    """
    lower = read_json(file) if file.exists() else None
    if not lower or made != made_with(lower):  # those of a later run, too
        return False
    meshes, below = (
        {key: settings["model"][key] and MeshSettings.model_validate(settings["model"][key]) for key in KEYS}
        for settings in (now, lower)
    )
    if not are_finer(meshes, below, get_solver(now["solver"]).capabilities.elements):
        return False
    alike = {**lower, "model": {**lower["model"], **{key: now["model"][key] for key in KEYS}}}
    return made_with(alike) == made_with(now)
