"""Evidence for an effect: the likelihood integrated over its numbers (Laplace's approximation)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.fit.problem import InverseProblem
from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.study.several import AT

LIKELY = 0.5
"""Likely size of an effect's number: its standard deviation before anything was measured, as a share of its scale."""


def log_odds(fall: float, far: float, information: np.ndarray, spread: float) -> float:
    """Logarithm of the odds for a model with an effect against the one without it (MacKay 1992).

    The numbers of the effect have a normal prior of their likely size; constants have the same prior in both.

    Parameters
    ----------
    fall : float
        Of the misfit, by the effect.
    far : float
        Sum of squares of its numbers, in units of their likely sizes.
    information : ndarray, shape (numbers, numbers)
        As from `information`.
    spread : float
        Misfit per value, at least 1: where no model explains the data, all weighs less.
    """
    certain = np.eye(len(information)) + information / spread
    return 0.5 * float(fall / spread - far - np.linalg.slogdet(certain)[1])


def information(
    parameters: Sequence[Parameter], values: Mapping[str, float], slopes: np.ndarray, effect: Effect | None
) -> tuple[np.ndarray, np.ndarray]:
    """Information on an effect's numbers in units of their likely sizes, and how far these are from absent.

    Sizes of an effect are as likely as half of their scale. Its place may be anywhere between its bounds.

    Parameters
    ----------
    parameters : sequence of Parameter
        All that a model fits.
    values : mapping
        Where.
    slopes : ndarray, shape (values, parameters)
        In units of the noise, per scale of each parameter.
    effect : Effect or None

    Returns
    -------
    ndarray, shape (numbers, numbers)
        Once all else that is fitted follows; sizes and places of the effect in the order of the parameters, in a study
        with several tests also those that a test has for itself.
    ndarray, shape (numbers,)
        0 for places.
    """
    absent = effect.null() if effect else {}
    places = [effect.key(name) for name in effect.refine] if effect else []
    names = [p.name.partition(AT)[0] for p in parameters]
    own = [n for n, name in enumerate(names) if name in absent or name in places]
    numbers = [(parameters[n], absent.get(names[n])) for n in own]
    likely = np.array(
        [LIKELY if null is not None else (p.upper - p.lower) / p.scale / np.sqrt(12.0) for p, null in numbers]
    )
    others = np.delete(slopes, own, axis=1)
    basis, sizes, _ = np.linalg.svd(others, full_matrices=False)
    basis = basis[:, sizes > 1e-6 * sizes.max(initial=0.0)]
    left = (slopes[:, own] - basis @ (basis.T @ slopes[:, own])) * likely
    far = [(values[p.name] - null) / p.scale / LIKELY if null is not None else 0.0 for p, null in numbers]
    return left.T @ left, np.array(far)


def spare(problem: InverseProblem, score_test: ScoreTest, values: Mapping[str, float]) -> list[Effect]:
    """Effects of a model whose evidence beside its other effects speaks against them, the least likely first.

    By slopes where the fit has ended: what the misfit would rise by without an effect, all else following. The last
    effect is not asked for: the model without it has been diagnosed. Nor are effects without numbers.

    Parameters
    ----------
    problem : InverseProblem
    score_test : ScoreTest
        Of the model.
    values : mapping
        Where its fit has ended.
    """
    parameters, spread = problem.settings.parameters(), max(1.0, score_test.misfit / max(score_test.freedom, 1))
    found = dict[str, float]()
    for name in list(problem.settings.model.effects)[:-1]:
        known, far = information(parameters, values, score_test.own, problem.effects[name])
        if len(far):
            found[name] = log_odds(float(far @ known @ far), float(far @ far), known, spread)
    return [problem.effects[name] for name in sorted(found, key=found.__getitem__) if found[name] < 0.0]
