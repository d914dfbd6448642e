"""A fitted model diagnosed: compared with everything that was measured, candidates tested, the best refitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.progress import begin
from fingerfit.diagnosis.candidates import left_out, untestable
from fingerfit.diagnosis.comparison import Comparison, Everything
from fingerfit.diagnosis.designs import Further, identification, separation
from fingerfit.diagnosis.effect_form import NO_FORM, form_of
from fingerfit.diagnosis.errors import errors
from fingerfit.diagnosis.evidence import spare
from fingerfit.diagnosis.first_pass import widened
from fingerfit.diagnosis.form_or_state import form_or_state, shown
from fingerfit.diagnosis.mesh_errors import by_finer_mesh
from fingerfit.diagnosis.ranges import not_excluded
from fingerfit.diagnosis.ranking import Ranked, stiffness_map
from fingerfit.diagnosis.refit import Refit, explains, loud
from fingerfit.diagnosis.reservations import (
    by_settings,
    doubted,
    largest_part,
    leave_mesh,
    loud_by_mesh,
    not_needed,
    of_family,
    perhaps,
    some_far_off,
    too_coarse,
    untried,
    with_blur,
)
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.second_queue import by_one_likelihood, pair_of, partner_of, refit_best
from fingerfit.diagnosis.sides import Sides, sides_of
from fingerfit.diagnosis.tested import test_all
from fingerfit.diagnosis.traces import small_part, traced
from fingerfit.diagnosis.verdict import (
    Verdict,
    beside_probe,
    both_explain,
    decide,
    generalising,
    half_explained,
    nearest,
)
from fingerfit.diagnosis.worth import blamed_on_mesh, most_of, too_small
from fingerfit.fit.lost import Lost
from fingerfit.fit.minimum import minimum
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.model.effect import MESH_ERROR, OUTLINE, Effect
from fingerfit.settings.extend import rivals, with_model
from fingerfit.study.several import AT

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
    unsolved : dict
        Effects that do not count, by title, since the solver ended their simulations without an answer: how it did.
    spare : list of Effect
        Effects of an adequate model that it may not need: as from `spare`.
    not_excluded : list of Ranked
        Effects that an adequate model may lack: as from `not_excluded`.
    outlined : Refit, optional
        Of the model with the sides that the picture before compression shows, where they lie elsewhere.
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
    unsolved: dict[str, str]
    spare: list[Effect]
    not_excluded: list[Ranked]
    outlined: Refit | None = None


def diagnose(
    problem: InverseProblem,
    last: Round,
    everything: Everything,
    threads: int = 1,
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

    Raises
    ------
    SolverError
        When the solver ends a simulation of the fitted model itself without an answer, or is not there.
    """
    with Lost.noting([one.lost for one in (problem, *problem.every)]) as lost:
        found = _diagnose(problem, last, everything, threads)
        if found.verdict.kind == "unexplained" and (sides := sides_of(found.comparison)).off:
            # neither another form nor a state explains it: where the sides lie is not what is missing, or not all
            again = _diagnose(problem, last, everything, threads, Sides())
            text = f"{again.verdict.sentence}; {shown(sides)}"
            found = replace(again, verdict=replace(again.verdict, sentence=text), run=found.run + again.run)
        problem.asked.difference_update(lost.names)  # they have no answer, and are none of those that were run
    return found


