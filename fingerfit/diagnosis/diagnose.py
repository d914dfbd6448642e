"""A fitted model diagnosed: compared with everything that was measured, candidates tested, the best refitted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fingerfit.core.errors import InputError, StateError
from fingerfit.core.processes import side_by_side
from fingerfit.core.progress import tell
from fingerfit.diagnosis.candidates import candidates, left_out, makes_sense, may_be, untestable
from fingerfit.diagnosis.comparison import Comparison, anchor_of, rank_candidates, stiffness_map
from fingerfit.diagnosis.designs import Further, identification, separation
from fingerfit.diagnosis.errors import errors
from fingerfit.diagnosis.evidence import spare
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.first_pass import widened
from fingerfit.diagnosis.form_or_state import form_or_state
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.likelihood import Weighed, misfits
from fingerfit.diagnosis.mesh_errors import by_halved_mesh, errors_but_mesh
from fingerfit.diagnosis.ranges import not_excluded
from fingerfit.diagnosis.ranking import Ranked, best_places, spread_of
from fingerfit.diagnosis.refit import GOOD, LOUD, Refit, excess, explains
from fingerfit.diagnosis.reservations import (
    by_settings,
    doubted,
    far_off,
    form_of,
    largest_part,
    loud_by_mesh,
    not_needed,
    of_family,
    perhaps,
    too_coarse,
    traced,
    untried,
)
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.second_pass import Everything, ended_of, refit_anywhere
from fingerfit.diagnosis.series import cut
from fingerfit.diagnosis.sides import sides_of
from fingerfit.diagnosis.tested import Tested
from fingerfit.diagnosis.trials import rank_again, refit_all
from fingerfit.diagnosis.verdict import (
    MATTERS,
    Verdict,
    best_of,
    decide,
    ended_well,
    generalising,
    half_explained,
    nearest,
)
from fingerfit.diagnosis.worth import LARGEST, to_refit, too_small
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import finest, minimum
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.model.effect import MESH_ERROR, OUTLINE, STATE, Effect
from fingerfit.settings.extend import rivals, with_model
from fingerfit.study.several import AT

HALF = 0.5
"""Share of a series' log odds from which what has fewer numbers is refitted beside it. A choice (decision 19)."""
BATCHES = 2
"""How often the next best effects are refitted, as long as none explains the residual."""


@dataclass(frozen=True)
class Diagnosis:
    """All that was found out about a model.

    Parameters
    ----------
    comparison : Comparison
    score_test : ScoreTest
    ranking : list of Ranked
        Tested effects, the best first.
    refits : dict
        Refits of the best ones, by effect.
    verdict : Verdict
    run : int
        Simulations that were not known before.
    measurements : list of (str, float)
        Changes of the measurement and by how much each would separate the first two effects better.
    further : dict
        For constants that are not identified, measurements that would: as from `identification`.
    stiffness : ndarray, shape (places, dim + 2)
        As from `stiffness_map`.
    lacking : dict
        Effects that were not tried, by title, and what the solver lacks for them.
    untestable : dict
        Effects that were not tried, by title, and what would have to be measured.
    left_out : list of str
        Titles of the effects that were not tried, as ``diagnosis`` in config.yaml says.
    spare : list of Effect
        Effects of an adequate model that it may not need: as from `spare`.
    not_excluded : list of Ranked
        Effects that an adequate model may lack: as from `not_excluded`.
    """

    comparison: Comparison
    score_test: ScoreTest
    ranking: list[Ranked]
    refits: dict[str, Refit]
    verdict: Verdict
    run: int
    measurements: list[tuple[str, float]]
    further: dict[str, list[Further]]
    stiffness: np.ndarray
    lacking: dict[str, InputError]
    untestable: dict[str, InputError]
    left_out: list[str]
    spare: list[Effect]
    not_excluded: list[Ranked]


