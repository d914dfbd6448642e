"""The first pass: candidates refitted on displacements that are registered once, and on the response.

The residual r0 of the fitted model is known at patches of material. Another model's is r0 - (u - u0), with u and u0 the
displacements of the two models at the same patches: no picture is warped. So each candidate is refitted, its numbers
together with the model's own constants, by least squares within bounds (a trust-region method: Branch, Coleman and Li
1999), always weighed by the covariance of the model without it. Brightness is left to the second pass, and so are
patches that are farther off than registration reaches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.diagnosis.budget import MOVES
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.evidence import information
from fingerfit.diagnosis.ranking import Ranked, Refitted, within_bounds
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.fit.first_order import beside
from fingerfit.fit.intervals import bound_of
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Asked, simulations
from fingerfit.fit.slopes import STEP, bounds_of, coordinates, difference, moved
from fingerfit.imaging.registration import FARTHEST
from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.settings.extend import extended
from fingerfit.solvers.contract import Outcome

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

MOVE = 0.7
"""Longest first move, in a logarithm or as a share of a scale: a modulus doubles."""
FALL = 2e-3
"""Share of the misfit by which a move must lower it for another one to follow."""
STILL = 1e-4
"""A move shorter than this share of the way so far is the last one: 0.01 %. A choice."""
NEAR = 0.1 * STEP
"""Step of slopes by the tangent, which no tolerance of a solver blurs: by Poisson's ratio the bulk modulus changes ten
times as much. Elements have their moduli to four decimals of the logarithm, a sixtieth of it."""
BLIND = 0.01
"""Change of all values together, in units of their noise, that a number makes which is moved by its scale: one that
makes less at the start stays there. Rounding alone would lead it anywhere."""
GRID = 5
"""Decimals of a distance: sums in another order must not ask for other simulations."""


class FirstPass:
    """Refits against what a fitted model leaves.

    Parameters
    ----------
    comparison : Comparison
        Of the model without any candidate; its anchor is solved.
    threads : int
        Simulations beside each other.

    Raises
    ------
    StateError
        When the model has no solution on the search mesh.
    """

    def __init__(self, comparison: Comparison, threads: int = 1) -> None:
        self.comparison, self.threads = comparison, threads
        anchor = comparison.read(comparison.anchor)
        if anchor is None:
            raise StateError("the estimate has no solution on the search mesh")
        self.rows = comparison.kept & _followed(comparison)
        self._left, self._anchor = np.where(comparison.kept, comparison.whole, 0.0), anchor
        self._inside = inside = self.rows[comparison.kept]
        covariance, nuisance = comparison.covariance[np.ix_(inside, inside)], comparison.nuisance()[inside]
        # of a model without numbers of its own: they are fitted here, not projected away
        self._weights = ScoreTest(comparison.vector[inside], covariance, np.zeros((self.count, 0)), nuisance)

    @cached_property
    def known(self) -> dict[str, np.ndarray]:
        """Slopes of the fitted model, by its parameters, shape (values,) each; those that were taken only."""
        comparison = self.comparison
        taken = [p for p in comparison.problem.settings.parameters() if comparison.slope(p.name).any()]
        return {p.name: -self.whiten(comparison.column(p)) for p in taken}

    @cached_property
    def _score_test(self) -> ScoreTest:
        comparison, inside = self.comparison, self._inside
        return self._weights.of_another(comparison.vector[inside], comparison.own()[inside], comparison.known)

    def promised(self, one: Ranked) -> Ranked:
        """An effect with what slopes predict of the values that are fitted here alone."""
        return replace(one, finding=within_bounds(self._score_test, one.candidate.effect, one.columns[self._inside]))

    @property
    def count(self) -> int:
        """Number of values that are fitted."""
        return int(self.rows.sum())

    def refit(
        self,
        problem: InverseProblem,
        start: Mapping[str, float],
        effect: Effect | None = None,
        moves: int = MOVES,
        near: bool = False,
    ) -> Refitted:
        """Refit a model from a start that has a solution.

        Parameters
        ----------
        problem : InverseProblem
            Of the model: that of the comparison, or one with effects more.
        start : mapping
            Its constants and numbers of effects, in their units.
        effect : Effect, optional
            The one whose evidence is asked for.
        moves : int
            At most as many.
        near : bool
            Whether the start is near the fitted model, whose slopes then do for the first move, and what is found is
            looked at again: later moves take the slopes that the earlier ones showed (Broyden 1965).

        Raises
        ------
        StateError
            When the start has no solution, or the solver ends one of its simulations without an answer.
        """
        path = Way(self, problem, start, self.known if near else {}, secant=near)
        begin = np.zeros(len(path.parameters))
        if not np.isfinite(path.residual(begin)).all():
            raise StateError("the start of a refit has no solution")
        free = np.linalg.norm(path.slopes(begin), axis=0) > BLIND
        free |= not free.any()
        end, found = path.minimum(free, FALL, moves)
        values = path.values(end)
        bound = tuple(p.name for p in path.parameters if bound_of(p, values[p.name]) is not None)
        slopes = np.zeros((path.count, len(free)))
        slopes[:, free] = found.jac
        known, misfit = information(path.parameters, values, slopes, effect), float(2.0 * found.cost)
        return Refitted(values, misfit, found.status > 0, bound, path.run, path.count, known)

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Values, or columns of them, in units of their noise; those that are fitted only."""
        return self._weights.whiten(columns[self.rows])

    def left(self, change: np.ndarray) -> np.ndarray:
        """What a model leaves whose solution differs so from that of the fitted one, in units of the noise."""
        return self.whiten(self._left - change)

    def change(self, read: np.ndarray) -> np.ndarray:
        """How a solution differs from that of the fitted model, shape (all,)."""
        return read - self._anchor


