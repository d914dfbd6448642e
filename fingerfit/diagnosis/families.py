"""Families of effects: which of their members, or which probe, stands for each of them, and the odds for it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from fingerfit.diagnosis.ranking import Ranked, spread_of
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.score_tests import ScoreTest, per_value
from fingerfit.model.effect import FAMILIES, OUTLINE

ENOUGH = 0.75
"""Share of the excess misfit that an answer must explain; of what its family's probe explains, a member."""
SURE = 4.6
"""Logarithm of the odds from which an answer is sure: 100 to 1."""


def nominated(
    score_test: ScoreTest, ranking: Sequence[Ranked], falls: Mapping[str, float] | None = None
) -> list[Ranked]:
    """The ranking with the members of a family, or its probe, or both.

    A probe imitates all of its members. One of them is the answer where it does most of what the probe does; else there
    is something in the family that has no member. Where the probe is surely likelier all the same, refits of both tell:
    what is there may have another form, or a number of the member may end at its bound.

    Parameters
    ----------
    score_test : ScoreTest
    ranking : sequence of Ranked
    falls : mapping, optional
        By how much the misfit fell in refits, by name of the effect. A member that keeps less than was promised does
        not hold its probe back any more.
    """
    known = falls or {}
    spread = spread_of(score_test.misfit, ranking, score_test.freedom)
    probes = {one.candidate.effect.family: one for one in ranking if one.candidate.effect.probe}

    def of(family: str) -> list[Ranked]:
        return [one for one in ranking if one.candidate.effect.family == family and one is not probes[family]]

    def stands(family: str) -> bool:
        probe, members = probes[family], of(family)
        limit = ENOUGH * probe.finding.fall
        members = [one for one in members if known.get(one.candidate.effect.name, np.inf) >= limit]
        beyond = all(one.finding.fall < limit for one in members)
        return beyond and all(one.odds(spread) < probe.odds(spread) for one in members)

    def likelier(family: str) -> bool:
        best = max((one.odds(spread) for one in of(family)), default=-np.inf)
        return probes[family].odds(spread) - best > SURE

    standing = {family: stands(family) for family in probes}
    beside = {family for family in probes if likelier(family)}
    return [
        one
        for one in ranking
        if one.candidate.effect.probe == standing.get(family := one.candidate.effect.family, False)
        or (one.candidate.effect.probe and family in beside)
    ]


def families(score_test: ScoreTest, ranking: Sequence[Ranked]) -> dict[str, tuple[Ranked, float]]:
    """The best of each family, the likeliest first, with the logarithm of the family's odds against the model without.

    A member stands for a family whose probe may do better, as of an effect of another form; the family is as likely as
    the best that it has.
    """
    spread = spread_of(score_test.misfit, ranking, score_test.freedom)
    odds: dict[str, float] = {}
    for one in ranking:
        family = one.candidate.effect.family
        odds[family] = max(one.odds(spread), odds.get(family, -np.inf))
    best: dict[str, Ranked] = {}
    for one in sorted(nominated(score_test, ranking), key=lambda one: -one.odds(spread)):
        best.setdefault(one.candidate.effect.family, one)
    return {family: (best[family], odds[family]) for family in sorted(best, key=lambda name: -odds[name])}


def by_refits(ranking: Sequence[Ranked], refits: Mapping[str, Refit]) -> dict[str, tuple[str, float]]:
    """The effect whose refit leaves least of each family, and the logarithm of its odds against the best one of all.

    Where no refit explains the data, all weighs less. Those that missed their minimum, or ended where their effect is
    absent, do not count.
    """
    family = {one.candidate.effect.name: one.candidate.effect.family for one in ranking}
    counted = {name: one for name, one in refits.items() if name in family and not (one.missed or one.absent)}
    order = sorted(counted, key=lambda name: counted[name].level)
    found: dict[str, tuple[str, float]] = {}
    for name in order:
        best, one = counted[order[0]], counted[name]
        found.setdefault(family[name], (name, (best.level - one.level) / 2 / per_value(best.misfit, best.freedom)))
    return found


