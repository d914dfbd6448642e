"""How far constants may be off where the model leaves more than the noise: intervals take the model for right.

Two things tell. Models with one effect more that explain about as much put the constants elsewhere. And fits to parts
of the data do: each time one part of the body, or of the forces, is left out (delete-group jackknife: Shao and Wu,
Annals of Statistics 17, 1989). What the constants take up without a trace neither of them sees.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import Refit, chance
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.worth import odds_after
from fingerfit.fit.slopes import coordinates, moved
from fingerfit.model.parameters import Parameter

COMPARABLE = 0.5
"""Share of the best refit's fall of the misfit from which a refit says what the constants may be. A choice."""
EXCLUDED = 0.05
"""Odds below which an effect is excluded, as surely as a 95 % interval excludes what is outside of it."""
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
    best = max((refit.fall for refit in refits), default=0.0)
    elsewhere = [refit.values for refit in refits if refit.fall > 0 and refit.fall >= COMPARABLE * best]
    spread, count = left_out(comparison)
    # one part alone has no spread between parts
    further = np.sqrt(excess) * stdtrit(count - 1, 0.975) * spread if count > 1 else np.zeros_like(spread)
    return _reaching(comparison.problem.settings.parameters(), elsewhere, estimate, further)


def not_excluded(
    ranking: Sequence[Ranked], score_test: ScoreTest, refits: Mapping[str, Refit], tests: int
) -> list[Ranked]:
    """Effects that an adequate model may lack: their odds, after so many tests, are above `EXCLUDED`.

    Parameters
    ----------
    ranking : sequence of Ranked
        Tested effects; those that the first pass has refitted to a minimum count.
    score_test : ScoreTest
        Of the model.
    refits : mapping
        Of the second pass, by name of the effect.
    tests : int
    """

    def likely(one: Ranked) -> bool:
        refit = refits.get(one.candidate.effect.name)
        return odds_after(one, score_test, ranking, tests, refit) > float(np.log(EXCLUDED))

    return [one for one in ranking if one.refitted and one.refitted.converged and likely(one)]


def with_effects(
    parameters: tuple[Parameter, ...],
    effects: Sequence[Ranked],
    refits: Mapping[str, Refit],
    estimate: Mapping[str, Mapping[str, Any]],
) -> dict[str, tuple[float, float]]:
    """Ends of the constants' intervals if one of these effects may be there, or none; nothing without effects.

    Parameters
    ----------
    parameters : tuple of Parameter
        Of the model without them.
    effects : sequence of Ranked
        As from `not_excluded`.
    refits : mapping
        Of the second pass, by name of the effect; the first pass speaks for the others.
    estimate : mapping
        As for `ranges`.
    """
    models = [
        refits[name].values if (name := one.candidate.effect.name) in refits else one.refitted.values
        for one in effects
        if one.refitted
    ]
    return _reaching(parameters, models, estimate) if models else {}


def _reaching(
    parameters: tuple[Parameter, ...],
    models: Sequence[Mapping[str, float]],
    estimate: Mapping[str, Mapping[str, Any]],
    further: np.ndarray | float = 0.0,
) -> dict[str, tuple[float, float]]:
    """From the lowest to the highest constant of models, and beyond both ends the interval joined with what is further.

    `further`, shape (parameters,), is in search coordinates.
    """
    values = {p.name: estimate[p.name]["value"] for p in parameters}
    at = coordinates(parameters, values)
    apart = np.stack([at, *(coordinates(parameters, {**values, **model}) for model in models)]) - at
    ends = [
        coordinates(parameters, {p.name: estimate[p.name]["interval95"][side] for p in parameters}) - at
        for side in (0, 1)
    ]
    low = apart.min(axis=0) - np.hypot(ends[0], further)
    high = apart.max(axis=0) + np.hypot(ends[1], further)
    lowest, highest = moved(parameters, values, low), moved(parameters, values, high)
    return {p.name: (lowest[p.name], highest[p.name]) for p in parameters}


def excess_of(comparison: Comparison) -> float:
    """Share of the misfit beyond what chance leaves but once in a hundred times, 0 to 1."""
    found = comparison.score_test
    return max(0.0, 1.0 - chance(found.freedom) / found.misfit) if found.misfit > 0 else 0.0


def left_out(comparison: Comparison) -> tuple[np.ndarray, int]:
    """Standard deviations of the constants by leaving out one part of the data after the other; how many parts.

    Returns
    -------
    spread : ndarray, shape (parameters,)
        In search coordinates, by the slopes at the estimate.
    count : int
    """
    nuisance, own, vector = comparison.nuisance(), comparison.own(), comparison.vector
    covariance, parts = comparison.covariance + nuisance @ nuisance.T, parts_of_data(comparison)
    known = comparison.known
    found = []
    for part in np.unique(parts):
        kept = parts != part
        root = np.linalg.cholesky(covariance[np.ix_(kept, kept)])
        columns = np.concatenate([np.linalg.solve(root, own[kept]), known.slopes])
        rest = np.append(np.linalg.solve(root, vector[kept]), known.left)
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
    return np.asarray(whole[comparison.kept])
