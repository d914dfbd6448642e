"""From tests and refits to one of four answers: missing, indistinguishable, adequate, unexplained."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fingerfit.diagnose import Look, alike
from fingerfit.effects.contract import NUMERICS
from fingerfit.judge import Judge

LEVEL = 0.01
"""Probability of a false alarm in all tests together."""
GOOD = 1.25
"""Misfit per degree of freedom up to which a model is adequate, unless chance alone allows more."""
ENOUGH = 0.75
"""Share of the excess misfit that an answer must explain."""
RIVAL = 12.0
"""Difference of misfit below which two refits cannot be told apart: odds of 400 to 1."""
NEAR = 0.03
"""The same for two refits that are both adequate, per degree of freedom: what an error of the mesh may decide."""
SEEN, SEEN_OF_FEW = 0.02, 0.002
"""Share of its signal that the constants cannot imitate, from which an effect is refitted; of few values, as of forces
alone, all signals are alike, and refits, which decide, cost little."""
FEW = 50
LOUD = 1.5
"""Error in units of the noise floor beyond which no model is adequate."""
TRIED = 3
"""Effects that are refitted at once."""


@dataclass(frozen=True)
class Refit:
    """A model with one effect more, fitted.

    Parameters
    ----------
    misfit : float
    freedom : int
    fitted, held_out : float or None
        Error in units of the noise floor.
    values : mapping
        Constants and numbers of the effect.
    """

    misfit: float
    freedom: int
    fitted: float
    held_out: float | None
    values: Mapping[str, float]


@dataclass(frozen=True)
class Verdict:
    """The answer.

    Parameters
    ----------
    kind : str
        ``missing``, ``indistinguishable``, ``adequate`` or ``unexplained``.
    effects : tuple of str
        Blamed effects, the best first.
    sentence : str
        For a person.
    threshold : float
        Fall of the misfit that an effect of one parameter needs.
    """

    kind: str
    effects: tuple[str, ...]
    sentence: str
    threshold: float


def threshold(judge: Judge, looks: Sequence[Look], tests: int, columns: int = 1) -> float:
    """Fall of the misfit beyond chance, for effects of as many parameters."""
    from scipy.special import chdtri

    best = max((look.finding.fall for look in looks), default=0.0)
    spread = max(1.0, (judge.misfit - best) / max(judge.freedom, 1))
    return float(chdtri(columns, LEVEL / max(tests, 1))) * spread


def to_refit(judge: Judge, looks: Sequence[Look], tests: int, known: Collection[str] = ()) -> list[Look]:
    """Effects that are worth a refit: beyond chance, seen by the data, among the best, no matter of the solver's.

    Where some are `known` and did not explain it, the next best: far from the truth predictions from slopes rank
    roughly.
    """
    found = [
        look
        for look in looks
        if look.suspect.effect.acts != NUMERICS
        and look.finding.fall > threshold(judge, looks, tests, look.columns.shape[1])
        and look.finding.visible > (SEEN if judge.freedom > FEW else SEEN_OF_FEW)
    ]
    if known:
        return [look for look in found if look.suspect.effect.name not in known][:TRIED]
    return [look for look in found if look.finding.fall > 0.3 * found[0].finding.fall][:TRIED]


def good(freedom: int) -> float:
    """Misfit per degree of freedom up to which a model is adequate: with few values chance alone goes beyond `GOOD`.

    >>> good(1000), round(good(19), 2)
    (1.25, 1.9)
    """
    from scipy.special import chdtri

    return max(GOOD, float(chdtri(max(freedom, 1), LEVEL)) / max(freedom, 1))


def decide(judge: Judge, looks: Sequence[Look], refits: Mapping[str, Refit], tests: int) -> Verdict:
    """The verdict on a model.

    Parameters
    ----------
    judge : Judge
        Of the model without any of them.
    looks : sequence of Look
        Tested effects, the best first.
    refits : mapping
        Refits of the best ones, by name of the effect.
    tests : int
        Number of tests that were made.
    """
    if judge.freedom < 1:
        text = "there are as many constants as measured values: nothing can be said about what is missing"
        return Verdict("unexplained", (), text, 0.0)
    limit = threshold(judge, looks, tests)
    before, adequate = judge.misfit / judge.freedom, good(judge.freedom)
    by_name = {look.suspect.effect.name: look for look in looks}
    tried = [name for name in by_name if name in refits]
    if not tried:
        candidates = [look.suspect.effect.name for look in to_refit(judge, looks, tests)]
        if candidates or before > adequate:
            text = "something is missing, but none of the known effects explains it"
            return Verdict("unexplained", (), text, limit)
        return Verdict("adequate", (), "the model explains the measurements to within their noise", limit)
    best = min(tried, key=lambda name: refits[name].misfit)
    after = refits[best].misfit
    rest = after / refits[best].freedom
    excess = max(judge.misfit - judge.freedom, 1.0)
    share = (judge.misfit - after) / excess
    if judge.misfit - after < limit:
        kind = "adequate" if before <= adequate else "unexplained"
        text = "no known effect improves the fit beyond chance"
        return Verdict(kind, (), text, limit)
    if rest > good(refits[best].freedom) and share < ENOUGH:
        partner, both = _partner(judge, by_name[best], looks)
        if partner is None or both / excess < ENOUGH:
            nearest = f"{_title(by_name[best])} comes nearest but explains only {100 * share:.0f} % of it"
            return Verdict("unexplained", (), f"something is missing; {nearest}", limit)
    rivals = [name for name in tried if _rival(refits[name], refits[best])]
    rivals = [best, *(name for name in rivals if name != best)]
    if len(rivals) > 1:
        names = " or ".join(_title(by_name[name]) for name in rivals)
        return Verdict("indistinguishable", tuple(rivals), f"missing: {names}; these data cannot tell which", limit)
    text = f"missing: {_title(by_name[best])}; it explains {100 * min(share, 1.0):.0f} % of the misfit beyond the noise"
    return Verdict("missing", (best,), text, limit)


def doubted(verdict: Verdict, error: float) -> Verdict:
    """The verdict, but no *adequate* where the pictures still differ by much more than their noise.

    Few and coarse patches can have no misfit while every pixel shows that the model is wrong.

    Parameters
    ----------
    verdict : Verdict
    error : float
        Of the fitted measurements in units of the noise floor.
    """
    if verdict.kind != "adequate" or not error > LOUD:
        return verdict
    text = f"something is missing: the measurements differ by {error:.2g} times their noise, but no effect explains it"
    return Verdict("unexplained", (), text, verdict.threshold)


def _rival(one: Refit, best: Refit) -> bool:
    """Whether a refit cannot be told from the best one: by odds, or because both explain the data well enough."""
    behind = one.misfit - best.misfit
    if behind < RIVAL * max(1.0, best.misfit / best.freedom):
        return True
    return one.misfit / one.freedom <= good(one.freedom) and behind < NEAR * one.freedom


def _title(look: Look) -> str:
    return look.suspect.effect.title


def _partner(judge: Judge, best: Look, looks: Sequence[Look]) -> tuple[Look | None, float]:
    """The effect that explains most together with the best one, and the fall of both."""
    found, most = None, 0.0
    for look in looks:
        if look is best or look.finding.visible < 0.02:
            continue
        columns = np.concatenate([best.columns, look.columns], axis=1)
        wide = np.full(columns.shape[1], np.inf)
        fall = judge.test(columns, -wide, wide).fall
        if fall > most:
            found, most = look, fall
    return found, most


def confusions(judge: Judge, looks: Sequence[Look], count: int = 6) -> list[dict[str, float | str]]:
    """Pairs of the first few effects that look alike on these data."""
    found: list[dict[str, float | str]] = []
    first = [look for look in looks[:count] if look.finding.visible > 1e-4]
    for n, a in enumerate(first):
        for b in first[n + 1 :]:
            value = alike(judge, a, b)
            if value > 0.5:
                found.append({"a": a.suspect.effect.name, "b": b.suspect.effect.name, "likeness": value})
    return sorted(found, key=lambda entry: -float(entry["likeness"]))
