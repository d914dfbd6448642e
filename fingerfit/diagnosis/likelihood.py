"""One likelihood for models that are compared: the same values, weighed by the same covariance.

Each model's own covariance knows how badly its pictures could be registered and what its mesh may be wrong by: the
worse a model, the more it is forgiven. So models are compared by the covariance of one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fingerfit.diagnosis.score_tests import ScoreTest


@dataclass(frozen=True)
class Weighed:
    """What a model leaves, and what it weighs.

    Parameters
    ----------
    kept : ndarray of bool, shape (all,)
        Which values are known.
    vector : ndarray, shape (kept,)
    covariance : ndarray, shape (kept, kept)
    own : ndarray, shape (kept, parameters)
        Slopes of the model's own numbers.
    nuisance : ndarray, shape (kept, nuisances)
    known : (ndarray, ndarray), optional
        As for `ScoreTest`.
    """

    kept: np.ndarray
    vector: np.ndarray
    covariance: np.ndarray
    own: np.ndarray
    nuisance: np.ndarray
    known: tuple[np.ndarray, np.ndarray] | None = None


def misfits(models: Mapping[str, Weighed], reference: str) -> dict[str, float]:
    """Misfits of models, of the values that all of them know, weighed by the covariance of one of them.

    Parameters
    ----------
    models : mapping
        By name.
    reference : str
        The one whose covariance is taken.
    """
    known = np.logical_and.reduce([model.kept for model in models.values()])
    rows = {name: known[model.kept] for name, model in models.items()}
    one, its = models[reference], rows[reference]
    first = ScoreTest(
        one.vector[its], one.covariance[np.ix_(its, its)], one.own[its], one.nuisance[its], known=one.known
    )
    return {
        name: first.of_another(model.vector[rows[name]], model.own[rows[name]], model.known).misfit
        for name, model in models.items()
    }


def fall(before: Weighed, after: Weighed) -> float:
    """By how much the misfit falls from one model to another, both weighed by the covariance of the first."""
    both = misfits({"before": before, "after": after}, "before")
    return both["before"] - both["after"]