def widened(problem: InverseProblem, values: Mapping[str, float], one: Ranked, share: float = 1.0) -> InverseProblem:
    """The problem of the model with a candidate more, that starts where its refit of the first pass ended.

    Where there is none, or with a share of the size, at that of the predicted size, with the constants of the model
    without it, `values`. The numbers have few digits: `fingerfit add` writes them, and the model that is made so asks
    for the same simulations.

    Parameters
    ----------
    problem : InverseProblem
        Of the model without it.
    values : mapping
        Constants of that model and numbers of its effects, in their units.
    one : Ranked
        The candidate.
    share : float
        Of the predicted size at which it starts.
    """
    effect = one.candidate.effect
    size = {p.name: _few(p.null + share * (one.size[p.name] - p.null)) for p in effect.parameters}
    place = {name: _few(value) for name, value in one.place.items()}
    if one.refitted and share == 1.0:
        values = {name: _few(one.refitted.values[name]) for name in values}
    settings = extended(problem.settings, effect, place, size, values)
    return problem.with_settings(settings)


def _few(value: float) -> float:
    return float(f"{value:.4g}")


class Way:
    """The way of one refit: from a distance in search coordinates to what the model leaves there, and its slopes."""

    def __init__(
        self,
        owner: FirstPass,
        problem: InverseProblem,
        start: Mapping[str, float],
        known: Mapping[str, np.ndarray],
        secant: bool = False,
    ) -> None:
        self.owner, self.problem, self.start, self.run = owner, problem, dict(start), 0
        self._known, self._secant = known, secant
        self._before: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._asked: Asked | None = None
        self.parameters: tuple[Parameter, ...] = problem.settings.parameters()
        self.priors = problem.priors
        self.count = owner.count + len(self.priors.rows)
        comparison = owner.comparison
        effects = problem.settings.effects()
        names = problem.settings.names_of
        absent = {name: value for e in effects for key, value in e.null().items() for name in names(key)}
        self._base = {**absent, **comparison.base.values}
        around = {**problem.settings.fixed(), **self.start, **self._base}
        self._linear = {n for e in effects if e.observes_alone for p in e.parameters for n in names(e.key(p.name))}
        self._observed = {
            name: comparison.observed(effect, around, name.partition(".")[2])
            for effect in effects
            if effect.observes
            for p in effect.parameters
            for name in names(effect.key(p.name))
        }

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the distances; a start on a bound lies a little inside."""
        at = coordinates(self.parameters, self.start)
        lower, upper = (end - at for end in bounds_of(self.parameters))
        return np.minimum(lower, -1e-6), np.maximum(upper, 1e-6)

    def minimum(self, free: np.ndarray, fall: float, moves: int) -> tuple[np.ndarray, OptimizeResult]:
        """Least squares from the start.

        Parameters
        ----------
        free : ndarray of bool, shape (parameters,)
            Numbers that are moved, at least one.
        fall : float
            Share of the misfit by which a move must lower it for another one to follow.
        moves : int
            At most as many.

        Returns
        -------
        ndarray, shape (parameters,)
            The distance where it ended.
        OptimizeResult
            Of the free numbers.
        """
        from scipy.optimize import least_squares

        def whole(x: np.ndarray) -> np.ndarray:
            delta: np.ndarray = np.zeros(len(free))
            delta[free] = x
            return delta

        found = least_squares(
            lambda x: self.residual(whole(x)), np.zeros(free.sum()), lambda x: self.slopes(whole(x))[:, free],
            [ends[free] for ends in self.bounds],
            x_scale=MOVE, ftol=fall, xtol=STILL, gtol=None, max_nfev=moves,
        )  # fmt: skip
        return whole(found.x), found

    def values(self, delta: np.ndarray) -> dict[str, float]:
        """The guess at a distance, shape (parameters,)."""
        return moved(self.parameters, self.start, np.round(delta, GRID))

    def residual(self, delta: np.ndarray) -> np.ndarray:
        """What the model leaves there, in units of the noise, shape (values,); infinite without a solution."""
        asked = self._ask(self.values(delta))
        self._solve([asked])
        found = self._left(asked)
        return np.full(self.count, np.inf) if found is None else found

    def slopes(self, delta: np.ndarray) -> np.ndarray:
        """Derivatives of that, shape (values, parameters); 0 where neither side has a solution."""
        if self._before is not None and np.array_equal(delta, self._before[0]):
            return self._before[2]
        if self._secant and self._before is not None:
            here, (last, left, columns) = self.residual(delta), self._before
            move = delta - last
            columns = columns + np.outer(here - left - columns @ move, move / (move @ move))
        else:
            columns = self._differences(delta)
            here = self.residual(delta)
        self._before = delta.copy(), here, columns
        return columns

    def _differences(self, delta: np.ndarray) -> np.ndarray:
        columns, signs = np.zeros((self.count, len(delta))), dict[int, float]()
        columns[self.owner.count :] = -self.priors.rows
        for n, p in enumerate(self.parameters):
            if p.name in self._linear:
                columns[: self.owner.count, n] = -self.owner.whiten(self._observed[p.name]) * p.scale
            elif not delta.any() and p.name in self._known:
                columns[: self.owner.count, n] = self._known[p.name]
            else:
                signs[n] = 1.0 if delta[n] + STEP <= self.bounds[1][n] else -1.0
        for n, slope in self._slopes(delta, signs).items():
            columns[:, n] = slope
        return columns

    def _slopes(self, delta: np.ndarray, signs: Mapping[int, float]) -> dict[int, np.ndarray]:
        """Slopes by some of the numbers, to one side: by the tangent, else by simulations; none without a solution."""
        here, unit = self._ask(self.values(delta)), np.eye(len(delta))

        def moved_by(step: float, chosen: Sequence[int]) -> list[Asked]:
            return [self.problem.ask(self.values(delta + signs[n] * step * unit[n])) for n in chosen]

        self._solve([here])
        found, numbers = dict[int, np.ndarray | None](), list(signs)
        near = moved_by(NEAR, numbers)
        for n, asked, answer in zip(numbers, near, beside(self.problem, here, near), strict=True):
            if answer is not None:
                found[n] = difference(self._left(asked, answer), None, lambda: self._left(here), signs[n] * NEAR)
        simulated = [n for n in numbers if n not in found]
        # beside many numbers that nobody answers to first order: what the moves show must do
        self._secant |= len(simulated) > MOVES
        far = moved_by(STEP, simulated)
        self._solve(far)
        for n, asked in zip(simulated, far, strict=True):
            found[n] = difference(self._left(asked), None, lambda: self._left(here), signs[n] * STEP)
        return {n: slope for n, slope in found.items() if slope is not None}

    def _ask(self, values: Mapping[str, float]) -> Asked:
        """The deck of a guess, made once for what it leaves and for its slopes."""
        if self._asked is None or self._asked.values != values:
            self._asked = self.problem.ask(values)
        return self._asked

    def _solve(self, asked: Sequence[Asked]) -> None:
        own = self.problem is self.owner.comparison.problem
        self.run += solve_missing(self.problem, asked, self.owner.threads, needed=own)
        # a refit whose moves or slopes are not to be had would end where it began, and seem to explain nothing
        if why := self.problem.lost.why(one.sim for one in simulations(asked)):
            raise StateError(f"a simulation of a refit cannot be had: {why}")

    def change(self, values: Mapping[str, float]) -> np.ndarray | None:
        """How a guess that was solved differs from the fitted model, shape (all,); None where it has no solution."""
        return self._change(self._ask(values))

    def _left(self, asked: Asked, answer: Outcome | None = None) -> np.ndarray | None:
        change = self._change(asked, answer)
        return None if change is None else np.append(self.owner.left(change), self.priors.left(asked.values))

    def _change(self, asked: Asked, answer: Outcome | None = None) -> np.ndarray | None:
        comparison = self.owner.comparison
        read = comparison.read(asked) if answer is None else comparison.read_answer(asked, answer)
        if read is None:
            return None
        for name, column in self._observed.items():
            read = read + column * (asked.values[name] - self._base[name])
        return self.owner.change(read)


def _followed(comparison: Comparison) -> np.ndarray:
    """Values that the first pass fits: no brightness, and no patch that is farther off than registration reaches."""
    if len(comparison.every) > 1:
        return np.concatenate([_followed(test) for test in comparison.every])
    residual, data = comparison.residual, comparison.data
    found = np.ones(residual.value.shape, dtype=bool)
    found[..., -1] = False
    pictures = len(data.picture_step)
    with np.errstate(invalid="ignore"):
        far = np.abs(residual.value[:pictures, :, :-1]) > FARTHEST * np.asarray(data.spacing)
    found[:pictures][far.any(axis=2)] = False
    return np.concatenate([found.ravel(), np.ones(len(residual.response), dtype=bool)])
