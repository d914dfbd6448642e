"""The local minimum of the score: where the finest solution and the slopes around it say that it is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError, StateError
from fingerfit.fit.finer import as_on_finer_mesh, has_snapped, on_finer_mesh
from fingerfit.fit.intervals import SHORTEST, WIDTH, minimise, widths
from fingerfit.fit.linear import LinearModel
from fingerfit.fit.objective import Objective
from fingerfit.fit.observed import Observed, between
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, SENSITIVITY, InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.fit.slopes import STEP, bounds_of, coordinates, difference, moved, step_of, step_to
from fingerfit.forward.score import JointPrediction, Prediction
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.parameters import Parameter
from fingerfit.settings.choices import CONFIG
from fingerfit.solvers.contract import CONVERGED

TRUST = 0.3
"""Longest move by one set of slopes, in the logarithm or as a share of the scale of a parameter; a choice. Slopes of a
logarithm are an exponential's: over 0.3 they change by a third."""
IN_TURN = 3
"""How often constants, by the score, and effects on the observation, by least squares, follow each other; a choice."""
REWEIGHED = 100
"""How often a minimum is found again with what the data count there, where the score allows for an error of the model:
each time the score falls, as it is concave in the misfits (Hunter and Lange 2004). It bounds the time."""
ORDER = 1.2
"""Order of convergence of displacements at a glued corner: twice the exponent of its singularity (Williams
1952; docs/decisions/0003-two-meshes.md)."""
_LEAST = 0.1
"""Of what Richardson's formula divides by: a second mesh that is no finer than the first would give infinity
(docs/decisions/0003-two-meshes.md)."""


@dataclass(frozen=True)
class Minimum:
    """Where the finest solution and the slopes say that the minimum of the score is.

    Parameters
    ----------
    values : dict
        Constants at the minimum, in their units.
    base : Asked
        The simulation that the linear model is built on.
    model : LinearModel
    move : float
        Longest move from the base to the minimum, in the logarithm or as a multiple of the scale; of numbers that
        change the pictures faster than moduli do, in what a modulus changes as much by.
    fall : float
        Fall of the score that it promises.
    """

    values: dict[str, float]
    base: Asked
    model: LinearModel
    move: float
    fall: float


def minimum(problem: InverseProblem, last: Round) -> Minimum:
    """Minimum of the score on the finest mesh that has a solution.

    Raises
    ------
    StateError
        When no guess had a solution, or none is known on either side of the best one in a constant.
    InputError
        For a constant whose bounds are so near to each other that they leave no room for a slope.
    """
    # after steps that went wrong the next ones are short
    trust = last.best.get("trust", TRUST) if last.best and last.stage == SENSITIVITY else TRUST
    return _minimum(problem, last, finest(problem, last), trust)


def finest(problem: InverseProblem, last: Round) -> Asked:
    """The last simulation on the finest mesh that has a solution, or the best guess of the search."""
    solved = [asked for asked in last.batch if asked.role == FINAL and not unusable(problem, asked)]
    return solved[-1] if solved else problem.ask(best_values(last))


def on_search_mesh(problem: InverseProblem, last: Round) -> Minimum:
    """Minimum of the score on the mesh of the search."""
    return _minimum(problem, last, problem.ask(best_values(last)))


def partly_on_finer_mesh(problem: InverseProblem, last: Round) -> Minimum | None:
    """Minimum of the score where the finer mesh has a usable solution up to some step only, as that is continued.

    None where there is none at any step of one of the tests.
    """
    asked = on_finer_mesh(problem, last)
    if asked is None:
        return None
    made: list[Any] = []
    for test, one in zip(problem.every, asked.every, strict=True):
        outcome = as_on_finer_mesh(test, one, test.data)
        found = test.predictor(SEARCH).predict(outcome, test.seen(one.values)) if outcome else None
        if found is None:
            return None
        made.append(found.prediction)
    model = _linear_model(problem, last, problem.ask(asked.values))
    base: Any = JointPrediction(tuple(made)) if asked.tests else made[0]
    return _at_minimum(problem, asked, replace(model, base=base))


