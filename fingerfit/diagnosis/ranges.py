"""How far constants may be off where the model leaves more than the noise: intervals take the model for right.

Two things tell. Models with one effect more that explain about as much put the constants elsewhere. And fits to parts
of the data do: each time one part of the body, or of the forces, is left out (delete-group jackknife: Shao and Wu,
Annals of Statistics 17, 1989). What the constants take up without a trace neither of them sees.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.refit import LEVEL, Refit
from fingerfit.fit.slopes import coordinates, moved

COMPARABLE = 0.5
"""Share of the best refit's fall of the misfit from which a refit says what the constants may be. A choice."""
PARTS = 4
"""Parts of the forces, each of steps that follow each other: as many as the body has in the plane. A choice."""
UNSEEN = 1e-8
"""Curvature, as a share of the steepest, below which a part of the data says nothing of a constant. A choice."""


def ranges(
    comparison: Comparison, refits: Collection[Refit], estimate: Mapping[str, Mapping[str, Any]]
) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each constant, in its unit; nothing where the model leaves no more than the noise.

    Parameters
    ----------
    comparison : Comparison
    refits : collection of Refit
        Models with one effect more.
    estimate : mapping
        Entries of estimate.json by constant; their intervals take the model for right.
    """
    from scipy.special import stdtrit

    excess = excess_of(comparison)
    if not excess:
        return {}
    parameters = comparison.problem.settings.parameters()
    values = {p.name: estimate[p.name]["value"] for p in parameters}
    at = coordinates(parameters, values)
    best = max((refit.fall for refit in refits), default=0.0)
    elsewhere = [refit for refit in refits if refit.fall > 0 and refit.fall >= COMPARABLE * best]
    models = np.stack([at, *(coordinates(parameters, {**values, **refit.values}) for refit in elsewhere)]) - at
    ends = [
        coordinates(parameters, {p.name: estimate[p.name]["interval95"][side] for p in parameters}) - at
        for side in (0, 1)
    ]
    spread, count = left_out(comparison)
    further = np.sqrt(excess) * stdtrit(count - 1, 0.975) * spread
    low = models.min(axis=0) - np.hypot(ends[0], further)
    high = models.max(axis=0) + np.hypot(ends[1], further)
    lowest, highest = moved(parameters, values, low), moved(parameters, values, high)
    return {p.name: (lowest[p.name], highest[p.name]) for p in parameters}


def excess_of(comparison: Comparison) -> float:
    """Share of the misfit beyond what chance leaves but once in a hundred times, 0 to 1."""
    from scipy.special import chdtri

    found = comparison.score_test
    return float(max(0.0, 1.0 - chdtri(found.freedom, LEVEL) / found.misfit)) if found.misfit > 0 else 0.0


def left_out(comparison: Comparison) -> tuple[np.ndarray, int]:
    """Standard deviations of the constants by leaving out one part of the data after the other; how many parts.

    Returns
    -------
    spread : ndarray, shape (parameters,)
        In search coordinates, by the slopes at the estimate.
    count : int
    """
    nuisance, own, vector = comparison.nuisance(), comparison.own(), comparison.residual.vector
    covariance, parts = comparison.covariance + nuisance @ nuisance.T, parts_of_data(comparison)
    before, known = comparison.known
    found = []
    for part in np.unique(parts):
        kept = parts != part
        root = np.linalg.cholesky(covariance[np.ix_(kept, kept)])
        columns = np.concatenate([np.linalg.solve(root, own[kept]), known])
        rest = np.append(np.linalg.solve(root, vector[kept]), before)
        found.append(np.linalg.pinv(columns.T @ columns, rcond=UNSEEN, hermitian=True) @ (columns.T @ rest))
    count = len(found)
    return np.sqrt((count - 1) * np.var(found, axis=0)), count


def parts_of_data(comparison: Comparison) -> np.ndarray:
    """Which part of the data each value belongs to: an end of the body along each axis, or steps of the forces."""
    found, first = [], 0
    for test in comparison.every:
        own = _parts(test)
        found.append(own + first)
        first += int(own.max(initial=-1)) + 1
    return np.concatenate(found)


def _parts(comparison: Comparison) -> np.ndarray:
    centre, shape = comparison.patches.centre, comparison.residual.value.shape
    beyond = centre > np.median(centre, axis=0)
    corner = beyond @ (2 ** np.arange(centre.shape[1]))
    data = comparison.data
    later = 2 ** centre.shape[1] + data.response_step * PARTS // max(len(data.step), 1)
    whole = np.concatenate([np.broadcast_to(corner[None, :, None], shape).ravel(), later])
    return np.asarray(whole[comparison.residual.kept])