def leads(
    score_test: ScoreTest, ranking: Sequence[Ranked], one: Ranked, behind: Mapping[str, float] | None = None
) -> bool:
    """Whether an effect that explains a part is surely the largest one.

    Its family is far likelier than any other, and has a probe: without one nobody knows whether it has something
    better than this member. Where both were refitted, that decides; else the odds of the first pass.

    Parameters
    ----------
    score_test : ScoreTest
    ranking : sequence of Ranked
    one : Ranked
    behind : mapping, optional
        Of refits of other effects: logarithm of the odds of this one against it, by name.
    """
    odds = {family: value for family, (_, value) in families(score_test, ranking).items()}
    own = one.candidate.effect.family
    probed = any(other.candidate.effect.probe and other.candidate.effect.family == own for other in ranking)
    if not probed or own not in odds:
        return False
    leading = {other: odds[own] - odds[other] for other in odds.keys() - {own}}
    family_of = {other.candidate.effect.name: other.candidate.effect.family for other in ranking}
    refitted = dict[str, float]()
    for name, value in (behind or {}).items():
        refitted[family_of[name]] = min(value, refitted.get(family_of[name], np.inf))
    return all(value > SURE for family, value in (leading | refitted).items() if family != own)


def odds(log_odds: float) -> str:
    """Odds from their natural logarithm, in powers of ten where they are large.

    Examples
    --------
    >>> odds(0.7), odds(-4.6), odds(1045.7), odds(0.0)
    ('2 to 1', '1 to 99', '10^454 to 1', '1 to 1')
    """
    power = abs(log_odds) / np.log(10)
    size = f"10^{power:.0f}" if power >= 4 else f"{np.exp(abs(log_odds)):.0f}"
    return f"1 to {size}" if log_odds < 0 else f"{size} to 1"


def family_told(diagnosis: Mapping[str, Any]) -> str:
    """The families of what is named, and their odds by refits against the best other one; empty where none is named.

    Parameters
    ----------
    diagnosis : mapping
        What diagnosis.json has.
    """
    family, named = str(diagnosis.get("family")), diagnosis.get("effects") or []
    refits = {one["family"]: one["refit"]["log_odds"] for one in diagnosis.get("families") or [] if one.get("refit")}
    if family not in refits or not named:
        return ""
    ranking = [entry for entry in diagnosis.get("ranking") or [] if "family" in entry]
    of = {OUTLINE: "geometry", **{entry["effect"]: entry["family"] for entry in ranking}}
    own = dict.fromkeys([family, *(of[name] for name in named if name in of)])
    lies = f"The effect lies in {' or '.join(FAMILIES[name] for name in own)}"
    tested = {one["family"]: one["log_odds"] for one in diagnosis["families"]}
    if others := refits.keys() - own:
        gain, other = _against(refits, own, others)
        if gain < 0.0:
            return f"{lies}; by the misfit alone the odds are {odds(-gain)} for {FAMILIES[other]}."
        return f"{lies}, by odds of {odds(gain)} against {FAMILIES[other]}."
    if any(entry["family"] not in own and entry.get("refit") for entry in ranking):
        return f"{lies}; the refits of others do not count."
    why = "no effect of another family was likely enough to be refitted"
    if not (others := tested.keys() - own):
        return f"{lies}; {why}."
    gain, other = _against(tested, own, others)
    return f"{lies}; {why} (odds of {odds(gain)} against {FAMILIES[other]} before any refit)."


def _against(log_odds: Mapping[str, float], own: Collection[str], others: Collection[str]) -> tuple[float, str]:
    """Log odds of the best of some families against the best of others, and which that is."""
    other = max(others, key=lambda name: (log_odds[name], name))
    return max(log_odds.get(name, -np.inf) for name in own) - log_odds[other], other