def diagnose(
    problem: InverseProblem,
    last: Round,
    everything: Everything,
    threads: int = 1,
    intervals: Mapping[str, Sequence[float]] | None = None,
) -> Diagnosis:
    """Diagnose a fitted model.

    Parameters
    ----------
    problem : InverseProblem
    last : Round
        Its last round, all simulations solved.
    everything : Data or sequence of Data
        Prepared with all pictures, fitted or not; of a study with several tests that of each.
    threads : int
        Simulations beside each other.
    intervals : mapping, optional
        Lower and upper end of the 95 % interval of each constant, as the estimate has them: what moves none of them out
        of it is a trace.
    """
    found = _test_all(problem, last, everything, threads)
    run, refits = found.run, dict[str, Refit]()
    fitted, held_out = errors(found.comparison)
    but_mesh = errors_but_mesh(found.comparison)
    at_least = but_mesh[0]
    if at_least > LOUD:  # that something is missing is known: nothing is named by chance because much was tried
        found = replace(found, tests=1)
    score_test, ranking, tests = found.score_test, found.ranking, found.tests
    halves, ended = set[str](), dict[str, Refit]()
    outline = found.outline
    verdict = decide(score_test, ranking, {}, tests, held_out=held_out)
    unexplained = not explains(score_test)
    # before any effect is blamed: what a mesh leaves may be no more than the noise, and still be most of what is seen
    blames = unexplained or verdict.kind != "adequate"
    by_mesh, more = by_halved_mesh(found.comparison, score_test, threads) if blames and not outline.off else (0.0, 0)
    run += more
    seen = 0.0 if unexplained else max((one.finding.fall for one in ranking if one.refitted), default=0.0)
    coarse = by_mesh > 0.0 and by_mesh > LARGEST * max(excess(score_test), seen)
    probed = any(effect.probe for effect in problem.settings.effects())
    # of a body of another shape, and of one that is not solved well, refits say nothing
    no_refits = coarse or (outline.off and unexplained) or too_small(score_test, ranking, at_least)
    for _ in range(0 if no_refits else BATCHES):
        run += _refit_best(problem, last, everything, found, refits, threads)
        refits = by_one_likelihood(refits, found.weighed)
        well = ended_well(score_test, refits, fitted)
        ended, missed = nearest(well), refits.keys() - well.keys()
        verdict = doubted(decide(score_test, ranking, ended, tests, None, held_out, missed), at_least)
        half = half_explained(score_test, ranking, generalising(score_test, ended, held_out), tests)
        # a probe has as many numbers as several effects: no partner is looked for beside it
        if half is not None and not (probed or half.candidate.effect.probe or half.candidate.effect.name in halves):
            halves.add(half.candidate.effect.name)
            partner, more = _partner(problem, last, half, everything, found, threads)
            verdict, run = decide(score_test, ranking, ended, tests, partner, held_out), run + more
        if verdict.kind != "unexplained":
            break
    general, beside = generalising(score_test, ended, held_out), bool(problem.settings.model.effects)
    verdict = largest_part(verdict, score_test, ranking, general, fitted, refits, held_out, beside)
    estimate = minimum(problem, last).values
    constants = problem.settings.model.parameters
    own = {p.name: estimate[p.name] for p in problem.settings.parameters() if p.name.partition(AT)[0] in constants}
    base = Refit(score_test.misfit, score_test.freedom, fitted, held_out, own, but_mesh=but_mesh)
    tolerance = problem.settings.fit.tolerance
    blamed = [one.candidate.effect for one in ranking if one.candidate.effect.name in verdict.effects]
    form = form_of(found.comparison, blamed)
    verdict = traced(verdict, score_test, ranking, refits, base, tolerance, tests, intervals, form)
    measurements = list[tuple[str, float]]()
    further, more = identification(found.comparison, threads)
    run += more
    if verdict.kind == "indistinguishable":
        named = {one.candidate.effect.name: one for one in ranking}
        first, second = (named[name] for name in verdict.effects[:2])
        measurements, more = separation(found.comparison, first, second, threads)
        run += more
    stiffness = stiffness_map(found.comparison, found.everywhere)
    verdict = by_settings(of_family(verdict, score_test, ranking, ended), score_test, ranking, tests)
    mesh = next((effect for effect in problem.effects.values() if effect.signal == MESH_ERROR), None)
    if mesh:
        if coarse:
            verdict = too_coarse(verdict, score_test, by_mesh, seen, mesh, fitted)
        verdict = loud_by_mesh(verdict, fitted, at_least, mesh)
    if outline.off and verdict.kind != "adequate" and problem.settings.tries(OUTLINE):
        verdict, states, more = form_or_state(verdict, problem, last, everything, found, refits, threads)
        begins = {one.candidate.effect.name: one for one, _ in states}
        ranking = [begins.get(one.candidate.effect.name, one) for one in ranking]
        refits |= {one.candidate.effect.name: refit for one, refit in states}
        run += more
    needless = spare(problem, score_test, found.comparison.base.values) if verdict.kind == "adequate" else []
    verdict = not_needed(far_off(verdict, found.comparison), needless)
    maybe = not_excluded(ranking, score_test, refits, tests) if verdict.kind == "adequate" else []
    verdict = perhaps(verdict, [one.candidate.effect.title for one in maybe])
    untold = found.lacking, untestable(problem), left_out(problem)
    verdict = untried(verdict, problem.settings.solver, list(found.lacking), len(untold[-1]))
    return Diagnosis(
        found.comparison, score_test, ranking, refits, verdict, run, measurements, further, stiffness, *untold,
        needless, maybe,
    )  # fmt: skip


