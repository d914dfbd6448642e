"""Which effects are refitted with pictures, in which order, and a partner for one that explains half of the misfit."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.processes import side_by_side
from fingerfit.core.progress import begin, counted, tell
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.likelihood import Weighed, misfits
from fingerfit.diagnosis.ranking import REFIT, Ranked, said_by, spread_of
from fingerfit.diagnosis.refit import EXPLAINED, Refit, chance, explains
from fingerfit.diagnosis.second_pass import ended_of, refit_anywhere
from fingerfit.diagnosis.tested import Tested, in_space, test_all
from fingerfit.diagnosis.verdict import BUT_FORM, MATTERS, PART, RIVAL, best_of, both_explain, generalising, misses
from fingerfit.diagnosis.worth import falls_short, to_refit, worth_a_refit
from fingerfit.fit.jobs import solved, solved_since

HALF = 0.5
"""Share of a series' log odds from which what has fewer numbers is refitted beside it. A choice (decision 50)."""


def refit_best(found: Tested, refits: dict[str, Refit], threads: int) -> int:
    """Refit the best effects that are not in `refits` yet, and put them there; how many simulations were not known."""
    problem = found.comparison.problem
    before = solved(problem)
    for ranked, refit in refits_of(found, threads, refits):
        refits[ranked.candidate.effect.name] = refit
    return solved_since(problem, before)


def refits_of(found: Tested, threads: int, known: Mapping[str, Refit] | None = None) -> Iterator[tuple[Ranked, Refit]]:
    """The effects that are worth it, each with its refit, one by one.

    Where one explains most of the misfit, not those whose odds were far below its own (both in the first pass, or both
    by slopes), by more than tells refits apart, and no probe that was less likely: it would only say that there is
    something of no known form.
    But where the best one leaves more than the noise, in the pictures and in the patches, a probe of another family may
    come nearer, and counts as a member does. A member of a family of which none has explained it is refitted where it
    explains as much in the first pass. A series of many numbers may imitate what has few: beside it others are
    tried that were half as likely. No effect that explains far too little in the first pass (`falls_short`).
    A probe comes after the members of its family, and not at all where one of them explains the data, every pixel
    included. Nor do then those that only slopes speak for; they come after what explained the data in the first pass.
    At last those that take the places of lost refits: `instead_of`.
    """
    # the best log odds of what explains the data, of the first pass and of slopes, which are not one measure
    explained, by_series, named = {True: -np.inf, False: -np.inf}, False, set[str]()
    most = 0.0  # by how much the misfit falls in the first pass by what explains the data
    nearest_by, least = set[str](), np.inf  # families of what explains the data, and the least error of these
    done = dict(known or {})
    by_chance = False  # whether one of them leaves no more than chance does in patches, and hardly more in pictures
    spread = spread_of(found.score_test.misfit, found.ranking, found.score_test.freedom)
    # in space a refit takes as much memory as several volumes: there its simulations are what is made beside each other
    problem = found.comparison.problem
    beside, each, by = 1, threads, said_by(REFIT, problem.settings.model.effects)

    def worth_it(ranked: Ranked) -> bool:
        effect = ranked.candidate.effect
        if (effect.probe and effect.family in named) or falls_short(ranked, found.score_test, found.but_mesh[0]):
            return False
        elsewhere = effect.family not in nearest_by and least > 1.0 + MATTERS and not by_chance
        if seen and not ranked.refitted and least <= 1.0 + MATTERS:
            return False
        # what explains as much there with more numbers is of another family: how likely these are, the refit says
        as_much = ranked.refitted and not effect.probe and ranked.finding.fall >= BUT_FORM * most > 0.0
        if as_much and effect.family not in nearest_by:
            return True
        share = HALF if by_series else 1.0 if effect.probe and not elsewhere else ENOUGH
        # members that not even refits may tell apart are all refitted
        alike = 0.0 if effect.probe else 0.5 * RIVAL
        best = explained[bool(ranked.refitted)]
        return ranked.odds(spread) >= min(share * best, best - alike)

    def refitted(ranked: Ranked) -> tuple[tuple[Refit, int] | None, set[str], int]:
        known, name = set(problem.asked), ranked.candidate.effect.name
        begin(f"{by}: {name} ({ranked.candidate.effect.title})")
        if name in found.made:
            return (found.made[name], 0), set(), 0
        before = solved(problem)
        try:
            made = refit_anywhere(found.comparison, ranked, each)
        except StateError:
            made = None  # bodies without a solution explain nothing
        return made, problem.asked - known, solved_since(problem, before)

    left = to_refit(found.score_test, found.ranking, found.tests, known)
    seen = any(one.refitted and one.refitted.share >= ENOUGH for one in left)
    members = {one.candidate.effect.family for one in left if not one.candidate.effect.probe}
    left.sort(
        key=lambda one: (
            one.candidate.effect.probe and one.candidate.effect.family in members,
            seen and one.refitted is None,
        )
    )
    left = [one for one in left if worth_it(one)]
    tried = set(done)
    while left:
        now, left = left[:beside], left[beside:]
        # what an earlier one of them has made needless is thrown away, so that one process finds the same
        for ranked, (made, asked, run) in zip(now, side_by_side(refitted, now, beside), strict=True):
            if not worth_it(ranked):
                continue
            tried.add(ranked.candidate.effect.name)
            problem.asked.update(asked)
            if made is None:
                found.ended(ranked, problem.lost.why(sorted(asked)))
                continue
            (refit, place), effect = made, ranked.candidate.effect
            found.made[effect.name] = refit
            if place:
                ranked = found.moved(ranked, place)
            refit = replace(refit, missed=misses(found.score_test, refit, found.but_mesh[0]))
            if not refit.missed and (explains(refit) or refit.explained(found.score_test.misfit) >= ENOUGH):
                field = bool(effect.series) and effect.probe
                first, odds = bool(ranked.refitted), ranked.odds(spread)
                if odds > explained[first]:
                    explained[first], by_series = odds, field if first else by_series
                nearest_by.add(effect.family)
                most = max(most, ranked.finding.fall if first else 0.0)
                least = min(least, refit.at_least)
            whole = not refit.missed and explains(refit) and refit.fitted <= EXPLAINED
            by_chance |= whole and refit.misfit <= chance(refit.freedom)
            done[effect.name] = refit
            share = by_one_likelihood(done, found.comparison.weighed)[effect.name].explained(found.score_test.misfit)
            if whole and not effect.probe:
                named.add(effect.family)
            left = [one for one in left if worth_it(one)]
            share, ran = min(1.0, max(0.0, share)), counted(run, "simulation")
            said = "found no minimum, and does not count" if refit.missed else f"explains {100 * share:.0f} %"
            tell(f"{by}: {effect.name} ({effect.title}) {said}; {ran} run")
            yield ranked, refit
        # the first one often makes all others needless, which would hold it up
        beside, each = (1, threads) if in_space(problem) else (threads, 1)
        if not left:
            left = [one for one in instead_of(found, tried, done) if worth_it(one)]


