"""What follows a search: slopes around its best guess, the finer mesh, and the way to the minimum of the score.

Around the best guess of the search mesh the prediction is linear in the logarithms of the constants. With the
solution of the finer mesh as its base this linear model is moved to the minimum of the very score that was used,
and solved again there, until the moves are small (docs/decisions/0003-two-meshes.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError, StateError
from fingerfit.fit.intervals import minimise
from fingerfit.fit.linear import STEP, LinearModel, coordinates, moved, sensitivity_values
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, SENSITIVITY, Fit
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.score import Prediction, deviations
from fingerfit.settings.choices import CONFIG
from fingerfit.solvers.contract import CONVERGED, Outcome

ANCHOR = "anchor"
"""Role of a guess that is solved on the search mesh to be compared with the finest one."""
ADDED = "effects added"
"""Reason for the slopes of a model with effects: it starts where the model without the last one ended."""
FAR, FIRST = 0.12, 0.005
"""A longer move needs new slopes: at any time, and after the first slopes of a model with effects."""
AGAIN, AGAIN_ADDED = 3, 15
"""How often slopes are taken at most: after a search, and in a model with effects, which has none."""
FALL, FALL_SHARE = 0.5, 1e-3
"""Promised fall of a likelihood, and share of it, from which slopes are taken again in studies without pictures."""
TRUST = 0.3
"""Longest move by one set of slopes."""
IN_TURN = 3
"""How often constants, by the score, and effects on the observation, by least squares, follow each other."""
CLOSE = 0.05
"""A longer move, in the logarithm, is checked by another solution."""
NEARER = 0.01
"""The same in a model with effects, where constants and an effect may compensate each other."""
SOLUTIONS = 4
"""At most as many on the finest mesh."""
ORDER = 1.2
"""Order of convergence of displacements at a glued corner: twice the exponent of its singularity (Williams 1952)."""


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
        Longest move from the base to the minimum, in the logarithm or as a share of the distance of the bounds.
    fall : float
        Fall of the score that it promises.
    """

    values: dict[str, float]
    base: Asked
    model: LinearModel
    move: float
    fall: float


def around_best(
    fit: Fit, base: Mapping[str, Any], best: Mapping[str, float], reason: str, slopes: int = 1, rough: bool = False
) -> Round:
    """The round that asks for the slopes around the best guess, and for the finest solution there.

    Rough slopes, by one side of each constant, are for guesses that will be left: others follow in any case.
    """
    sides = sensitivity_values(fit.settings.parameters(), best)
    if rough:
        sides = {role: values for role, values in sides.items() if role[0] == "+" or "+" + role[1:] not in sides}
    # the costly one first: it runs beside the others
    batch = [fit.ask(best, FINAL), fit.ask(best, ANCHOR)]
    batch += [fit.ask(values, role) for role, values in sides.items()]
    if fit.observed.any():
        batch += _by_control(fit, best)
    return Round(stage=SENSITIVITY, stop=None, batch=batch, reason=reason, slopes=slopes, rough=rough, **base)


def _by_control(fit: Fit, best: Mapping[str, float]) -> list[Asked]:
    """Slopes by the prescribed quantity: intervals and the diagnosis need them, a move seldom."""
    return [fit.ask(best, "+control", 1.0 + STEP), fit.ask(best, "-control", 1.0 - STEP)]


def refine_round(fit: Fit, last: Round) -> Round:
    """The round after slopes or a finest solution are known: solve at the minimum of the linear model."""
    found = minimum(fit, last)
    again = AGAIN if last.history else AGAIN_ADDED
    if last.slopes < again:
        back, trust = _half_way_back(fit, last, found)
        if back is not None:
            return _slopes_again(fit, last, back, {"before": (last.best or {})["before"], "trust": trust})
        # no search came before the first slopes of a model with effects: they are taken where it was predicted to be
        far = FAR if last.reason != ADDED else FIRST if last.slopes == 1 else CLOSE
        if last.rough or found.move > far or _promises(fit, found):
            before = {"values": dict(found.base.values), "score": fit.score(found.model.base), "fall": found.fall}
            rough = last.reason == ADDED and found.move > FAR and last.slopes + 1 < again
            return _slopes_again(fit, last, found.values, {"before": before, "trust": trust}, rough)
    asked = fit.ask(found.values, FINAL)
    known = list(last.batch)
    if all(asked.role != "+control" for asked in known):
        known += _by_control(fit, best_values(last))
    solutions = sum(a.role == FINAL for a in last.batch)
    lost = solutions > 1 and _diverged(fit, last.batch[-1])
    close = NEARER if last.reason == ADDED else CLOSE
    enough = found.move <= close or solutions + 1 >= SOLUTIONS or lost
    return Round(
        number=last.number + 1,
        stage=FINAL,
        stop=last.reason if enough else None,
        solver=last.solver,
        meshes=last.meshes,
        history=last.history,
        # the same guess on the search mesh shows what the finer mesh changes there
        batch=known if lost else [*known, fit.ask(found.values, ANCHOR), asked],
        best=last.best,
        reason=last.reason,
        slopes=last.slopes,
    )


