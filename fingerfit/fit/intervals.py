"""Standard errors, intervals and what the data cannot tell, from repetitions of the measurement."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.fit.identified import (
    identifiability,
    positive,
    room,
    unseen,
    unseen_combinations,
    unseen_constants,
)
from fingerfit.fit.objective import Objective
from fingerfit.fit.slopes import bounds_of
from fingerfit.model.parameters import Parameter

WIDTH = 0.02
"""Step of the finite differences of a score that is linearised already, in search coordinates: 2 % of a modulus, a few
of the phantom's standard errors. A choice."""
ENOUGH = 0.1
"""Share of the fall that the slope promises which a step must bring; a whole step to the minimum of a parabola brings
half of it. A choice, made after a made-up score; four fits that were tried end where they did."""
_CURVED = 6
"""Repetitions that give the mean curvature, which needs far more scores than a gradient; a choice."""
REACH, STEPS = 0.15, 20
"""Longest step of `minimise`, in search coordinates, and how many at most. Choices."""
SHORTEST = 1e-5
"""Shortest step of `minimise`, in search coordinates: 0.001 % of a modulus, whose standard errors are 0.5 %
and more in the phantom."""
NORMAL = 1.96
"""Standard deviations from the middle to the ends of a 95 % interval, and the root of the rise of the misfit there
(3.84, chi-square of one degree of freedom)."""


def widths(parameters: Sequence[Parameter], moving: np.ndarray) -> np.ndarray:
    """Steps of the finite differences, shape (parameters,): `WIDTH`, or less.

    A number of an effect that moves the pictures faster than any constant does gets a shorter one, by which they change
    as much: over a longer one a similarity is no parabola, and its slope may have the wrong sign.

    Parameters
    ----------
    parameters : sequence of Parameter
        Those on a logarithmic scale, as constants are, have `WIDTH`.
    moving : ndarray, shape (parameters,)
        As of `fingerfit.fit.linear.LinearModel.moving`.
    """
    fastest = moving[np.array([p.log for p in parameters], dtype=bool)].max(initial=0.0)
    share = np.divide(fastest, moving, out=np.ones(len(moving)), where=moving > fastest)
    return WIDTH * np.where(fastest > 0, share, 1.0)