def _diagnose(
    problem: InverseProblem,
    last: Round,
    everything: Everything,
    threads: int,
    sides: Sides | None = None,
) -> Diagnosis:
    """As `diagnose`, where simulations that the solver ends without an answer are noted.

    With `sides` as if they lay there.
    """
    found = test_all(problem, last, everything, threads, sides=sides)
    run, refits = found.run, dict[str, Refit]()
    fitted, held_out = errors(found.comparison)
    at_least, held = found.but_mesh
    score_test, ranking = found.score_test, found.ranking
    if loud(at_least, score_test.freedom):  # that something is missing is known: nothing is named by chance
        found = replace(found, tests=1)
    tests, pictured = found.tests, all(len(test.data.picture_step) for test in found.comparison.every)
    halves, ended = set[str](), dict[str, Refit]()
    bright = {one.candidate.effect.name for one in ranking if one.candidate.effect.on_brightness}
    outline = found.outline
    verdict = decide(score_test, ranking, {}, tests, held_out=held)
    unexplained = not explains(score_test)
    # before any effect is blamed: what a mesh leaves may be no more than the noise, and still be most of what is seen
    blames = unexplained or verdict.kind != "adequate"
    by_mesh, finer, more = (0.0, "", 0)
    if blames and not outline.off:
        by_mesh, finer, more = by_finer_mesh(found.comparison, score_test, threads)
    run += more
    coarse = blamed_on_mesh(by_mesh, score_test, ranking)
    seen = 0.0 if unexplained else most_of(ranking)
    probed = any(effect.probe for effect in problem.settings.effects())
    # of a body of another shape, and of one that is not solved well, refits say nothing
    no_refits = coarse or (outline.off and unexplained) or too_small(score_test, ranking, at_least)
    # a probe is likelier than its members, but two of these may be what it imitates
    nothing = dict[str, Refit](), None, 0
    pair, partner, more = nothing if no_refits or probed else pair_of(found, held, threads)
    run += more
    halves.update(pair)
    if partner is not None:
        verdict = decide(score_test, ranking, pair, tests, partner, held)
        refits = ended = pair if verdict.kind == "missing" else {}
    for _ in range(0 if no_refits or refits else BATCHES):
        run += refit_best(found, refits, threads)
        refits = by_one_likelihood({**pair, **refits}, found.comparison.weighed)
        well = {name: refit for name, refit in refits.items() if not refit.missed}
        ended, missed = nearest(well, bright), refits.keys() - well.keys()
        verdict = decide(score_test, ranking, ended, tests, None, held, missed)
        verdict = doubted(verdict, at_least, held if pictured else None, score_test.freedom)
        verdict = small_part(verdict, score_test, ranking, ended, at_least)
        half = half_explained(score_test, ranking, generalising(score_test, ended, held), tests)
        # a probe has as many numbers as several effects: no partner is looked for beside it
        one = None if half and half.candidate.effect.probe else half
        if one is None:
            one = beside_probe(ranking, ended, generalising(score_test, well, held), score_test.misfit)
        if one is not None and not (probed or one.candidate.effect.name in halves):
            name = one.candidate.effect.name
            halves.add(name)
            partner, more = partner_of(one, found, threads)
            run += more
            if partner and one is not half and partner[0].candidate.effect.probe:
                partner = None  # it says no more than the probe that came nearest
            if both_explain(score_test, partner, held):
                ended = {name: well[name]}
                verdict = decide(score_test, ranking, ended, tests, partner, held)
        if verdict.kind != "unexplained":
            break
    general, beside = generalising(score_test, ended, held), bool(problem.settings.model.effects)
    verdict = largest_part(verdict, score_test, ranking, general, fitted, refits, held_out, beside)
    estimate = minimum(problem, last).values
    constants = problem.settings.model.parameters
    own = {p.name: estimate[p.name] for p in problem.settings.parameters() if p.name.partition(AT)[0] in constants}
    base = Refit(score_test.misfit, score_test.freedom, fitted, held_out, own, but_mesh=found.but_mesh)
    tolerance = problem.settings.fit.tolerance
    blamed = [one.candidate.effect for one in ranking if one.candidate.effect.name in verdict.effects]
    form = form_of(found.comparison, blamed, refits) if verdict.kind != "adequate" else NO_FORM
    verdict = traced(verdict, score_test, ranking, refits, base, tolerance, tests, form)
    measurements = list[tuple[str, float]]()
    begin("what further measurements would tell")
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
            verdict = too_coarse(verdict, score_test, (by_mesh, finer), seen, mesh, fitted)
        no_form = all(problem.effects[name].probe for name in verdict.effects) and not (coarse or outline.off)
        by_mesh_too = by_mesh > 0.0 and not unexplained and leave_mesh(verdict.effects, refits)
        verdict = loud_by_mesh(verdict, fitted, at_least, mesh, no_form or by_mesh_too)
    outlined: Refit | None = None
    if outline.off and verdict.kind != "adequate" and problem.settings.tries(OUTLINE):
        verdict, states, outlined, more = form_or_state(verdict, found, refits, threads)
        begins = {one.candidate.effect.name: one for one, _ in states}
        ranking = [begins.get(one.candidate.effect.name, one) for one in ranking]
        refits |= {one.candidate.effect.name: refit for one, refit in states}
        run += more
    needless = spare(problem, score_test, found.comparison.base.values) if verdict.kind == "adequate" else []
    verdict = with_blur(not_needed(some_far_off(verdict, found.comparison), needless), found.comparison)
    maybe = not_excluded(ranking, score_test, refits, tests) if verdict.kind == "adequate" else []
    verdict = perhaps(verdict, [one.candidate.effect.title for one in maybe])
    untold = found.lacking, untestable(problem), left_out(problem)
    verdict = untried(verdict, problem.settings.solver, list(found.lacking), len(untold[-1]), list(found.unsolved))
    return Diagnosis(
        found.comparison, score_test, ranking, refits, verdict, run, measurements, further, stiffness, *untold,
        found.unsolved, needless, maybe, outlined,
    )  # fmt: skip


def added(problem: InverseProblem, last: Round, found: Diagnosis, name: str) -> InverseProblem:
    """Fit of the model with an effect that was named, on the way of its refit: none of its simulations is new.

    Raises
    ------
    InputError
        For an effect that was not refitted.
    """
    one = next((one for one in found.ranking if one.candidate.effect.name == name), None)
    if one is None or name not in found.refits:
        raise InputError("add", "effect", name, f"one that was refitted: {', '.join(found.refits) or 'here none was'}")
    wider = widened(problem, minimum(problem, last).values, one, found.refits[name].share)
    refits = found.refits | ({OUTLINE: found.outlined} if found.outlined else {})
    intervals = {other: refit.intervals for other, refit in refits.items()}
    known = rivals(problem.settings, name, refits[name].values, found.verdict.effects, intervals)
    known = problem.settings.model.rivals | known
    return wider.with_settings(with_model(wider.settings, rivals=known))
