"""How many numbers of a series the data can tell: of smooth modes of stiffness, the longest waves first.

The evidence for the first few of them, integrated over their likely sizes, grows with each that explains more than
chance does, and falls with each that does not (MacKay, Neural Computation 4, 1992). The slopes of the fitted model do
for it: a wave that they show is there, if of another size.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.evidence import LIKELY
from fingerfit.diagnosis.families import SURE
from fingerfit.diagnosis.ranking import Ranked, bounds_of_size, within_bounds
from fingerfit.diagnosis.score_tests import ScoreTest


def evidences(signature: np.ndarray, rest: np.ndarray, likely: np.ndarray) -> np.ndarray:
    """Logarithm of the odds for the first 1, 2, ... numbers of a series against none, shape (numbers,).

    Parameters
    ----------
    signature : ndarray, shape (values, numbers)
        What each number does, in units of the noise and once the constants follow.
    rest : ndarray, shape (values,)
        What there is to be explained, in the same units.
    likely : ndarray, shape (numbers,)
        Standard deviations of the numbers before anything was measured.

    >>> seen = np.eye(3)[:, :2]
    >>> evidences(seen, np.array([9.0, 0.0, 0.0]), np.array([5.0, 5.0])).argmax() + 1
    np.int64(1)
    """
    columns = signature * likely
    normal, told = np.eye(columns.shape[1]) + columns.T @ columns, columns.T @ rest
    found = []
    for count in range(1, len(told) + 1):
        part, right = normal[:count, :count], told[:count]
        found.append(0.5 * float(right @ np.linalg.solve(part, right) - np.linalg.slogdet(part)[1]))
    return np.array(found)


def cut(score_test: ScoreTest, one: Ranked) -> Ranked:
    """A candidate whose numbers are a series with as many of them as there is evidence for; others as they are.

    Where nothing explains the data, the noise counts as what the whole series leaves.
    """
    effect, place = one.candidate.effect, one.candidate.place
    if not effect.series:
        return one
    spread = max(1.0, (score_test.misfit - one.finding.fall) / max(score_test.freedom, 1))
    likely = np.array([LIKELY * p.scale for p in effect.parameters])
    signature, rest = (values / np.sqrt(spread) for values in (score_test.signature(one.columns), score_test.rest))
    odds = evidences(signature, rest, likely)
    # the fewest that are not surely worse than the best: each one more costs simulations in every move of a refit
    count = int((odds > odds.max() - SURE).argmax()) + 1
    part = effect.first(count)
    few = replace(
        one.candidate,
        effect=part,
        place={**place, effect.key(effect.series): float(count)},
        asked=one.candidate.asked[:count],
    )
    columns = one.columns[:, :count]
    return replace(one, candidate=few, columns=columns, finding=within_bounds(score_test, part, columns))


def of_held_out(one: Ranked) -> np.ndarray:
    """Which numbers of a candidate, bool, act on held-out pictures alone: of a series with some for each picture."""
    effect = one.candidate.effect
    if not (effect.series and effect.observes_alone):
        return np.zeros(len(effect.parameters), dtype=bool)
    return np.asarray(~one.columns.any(axis=0))


def with_held_out(comparison: Comparison, one: Ranked) -> Ranked:
    """A series with a number for each picture: those of held-out pictures by least squares on these pictures.

    Where such a picture lies, or how bright it is, no other one tells. It says nothing of the body and chooses nothing:
    the fit, which does not see that picture, leaves its number where it is.
    """
    effect, unseen = one.candidate.effect, of_held_out(one)
    if not unseen.any():
        return one
    columns = np.stack([comparison.observed(effect, one.candidate.place, p.name) for p in effect.parameters], axis=1)
    size = np.where(unseen, 0.0, one.finding.size)
    # the constants as they are beside the numbers of the fitted pictures
    follow = comparison.score_test.follow(comparison.vector - one.columns @ size)
    own = np.stack([comparison.column(p) for p in comparison.problem.settings.parameters()], axis=1)
    left = comparison.whole - columns @ size + own @ follow
    rows = np.isfinite(left) & columns[:, unseen].any(axis=1)
    found = np.linalg.lstsq(columns[rows][:, unseen], left[rows], rcond=None)[0]
    size[unseen] = np.clip(found, *bounds_of_size(effect)[:, unseen])
    return replace(one, finding=replace(one.finding, size=size))