def mesh_error(
    problem: InverseProblem, found: Minimum, searched: Minimum, partly: Minimum | None = None
) -> np.ndarray | None:
    """Error of the mesh that is left, by constant, shape (parameters,) in search coordinates.

    What the finer mesh changed, continued with the order of convergence of a glued corner (Richardson; Roache
    1994 gives the way of reporting it). Of an estimate on the mesh of the search it is the change as well. None without
    a finer mesh. Constants on a logarithmic scale have their root mean square: with the same mesh, one that changed
    little did so by chance, its changes having cancelled.

    Parameters
    ----------
    problem : InverseProblem
    found, searched : Minimum
        On the finest mesh that has a solution, and on that of the search.
    partly : Minimum, optional
        As of `partly_on_finer_mesh`, where that is the mesh of the search.
    """
    on_finer = problem.mesh_of(found.base) == REFINED
    finer = found if on_finer else partly
    if finer is None:
        return None
    parameters = problem.settings.parameters()
    change = coordinates(parameters, finer.values) - coordinates(parameters, searched.values)
    alike = np.array([p.log for p in parameters], dtype=bool)
    change[alike] = np.sqrt(np.mean(change[alike] ** 2)) if alike.any() else 0.0
    return np.abs(change) * left_over(problem, problem.mesh_of(found.base))


def left_over(problem: InverseProblem, mesh: str) -> float:
    """Error of a mesh as a share of what the finer one changes, from its order of convergence; of several the largest.

    Of the finer mesh what is left of that; of the mesh of the search all of it as well.
    """
    if len(problem.every) > 1:
        return max(left_over(test, mesh) for test in problem.every)
    coarse, fine = problem.meshes[SEARCH], problem.meshes[REFINED]
    ratio = (_linear_elements(fine) / _linear_elements(coarse)) ** (1 / coarse.dim)
    return 1.0 / max(ratio**ORDER - 1.0, _LEAST) + (0.0 if mesh == REFINED else 1.0)


def _linear_elements(mesh: Mesh) -> int:
    """How many elements a mesh has, a quadratic one counted as the linear ones between all of its nodes along edges."""
    kinds = [(ELEMENTS[block.element], len(block.nodes)) for block in mesh.blocks]
    return sum(count * (2**kind.dim if kind.nodes > kind.corners else 1) for kind, count in kinds)


def _minimum(problem: InverseProblem, last: Round, base: Asked, trust: float = TRUST) -> Minimum:
    return _at_minimum(problem, base, _linear_model(problem, last, base), trust)


def _at_minimum(problem: InverseProblem, base: Asked, model: LinearModel, trust: float = TRUST) -> Minimum:
    delta = _move(problem, model, trust)
    objective = problem.objective(model)
    fall = objective(np.zeros(len(delta))) - objective(delta)
    values = moved(problem.settings.parameters(), base.values, delta)
    far = np.abs(delta) / _shares(problem, model)
    return Minimum(values, base, model, float(far.max(initial=0.0)), fall)


def _shares(problem: InverseProblem, model: LinearModel) -> np.ndarray:
    """Shares of the change of a modulus at which numbers change the pictures as that does, at most 1, (parameters,)."""
    return widths(problem.settings.parameters(), model.moving) / WIDTH


def by_data(problem: InverseProblem, found: Minimum) -> np.ndarray:
    """Move from the base to the minimum of the data alone, without priors, shape (parameters,)."""
    return _move(problem, found.model, TRUST, known=False)


def _move(problem: InverseProblem, model: LinearModel, trust: float, known: bool = True) -> np.ndarray:
    parameters = problem.settings.parameters()
    at = coordinates(parameters, model.values)
    low, high = (end - at for end in bounds_of(parameters))
    reach = trust * _shares(problem, model)
    low, high = np.maximum(low, -reach), np.minimum(high, reach)
    find, delta = _least_squares if problem.exact else _by_score, np.zeros(len(low))
    for _ in range(REWEIGHED):
        counted = problem.as_counted(model.at(delta))
        last, delta = delta, find(counted, model, low, high, known)
        if counted is problem or np.abs(delta - last).max(initial=0.0) < SHORTEST:
            break
    return delta


def _by_score(
    problem: InverseProblem, model: LinearModel, low: np.ndarray, high: np.ndarray, known: bool
) -> np.ndarray:
    """Minimum of the score; the numbers of effects on the observation are those of the least squares."""
    observed, objective = problem.observed, problem.objective(model, known)
    width = widths(problem.settings.parameters(), model.moving)
    sure = problem.unit * problem.priors.curvature if known and problem.priors else np.inf
    delta: np.ndarray = np.zeros(len(low))
    squares = Observed(observed, problem.data, model) if observed.any() else None
    for _ in range(IN_TURN if squares else 1):
        delta = _constants(problem, objective, width, delta, low, high, sure)
        if squares:
            delta[observed] = 0.0
            delta[observed] = squares.moves(low, high, model.at(delta))
    return delta


