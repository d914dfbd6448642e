"""Fits inside one process, for the benchmarks: the course of the workflow without Snakemake."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fingerfit.course import next_round
from fingerfit.files import write_text
from fingerfit.fit import Fit
from fingerfit.mesh_io import format_mesh
from fingerfit.prepare import make_mesh, prepare
from fingerfit.report import estimate_of
from fingerfit.rounds import Round, Walk
from fingerfit.settings import load_settings
from fingerfit.solvers.registry import get_solver
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


def fit_study(config: Mapping[str, Any], folder: Path) -> Fitted:
    """Fit the study of a config; rounds and simulations go to `folder`."""
    settings = load_settings(config)
    solver, study = get_solver(settings.solver), load_study(Path(settings.study))
    model, seconds = folder / "model", {"propose": 0.0, "simulate": 0.0, "estimate": 0.0}
    wanted = {"search": settings.model.mesh, "refined": settings.model.refined}
    meshes = {name: make_mesh(study, mesh) for name, mesh in wanted.items() if mesh}
    files = {name: model / f"{name}.inp" for name in meshes}
    for name, mesh in meshes.items():
        write_text(files[name], format_mesh(mesh))
    data = prepare(study, meshes["search"], settings.fit.steps, settings.fit.smooth, settings.fit.crop)
    fit, walk, last = Fit(settings, data, files, folder / "sims"), Walk(folder, model), None
    while last is None or last.stop is None:
        start = time.perf_counter()
        last = next_round(fit, last)
        seconds["propose"] += time.perf_counter() - start
        path = model / "rounds" / f"{last.number}.json"
        last.save(path)
        for sim in walk.batch(path):
            place = folder / "sims" / sim
            if not (place / "solution.npz").exists():
                start = time.perf_counter()
                solver.solve(place / "deck.inp", place, 1).save(place / "solution.npz")
                seconds["simulate"] += time.perf_counter() - start
    start = time.perf_counter()
    found = estimate_of(fit, last)
    seconds["estimate"] = time.perf_counter() - start
    return Fitted(found, fit, last, seconds)