def instead_of(found: Tested, tried: Collection[str], done: Mapping[str, Refit]) -> list[Ranked]:
    """Effects that take the places of those whose refits are lost: the likeliest other one of each family.

    Lost is a refit without a solution, one that ended where its effect is absent, and one that missed its minimum. Not
    where another refit of the family has ended, nor by an effect that was less likely in the first pass, by a quarter
    of the log odds, and than all others that were refitted: without the lost one it would have had a place of its own.

    Parameters
    ----------
    found : Tested
    tried : collection of str
        Effects whose refits were tried.
    done : mapping
        These refits, of those that have a solution.
    """
    spread = spread_of(found.score_test.misfit, found.ranking, found.score_test.freedom)
    ended = {name for name, refit in done.items() if not (refit.absent or refit.missed)}
    families = {one.candidate.effect.family for one in found.ranking if one.candidate.effect.name in ended}
    lost, chosen, last = dict[str, float](), dict[str, Ranked](), np.inf
    for one in found.ranking:
        effect = one.candidate.effect
        if effect.name in tried and effect.family not in families:
            lost[effect.family] = max(one.odds(spread), lost.get(effect.family, -np.inf))
        elif effect.name in tried and one.refitted:
            last = min(last, one.odds(spread))
    # without those that are lost: such a probe does not stand for its members any more
    left = [one for one in found.ranking if one.candidate.effect.name not in set(tried) - ended]
    worth = worth_a_refit(found.score_test, left, found.tests, done)
    for one in sorted(worth, key=lambda one: -one.odds(spread)):
        effect = one.candidate.effect
        least = min(ENOUGH * lost[effect.family], last) if effect.family in lost else np.inf
        if one.refitted and effect.name not in tried and one.odds(spread) >= least:
            chosen.setdefault(effect.family, one)
    return list(chosen.values())