def _slopes_again(
    fit: Fit, last: Round, values: dict[str, float], memory: dict[str, Any], rough: bool = False
) -> Round:
    """The round that asks for slopes elsewhere; it remembers where the move began and how far moves are trusted."""
    base: dict[str, Any] = {
        "number": last.number + 1,
        "solver": last.solver,
        "meshes": last.meshes,
        "history": last.history,
        "best": {"values": values, "score": None, **memory},
    }
    return around_best(fit, base, values, last.reason or "", last.slopes + 1, rough)


def _half_way_back(fit: Fit, last: Round, found: Minimum) -> tuple[dict[str, float] | None, float]:
    """Half of a move that raised the score, or None where it did not; and how far the next one is trusted.

    By the share of the promised fall that came true (Levenberg and Marquardt's method with a trust region: More 1978).
    """
    best = last.best or {}
    before, trust = best.get("before"), best.get("trust", TRUST)
    if last.stage != SENSITIVITY or before is None or not before["fall"] > 0:
        return None, trust
    true = (before["score"] - fit.score(found.model.base)) / before["fall"]
    trust = 0.4 * trust if true < 0.25 else min(2 * trust, TRUST) if true > 0.75 else trust
    parameters = fit.settings.parameters()
    way = 0.4 * (coordinates(parameters, found.base.values) - coordinates(parameters, before["values"]))
    # so near to where the move began that there is nothing to go back to
    if true > 0.01 or np.abs(way).max() < NEARER:
        return None, trust
    return moved(parameters, before["values"], way), trust


def _promises(fit: Fit, found: Minimum) -> bool:
    """Whether forces and points alone, cheap and exact, still see a move that is short."""
    return fit.exact and found.fall > max(FALL, FALL_SHARE * fit.score(found.model.base))


def minimum(fit: Fit, last: Round) -> Minimum:
    """Minimum of the score on the finest mesh that has a solution."""
    # after moves that went wrong the next ones are short
    trust = last.best.get("trust", TRUST) if last.best and last.stage == SENSITIVITY else TRUST
    return _minimum(fit, last, finest(fit, last), trust)


def finest(fit: Fit, last: Round) -> Asked:
    """The last simulation on the finest mesh that has a solution, or the best guess of the search."""
    solved = [asked for asked in last.batch if asked.role == FINAL and not _diverged(fit, asked)]
    return solved[-1] if solved else fit.ask(best_values(last))


def on_search_mesh(fit: Fit, last: Round) -> Minimum:
    """Minimum of the score on the mesh of the search."""
    return _minimum(fit, last, fit.ask(best_values(last)))


def mesh_error(fit: Fit, found: Minimum, searched: Minimum) -> np.ndarray | None:
    """Error of the finest mesh that is left, by constant, shape (parameters,) in search coordinates.

    What the finer mesh changed, continued with the order of convergence of a glued corner (Richardson; Roache
    1994 gives the way of reporting it). None without a finer mesh.

    Parameters
    ----------
    fit : Fit
    found, searched : Minimum
        On the finest mesh and on that of the search.
    """
    if fit.mesh_of(found.base) != REFINED:
        return None
    parameters = fit.settings.parameters()
    change = coordinates(parameters, found.values) - coordinates(parameters, searched.values)
    return np.abs(change) * left_over(fit)


def left_over(fit: Fit) -> float:
    """Error of the finer mesh as a share of what it changed, from its order of convergence."""
    coarse, fine = fit.meshes[SEARCH], fit.meshes[REFINED]
    ratio = (fine.element_count / coarse.element_count) ** (1 / coarse.dim)
    return 1.0 / max(ratio**ORDER - 1.0, 0.1)


def _minimum(fit: Fit, last: Round, base: Asked, trust: float = TRUST) -> Minimum:
    parameters = fit.settings.parameters()
    model = _linear_model(fit, last, base)
    at = coordinates(parameters, base.values)
    low = coordinates(parameters, {p.name: p.lower for p in parameters}) - at
    high = coordinates(parameters, {p.name: p.upper for p in parameters}) - at
    low, high = np.maximum(low, -trust), np.minimum(high, trust)
    delta = _least_squares(fit, model, low, high) if fit.exact else _by_score(fit, model, low, high)
    objective = fit.objective(model)
    fall = objective(np.zeros(len(delta))) - objective(delta)
    return Minimum(moved(parameters, base.values, delta), base, model, float(np.abs(delta).max(initial=0.0)), fall)


