"""One likelihood for models that are compared: the same values, weighed by the same covariance.

Each model's own covariance knows how badly its pictures could be registered and what its mesh may be wrong by: the
worse a model, the more it is forgiven. So models are compared by the covariance of one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fingerfit.diagnosis.score_tests import Known, ScoreTest


@dataclass(frozen=True)
class Left:
    """What a model leaves, as others weigh it.

    Parameters
    ----------
    kept : ndarray of bool, shape (all,)
        Which values are known, and of steps that the fit used.
    vector : ndarray, shape (kept,)
    own : ndarray, shape (kept, parameters)
        Slopes of the model's own numbers.
    known : Known, optional
    """

    kept: np.ndarray
    vector: np.ndarray
    own: np.ndarray
    known: Known | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Weighed(Left):
    """What a model leaves, and what it weighs.

    Parameters
    ----------
    covariance : ndarray, shape (kept, kept)
    nuisance : ndarray, shape (kept, nuisances)
    whole : ndarray, shape (all,), optional
        What it leaves of all that was measured, held-out steps included; NaN where not known.
    """

    covariance: np.ndarray
    nuisance: np.ndarray
    whole: np.ndarray | None = field(default=None, kw_only=True)


def by_likelihood_of(reference: Weighed, models: Mapping[str, Left]) -> dict[str, ScoreTest]:
    """What models leave of the values that all of them and the reference know, weighed by the covariance of that one.

    Parameters
    ----------
    reference : Weighed
        The one whose covariance is taken.
    models : mapping
        By name.
    """
    known = np.logical_and.reduce([reference.kept, *(model.kept for model in models.values())])
    its = known[reference.kept]
    covariance = reference.covariance[np.ix_(its, its)]
    first = ScoreTest(
        reference.vector[its], covariance, reference.own[its], reference.nuisance[its], known=reference.known
    )
    rows = {name: known[model.kept] for name, model in models.items()}
    return {
        name: first.of_another(model.vector[rows[name]], model.own[rows[name]], model.known)
        for name, model in models.items()
    }


def misfits(models: Mapping[str, Weighed], reference: str) -> dict[str, float]:
    """Misfits of models, by name: as `by_likelihood_of` the one with the name `reference`."""
    return {name: one.misfit for name, one in by_likelihood_of(models[reference], models).items()}


def fall(before: Weighed, after: Weighed) -> float:
    """By how much the misfit falls from one model to another, both weighed by the covariance of the first."""
    both = misfits({"before": before, "after": after}, "before")
    return both["before"] - both["after"]