def imitated(known: Tested) -> Ranked | None:
    """A member that may be one of two that the probe of its family imitates; None where none may be.

    In the first pass the probe is likelier than all others and explains enough, and its likeliest member a part of it:
    what the probe does not explain, two of its members will not either. Where an effect of another family explains
    enough alone, that comes first.
    """
    spread = spread_of(known.score_test.misfit, known.ranking, known.score_test.freedom)
    refitted = ((one, one.refitted) for one in known.ranking if one.refitted)
    tried = sorted(refitted, key=lambda pair: -pair[0].odds(spread))
    if not tried:
        return None
    (probe, first), *others = tried
    if not probe.candidate.effect.probe or first.share < ENOUGH:
        return None
    family = probe.candidate.effect.family
    if any(there.share >= ENOUGH for one, there in others if one.candidate.effect.family != family):
        return None
    kin = (one for one, there in others if one.candidate.effect.family == family and there.share >= PART)
    return next(kin, None)


def pair_of(
    found: Tested, held_out: float | None, threads: int
) -> tuple[dict[str, Refit], tuple[Ranked, Refit] | None, int]:
    """The refit of the member that `imitated` finds; and its partner in the family, where it does not explain the data.

    Returns
    -------
    dict
        That refit by the name of the effect; empty without one.
    (Ranked, Refit) or None
        The partner, and the refit of both; None where both do not explain the data, held-out steps included.
    int
        Simulations that were not known.
    """
    member, alone = imitated(found), dict[str, Refit]()
    if member is None:
        return alone, None, 0
    only = replace(found, ranking=[member])
    run = refit_best(only, alone, threads)
    (ended,) = only.ranking  # maybe in another of its places
    found.ranking[:] = [ended if one is member else one for one in found.ranking]
    left = generalising(found.score_test, alone, held_out)
    if not left or any(explains(refit) for refit in left.values()):
        return alone, None, run
    partner, more = partner_of(ended, found, threads, ended.candidate.effect.family)
    run += more
    return alone, partner if both_explain(found.score_test, partner, held_out) else None, run


def partner_of(half: Ranked, known: Tested, threads: int, family: str = "") -> tuple[tuple[Ranked, Refit] | None, int]:
    """The effect, of a `family` where one is given, that explains most of what another one leaves; the refit of both.

    It is looked for where the refit of the first one ended, as the next rung would, whose simulations these are. In
    space, where these take hours, by the slopes of the model without it.
    """
    problem, everything = known.comparison.problem, known.comparison.everything
    begin(f"a second effect beside {half.candidate.effect.name} ({half.candidate.effect.title})")
    before = solved(problem)
    ended = ended_of(known.comparison, half, threads)
    slopes, tried = known if in_space(problem) else None, dict[str, Refit]()
    after = ended.comparison
    found = test_all(after.problem, after.last, everything, threads, slopes, family)
    if family:  # else the probe of that family is refitted: only what may explain the rest is worth it before
        found = replace(found, ranking=[one for one in found.ranking if one.refitted and one.refitted.share >= ENOUGH])
    for ranked, refit in refits_of(found, threads):
        tried[ranked.candidate.effect.name] = refit
        if explains(refit):
            break
    problem.asked.update(after.problem.asked)
    tried = by_one_likelihood(tried, found.comparison.weighed)
    return best_of(found.ranking, tried), solved_since(problem, before)


def by_one_likelihood(refits: Mapping[str, Refit], without: Weighed) -> dict[str, Refit]:
    """Refits with their misfits by one likelihood: that of the one whose pictures or points come nearest, but for
    what its mesh makes of them; the mean of these where several come as near.

    `without` is what the model leaves that has none of the effects. A refit that ended at the absent values of its
    effect earns nothing: it is that model, and where it leaves less, what others explain counts from there.
    """
    models = {name: refit.weighed for name, refit in refits.items() if refit.weighed is not None}
    if not models:
        return dict(refits)
    errors = {name: float(np.nan_to_num(refits[name].at_least, nan=np.inf)) for name in models}
    near = [name for name, error in errors.items() if error <= min(errors.values()) + MATTERS]
    each = [misfits({**models, "": without}, name) for name in near]
    found = {name: float(np.mean([by[name] for by in each])) for name in each[0]}
    absent = [name for name in models if refits[name].absent]
    before = min(found[name] for name in ("", *absent))
    lower = max(0.0, *(refits[name].fall for name in absent)) if absent else 0.0
    return {
        name: replace(refit, compared=found[name], before=before, lower=lower) if name in found else refit
        for name, refit in refits.items()
    }
