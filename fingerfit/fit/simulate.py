"""Fits in one process."""

from __future__ import annotations

from pathlib import Path

from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.check import check_data
from fingerfit.fit.course import next_round
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.joint import problem_of
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.settings.config import Settings
from fingerfit.study.data import Data
from fingerfit.study.reader import load_study


def begin(settings: Settings, folder: Path) -> tuple[InverseProblem, Data | list[Data]]:
    """A fit outside the workflow, its meshes and simulations in `folder`; also the data with all pictures.

    Those of a study with several tests are a list.

    Raises
    ------
    Problems
        With one line for everything that is wrong with the study.
    """
    study = load_study(Path(settings.study))
    fitted, everything, files = list[Data](), list[Data](), list[dict[str, Path]]()
    for test in study.every:
        meshes = {SEARCH: make_mesh(test, settings.model.mesh)}
        if settings.model.refined or test.body.refined:
            meshes[REFINED] = make_mesh(test, settings.model.refined, finer=True)
        files.append({name: folder / f"{name}{'-' * bool(test.test)}{test.test}.inp" for name in meshes})
        for name, mesh in meshes.items():
            write_text(files[-1][name], format_mesh(mesh))
        for steps, kept in ((settings.fit.steps, fitted), (None, everything)):
            kept.append(prepare(test, meshes[SEARCH], steps, settings.fit.smooth, settings.fit.crop))
        check_data(settings, test, fitted[-1])
    return problem_of(settings, fitted, files, folder / "sims"), everything[0] if len(everything) == 1 else everything


def run_fit(problem: InverseProblem, threads: int) -> tuple[Round, int]:
    """All rounds of a fit in this process; the last round, and how many simulations were not known before."""
    last, run = None, 0
    while last is None or last.stop is None:
        last = next_round(problem, last, threads)
        run += solve_missing(problem, last.batch, threads)
    return last, run
