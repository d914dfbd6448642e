"""Evidence for an effect: the likelihood integrated over its numbers (Laplace's approximation)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import comb

import numpy as np

from fingerfit.diagnosis.score_tests import RANK, ScoreTest, per_value
from fingerfit.fit.problem import InverseProblem
from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.study.several import AT

LIKELY = 0.5
"""Likely size of an effect's number: its standard deviation before anything was measured, as a share of its scale."""
UNSEEN = 1e-6
"""Information on a number, in units of its likely size, that is as good as none."""
ROUNDING = 1e-9
"""Singular value of the information, as a share of the largest one, up to which a direction counts as none."""


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


def log_odds_of_some(
    fall: float, far: np.ndarray, information: np.ndarray, spread: float, optional: np.ndarray
) -> float:
    """Logarithm of the odds for an effect of which not all numbers need be there, against the model without it.

    How many of the optional ones are there is as likely for each count, and so is each choice of as many. Of these the
    ones count that `without_least` goes through; the others have less evidence, so that the odds are a lower bound.

    Parameters
    ----------
    fall, information, spread
        As for `log_odds`: with all numbers.
    far, optional
        As from `information`.
    """
    count, odds = int(optional.sum()), list[float]()
    for kept, rise, moved in without_least(far, information, optional):
        prior = np.log(max(count, 1)) + np.log(comb(count, int((optional & kept).sum())))
        one = log_odds(fall - rise, float(moved @ moved), information[np.ix_(kept, kept)], spread)
        odds.append(one - float(prior))
    return float(np.logaddexp.reduce(odds))


def without_least(
    far: np.ndarray, information: np.ndarray, optional: np.ndarray
) -> Iterator[tuple[np.ndarray, float, np.ndarray]]:
    """An effect with all of its numbers, then without one optional one after the other, the least first, but the last.

    By the linear model where its fit has ended. Parameters as for `log_odds_of_some`.

    Yields
    ------
    ndarray of bool, shape (numbers,)
        Which numbers it still has.
    float
        By how much the misfit rises without the others, those that it has and the constants following.
    ndarray, shape (kept,)
        Its numbers then, in units of their likely sizes.
    """
    kept = np.ones(len(far), dtype=bool)
    while True:
        among, gone = information[np.ix_(kept, kept)], information[np.ix_(kept, ~kept)] @ far[~kept]
        follows = np.linalg.lstsq(among, gone, rcond=ROUNDING)[0]
        rise = float(far[~kept] @ information[np.ix_(~kept, ~kept)] @ far[~kept] - gone @ follows)
        moved = np.where(optional[kept], far[kept] + follows, far[kept])
        yield kept.copy(), max(rise, 0.0), moved
        left = np.flatnonzero(optional[kept])
        if len(left) < 2:
            return
        # what the misfit rises by without a number is its square over its variance
        variance = np.diag(np.linalg.inv(among + UNSEEN * np.eye(len(among))))[left]
        least = left[np.argmin(moved[left] ** 2 / variance)]
        kept[np.flatnonzero(kept)[least]] = False


def worth(far: np.ndarray, information: np.ndarray, spread: float, optional: np.ndarray, choices: int = 1) -> float:
    """Misfit that the numbers of a refit must explain to be worth it: what its evidence loses by them.

    They end at their place, so that nothing falls any more; those that the effect does not need cost little.

    Parameters
    ----------
    far, information, spread, optional
        As for `log_odds_of_some`.
    choices : int
        Of how many places that no fit can move the effect's was chosen. Each was as likely before, so that the odds for
        it are divided by their number.
    """
    lost = log_odds_of_some(0.0, far, information, spread, optional) if len(far) else 0.0
    return 2.0 * spread * (float(np.log(choices)) - lost)


def information(
    parameters: Sequence[Parameter], values: Mapping[str, float], slopes: np.ndarray, effect: Effect | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    ndarray of bool, shape (numbers,)
        Which of them an effect may be there without: sizes of a member, but for those of a series.
    """
    absent = effect.null() if effect else {}
    scale = {effect.key(p.name): p.scale for p in effect.parameters} if effect else {}
    places = [effect.key(name) for name in effect.refine] if effect else []
    names = [p.name.partition(AT)[0] for p in parameters]
    own = [n for n, name in enumerate(names) if name in absent or name in places]
    whole = np.array([parameters[n].upper - parameters[n].lower for n in own])
    size = np.array([LIKELY * scale[names[n]] if names[n] in absent else 0.0 for n in own])
    likely = np.where(size > 0, size, whole / np.sqrt(12.0)) / np.array([parameters[n].scale for n in own])
    others = np.delete(slopes, own, axis=1)
    basis, sizes, _ = np.linalg.svd(others, full_matrices=False)
    basis = basis[:, sizes > RANK * sizes.max(initial=0.0)]
    left = (slopes[:, own] - basis @ (basis.T @ slopes[:, own])) * likely
    away = np.array([values[parameters[n].name] - absent.get(names[n], np.nan) for n in own])
    far = np.divide(away, size, out=np.zeros(len(own)), where=size > 0)
    return left.T @ left, far, (size > 0) & (effect is not None and not effect.probe and not effect.series)


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
    parameters, spread = problem.settings.parameters(), per_value(score_test.misfit, score_test.freedom)
    found = dict[str, float]()
    for name in list(problem.settings.model.effects)[:-1]:
        known, far, _ = information(parameters, values, score_test.own, problem.effects[name])
        if len(far):
            found[name] = log_odds(float(far @ known @ far), float(far @ far), known, spread)
    return [problem.effects[name] for name in sorted(found, key=found.__getitem__) if found[name] < 0.0]
