"""Which effects are refitted with pictures, and in which order."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.processes import side_by_side
from fingerfit.core.progress import begin, counted, tell
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.likelihood import Weighed, misfits
from fingerfit.diagnosis.ranking import REFIT, Ranked, said_by, spread_of
from fingerfit.diagnosis.refit import EXPLAINED, Refit, chance, explains
from fingerfit.diagnosis.second_pass import refit_anywhere
from fingerfit.diagnosis.tested import Tested, in_space
from fingerfit.diagnosis.verdict import BUT_FORM, MATTERS, RIVAL, misses
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
    """The effects that are worth it, each with its refit, one by one, in the order of `Queue`.

    At last those that take the places of lost refits: `instead_of`.
    """
    queue, problem = Queue(found, known or {}), found.comparison.problem
    by = said_by(REFIT, problem.settings.model.effects)
    # in space a refit takes as much memory as several volumes: there its simulations are what is made beside each other
    beside, each = 1, threads
    while queue.left:
        now, queue.left = queue.left[:beside], queue.left[beside:]
        made = side_by_side(partial(_made, found, each), now, beside)
        # what an earlier one of them has made needless is thrown away, so that one process finds the same
        for ranked, (result, asked, run) in zip(now, made, strict=True):
            if not queue.worth_it(ranked):
                continue
            effect = ranked.candidate.effect
            queue.tried.add(effect.name)
            problem.asked.update(asked)
            if result is None:
                found.ended(ranked, problem.lost.why(sorted(asked)))
                continue
            refit, place = result
            found.made[effect.name] = refit
            if place:
                ranked = found.moved(ranked, place)
            refit = replace(refit, missed=misses(found.score_test, refit, found.but_mesh[0]))
            queue.learn(ranked, refit)
            share = queue.share(effect.name)
            said = "found no minimum, and does not count" if refit.missed else f"explains {100 * share:.0f} %"
            tell(f"{by}: {effect.name} ({effect.title}) {said}; {counted(run, 'simulation')} run")
            yield ranked, refit
        # the first one often makes all others needless, which would hold it up
        beside, each = (1, threads) if in_space(problem) else (threads, 1)
        queue.fill()


def _made(found: Tested, threads: int, ranked: Ranked) -> tuple[tuple[Refit, int] | None, set[str], int]:
    """A refit and its place, None without a solution; what it asked for, and how many simulations were not known."""
    problem, effect = found.comparison.problem, ranked.candidate.effect
    known = set(problem.asked)
    begin(f"{said_by(REFIT, problem.settings.model.effects)}: {effect.name} ({effect.title})")
    if effect.name in found.made:
        return (found.made[effect.name], 0), set(), 0
    before = solved(problem)
    try:
        made = refit_anywhere(found.comparison, ranked, threads)
    except StateError:
        made = None  # bodies without a solution explain nothing
    return made, problem.asked - known, solved_since(problem, before)


class Queue:
    """Which effects are left that are worth a refit, after what the refits before have said.

    A probe comes after the members of its family; those that only slopes speak for come after what explained the data
    in the first pass.

    Parameters
    ----------
    found : Tested
    known : mapping
        Refits of earlier queues, by name of the effect.
    """

    def __init__(self, found: Tested, known: Mapping[str, Refit]) -> None:
        self.found, self.done, self.tried = found, dict(known), set(known)
        self.spread = spread_of(found.score_test.misfit, found.ranking, found.score_test.freedom)
        # of refits that explain the data: the best log odds of the first pass and of slopes, which are not one measure
        self.explained = {True: -np.inf, False: -np.inf}
        self.by_series = False  # whether the likeliest of these is a series that is a probe
        self.most = 0.0  # by how much the misfit falls in the first pass by one of them
        self.families, self.least = set[str](), np.inf  # their families, and their least error
        self.by_chance = False  # whether one leaves no more than chance does in patches, and hardly more in pictures
        self.named = set[str]()  # families of members that explain the data, every pixel included
        left = to_refit(found.score_test, found.ranking, found.tests, known)
        self.seen = any(one.refitted and one.refitted.share >= ENOUGH for one in left)
        members = {one.candidate.effect.family for one in left if not one.candidate.effect.probe}

        def late(one: Ranked) -> tuple[bool, bool]:
            effect = one.candidate.effect
            return effect.probe and effect.family in members, self.seen and one.refitted is None

        self.left = [one for one in sorted(left, key=late) if self.worth_it(one)]

    def worth_it(self, one: Ranked) -> bool:
        """Whether an effect is worth a refit.

        Where one explains most of the misfit, not those whose odds were far below its own (both in the first pass, or
        both by slopes), by more than tells refits apart, and no probe that was less likely: it would only say that
        there is something of no known form; nor where a member of its family explains the data, every pixel included.
        But where the best one leaves more than the noise, in the pictures and in the patches, a probe of another family
        may come nearer, and counts as a member does. A member of a family of which none has explained it is refitted
        where it explains as much in the first pass. A series of many numbers may imitate what has few: beside it others
        are tried that were half as likely. No effect that explains far too little in the first pass (`falls_short`).
        """
        effect, first = one.candidate.effect, bool(one.refitted)
        if (effect.probe and effect.family in self.named) or self._falls_short(one):
            return False
        near = self.least <= 1.0 + MATTERS
        if self.seen and not first and near:
            return False
        other_family = effect.family not in self.families
        # what explains as much there with more numbers is of another family: how likely these are, the refit says
        if other_family and first and not effect.probe and one.finding.fall >= BUT_FORM * self.most > 0.0:
            return True
        elsewhere = other_family and not (near or self.by_chance)
        share = HALF if self.by_series else 1.0 if effect.probe and not elsewhere else ENOUGH
        # members that not even refits may tell apart are all refitted
        alike = 0.0 if effect.probe else 0.5 * RIVAL
        best = self.explained[first]
        return one.odds(self.spread) >= min(share * best, best - alike)

    def _falls_short(self, one: Ranked) -> bool:
        return falls_short(one, self.found.score_test, self.found.but_mesh[0])

    def learn(self, one: Ranked, refit: Refit) -> None:
        """Take in what a refit says, and drop what is not worth it any more."""
        effect, first, odds = one.candidate.effect, bool(one.refitted), one.odds(self.spread)
        if not refit.missed and (explains(refit) or refit.explained(self.found.score_test.misfit) >= ENOUGH):
            field = bool(effect.series) and effect.probe
            if odds > self.explained[first]:
                self.explained[first], self.by_series = odds, field if first else self.by_series
            self.families.add(effect.family)
            self.most = max(self.most, one.finding.fall if first else 0.0)
            self.least = min(self.least, refit.at_least)
        whole = not refit.missed and explains(refit) and refit.fitted <= EXPLAINED
        self.by_chance |= whole and refit.misfit <= chance(refit.freedom)
        if whole and not effect.probe:
            self.named.add(effect.family)
        self.done[effect.name] = refit
        self.left = [one for one in self.left if self.worth_it(one)]

    def share(self, name: str) -> float:
        """Share of the misfit beyond the noise that a refit explains, by the likelihood that all of them have."""
        common = by_one_likelihood(self.done, self.found.comparison.weighed)[name]
        return min(1.0, max(0.0, common.explained(self.found.score_test.misfit)))

    def fill(self) -> None:
        """Where none is left, take those that take the places of lost refits."""
        if not self.left:
            self.left = [one for one in instead_of(self.found, self.tried, self.done) if self.worth_it(one)]


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