def _constants(
    problem: InverseProblem,
    score: Objective,
    width: np.ndarray,
    delta: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    sure: float,
) -> np.ndarray:
    """`delta`, moved to the minimum of the score along all but the numbers of effects on the observation."""
    free = np.flatnonzero(~problem.observed)
    low, high = (low - delta)[free], (high - delta)[free]
    found: np.ndarray = delta.copy()
    found[free] += minimise(score.along(free, delta), width[free], low=low, high=high, sure=sure)
    return found


def _least_squares(
    problem: InverseProblem, model: LinearModel, low: np.ndarray, high: np.ndarray, known: bool
) -> np.ndarray:
    """Minimum of the likelihood of forces, points and priors alone, between bounds: linear least squares."""
    left = problem.deviations(model.base)
    columns = np.stack([problem.deviations(model.base + slope) - left for slope in model.slopes], axis=1)
    if known and (priors := problem.priors):
        columns, left = np.concatenate([columns, priors.rows]), np.append(left, -priors.left(model.values))
    return between(low, high, columns, left)


def _linear_model(problem: InverseProblem, last: Round, base: Asked) -> LinearModel:
    by_role = {asked.role: asked for asked in last.batch}

    def at(role: str) -> Prediction | None:
        if role not in by_role or diverged(problem, by_role[role]):
            return None
        return problem.prediction(by_role[role])

    def middle() -> Prediction:
        return problem.prediction(problem.ask(best_values(last)))

    parameters = problem.settings.parameters()
    seen = {p.name: p for p, alone in zip(parameters, problem.observed, strict=True) if alone}

    def slope(name: str) -> Prediction:
        if not {"+" + name, "-" + name} & by_role.keys():  # a side beyond a bound was not asked for
            expected = f"bounds farther apart than two steps of a slope, {2 * STEP:g} in the logarithm"
            raise InputError(CONFIG, f"model.parameters.{name}", "bounds next to each other", expected)
        step = step_of(name, by_role, parameters, best_values(last))
        if name in seen:
            return _seen(problem, base, seen[name], step)
        found = difference(at("+" + name), at("-" + name), middle, step)
        if found is None:
            raise StateError(f"no solution on either side of the best guess in {name}")
        return found

    slopes = tuple(slope(parameter.name) for parameter in parameters)
    control = slope("control") if "+control" in by_role else None
    return LinearModel(problem.prediction(base), slopes, control, base.values)


def _seen(problem: InverseProblem, base: Asked, parameter: Parameter, step: float) -> Prediction:
    """Slope by a number that changes only what is seen of a solution: of the very one that the model is built on.

    Least squares of pictures end where they should only if the slopes have the texture where that solution has it.
    """
    ends = [{**base.values, **moved((parameter,), base.values, np.array([way]))} for way in (step, -step)]
    ahead, behind = (problem.prediction(problem.ask(end, base.role)) for end in ends)
    slope: Prediction = (ahead - behind) * (1.0 / sum(step_to(parameter, end, base.values) for end in ends))
    return slope


def best_values(last: Round) -> dict[str, float]:
    """Where the search ended.

    Raises
    ------
    StateError
        When no guess had a solution.
    """
    if last.best is None:
        raise StateError("the search found no guess with a solution")
    return dict(last.best["values"])


def diverged(problem: InverseProblem, asked: Asked) -> bool:
    """Whether a guess has no solution, in one of the tests."""
    return any(problem.answer(one.sim).status != CONVERGED for one in asked.every)


def unusable(problem: InverseProblem, asked: Asked) -> bool:
    """Whether a guess on the finer mesh has no solution, or one in which the body goes through itself or a plate.

    At glued corners a fine mesh lets the free side fold over the edge where a coarse one does not
    (`fingerfit.fit.finer.has_snapped`).
    """
    if diverged(problem, asked):
        return True
    if problem.mesh_of(asked) != REFINED:
        return False
    pairs = zip(problem.every, asked.every, strict=True)
    return problem.folds(asked) or any(has_snapped(test, one) for test, one in pairs)