def _test_all(
    problem: InverseProblem, last: Round, everything: Everything, threads: int, known: Tested | None = None
) -> Tested:
    """Test all candidates; with the slopes that are `known` of a model with an effect less, where these are given."""
    if known is None:
        found, lacking = candidates(problem, finest(problem, last).values)
        tell(f"slopes of {len({candidate.effect.name for candidate in found})} effects")
    else:
        tested, lacking = [one.candidate for one in known.everywhere], known.lacking
        possible = [one for one in tested if makes_sense(one.effect, problem)]
        found = [one for one in possible if may_be(one.effect, one.place, problem)]
    asked = [a for one in found for a in one.asked if not (known and problem.is_solved(a))]
    without = known.comparison.anchor if known else None
    run = solve_missing(problem, [anchor_of(problem, last)], threads)
    comparison = comparison_of(problem, last, everything)
    run += solve_missing(problem, comparison.read_beside(asked, threads, without), threads)
    score_test, outline = comparison.score_test, sides_of(comparison)
    everywhere = [cut(score_test, one) for one in rank_candidates(comparison, score_test, found, without)]
    ranking = best_places(everywhere)
    if _in_space(problem):
        ranking, more = rank_again(comparison, score_test, ranking, len(found), threads)
    else:
        # a body of another shape is fitted before anything else, but for the state it may be in
        another = outline.off and not explains(score_test) and problem.settings.tries(OUTLINE)
        family = STATE if another else ""
        ranking, more = refit_all(comparison, ranking, threads, explains(score_test), everywhere, family)
    run += more
    return Tested(comparison, score_test, everywhere, ranking, len(found), run, lacking, outline)


def _in_space(problem: InverseProblem) -> bool:
    return any(test.meshes[SEARCH].dim == 3 for test in problem.every)


def _refit_best(
    problem: InverseProblem, last: Round, everything: Everything, found: Tested, refits: dict[str, Refit], threads: int
) -> int:
    """Refit the best effects that are not in `refits` yet, and put them there; how many simulations were not known."""
    run = 0
    for ranked, refit, more in _refits(problem, last, everything, found, threads, refits):
        refits[ranked.candidate.effect.name] = refit
        run += more
    return run


