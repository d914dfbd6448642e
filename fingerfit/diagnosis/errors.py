"""How far a model is off, in units of the noise: on the steps that were fitted, and on those that were held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.fit.problem import InverseProblem
from fingerfit.study.data import Data


def errors(comparison: Comparison) -> tuple[float, float | None]:
    """Error of fitted and of held-out pictures in units of the noise floor; 1 is the noise.

    Without pictures: of the steps' points and forces (or displacements), each in units of its noise.
    """
    if len(comparison.every) > 1:
        return of_tests([errors(test) for test in comparison.every])
    if not len(comparison.data.picture_step):
        return _errors_by_step(comparison)
    ratio = comparison.error / comparison.floor
    fitted = fitted_pictures(comparison.problem, comparison.data)
    held = ratio[~fitted]
    return root_mean_square(ratio[fitted]), root_mean_square(held) if len(held) else None


def of_tests(each: Sequence[tuple[float, float | None]]) -> tuple[float, float | None]:
    """Errors of several tests together: each counts alike, however many values it has."""
    own = np.array(each, dtype=float)
    held = own[np.isfinite(own[:, 1]), 1]
    return root_mean_square(own[:, 0]), root_mean_square(held) if len(held) else None


def fitted_pictures(problem: InverseProblem, data: Data) -> np.ndarray:
    """Which pictures the fit used, bool."""
    return fitted_steps(problem, data)[: len(data.picture_step)]


def fitted_steps(problem: InverseProblem, data: Data) -> np.ndarray:
    """Which fields of displacements, of pictures and of points, are of steps that the fit used, bool."""
    return are_fitted(problem, data, data.entry_step)


def are_fitted(problem: InverseProblem, data: Data, steps: np.ndarray) -> np.ndarray:
    """Whether the fit used steps, by their indices, bool."""
    wanted = problem.settings.fit.steps
    return np.array([wanted is None or int(data.step[step]) in wanted for step in steps], dtype=bool)


def _errors_by_step(comparison: Comparison) -> tuple[float, float | None]:
    residual = comparison.residual
    fitted, by_control = comparison.kept[residual.kept], comparison.nuisance(kept=residual.kept)[:, 0::2]
    noise = residual.covariance + by_control @ by_control.T
    found = []
    for chosen in (fitted, ~fitted):
        own = np.linalg.cholesky(noise[np.ix_(chosen, chosen)])
        found.append(root_mean_square(np.linalg.solve(own, residual.vector[chosen])) if chosen.any() else None)
    return float("nan") if found[0] is None else found[0], found[1]


def root_mean_square(values: np.ndarray) -> float:
    """Of values; not a number without any."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
