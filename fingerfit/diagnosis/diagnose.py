"""A fitted model diagnosed: compared with everything that was measured, candidates tested, the best refitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.progress import begin
from fingerfit.diagnosis.batches import Answer, before_refits, refitted
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
from fingerfit.diagnosis.sides import Sides, sides_of
from fingerfit.diagnosis.tested import Tested, test_all
from fingerfit.diagnosis.traces import traced
from fingerfit.diagnosis.verdict import Verdict, generalising
from fingerfit.diagnosis.worth import blamed_on_mesh, most_of, too_small
from fingerfit.fit.lost import Lost
from fingerfit.fit.minimum import minimum
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.model.effect import MESH_ERROR, OUTLINE, Effect
from fingerfit.settings.extend import rivals, with_model
from fingerfit.study.several import AT


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
    if loud(found.but_mesh[0], found.score_test.freedom):  # something is missing for sure: nothing is named by chance
        found = replace(found, tests=1)
    mesh, more = _mesh_of(found, threads)
    answer = _answer(found, mesh, threads)
    verdict = _what_matters(answer, found)
    run = found.run + more + answer.run
    begin("what further measurements would tell")
    further, more = identification(found.comparison, threads)
    run += more
    measurements, more = _measurements(verdict, found, threads)
    run += more
    score_test, ranking, refits = found.score_test, found.ranking, answer.refits
    stiffness = stiffness_map(found.comparison, found.everywhere)
    verdict = by_settings(of_family(verdict, score_test, ranking, answer.nearest), score_test, ranking, found.tests)
    verdict = _with_mesh(verdict, mesh, answer, found)
    outlined: Refit | None = None
    if found.outline.off and verdict.kind != "adequate" and problem.settings.tries(OUTLINE):
        verdict, states, outlined, more = form_or_state(verdict, found, refits, threads)
        begins = {one.candidate.effect.name: one for one, _ in states}
        ranking = [begins.get(one.candidate.effect.name, one) for one in ranking]
        refits |= {one.candidate.effect.name: refit for one, refit in states}
        run += more
    needless = spare(problem, score_test, found.comparison.base.values) if verdict.kind == "adequate" else []
    verdict = with_blur(not_needed(some_far_off(verdict, found.comparison), needless), found.comparison)
    maybe = not_excluded(ranking, score_test, refits, found.tests) if verdict.kind == "adequate" else []
    verdict = perhaps(verdict, [one.candidate.effect.title for one in maybe])
    untold = found.lacking, untestable(problem), left_out(problem)
    verdict = untried(verdict, problem.settings.solver, list(found.lacking), len(untold[-1]), list(found.unsolved))
    return Diagnosis(
        found.comparison, score_test, ranking, refits, verdict, run, measurements, further, stiffness, *untold,
        found.unsolved, needless, maybe, outlined,
    )  # fmt: skip


@dataclass(frozen=True)
class _Mesh:
    """By how much a finer mesh lowers the misfit, which one, and whether it comes before all effects."""

    fall: float = 0.0
    finer: str = ""
    coarse: bool = False


def _mesh_of(found: Tested, threads: int) -> tuple[_Mesh, int]:
    """What the mesh leaves, before any effect is blamed; and the simulations that were not known.

    It may be no more than the noise, and still be most of what is seen.
    """
    score_test, ranking = found.score_test, found.ranking
    if found.outline.off or (explains(score_test) and before_refits(found).verdict.kind == "adequate"):
        return _Mesh(), 0
    fall, finer, run = by_finer_mesh(found.comparison, score_test, threads)
    return _Mesh(fall, finer, blamed_on_mesh(fall, score_test, ranking)), run


def _answer(found: Tested, mesh: _Mesh, threads: int) -> Answer:
    """What refits say; of a body of another shape, and of one that is not solved well, they would say nothing."""
    another = found.outline.off and not explains(found.score_test)
    nothing = mesh.coarse or another or too_small(found.score_test, found.ranking, found.but_mesh[0])
    return before_refits(found) if nothing else refitted(found, threads)


def _what_matters(answer: Answer, found: Tested) -> Verdict:
    """The verdict, also on what is the largest part where nothing explains it all; what does not matter is a trace."""
    comparison, score_test, ranking = found.comparison, found.score_test, found.ranking
    problem, (fitted, held_out) = comparison.problem, errors(comparison)
    general, beside = generalising(score_test, answer.nearest, found.but_mesh[1]), bool(problem.settings.model.effects)
    verdict = largest_part(answer.verdict, score_test, ranking, general, fitted, answer.refits, held_out, beside)
    estimate = minimum(problem, comparison.last).values
    constants = problem.settings.model.parameters
    own = {p.name: estimate[p.name] for p in problem.settings.parameters() if p.name.partition(AT)[0] in constants}
    base = Refit(score_test.misfit, score_test.freedom, fitted, held_out, own, but_mesh=found.but_mesh)
    blamed = [one.candidate.effect for one in ranking if one.candidate.effect.name in verdict.effects]
    form = form_of(comparison, blamed, answer.refits) if verdict.kind != "adequate" else NO_FORM
    tolerance = problem.settings.fit.tolerance
    return traced(verdict, score_test, ranking, answer.refits, base, tolerance, found.tests, form)


def _measurements(verdict: Verdict, found: Tested, threads: int) -> tuple[list[tuple[str, float]], int]:
    """Changes of the measurement that would tell apart what these data cannot, as from `separation`."""
    if verdict.kind != "indistinguishable":
        return [], 0
    named = {one.candidate.effect.name: one for one in found.ranking}
    first, second = (named[name] for name in verdict.effects[:2])
    return separation(found.comparison, first, second, threads)


def _with_mesh(verdict: Verdict, mesh: _Mesh, answer: Answer, found: Tested) -> Verdict:
    """The verdict, and what the mesh leaves."""
    score_test, problem = found.score_test, found.comparison.problem
    effect = next((effect for effect in problem.effects.values() if effect.signal == MESH_ERROR), None)
    if effect is None:
        return verdict
    fitted, unexplained = errors(found.comparison)[0], not explains(score_test)
    if mesh.coarse:
        seen = 0.0 if unexplained else most_of(found.ranking)
        verdict = too_coarse(verdict, score_test, (mesh.fall, mesh.finer), seen, effect, fitted)
    no_form = all(problem.effects[name].probe for name in verdict.effects) and not (mesh.coarse or found.outline.off)
    by_mesh_too = mesh.fall > 0.0 and not unexplained and leave_mesh(verdict.effects, answer.refits)
    return loud_by_mesh(verdict, fitted, found.but_mesh[0], effect, no_form or by_mesh_too)


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
