"""Two effects that explain together what none does alone: a member that is half of it, and its partner."""

from __future__ import annotations

from dataclasses import replace

from fingerfit.core.progress import begin
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.ranking import Ranked, spread_of
from fingerfit.diagnosis.refit import Refit, explains
from fingerfit.diagnosis.second_pass import ended_of
from fingerfit.diagnosis.second_queue import by_one_likelihood, refit_best, refits_of
from fingerfit.diagnosis.tested import Tested, in_space, test_all
from fingerfit.diagnosis.verdict import PART, best_of, both_explain, generalising
from fingerfit.fit.jobs import solved, solved_since


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
