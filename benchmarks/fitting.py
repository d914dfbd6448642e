"""Fits inside one process, for the benchmarks: the course of the workflow without Snakemake."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fingerfit.course import next_round
from fingerfit.data import Data
from fingerfit.files import write_text
from fingerfit.fit import REFINED, SEARCH, Fit
from fingerfit.mesh_io import format_mesh
from fingerfit.prepare import make_mesh, prepare
from fingerfit.report import estimate_of
from fingerfit.rounds import Round
from fingerfit.settings import load_settings
from fingerfit.simulate import solve_missing
from fingerfit.study_file import load_study

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / "benchmarks/.cache"


@dataclass
class Fitted:
    """A finished fit.

    Parameters
    ----------
    estimate : dict
        What estimate.json would hold.
    fit : Fit
    last : Round
    seconds : dict
        Wall time of ``propose``, ``simulate``, ``estimate``.
    """

    estimate: dict[str, Any]
    fit: Fit
    last: Round
    seconds: dict[str, float] = field(default_factory=dict)


def fit_of(config: Mapping[str, Any], folder: Path) -> tuple[Fit, Data]:
    """A fit that can begin, its simulations in `folder`; also the data with all pictures, fitted or not."""
    settings = load_settings(config)
    study = load_study(Path(settings.study))
    wanted = {SEARCH: settings.model.mesh, REFINED: settings.model.refined}
    meshes = {name: make_mesh(study, mesh) for name, mesh in wanted.items() if mesh}
    files = {name: folder / f"{name}.inp" for name in meshes}
    for name, mesh in meshes.items():
        write_text(files[name], format_mesh(mesh))
    fitted, everything = (
        prepare(study, meshes[SEARCH], steps, settings.fit.smooth, settings.fit.crop)
        for steps in (settings.fit.steps, None)
    )
    return Fit(settings, fitted, files, folder / "sims"), everything


def fit_study(config: Mapping[str, Any], folder: Path) -> Fitted:
    """Fit the study of a config; simulations go to `folder`."""
    fit, last = fit_of(config, folder)[0], None
    seconds = {"propose": 0.0, "simulate": 0.0, "estimate": 0.0}
    while last is None or last.stop is None:
        start = time.perf_counter()
        last = next_round(fit, last)
        asked = time.perf_counter()
        solve_missing(fit, last.batch, 1)
        seconds["propose"] += asked - start
        seconds["simulate"] += time.perf_counter() - asked
    start = time.perf_counter()
    found = estimate_of(fit, last)
    seconds["estimate"] = time.perf_counter() - start
    return Fitted(found, fit, last, seconds)