def _gradient(objective: Callable[[np.ndarray], float], at: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Central differences, shape of `at`: a similarity of noisy pictures is no parabola nearer to its minimum."""
    ends = [(objective(at + step), objective(at - step)) for step in np.diag(width)]
    return np.array([ahead - behind for ahead, behind in ends]) / (2 * width)


def gradient_and_hessian(objective: Callable[[np.ndarray], float], width: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Central differences at 0 over steps of shape (size,): shapes (size,) and (size, size)."""
    size, steps = len(width), np.diag(width)
    middle = objective(np.zeros(size))
    ahead = np.array([objective(step) for step in steps])
    behind = np.array([objective(-step) for step in steps])
    hessian = np.diag((ahead - 2 * middle + behind) / width**2)
    for i in range(size):
        for j in range(i):
            both = objective(steps[i] + steps[j]) + objective(-steps[i] - steps[j])
            cross = (both - ahead[i] - ahead[j] - behind[i] - behind[j] + 2 * middle) / (2 * width[i] * width[j])
            hessian[i, j] = hessian[j, i] = cross
    return (ahead - behind) / (2 * width), hessian


def curvature(objective: Objective, width: np.ndarray) -> np.ndarray:
    """Second derivatives at 0 by differences of the exact gradient over steps of shape (size,), shape (size, size).

    For tens of numbers this asks for fewer scores than second differences do. It shows the way to the minimum, which is
    where `_gradient` says. Their kernel over twice the step is a triangle: the box of the same spread is narrower.
    """
    found, width = np.zeros((len(width), len(width))), width / np.sqrt(2.0)
    for number, step in enumerate(np.diag(width)):
        found[number] = (objective.gradient(step) - objective.gradient(-step)) / (2 * width[number])
    return (found + found.T) / 2


def minimise(
    objective: Objective,
    width: np.ndarray,
    reach: float = REACH,
    low: np.ndarray | None = None,
    high: np.ndarray | None = None,
    sure: float = np.inf,
) -> np.ndarray:
    """Minimum of a smooth score near 0 by Newton steps with the curvature at 0, shape (size,).

    Directions that the score does not see are not moved along.

    Parameters
    ----------
    objective : Objective
    width : ndarray, shape (size,)
        Steps of finite differences.
    reach : float
        Longest step.
    low, high : ndarray, shape (size,), optional
        Bounds, around 0.
    sure : float
        Curvature that is seen in any case.
    """
    size = len(width)
    gradient, hessian = _gradient(objective, np.zeros(size), width), positive(curvature(objective, width))
    steepest = max(float(np.abs(np.diag(hessian)).max(initial=0.0)), 1e-300)
    least = unseen(steepest, sure)
    low = np.full(size, -np.inf) if low is None else low
    high = np.full(size, np.inf) if high is None else high
    at, value = np.zeros(size), objective(np.zeros(size))
    for _ in range(STEPS):
        # a constant at its bound that would go further stays; the others find their minimum without it
        free = ~(((at <= low) & (gradient > 0)) | ((at >= high) & (gradient < 0)))
        step = np.zeros(size)
        step[free] = -np.linalg.pinv(hessian[np.ix_(free, free)], rcond=least, hermitian=True) @ gradient[free]
        # shortened before it is cut: a long step that is cut along one axis alone points elsewhere
        step *= min(1.0, reach / max(np.abs(step).max(initial=0.0), 1e-300))
        inside = np.clip(at + step, low, high) - at
        cut, step = not np.array_equal(inside, at + step - at), _downhill(objective, at, value, inside, gradient)
        if cut and not step.any():
            # bounds have turned the step uphill: straight down, as far as they let it
            down = np.where(free, -gradient / steepest, 0.0)
            down *= min(1.0, reach / max(np.abs(down).max(initial=0.0), 1e-300))
            step = _downhill(objective, at, value, np.clip(at + down, low, high) - at, gradient)
        if not step.any():
            break
        at = at + step
        value = objective(at)
        gradient = _gradient(objective, at, width)
    return at


def _downhill(objective: Objective, at: np.ndarray, value: float, step: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """A step, halved until the score falls by enough (Armijo 1966); zero where it does not.

    Any fall at all would be too little: from the one side of a minimum to the other and back the score falls, too.
    """
    while np.abs(step).max(initial=0.0) > SHORTEST:
        if objective(at + step) < value - ENOUGH * max(-float(gradient @ step), 0.0):
            return step
        step = step / 2
    return np.zeros(len(step))


def repeat(
    draw: Callable[[], Objective], width: np.ndarray, count: int, sure: float = np.inf, minima: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Best constants of repetitions by one Newton step with their mean curvature, and that curvature.

    Where numbers compensate each other, the curvature along that is a small difference of large ones, which a
    similarity of noisy pictures does not show, and the step is far too short
    (docs/decisions/0004-parametric-bootstrap.md).

    Parameters
    ----------
    draw : callable
        Gives the score of a new repetition as a function of shape (size,) in search coordinates.
    width : ndarray, shape (size,)
        Steps of finite differences.
    count : int
        Number of repetitions. The first ones give the curvature; the others need their gradient.
    sure : float
        Curvature that is seen in any case.
    minima : bool
        Whether the minimum of each repetition is found instead of one step: several times the scores.

    Returns
    -------
    shifts : ndarray, shape (count, size)
    hessian : ndarray, shape (size, size)
    """
    curvatures, gradients, found = [], [], []
    for number in range(count):
        objective = draw()  # one at a time: each holds pictures of its own
        if number < _CURVED:
            gradient, hessian = gradient_and_hessian(objective, width)
            curvatures.append(hessian)
        elif not minima:
            gradient = _gradient(objective, np.zeros(len(width)), width)
        if minima:
            found.append(minimise(objective, width, sure=sure))
        else:
            gradients.append(gradient)
    hessian = np.mean(curvatures, axis=0)
    if minima:
        return np.array(found), hessian
    curved = positive(hessian)
    cut = unseen(float(np.linalg.eigvalsh(curved).max(initial=0.0)), sure)
    inverse = np.linalg.pinv(curved, rcond=cut, hermitian=True)
    return -np.array(gradients) @ inverse, hessian


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of an estimate.

    Parameters
    ----------
    relative : ndarray, shape (parameters,)
        Standard errors in search coordinates: of the logarithm.
    mesh : ndarray, shape (parameters,)
        Error of the mesh that is left, in search coordinates, as a standard deviation; 0 where it is not known.
    interval : ndarray, shape (parameters, 2)
        95 % interval, in units: noise, mesh and priors.
    correlation : ndarray, shape (parameters, parameters)
    remarks : tuple of str
        What the data cannot tell.
    """

    relative: np.ndarray
    mesh: np.ndarray
    interval: np.ndarray
    correlation: np.ndarray
    remarks: tuple[str, ...]


def summarise(
    shifts: np.ndarray,
    hessian: np.ndarray,
    parameters: Sequence[Parameter],
    values: Sequence[float],
    mesh: np.ndarray | None = None,
    sure: float = np.inf,
    known: np.ndarray | None = None,
) -> Uncertainty:
    """Uncertainty from repetitions.

    Parameters
    ----------
    shifts : ndarray, shape (repetitions, parameters)
        Best constants of the repetitions in search coordinates, relative to the truth of the repetitions.
    hessian : ndarray, shape (parameters, parameters)
        Curvature of the score.
    parameters, values
        What was estimated, values in units.
    mesh : ndarray, shape (parameters,), optional
        Error of the mesh, in search coordinates, as a standard deviation.
    sure : float
        Curvature that is seen in any case.
    known : ndarray, shape (parameters, parameters), optional
        Covariance that the errors of priors add.
    """
    # imported here, because rounds, which import `minimise`, need no scipy
    from scipy.special import ndtri, stdtrit

    mesh = np.zeros(len(parameters)) if mesh is None else mesh
    count = len(shifts)
    known = np.zeros((len(parameters), len(parameters))) if known is None else known
    noise = np.atleast_2d(np.cov(shifts, rowvar=False))
    covariance = noise + known
    spread = np.sqrt(np.diag(covariance))
    scale = np.where(spread > 0, spread, 1.0)
    half = np.hypot(
        stdtrit(count - 1, 0.975) * np.sqrt(np.diag(noise)), ndtri(0.975) * np.sqrt(mesh**2 + np.diag(known))
    )
    # the repetitions do not move what the score does not see: without a prior it may be anywhere in its bounds
    unknown = np.sqrt(np.diag(known)) < SHORTEST
    free = room(unseen_combinations(hessian, sure), parameters, values, unknown)
    bounds, half = np.array([(p.lower, p.upper) for p in parameters]), np.stack([-half, half], axis=1)
    interval = np.array([_ends(p, v, h) for p, v, h in zip(parameters, values, half + free, strict=True)])
    # an effect has no meaning beyond the bounds of its numbers, as a share below 0; those of constants are a user's
    ends = free.any(axis=1) | np.array(["." in p.name for p in parameters])
    interval = np.where(ends[:, None], np.clip(interval, bounds[:, :1], bounds[:, 1:]), interval)
    blind = unseen_constants(hessian, sure) & unknown
    interval = np.where(blind[:, None], bounds, interval)
    low, high = bounds_of(parameters)
    # of even distributions
    spread = np.where(blind, (high - low) / np.sqrt(12.0), np.hypot(spread, np.ptp(free, axis=1) / np.sqrt(12.0)))
    return Uncertainty(
        spread,
        mesh,
        interval,
        covariance / np.outer(scale, scale),
        identifiability(hessian, parameters, sure),
    )


def _ends(parameter: Parameter, value: float, away: np.ndarray) -> np.ndarray:
    """A value and what is to be added to it in search coordinates, shape (2,), in units."""
    return np.asarray(value * np.exp(away) if parameter.log else value + away * parameter.scale)


def bound_of(parameter: Parameter, value: float) -> str | None:
    """The bound that an estimate is at, ``lower`` or ``upper``; None where it is at none.

    The minimum of a score is found to the shortest step of `minimise`: what is nearer cannot be told from the bound.

    >>> bound_of(Parameter("mu", "MPa", 0.01, 1.0, 0.1), 0.01), bound_of(Parameter("mu", "MPa", 0.01, 1.0, 0.1), 0.0101)
    ('lower', None)
    """
    for name, bound in (("lower", parameter.lower), ("upper", parameter.upper)):
        away = np.log(value / bound) if parameter.log else (value - bound) / parameter.scale
        if abs(away) <= SHORTEST:
            return name
    return None


def at_a_bound(parameters: Sequence[Parameter], values: Mapping[str, float]) -> np.ndarray:
    """Which estimates are at a bound, shape (parameters,).

    >>> at_a_bound([Parameter("mu", "MPa", 0.01, 1.0, 0.1)], {"mu": 1.0})
    array([ True])
    """
    return np.array([bound_of(p, values[p.name]) is not None for p in parameters], dtype=bool)


def as_json(uncertainty: Uncertainty, parameters: Sequence[Parameter], values: Sequence[float]) -> dict[str, Any]:
    """Entries of estimate.json by parameter."""
    entries = {}
    for n, (parameter, value) in enumerate(zip(parameters, values, strict=True)):
        size = value if parameter.log else parameter.scale
        low, high = uncertainty.interval[n]
        entries[parameter.name] = {
            "value": float(value),
            "unit": parameter.unit,
            "standard_error": float(uncertainty.relative[n] * size),
            "mesh_error": float(uncertainty.mesh[n] * size),
            "interval95": [float(low), float(high)],
            "bounds": [parameter.lower, parameter.upper],
            "at_bound": bound_of(parameter, value),
            "log": parameter.log,
            "prior": list(parameter.prior) if parameter.prior else None,
        }
    return entries
