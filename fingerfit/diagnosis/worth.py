"""Which effects are worth a refit: beyond chance, seen by the data, likely, and not far too small."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fingerfit.diagnosis.families import SURE, nominated
from fingerfit.diagnosis.ranking import Ranked, spread_of
from fingerfit.diagnosis.refit import LEVEL, Refit, excess, explains, loud
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.model.effect import NUMERICS

SEEN, SEEN_OF_FEW = 0.02, 0.002
"""Share of its signal that the constants cannot imitate, from which an effect is refitted; of few values, as of forces
alone, all signals are alike, and refits, which decide, cost little."""
FEW = 50
"""Number of values up to which they are few."""
LIKELY_ENOUGH = 3.0
"""Logarithm of the odds from which something is missing in a model that explains the data: 20 to 1, as for a 95 %
interval."""
TRIED = 4
"""Effects that are refitted at once."""
LARGEST = 0.5
"""Share of the squared error beyond the noise, or of a misfit beyond chance, from which a part is the largest, whatever
the others are."""
LARGE = 0.3
"""Share of what the best effect explains, or slopes promise, from which one may turn out to be the best. A choice."""
FALLS_SHORT = 0.5
"""Share of `LARGEST` that an effect must explain in the first pass to be refitted, where the pictures are near enough
for it to see all: its refit may explain twice as much. A choice, made after single cases (decision 50)."""


def threshold(score_test: ScoreTest, ranking: Sequence[Ranked], tests: int, columns: int = 1) -> float:
    """Fall of the misfit beyond chance, for effects of as many parameters."""
    from scipy.special import chdtri

    return float(chdtri(columns, LEVEL / max(tests, 1))) * spread_of(score_test.misfit, ranking, score_test.freedom)


def to_refit(
    score_test: ScoreTest, ranking: Sequence[Ranked], tests: int, known: Mapping[str, Refit] | None = None
) -> list[Ranked]:
    """Effects that are worth a refit: beyond chance, seen by the data, among the best, no matter of the solver's.

    Where some are `known` and did not explain it, the next best: far from the truth predictions from slopes rank
    roughly. Those that only slopes speak for take no place of those that the first pass has refitted. Members of the
    best one's family that are as likely in the first pass come beside them. None where the model explains the data and
    the first pass is sure of no other one.
    """
    found = worth_a_refit(score_test, ranking, tests, known)
    spread = spread_of(score_test.misfit, ranking, score_test.freedom)
    parts = [[one for one in found if bool(one.refitted) == refitted] for refitted in (True, False)]
    if known:
        left = [[one for one in part if one.candidate.effect.name not in known] for part in parts]
    else:
        # what slopes predict of the brightness is no measure for refits, which explain displacements alone
        most = [max((one.finding.fall for one in part), default=0.0) for part in (parts[0], found)]
        left = [
            [one for one in part if one.finding.fall > LARGE * fall] for part, fall in zip(parts, most, strict=True)
        ]
    chosen = [one for part in left for one in part[:TRIED]]
    chosen += [one for part in left for one in part[TRIED:] if _tied(one, part[0], spread)]
    return [one for one in found if any(one is other for other in chosen)]


def worth_a_refit(
    score_test: ScoreTest, ranking: Sequence[Ranked], tests: int, known: Mapping[str, Refit] | None = None
) -> list[Ranked]:
    """Effects that are beyond chance, seen by the data, and no matter of the solver's, however many these are.

    None where the model explains the data and the first pass is sure of no other one; some may be `known`.
    """
    if explains(score_test) and not _sure(score_test, ranking, tests):
        return []
    return [
        one
        for one in nominated(score_test, ranking, {name: refit.earned for name, refit in (known or {}).items()})
        if one.candidate.effect.acts != NUMERICS
        and one.finding.fall > threshold(score_test, ranking, tests, one.columns.shape[1])
        and one.finding.visible > _seen(score_test)
    ]


def _tied(one: Ranked, best: Ranked, spread: float) -> bool:
    """Whether the first pass cannot tell an effect from the best one, which is of the same family."""
    kin = one.candidate.effect.family == best.candidate.effect.family
    return kin and best.odds(spread) - one.odds(spread) < SURE


def _sure(score_test: ScoreTest, ranking: Sequence[Ranked], tests: int) -> bool:
    """Whether an effect is `LIKELY_ENOUGH` after so many tests, or their odds are not known from a first pass."""
    known = [one for one in ranking if one.refitted]
    return not known or odds_of_any(known, score_test, ranking, tests) >= LIKELY_ENOUGH


def odds_after(
    one: Ranked, score_test: ScoreTest, ranking: Sequence[Ranked], tests: int, refit: Refit | None = None
) -> float:
    """Logarithm of the odds for an effect, against the model without it, after so many tests.

    Before them, each had an equal share of what speaks for any. By the first pass, or by a refit that explains less.
    """
    from numpy import log

    spread = spread_of(score_test.misfit, ranking, score_test.freedom)
    return one.odds(spread, refit.earned if refit else None) - float(log(max(tests, 1)))


def odds_of_any(
    those: Sequence[Ranked],
    score_test: ScoreTest,
    ranking: Sequence[Ranked],
    tests: int,
    refits: Mapping[str, Refit] | None = None,
) -> float:
    """Logarithm of the odds that one of several effects is there, whichever it is: the sum of their odds."""
    from numpy import logaddexp

    known = refits or {}
    odds = [odds_after(one, score_test, ranking, tests, known.get(one.candidate.effect.name)) for one in those]
    return float(logaddexp.reduce(odds))


def _seen(score_test: ScoreTest) -> float:
    return SEEN if score_test.freedom > FEW else SEEN_OF_FEW


def unseen(score_test: ScoreTest, ranking: Sequence[Ranked]) -> list[Ranked]:
    """Effects that may be there without a trace: the model's own constants imitate them."""
    found = [one for one in ranking if one.candidate.effect.acts != NUMERICS and not one.candidate.effect.probe]
    return [one for one in found if one.finding.visible <= _seen(score_test) and one.finding.signal > 0]


