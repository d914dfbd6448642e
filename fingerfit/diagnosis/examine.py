"""A fitted model examined: compared with everything that was measured, suspects tested, the best refitted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from fingerfit.core.errors import InputError, StateError
from fingerfit.diagnosis.candidates import suspects, untestable
from fingerfit.diagnosis.designs import separation
from fingerfit.diagnosis.examination import (
    Examination,
    Look,
    anchor_of,
    best_places,
    stiffness_map,
    try_suspects,
)
from fingerfit.diagnosis.score_test import Judge
from fingerfit.diagnosis.verdict import (
    SEEN,
    Refit,
    Verdict,
    by_settings,
    decide,
    doubted,
    explains,
    generalising,
    half_explained,
    threshold,
    to_refit,
    untried,
)
from fingerfit.fit.linear import moved
from fingerfit.fit.problem import SEARCH, Fit
from fingerfit.fit.refine import finest, minimum
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.simulate import run_fit, solve_missing
from fingerfit.settings.extend import extended
from fingerfit.study.data import Data

SECOND = 6
"""Effects that are looked at again before any is refitted, in space."""
BATCHES = 2
"""How often the next best effects are refitted, as long as none explains what is left."""


@dataclass(frozen=True)
class Examined:
    """All that was found out about a model.

    Parameters
    ----------
    examination : Examination
    judge : Judge
    looks : list of Look
        Tested effects, the best first.
    refits : dict
        Refits of the best ones, by effect.
    verdict : Verdict
    run : int
        Simulations that were not known before.
    measurements : list of (str, float)
        Changes of the measurement and by how much each would separate the first two effects better.
    stiffness : ndarray, shape (places, dim + 2)
        As from `stiffness_map`.
    lacking : dict
        Effects that were not tried, by title, and what the solver lacks for them.
    untestable : dict
        Effects that were not tried, by title, and what would have to be measured.
    """

    examination: Examination
    judge: Judge
    looks: list[Look]
    refits: dict[str, Refit]
    verdict: Verdict
    run: int
    measurements: list[tuple[str, float]]
    stiffness: np.ndarray
    lacking: dict[str, InputError]
    untestable: dict[str, InputError]


def examine(fit: Fit, last: Round, everything: Data, threads: int = 1) -> Examined:
    """Examine a fitted model.

    Parameters
    ----------
    fit : Fit
    last : Round
        Its last round, all simulations solved.
    everything : Data
        Prepared with all pictures, fitted or not.
    threads : int
        Simulations beside each other.
    """
    found = _look(fit, last, everything, threads)
    run, refits = found.run, dict[str, Refit]()
    judge, looks, tests = found.judge, found.looks, found.tests
    halves: set[str] = set()
    fitted, held_out = errors(found.examination)
    for _ in range(BATCHES):
        run += _refit_best(fit, last, everything, found, refits, threads)
        verdict = doubted(decide(judge, looks, refits, tests, held_out=held_out), fitted)
        half = half_explained(judge, looks, generalising(judge, refits, held_out), tests)
        if half is not None and half.suspect.effect.name not in halves:
            halves.add(half.suspect.effect.name)
            partner, more = _partner(fit, last, half, everything, judge.misfit, threads)
            verdict, run = decide(judge, looks, refits, tests, partner, held_out), run + more
        if verdict.kind != "unexplained":
            break
    measurements: list[tuple[str, float]] = []
    if verdict.kind == "indistinguishable":
        blamed = {one.suspect.effect.name: one for one in looks}
        first, second = (blamed[name] for name in verdict.effects[:2])
        measurements, more = separation(found.examination, first, second, threads)
        run += more
    stiffness = stiffness_map(found.examination, found.everywhere)
    verdict = by_settings(verdict, judge, looks, tests)
    verdict = untried(verdict, fit.settings.solver, list(found.lacking))
    untold = found.lacking, untestable(fit)
    return Examined(found.examination, judge, looks, refits, verdict, run, measurements, stiffness, *untold)


@dataclass(frozen=True)
class _Looked:
    """All suspects tested against what a model leaves: at all places, and the best place of each."""

    examination: Examination
    judge: Judge
    everywhere: list[Look]
    looks: list[Look]
    tests: int
    run: int
    lacking: dict[str, InputError]


def _look(fit: Fit, last: Round, everything: Data, threads: int) -> _Looked:
    found, lacking = suspects(fit, finest(fit, last).values)
    run = solve_missing(fit, [anchor_of(fit, last), *(asked for suspect in found for asked in suspect.asked)], threads)
    examination = Examination(fit, last, everything)
    judge = examination.judge
    everywhere = try_suspects(examination, judge, found)
    looks = best_places(everywhere)
    if fit.meshes[SEARCH].dim == 3:
        looks, more = look_again(examination, judge, looks, len(found), threads)
        run += more
    return _Looked(examination, judge, everywhere, looks, len(found), run, lacking)


def _refit_best(fit: Fit, last: Round, everything: Data, found: _Looked, refits: dict[str, Refit], threads: int) -> int:
    """Refit the best effects that are not in `refits` yet, and put them there; how many simulations were not known."""
    run = 0
    for candidate, refit, more in _refits(fit, last, everything, found, threads, tuple(refits)):
        refits[candidate.suspect.effect.name] = refit
        run += more
    return run


def _refits(
    fit: Fit, last: Round, everything: Data, found: _Looked, threads: int, known: Collection[str] = ()
) -> Iterator[tuple[Look, Refit, int]]:
    """The effects that are worth it, each with its refit and how many simulations were not known, one by one."""
    for candidate in to_refit(found.judge, found.looks, found.tests, known):
        try:
            yield candidate, *_refit(fit, last, candidate, everything, found, threads)
        except StateError:
            continue  # bodies without a solution explain nothing


def _partner(
    fit: Fit, last: Round, half: Look, everything: Data, before: float, threads: int
) -> tuple[tuple[Look, Refit] | None, int]:
    """The effect that explains most of what another one leaves, and the refit of both.

    It is looked for where the refit of the first one ended, as the next rung would, whose simulations these are.
    """
    ended, run = _ended(fit, last, half, everything, before, threads)
    found, best = _look(ended.fit, ended.last, everything, threads), None
    run += found.run
    for candidate, refit, more in _refits(ended.fit, ended.last, everything, found, threads):
        run += more
        if best is None or refit.misfit < best[1].misfit:
            best = candidate, refit
        if explains(refit):
            break
    fit.asked.update(ended.fit.asked)
    return best, run


def look_again(
    examination: Examination, judge: Judge, looks: list[Look], tests: int, threads: int = 1
) -> tuple[list[Look], int]:
    """Ranking by one simulation more of the best effects, each at its predicted size, the constants following.

    Slopes rank large effects badly. In space, where a refit costs tens of simulations, it pays to ask once more.

    Returns
    -------
    list of Look
        The best first; falls and sizes as the second look predicts them.
    int
        Simulations that were not known before.
    """
    fit, limit = examination.fit, threshold(judge, looks, tests)
    chosen = {
        number: _at_size(examination, judge, one)
        for number, one in enumerate(looks[:SECOND])
        if one.suspect.asked and one.finding.fall > limit and one.finding.visible > SEEN
    }
    run = solve_missing(fit, list(chosen.values()), threads)
    found, null = list(looks), examination.read(examination.anchor)
    for number, asked in chosen.items():
        one, there = looks[number], examination.read(asked)
        if there is None or null is None:
            continue
        again = judge.test((there - null)[examination.residual.kept][:, None], np.zeros(1), np.array([1.5]))
        parameters = one.suspect.effect.parameters
        bounds = ([p.lower - p.null for p in parameters], [p.upper - p.null for p in parameters])
        size = np.clip(one.finding.size * again.size[0], *bounds)
        found[number] = replace(one, finding=replace(one.finding, fall=again.fall, size=size))
    return sorted(found, key=lambda one: -one.finding.fall), run


def _at_size(examination: Examination, judge: Judge, one: Look) -> Asked:
    """The simulation of an effect at its predicted size, with the constants where they would follow it."""
    fit, effect = examination.fit, one.suspect.effect
    parameters, values = fit.settings.parameters(), examination.base.values
    change = np.clip(judge.follow(one.columns @ one.finding.size), -1.0, 1.0)
    size = {effect.key(name): value for name, value in one.size.items()}
    return fit.ask({**values, **moved(parameters, values, change), **one.suspect.place, **size}, f"{effect.name} again")


def errors(examination: Examination) -> tuple[float, float | None]:
    """Error of fitted and of held-out pictures in units of the noise floor; 1 is the noise.

    Without pictures: of the steps' points and forces (or displacements), each in units of its noise.
    """
    if not len(examination.data.picture_step):
        return _errors_by_step(examination)
    ratio = examination.residual.error / examination.floor
    fitted = fitted_pictures(examination.fit, examination.data)
    held = ratio[~fitted]
    return _root_mean_square(ratio[fitted]), _root_mean_square(held) if len(held) else None


def fitted_pictures(fit: Fit, data: Data) -> np.ndarray:
    """Which pictures the fit used, bool."""
    return fitted_steps(fit, data)[: len(data.picture_step)]


def fitted_steps(fit: Fit, data: Data) -> np.ndarray:
    """Which fields of displacements, of pictures and of points, are of steps that the fit used, bool."""
    return are_fitted(fit, data, data.entry_step)


def are_fitted(fit: Fit, data: Data, steps: np.ndarray) -> np.ndarray:
    """Whether the fit used steps, by their indices, bool."""
    wanted = fit.settings.fit.steps
    return np.array([wanted is None or int(data.step[step]) in wanted for step in steps], dtype=bool)


def _errors_by_step(examination: Examination) -> tuple[float, float | None]:
    residual = examination.residual
    fitted = are_fitted(examination.fit, examination.data, examination.step_of())
    noise = residual.covariance + examination.control_covariance()
    found = []
    for chosen in (fitted, ~fitted):
        own = np.linalg.cholesky(noise[np.ix_(chosen, chosen)])
        found.append(_root_mean_square(np.linalg.solve(own, residual.vector[chosen])) if chosen.any() else None)
    return float("nan") if found[0] is None else found[0], found[1]


def _refit(fit: Fit, last: Round, one: Look, everything: Data, found: _Looked, threads: int) -> tuple[Refit, int]:
    ended, run = _ended(fit, last, one, everything, found.judge.misfit, threads)
    fitted, held_out = errors(ended.examination)
    judge, values = ended.judge, minimum(ended.fit, ended.last).values
    common = judge.common_misfit, judge.common_freedom
    start = ended.fit.settings.model.effects[one.suspect.effect.name]
    count, fall = len(ended.fit.asked), _fall(found.examination, ended.examination)
    return Refit(judge.misfit, judge.freedom, fitted, held_out, values, *common, ended.share, start, count, fall), run


def _fall(before: Examination, after: Examination) -> float:
    """Fall of the misfit from one model to the next, both weighed by the covariance of the first."""
    kept = before.residual.kept & after.residual.kept
    rows = kept[before.residual.kept], kept[after.residual.kept]
    covariance, nuisance = before.covariance[np.ix_(rows[0], rows[0])], before.nuisance()[rows[0]]
    first, second = (
        Judge(one.residual.vector[its], covariance, one.own()[its], nuisance).misfit
        for one, its in zip((before, after), rows, strict=True)
    )
    return first - second


@dataclass(frozen=True)
class _Ended:
    """A model with one effect more, fitted and compared with everything."""

    fit: Fit
    last: Round
    examination: Examination
    judge: Judge
    share: float


def _ended(fit: Fit, last: Round, one: Look, everything: Data, before: float, threads: int) -> tuple[_Ended, int]:
    """A refit from the predicted size, and from a tenth of it where that ends worse than the model without the effect.

    A prediction from slopes can be far too large, and a search that starts there finds another valley, or bodies
    without a solution.

    Raises
    ------
    StateError
        When there is no solution on either way.
    """
    try:
        ended, run = _fitted(fit, last, one, everything, threads, 1.0)
    except StateError:
        return _fitted(fit, last, one, everything, threads, 0.1)
    if ended.judge.misfit >= before:
        other, more = _fitted(fit, last, one, everything, threads, 0.1)
        ended, run = min(ended, other, key=lambda each: each.judge.misfit), run + more
    return ended, run


def _fitted(fit: Fit, last: Round, one: Look, everything: Data, threads: int, share: float) -> tuple[_Ended, int]:
    wider = widened(fit, last, one, share)
    try:
        end, run = run_fit(wider, threads)
        run += solve_missing(wider, [anchor_of(wider, end)], threads)
    finally:
        fit.asked.update(wider.asked)
    examination = Examination(wider, end, everything)
    return _Ended(wider, end, examination, examination.judge, share), run


def added(fit: Fit, last: Round, found: Examined, name: str) -> Fit:
    """Fit of the model with an effect that was blamed, on the way of its refit: none of its simulations is new."""
    one = next(look for look in found.looks if look.suspect.effect.name == name)
    return widened(fit, last, one, found.refits[name].share)


def widened(fit: Fit, last: Round, one: Look, share: float = 1.0) -> Fit:
    """Fit of the model with a tested effect more, from where `fit` ended and a share of the predicted size.

    The size has few digits: `fingerfit add` writes it, and the model that is made so asks for the same simulations.
    """
    effect = one.suspect.effect
    size = {p.name: float(f"{p.null + share * (one.size[p.name] - p.null):.4g}") for p in effect.parameters}
    settings = extended(fit.settings, effect, one.suspect.place, size, minimum(fit, last).values)
    return Fit(settings, fit.data, fit.mesh_files, fit.sims)


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
