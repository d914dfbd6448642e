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
from fingerfit.mesh.mesh import Mesh
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.settings.config import Settings
from fingerfit.study.data import Data
from fingerfit.study.reader import load_study
from fingerfit.study.several import file_ending
from fingerfit.study.study import Study


def begin(settings: Settings, folder: Path, sims: Path | None = None) -> tuple[InverseProblem, Data | list[Data]]:
    """A fit outside the workflow, its meshes in `folder`, its simulations there or in `sims`; also all data.

    Those of a study with several tests are a list.

    Raises
    ------
    Problems
        With one line for everything that is wrong with the study.
    """
    fitted, files = list[Data](), list[dict[str, Path]]()
    for test in load_study(Path(settings.study)).every:
        mesh = make_mesh(test, settings.model.mesh)
        files.append(write_meshes(settings, test, mesh, folder))
        fitted.append(prepare(test, mesh, settings.fit.steps, settings.fit.smooth, settings.fit.crop))
        check_data(settings, test, fitted[-1])
    problem = problem_of(settings, fitted, files, sims or folder / "sims")
    return problem, measured(problem)


def write_meshes(settings: Settings, test: Study, mesh: Mesh, folder: Path) -> dict[str, Path]:
    """Write the mesh of the search and, where there is one, the finer mesh; returns the files by their roles."""
    meshes = {SEARCH: mesh}
    if settings.finer(test):
        meshes[REFINED] = make_mesh(test, settings.model.refined, finer=True)
    files = {name: folder / f"{name}{file_ending(test.test)}.inp" for name in meshes}
    for name, one in meshes.items():
        write_text(files[name], format_mesh(one))
    return files


def measured(problem: InverseProblem) -> Data | list[Data]:
    """What was measured with all pictures, fitted or not; of a study with several tests a list."""
    how = problem.settings.fit
    found = [prepare(test.study, test.meshes[SEARCH], None, how.smooth, how.crop) for test in problem.every]
    return found[0] if len(found) == 1 else found


def run_fit(problem: InverseProblem, threads: int) -> tuple[Round, int]:
    """All rounds of a fit in this process; the last round, and how many simulations were not known before."""
    last, run = None, 0
    while last is None or last.stop is None:
        last = next_round(problem, last, threads)
        run += solve_missing(problem, last.batch, threads)
    return last, run