def too_small(score_test: ScoreTest, ranking: Sequence[Ranked], error: float) -> bool:
    """Whether a model leaves more than the noise, and no effect of the first pass explains nearly enough of it.

    Parameters
    ----------
    score_test : ScoreTest
    ranking : sequence of Ranked
    error : float
        Of the model on the fitted steps, in units of the noise floor: where it is `loud` the first pass does not see
        all.
    """
    tried = [one for one in ranking if one.refitted]
    return bool(tried) and all(falls_short(one, score_test, error) for one in tried)


def falls_short(one: Ranked, score_test: ScoreTest, error: float) -> bool:
    """Whether the first pass sees all that a model leaves, which is more than the noise, and an effect explains so
    little of it there that no refit would make it the largest part. Parameters as for `too_small`.
    """
    sees_all = not loud(error, score_test.freedom) and not explains(score_test)
    return sees_all and one.refitted is not None and one.refitted.share < FALLS_SHORT * LARGEST


def most_of(ranking: Sequence[Ranked]) -> float:
    """Largest fall of the misfit by an effect that the first pass refitted; 0 where it refitted none."""
    return max((one.finding.fall for one in ranking if one.refitted), default=0.0)


def blamed_on_mesh(by_mesh: float, score_test: ScoreTest, ranking: Sequence[Ranked]) -> bool:
    """Whether the mesh comes before all effects: most of what is left is its error, or no effect explains as much.

    Its error is known to be there, since a finer mesh shows it, while an effect may imitate it. Where it is a small
    part of what is left, something else is missing.

    Parameters
    ----------
    by_mesh : float
        Fall of the misfit by a finer mesh.
    score_test : ScoreTest
    ranking : sequence of Ranked
    """
    left, most = excess(score_test), most_of(ranking)
    if explains(score_test):
        return by_mesh > LARGEST * max(left, most)
    return by_mesh > LARGEST * left or (by_mesh > FALLS_SHORT * LARGEST * left and by_mesh >= most)
