"""Sides of a block that lie elsewhere: by their form, or since the body was pressed or swelled before that picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander

from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.ranking import Ranked, bounds_of_size
from fingerfit.fit.rounds import Asked
from fingerfit.imaging.outline import CORNER, SIDES, Outline

LIKELY = 0.125
"""Likely distance of a side from where it is stated, as a share of the body's extent across it: as that of a border
between layers."""
_PLACES = 41
"""Along a side: many more than a parabola has numbers. A choice."""


@dataclass(frozen=True)
class Sides:
    """Where the picture before compression has the sides, against a model.

    Parameters
    ----------
    off : float
        How far a side surely lies from where the model has it, mm; 0 where all lie there.
    misfit : float
        Sum of the squared distances of their coefficients, in units of their errors.
    worth : float
        Misfit that another form of the body, which has the sides there, must explain to be worth its numbers:
        `worth_of_form`.
    """

    off: float = 0.0
    misfit: float = 0.0
    worth: float = 0.0


def sides_of(comparison: Comparison) -> Sides:
    """Where the sides are, in all tests whose picture shows them elsewhere than stated."""
    found = Sides()
    for test in comparison.every:
        if test.data.outline:
            outline, there = _outline(test), _sides(test, test.base)
            away = (outline.outward - there) / outline.spread[:, None]
            farthest = max(map(abs, outline.elsewhere(there).values()), default=0.0)
            known = np.isfinite(away)
            found = Sides(
                max(found.off, farthest),
                found.misfit + float((away[known] ** 2).sum()),
                found.worth + worth_of_form(away, LIKELY * _across(outline) / outline.spread),
            )
    return found


def worth_of_form(away: np.ndarray, likely: np.ndarray) -> float:
    """What the evidence for another form loses by its numbers: the misfit that these must explain.

    Each side lies where it is stated, or elsewhere by a polynomial of the place along it; each further degree is half
    as likely. A coefficient that is there has a normal prior of its likely size; one that is not is off by chance.

    Parameters
    ----------
    away : ndarray, shape (sides, degrees)
        How far out the picture has the sides, in units of their errors: Legendre coefficients; NaN where it does not
        show a side.
    likely : ndarray, shape (sides,)
        Likely sizes of the coefficients, in the same units.

    Examples
    --------
    A wider body is cheaper than one whose sides also bulge.

    >>> wide = worth_of_form(np.array([[20.0, 0.0, 0.0]]), np.array([30.0]))
    >>> bulged = worth_of_form(np.array([[20.0, 0.0, 20.0]]), np.array([30.0]))
    >>> round(wide, 1), round(bulged, 1)
    (10.0, 25.5)
    """
    worth = 0.0
    for coefficients, size in zip(away, likely, strict=True):
        if not np.isfinite(coefficients).all():
            continue
        there = coefficients**2 / (1.0 + size**2) + np.log(1.0 + size**2)
        degrees = np.arange(len(coefficients) + 1)
        left = [there[:n].sum() + (coefficients[n:] ** 2).sum() for n in degrees]
        prior = np.log(2.0) * np.minimum(degrees + 1, len(coefficients))
        worth -= 2.0 * float(np.logaddexp.reduce(-0.5 * np.array(left) - prior))
    return worth


def _across(outline: Outline) -> np.ndarray:
    """Extent of the body across each side, mm, shape (4,)."""
    return np.repeat(np.asarray(outline.high) - np.asarray(outline.low), 2)


def begun(comparison: Comparison, everywhere: Sequence[Ranked], most: float = np.inf) -> list[Ranked]:
    """Effects on the state in that picture, or on how it was taken, each where and as large as it brings the sides
    nearest, the nearest first.

    Probes are not among them: they move sides in so many ways that those say nothing. Nor are those that leave a side
    by slopes more than `most` mm off.
    """
    tests = [test for test in comparison.every if test.data.outline]
    outlines = [_outline(test) for test in tests]
    weight = np.concatenate([np.repeat(1.0 / one.spread, 3) for one in outlines])
    now = [_sides(test, test.anchor) for test in tests]
    goal = np.concatenate([_flat(one.outward - there) for one, there in zip(outlines, now, strict=True)])
    seen, found = np.isfinite(goal * weight), []
    for one in everywhere:
        effect = one.candidate.effect
        if not ("before" in effect.changes or effect.moves_first) or effect.probe or not seen.any():
            continue
        columns = []
        for number, parameter in enumerate(effect.parameters):
            moved = [
                _moved(test, comparison.every.index(test), one, number) - there
                for test, there in zip(tests, now, strict=True)
            ]
            columns.append(np.concatenate([_flat(part) for part in moved]) / parameter.step)
        slopes = np.stack(columns, axis=1)[seen] * weight[seen, None]
        size, *_ = np.linalg.lstsq(slopes, goal[seen] * weight[seen], rcond=None)
        size = np.clip(size, *bounds_of_size(effect))
        left = goal - np.stack(columns, axis=1) @ size
        if _farthest(outlines, left) <= most:
            away = float(((left * weight)[seen] ** 2).sum())
            found.append((away, replace(one, finding=replace(one.finding, size=size), refitted=None)))
    nearest = dict[str, Ranked]()
    for _, one in sorted(found, key=lambda pair: pair[0]):
        nearest.setdefault(one.candidate.effect.name, one)
    return list(nearest.values())


def _moved(test: Comparison, index: int, one: Ranked, number: int) -> np.ndarray:
    """Sides of a candidate with one of its parameters a step off, as in `Outline.outward`."""
    effect, asked = one.candidate.effect, one.candidate.asked
    if asked:
        return _sides(test, asked[number].every[index])
    parameter = effect.parameters[number]
    values = {**effect.null(), **one.candidate.place, effect.key(parameter.name): parameter.null + parameter.step}
    return _sides(test, replace(test.anchor, values={**test.anchor.values, **values}))


def _farthest(outlines: Sequence[Outline], left: np.ndarray) -> float:
    """How far at most a side is off where so much is left of the coefficients of all outlines, mm."""
    off = [0.0]
    for outline, part in zip(outlines, left.reshape(len(outlines), *outlines[0].outward.shape), strict=True):
        off += [abs(far) for far in replace(outline, outward=part).elsewhere().values()]
    return max(off)


def _outline(test: Comparison) -> Outline:
    data = test.data
    low, high = data.stated
    return Outline(low, high, data.sides[:, :-1], data.sides[:, -1], float(data.spacing.max()))


def _sides(test: Comparison, asked: Asked) -> np.ndarray:
    """How far out the sides of a simulation lie in that picture, as in `Outline.outward`.

    As in the picture: at places along the side where it lies then, evenly spaced, whatever the nodes are.
    """
    mesh, (low, high) = test.problem.meshes[test.problem.mesh_of(asked)], test.data.stated
    moved, seen = test.problem.outcome(asked).begun, test.problem.seen(asked.values)
    if seen is not None and seen.moves_first:
        there = mesh.points if moved is None else mesh.points + moved
        moved = there + seen.first(there) - mesh.points
    found = np.zeros((len(SIDES), 3))
    for number in range(len(SIDES)) if moved is not None else ():
        axis, last = divmod(number, 2)
        own = np.abs((mesh.points[:, axis] - (high if last else low)[axis]) / (high - low)[axis]) < 1e-6
        outward = (1 if last else -1) * np.asarray(moved)[own, axis]
        share = ((mesh.points + moved)[own, 1 - axis] - low[1 - axis]) / (high - low)[1 - axis]
        order = np.argsort(share)
        places = np.linspace(CORNER, 1.0 - CORNER, _PLACES)
        places = places[(places >= share.min()) & (places <= share.max())]
        basis = legvander(2 * places - 1, found.shape[1] - 1)
        found[number] = np.linalg.lstsq(basis, np.interp(places, share[order], outward[order]), rcond=None)[0]
    return found


def _flat(values: Any) -> np.ndarray:
    return np.asarray(values, float).ravel()
