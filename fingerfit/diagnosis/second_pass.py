"""The second pass: models with one effect more, fitted, and compared with everything that was measured.

Who asks for a refit counts its simulations, by solutions: those of one that comes to nothing have been run as well.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from fingerfit.core.errors import StateError
from fingerfit.diagnosis.comparison import Comparison, Everything, anchor_of
from fingerfit.diagnosis.errors import errors
from fingerfit.diagnosis.evidence import information, interval95
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.first_pass import widened
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.likelihood import fall, misfits
from fingerfit.diagnosis.mesh_errors import errors_but_mesh
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.score_tests import per_value
from fingerfit.diagnosis.sides import sides_of
from fingerfit.fit.jobs import solve_missing, solved, solved_since
from fingerfit.fit.minimum import minimum
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.model.effect import OUTLINE
from fingerfit.settings.extend import extended


def refit_of(before: Comparison, one: Ranked, threads: int) -> Refit:
    """The refit of an effect.

    Parameters
    ----------
    before : Comparison
        Of the model without it.
    one : Ranked
    threads : int

    Raises
    ------
    StateError
        When there is no solution.
    """
    ended = ended_of(before, one, threads)
    after, settings = ended.comparison, ended.comparison.problem.settings
    fitted, held_out = errors(after)
    score_test, values = after.score_test, minimum(after.problem, after.last).values
    start = settings.model.effects[one.candidate.effect.name]
    fitted_before = before.problem.settings.starts()
    constants = {name: value for name, value in settings.starts().items() if name in fitted_before}
    own = misfits({"before": before.weighed, "after": after.weighed}, "after")
    effect = after.problem.effects[one.candidate.effect.name]
    nulls = {name: null for key, null in effect.null().items() for name in settings.names_of(key)}
    parameters, spread = settings.parameters(), per_value(score_test.misfit, score_test.freedom)
    known = information(parameters, values, score_test.own, effect)
    return Refit(
        score_test.misfit, score_test.freedom, fitted, held_out, values,
        score_test.common_misfit, score_test.common_freedom,
        ended.share, start, len(after.problem.asked), ended.fall(before), constants, after.weighed,
        compared=own["after"], before=own["before"],
        numbers=len(parameters) - len(before.problem.settings.parameters()),
        worth=known.worth(spread, one.candidate.choices),
        intervals=interval95(parameters, values, score_test.own, spread),
        sides=sides_of(after), but_mesh=errors_but_mesh(after),
        absent=bool(nulls) and all(after.base.values.get(name, null) == null for name, null in nulls.items()),
    )  # fmt: skip


def refit_anywhere(before: Comparison, one: Ranked, threads: int) -> tuple[Refit, int]:
    """As `refit_of`; and where it explains much less than the first pass did, of the effect's other places as well.

    Returns
    -------
    Refit
        That with the largest fall.
    int
        Whose refit it is: 0 for the effect where it was, n for the n-th of ``also``.

    Raises
    ------
    StateError
        When there is no solution at any of these places.
    """
    tried = dict[int, Refit]()
    for number, there in enumerate((one, *one.also)):
        try:
            tried[number] = refit_of(before, there, threads)
        except StateError:
            continue
        if tried[number].fall >= ENOUGH * one.finding.fall:
            break
    if not tried:
        raise StateError(f"{one.candidate.effect.name}: no solution at any of its places")
    best = max(tried, key=lambda number: tried[number].fall)
    return tried[best], best


@dataclass(frozen=True)
class Ended:
    """A model with one effect more, fitted and compared with everything.

    Parameters
    ----------
    comparison : Comparison
        Of the model with the effect.
    share : float
        Of the predicted size, from which its fit began.
    """

    comparison: Comparison
    share: float

    def fall(self, before: Comparison) -> float:
        """Of the misfit against the model without the effect, both weighed by the covariance of that one."""
        return fall(before.weighed, self.comparison.weighed)


def ended_of(before: Comparison, one: Ranked, threads: int) -> Ended:
    """A refit from the predicted size, and from a tenth of it where that ends worse than the model without the effect.

    A prediction from slopes can be far too large, and a search that starts there finds another local minimum, or bodies
    without a solution.

    Raises
    ------
    StateError
        When there is no solution on either way.
    """
    try:
        ended = _fit(before, one, threads, 1.0)
    except StateError:
        return _fit(before, one, threads, 0.1)
    if ended.fall(before) <= 0.0:
        return max(ended, _fit(before, one, threads, 0.1), key=lambda each: each.fall(before))
    return ended


def _fit(before: Comparison, one: Ranked, threads: int, share: float) -> Ended:
    wider = widened(before.problem, minimum(before.problem, before.last).values, one, share)
    try:
        end = _run(wider, threads)
    finally:
        before.problem.asked.update(wider.asked)
    return Ended(comparison_of(wider, end, before.everything, find_blur=False), share)


def _run(wider: InverseProblem, threads: int) -> Round:
    """A fit, and its estimate on the mesh of the search.

    Raises
    ------
    StateError
        When there is no solution, or the solver ended a simulation without an answer: the fit may have missed its
        minimum for that.
    """
    end, _ = run_fit(wider, threads)
    solve_missing(wider, [anchor_of(wider, end)], threads)
    if why := wider.lost.why(sorted(wider.asked)):
        raise StateError(f"a simulation of a refit cannot be had: {why}")
    return end


def followed(problem: InverseProblem, last: Round, folder: Path) -> tuple[InverseProblem, Everything]:
    """The fit of a body with the sides that the first picture shows, and all its data; meshes in `folder`."""
    settings = extended(problem.settings, problem.effects[OUTLINE], {}, {}, minimum(problem, last).values)
    wider, everything = begin(settings, folder, problem.sims)
    for one in (wider, *wider.every):
        one.lost.note_with(problem.lost)
    return wider, everything


def with_outline(problem: InverseProblem, last: Round, threads: int) -> tuple[Refit | None, int]:
    """How well a body with the sides that the picture before compression shows explains what was measured.

    It has other meshes, and patches elsewhere, so that it cannot be compared value by value.

    Returns
    -------
    Refit or None
        None without a solution.
    int
        Simulations that were not known before.
    """
    known = solved(problem)
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
        wider, everything = followed(problem, last, Path(folder))
        try:
            end = _run(wider, threads)
            after = comparison_of(wider, end, everything)
            score_test, values = after.score_test, minimum(wider, end).values
            spread = per_value(score_test.misfit, score_test.freedom)
            found = Refit(
                score_test.misfit, score_test.freedom, *errors(after), values, but_mesh=errors_but_mesh(after),
                intervals=interval95(wider.settings.parameters(), values, score_test.own, spread),
            )  # fmt: skip
        except StateError:
            found = None
    problem.asked.update(wider.asked)
    return found, solved_since(problem, known)