def _refits(
    problem: InverseProblem,
    last: Round,
    everything: Everything,
    found: Tested,
    threads: int,
    known: Mapping[str, Refit] | None = None,
) -> Iterator[tuple[Ranked, Refit, int]]:
    """The effects that are worth it, each with its refit and how many simulations were not known, one by one.

    Where one explains most of the misfit, not those whose odds in the first pass were far below its own, and no probe
    that was less likely: it would only say that there is something of no known form. But where the best one leaves more
    than the noise, a probe of another family may come nearer, and counts as a member does. A series of many numbers may
    imitate what has few: beside it others are tried that were half as likely. A probe comes after the members of
    its family, and not at all where one of them explains the data, every pixel included. Nor do then those that only
    slopes speak for; they come after what explained the data in the first pass.
    """
    explained, by_series, named = -np.inf, False, set[str]()
    nearest_by, least = set[str](), np.inf  # families of what explains the data, and the least error of these
    spread = spread_of(found.score_test.misfit, found.ranking, found.score_test.freedom)
    # in space a refit takes as much memory as several volumes: there its simulations are what is made beside each other
    flat = not _in_space(problem)
    beside, each = 1, threads

    def worth_it(ranked: Ranked) -> bool:
        effect = ranked.candidate.effect
        if effect.probe and effect.family in named:
            return False
        elsewhere = effect.family not in nearest_by and least > 1.0 + MATTERS
        if seen and not ranked.refitted and least <= 1.0 + MATTERS:
            return False
        share = HALF if by_series else 1.0 if effect.probe and not elsewhere else ENOUGH
        return not ranked.refitted or ranked.odds(spread) >= share * explained

    def refitted(ranked: Ranked) -> tuple[tuple[Refit, int, int] | None, set[str]]:
        known = set(problem.asked)
        try:
            made = refit_anywhere(problem, last, ranked, everything, found.weighed, each)
        except StateError:
            made = None  # bodies without a solution explain nothing
        return made, problem.asked - known

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
    while left:
        now, left = left[:beside], left[beside:]
        # what an earlier one of them has made needless is thrown away, so that one process finds the same
        for ranked, (made, asked) in zip(now, side_by_side(refitted, now, beside), strict=True):
            if not worth_it(ranked):
                continue
            problem.asked.update(asked)
            if made is None:
                continue
            (refit, run, place), effect = made, ranked.candidate.effect
            if place:
                ranked = found.moved(ranked, place)
            if explains(refit) or refit.explained(found.score_test.misfit) >= ENOUGH:
                field = bool(effect.series) and effect.probe
                explained, by_series = max((explained, by_series), (ranked.odds(spread), field))
                nearest_by.add(effect.family)
                least = min(least, refit.fitted)
            share = min(1.0, max(0.0, refit.explained(found.score_test.misfit)))
            if not effect.probe and explains(refit) and refit.fitted <= GOOD:
                named.add(effect.family)
            left = [one for one in left if worth_it(one)]
            tell(f"refitted {effect.name} ({effect.title}): explains {100 * share:.0f} %; {run} simulations run")
            yield ranked, refit, run
        # the first one often makes all others needless, which would hold it up
        beside, each = (threads, 1) if flat else (1, threads)


def _partner(
    problem: InverseProblem, last: Round, half: Ranked, everything: Everything, known: Tested, threads: int
) -> tuple[tuple[Ranked, Refit] | None, int]:
    """The effect that explains most of what another one leaves, and the refit of both.

    It is looked for where the refit of the first one ended, as the next rung would, whose simulations these are. In
    space, where these take hours, by the slopes of the model without it.
    """
    ended, run = ended_of(problem, last, half, everything, known.weighed, threads)
    slopes = known if _in_space(problem) else None
    found, tried = _test_all(ended.problem, ended.last, everything, threads, slopes), dict[str, Refit]()
    run += found.run
    for ranked, refit, more in _refits(ended.problem, ended.last, everything, found, threads):
        tried[ranked.candidate.effect.name], run = refit, run + more
        if explains(refit):
            break
    problem.asked.update(ended.problem.asked)
    tried = by_one_likelihood(tried, found.weighed)
    return best_of(found.ranking, tried), run


def by_one_likelihood(refits: Mapping[str, Refit], without: Weighed) -> dict[str, Refit]:
    """Refits with their misfits by one likelihood: that of the one whose pictures or points come nearest, but for
    what its mesh makes of them.

    `without` is what the model leaves that has none of the effects.
    """
    models = {name: refit.weighed for name, refit in refits.items() if refit.weighed is not None}
    if not models:
        return dict(refits)
    best = min(models, key=lambda name: np.nan_to_num(refits[name].at_least, nan=np.inf))
    found = misfits({**models, "": without}, best)
    return {
        name: replace(refit, compared=found[name], before=found[""]) if name in found else refit
        for name, refit in refits.items()
    }


def added(problem: InverseProblem, last: Round, found: Diagnosis, name: str) -> InverseProblem:
    """Fit of the model with an effect that was named, on the way of its refit: none of its simulations is new."""
    one = next(one for one in found.ranking if one.candidate.effect.name == name)
    wider = widened(problem, minimum(problem, last).values, one, found.refits[name].share)
    refits = {other: refit.values for other, refit in found.refits.items()}
    known = problem.settings.model.rivals | rivals(problem.settings, name, found.verdict.effects, refits)
    return wider.with_settings(with_model(wider.settings, rivals=known))