def _by_score(fit: Fit, model: LinearModel, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of the score; the numbers of effects on the observation are those of the least squares.

    A similarity of pictures does not see their common brightness, nor forces and displacements at all.
    """
    observed, objective = fit.observed, fit.objective(model)
    delta: np.ndarray = np.zeros(len(low))
    for _ in range(IN_TURN if observed.any() else 1):
        delta = _constants(fit, objective, delta, low, high)
        if observed.any():
            delta[observed] = 0.0
            delta[observed] = _brightness_and_shifts(fit, model.at(delta), model, low, high)
    return delta


def _constants(
    fit: Fit, score: Callable[[np.ndarray], float], delta: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """`delta`, moved to the minimum of the score along all but the numbers of effects on the observation."""
    free = np.flatnonzero(~fit.observed)

    def at(step: np.ndarray) -> np.ndarray:
        found: np.ndarray = delta.copy()
        found[free] += step
        return found

    return at(minimise(lambda step: score(at(step)), len(free), low=(low - delta)[free], high=(high - delta)[free]))


def _brightness_and_shifts(
    fit: Fit, left: Prediction, model: LinearModel, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Numbers of effects on the observation that leave the least squares of pictures, conjugate quantity and points.

    The noise of the prescribed quantity moves pictures and conjugate quantity together: one unknown for each step.
    """
    from scipy.optimize import lsq_linear

    data, number = fit.data, np.flatnonzero(fit.observed)
    scale, steps = np.sqrt(2.0) * data.picture_noise or 1.0, len(data.step)

    def values(one: Prediction) -> np.ndarray:
        return np.concatenate([((one.pictures - data.measured) / scale).ravel(), deviations(one, data)])

    base = values(left)
    noise = np.divide(data.control_noise, np.abs(data.controlled), out=np.zeros(steps), where=data.controlled != 0)
    unknown = [model.by_control(share, data) for share in np.diag(noise)]
    columns = np.stack([values(left + one) - base for one in [*(model.slopes[n] for n in number), *unknown]], axis=1)
    likely = np.concatenate([np.zeros((steps, len(number))), np.eye(steps)], axis=1)
    ends = np.full(steps, np.inf)
    bounds = np.concatenate([low[number] - 1e-9, -ends]), np.concatenate([high[number] + 1e-9, ends])
    found = lsq_linear(np.concatenate([columns, likely]), -np.concatenate([base, np.zeros(steps)]), bounds)
    return np.asarray(found.x[: len(number)])


def _least_squares(fit: Fit, model: LinearModel, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Minimum of the likelihood of forces and points alone, between bounds: linear least squares."""
    from scipy.optimize import lsq_linear

    left = deviations(model.base, fit.data)
    columns = [deviations(model.base + slope, fit.data) - left for slope in model.slopes]
    # bounds that coincide, as at a corner of the space, are kept a little apart
    return np.asarray(lsq_linear(np.stack(columns, axis=1), -left, (low - 1e-9, high + 1e-9)).x)


def _linear_model(fit: Fit, last: Round, base: Asked) -> LinearModel:
    by_role = {asked.role: asked for asked in last.batch}

    def slope(name: str) -> Prediction:
        # a side beyond a bound was not asked for
        sides = [by_role.get(sign + name, fit.ask(best_values(last))) for sign in "+-"]
        lost = [sign + name not in by_role or _diverged(fit, side) for sign, side in zip("+-", sides, strict=True)]
        if not {"+" + name, "-" + name} & by_role.keys():
            expected = f"bounds farther apart than two steps of a slope, {2 * STEP:g} in the logarithm"
            raise InputError(CONFIG, f"model.parameters.{name}", "bounds next to each other", expected)
        if all(lost):
            raise StateError(f"no solution on either side of the best guess in {name}")
        # one-sided where one side has no solution
        middle = fit.ask(best_values(last))
        ahead, behind = [fit.prediction(middle if gone else side) for side, gone in zip(sides, lost, strict=True)]
        return (ahead - behind) * (1 / (STEP * (2 - sum(lost))))

    slopes = tuple(slope(parameter.name) for parameter in fit.settings.parameters())
    control = slope("control") if "+control" in by_role else None
    return LinearModel(fit.prediction(base), slopes, control, base.values)


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


def _diverged(fit: Fit, asked: Asked) -> bool:
    return Outcome.load(fit.sims / asked.sim / "solution.npz").status != CONVERGED
