"""Errors of the mesh: what they make of the pictures, and whether a still finer mesh explains all that is left.

How large the error of a mesh is expected to be follows from two meshes. Of two coarse ones that is a guess; a third,
finer one tells.
"""

from __future__ import annotations

import numpy as np

from fingerfit.core.progress import begin, tell
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.errors import errors, fitted_pictures, of_tests
from fingerfit.diagnosis.joint import joined
from fingerfit.diagnosis.refit import excess
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import left_over
from fingerfit.fit.problem import REFINED, SEARCH
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.finer import finer_mesh
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver

MOST = 2.0
"""Error of the mesh, at most, as a multiple of what a finer one changes: with the order of a glued corner (decision 3)
it is 1.8 times what half the element size does."""


def errors_but_mesh(comparison: Comparison) -> tuple[float, float | None]:
    """Errors of fitted and of held-out pictures as from `errors`, without what the mesh is expected to make of each.

    No less than the noise in all of them together. Without pictures or a finer mesh that tells, the errors as they
    are.
    """
    if len(comparison.every) > 1:
        return of_tests([errors_but_mesh(test) for test in comparison.every])
    by_mesh, fitted = _in_pictures(comparison), fitted_pictures(comparison.problem, comparison.data)
    if by_mesh is None or not fitted.any():
        return errors(comparison)
    error = comparison.error / comparison.floor

    def left(chosen: np.ndarray) -> float:
        square = np.maximum(error**2 - by_mesh**2, 0.0)[chosen].mean()
        return float(np.sqrt(max(square, min((error[chosen] ** 2).mean(), 1.0))))

    return left(fitted), left(~fitted) if not fitted.all() else None


def _in_pictures(comparison: Comparison) -> np.ndarray | None:
    """What the error of the mesh makes of each picture, in units of the noise floor; None where none tells.

    Of each patch as much as is expected, but no more than it leaves beyond the noise.
    """
    if not len(comparison.data.picture_step) or REFINED not in comparison.problem.meshes:
        return None
    own, other = comparison.prediction.pictures, None
    if comparison.mesh == REFINED:
        other = comparison.pictures(comparison.anchor)
    elif comparison.finer is not None:
        other = comparison.pictures_of(comparison.finer[1], comparison.base.values)
    if other is None:
        return None
    expected = left_over(comparison.problem, comparison.mesh) * (own - other)
    left, residual = comparison.data.measured - own, comparison.residual
    made = np.zeros(len(own))
    for n, (fit, floor) in enumerate(zip(residual.fits, residual.floor, strict=True)):
        pixels, square, beyond = (
            np.bincount(fit.patch, values)
            for values in (None, *(one[n].ravel()[fit.pixel] ** 2 for one in (expected, left)))
        )
        made[n] = np.minimum(square, np.maximum(beyond - pixels * floor**2, 0.0)).sum() / max(pixels.sum(), 1)
    return np.sqrt(made) / comparison.floor


def by_finer_mesh(comparison: Comparison, score_test: ScoreTest, threads: int = 1) -> tuple[float, str, int]:
    """How far the misfit falls by the error of the mesh, the constants following.

    Parameters
    ----------
    comparison : Comparison
        Its study has blocks in the plane, whose meshes are ours to make; the error of others is not looked for.
    score_test : ScoreTest
        Of what the model leaves.
    threads : int

    Returns
    -------
    float
    str
        By what: half the element size, or quadratic elements in place of linear ones.
    int
        Simulations that were not known.
    """
    changes, run, what = list[np.ndarray | None](), 0, ""
    begin("what a finer mesh changes")
    for test in comparison.every:
        change, what, more = _changed(test, threads)
        changes.append(change)
        run += more
    whole = joined(changes)
    if whole is None or not whole.any():
        return 0.0, what, run
    columns = whole[comparison.kept][:, None]
    fall, left = score_test.test(columns, np.zeros(1), np.full(1, MOST)).fall, excess(score_test)
    part = f"explains {min(100, 100 * fall / left):.0f} %" if left > 1.0 else f"lowers the misfit by {fall:.3g}"
    tell(f"{what} {part}")
    return fall, what, run


def _changed(test: Comparison, threads: int) -> tuple[np.ndarray | None, str, int]:
    """What a finer mesh changes, shape (all,); None where that has no solution."""
    problem = test.problem
    settings, study = problem.settings, problem.study
    spec = (settings.model.refined if problem.mesh_of(test.base) == REFINED else None) or settings.model.mesh
    base = test.read(test.base)
    if spec is None or base is None or study.body.width is None:
        return None, "", 0
    finer, what = finer_mesh(spec, get_solver(settings.solver).capabilities.elements)
    mesh = make_mesh(study, finer)
    other = problem.with_mesh(SEARCH, mesh)
    asked = other.ask(test.base.values)
    run = solve_missing(other, [asked], threads)
    if why := problem.lost.why(asked.sim):
        tell(f"{what}: {why}; what that changes is not known")
    outcome = other.outcome(asked)
    if outcome.status != CONVERGED or outcome.steps < len(test.data.step):
        return None, what, run
    return test.reader(mesh, problem.seen(test.base.values)).read(outcome) - base, what, run
