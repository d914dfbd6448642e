"""Evidence for an effect: the likelihood integrated over its numbers (Laplace's approximation)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from fingerfit.diagnosis.score_tests import RANK, ScoreTest, per_value
from fingerfit.fit.intervals import NORMAL
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.slopes import evenly, moved
from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.study.several import AT

LIKELY = 0.5
"""Likely size of an effect's number: its standard deviation before anything was measured, as a share of its scale."""
UNSEEN = 1e-6
"""Information on a number, in units of its likely size, that is as good as none."""
ROUNDING = 1e-9
"""Singular value of the information, as a share of the largest one, up to which a direction counts as none."""


@dataclass(frozen=True)
class Information:
    """What is known of an effect's own numbers where a fit has ended.

    Parameters
    ----------
    matrix : ndarray, shape (numbers, numbers)
        The information on them, in units of their likely sizes, once all else that is fitted follows.
    far : ndarray, shape (numbers,)
        How far they are from absent, in the same units; 0 for places.
    optional : ndarray of bool, shape (numbers,)
        Which of them the effect may be there without.
    polynomial : bool
        Whether these are coefficients of a polynomial by rising degree.
    """

    matrix: np.ndarray
    far: np.ndarray
    optional: np.ndarray
    polynomial: bool = False

    def odds(self, fall: float, spread: float) -> float:
        """Logarithm of the odds for the effect, of which not all numbers need be there, against the model without it.

        How many of the optional ones are there is as likely for each count, and so is each choice of as many; each
        further degree of a polynomial is half as likely as the one before. Of these the ones count that `without_least`
        goes through; the others have less evidence, so that the odds are a lower bound.

        Parameters
        ----------
        fall, spread
            As for `log_odds`: with all numbers.
        """
        count, odds = int(self.optional.sum()), list[float]()
        for kept, rise, size in self.without_least():
            there = int((self.optional & kept).sum())
            if self.polynomial:
                prior = np.log(2.0) * min(there, max(count - 1, 0))
            else:
                prior = np.log(max(count, 1)) + np.log(comb(count, there))
            one = log_odds(fall - rise, float(size @ size), self.matrix[np.ix_(kept, kept)], spread)
            odds.append(one - float(prior))
        return float(np.logaddexp.reduce(odds))

    def without_least(self) -> Iterator[tuple[np.ndarray, float, np.ndarray]]:
        """The effect with all of its numbers, then without one optional one after the other, but the last.

        The least one first, of a polynomial that of the highest degree; by the linear model where its fit has ended.

        Yields
        ------
        ndarray of bool, shape (numbers,)
            Which numbers it still has.
        float
            By how much the misfit rises without the others, those that it has and the constants following.
        ndarray, shape (kept,)
            Its numbers then, in units of their likely sizes.
        """
        far, kept = self.far, np.ones(len(self.far), dtype=bool)
        while True:
            among, gone = self.matrix[np.ix_(kept, kept)], self.matrix[np.ix_(kept, ~kept)] @ far[~kept]
            follows = np.linalg.lstsq(among, gone, rcond=ROUNDING)[0]
            rise = float(far[~kept] @ self.matrix[np.ix_(~kept, ~kept)] @ far[~kept] - gone @ follows)
            size = np.where(self.optional[kept], far[kept] + follows, far[kept])
            yield kept.copy(), max(rise, 0.0), size
            left = np.flatnonzero(self.optional[kept])
            if len(left) < 2:
                return
            # what the misfit rises by without a number is its square over its variance
            variance = np.diag(np.linalg.inv(among + UNSEEN * np.eye(len(among))))[left]
            least = left[-1] if self.polynomial else left[np.argmin(size[left] ** 2 / variance)]
            kept[np.flatnonzero(kept)[least]] = False

    def worth(self, spread: float, choices: int = 1) -> float:
        """Misfit that the numbers of a refit must explain to be worth it: what its evidence loses by them.

        They end at their place, so that nothing falls any more; those that the effect does not need cost little.

        Parameters
        ----------
        spread : float
            As for `log_odds`.
        choices : int
            Of how many places that no fit can move the effect's was chosen. Each was as likely before, so that the odds
            for it are divided by their number.
        """
        lost = self.odds(0.0, spread) if len(self.far) else 0.0
        return 2.0 * spread * (float(np.log(choices)) - lost)


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
        As of `Information`.
    spread : float
        Misfit per value, at least 1: where no model explains the data, all weighs less.
    """
    certain = np.eye(len(information)) + information / spread
    return 0.5 * float(fall / spread - far - np.linalg.slogdet(certain)[1])


def information(
    parameters: Sequence[Parameter], values: Mapping[str, float], slopes: np.ndarray, effect: Effect | None
) -> Information:
    """What is known of an effect's numbers where a fit has ended.

    Sizes of an effect are as likely as half of their scale. Its place may be anywhere between its bounds. Sizes of a
    member are optional, but for those of a series.

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
    Information
        On sizes and places of the effect in the order of the parameters, in a study with several tests also on those
        that a test has for itself.
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
    optional = (size > 0) & (effect is not None and not effect.probe and not effect.series)
    return Information(left.T @ left, far, optional, effect is not None and effect.polynomial)


def interval95(
    parameters: tuple[Parameter, ...], values: Mapping[str, float], slopes: np.ndarray, spread: float
) -> dict[str, tuple[float, float]]:
    """95 % intervals of all numbers of a refit, in their units, by slopes where it has ended; within their bounds.

    Parameters
    ----------
    parameters, values, slopes
        As for `information`.
    spread : float
        As for `log_odds`.
    """
    known = slopes.T @ slopes / spread + np.diag(evenly(parameters))
    half = NORMAL * np.sqrt(np.diag(np.linalg.inv(known)))
    low, high = (moved(parameters, values, side * half) for side in (-1.0, 1.0))
    return {name: (low[name], high[name]) for name in low}


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
        own = information(parameters, values, score_test.own, problem.effects[name])
        if len(far := own.far):
            found[name] = own.odds(float(far @ own.matrix @ far), spread)
    return [problem.effects[name] for name in sorted(found, key=found.__getitem__) if found[name] < 0.0]
