"""Candidates in order: what each would explain, the odds for it, and how alike they are."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fingerfit.deck.context import place_of
from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.evidence import Information
from fingerfit.diagnosis.score_tests import VISIBLE, Finding, ScoreTest, likeness
from fingerfit.fit.problem import SEARCH
from fingerfit.fit.rounds import Asked
from fingerfit.model.effect import Effect

FIRST_PASS, REFIT = "first pass", "refit"
"""What says how much an effect explains, in words: never one of them where the other one is meant."""
STARTS = 4
STARTS_ELSEWHERE = 2
"""Places between which a fit can move, from which an effect is refitted in the first pass, at most: in the layer (or at
the border, or side) that slopes prefer, and in each other one. Choices."""
ALIKE = 0.5
"""Likeness below which two places of an effect look otherwise, and above which two effects are told to be alike. A
choice."""


def said_by(what: str, effects: Collection[str]) -> str:
    """What tells of a model, and which effects the model has.

    >>> said_by(REFIT, ()), said_by(REFIT, ("tilt", "skin"))
    ('refit', 'refit beside tilt and skin')
    """
    return f"{what} beside {' and '.join(effects)}" if effects else what


@dataclass(frozen=True)
class Refitted:
    """A model refitted in the first pass.

    Parameters
    ----------
    values : dict
        Constants and numbers of effects at the minimum, in their units.
    misfit : float
    converged : bool
        Whether the minimum was reached.
    at_bound : tuple of str
        Numbers that end at a bound.
    simulations : int
        How many were not known before.
    count : int
        Number of values that were fitted.
    information : Information
        On the effect's own numbers.
    share : float
        Of the misfit beyond the noise, what it explains.
    """

    values: Mapping[str, float]
    misfit: float
    converged: bool
    at_bound: tuple[str, ...]
    simulations: int
    count: int
    information: Information
    share: float = 0.0


@dataclass(frozen=True)
class Ranked:
    """A tested candidate.

    Parameters
    ----------
    candidate : Candidate
    finding : Finding
        What it would explain.
    columns : ndarray, shape (kept, numbers)
        Slopes of all values by its numbers, per unit of each.
    refitted : Refitted, optional
        Its refit of the first pass.
    also : tuple of Ranked
        Its refits in other layers, or at other borders or sides, that the first pass cannot tell from it.
    """

    candidate: Candidate
    finding: Finding
    columns: np.ndarray
    refitted: Refitted | None = None
    also: tuple[Ranked, ...] = ()

    def odds(self, spread: float, fall: float | None = None) -> float:
        """Logarithm of the odds for the model with the effect against the one without it: `Information.odds`.

        Where there is no refit: as BIC has it.

        Parameters
        ----------
        spread : float
            Misfit per value of the best model, at least 1 (`spread_of`): where none explains the data, all weighs less.
        fall : float, optional
            Of the misfit, as a refit found it: counts where it is less than that of the first pass.
        """
        own = self.finding.fall if fall is None else min(fall, self.finding.fall)
        values, numbers = self.columns.shape
        if self.refitted is None:
            return 0.5 * (own / spread - numbers * float(np.log(max(values, 1))))
        return self.refitted.information.odds(own, spread)

    @property
    def size(self) -> dict[str, float]:
        """Predicted numbers of the effect, by their short names."""
        parameters = zip(self.candidate.effect.parameters, self.finding.size, strict=True)
        return {p.name: float(p.null + s) for p, s in parameters}

    @property
    def place(self) -> dict[str, float]:
        """Its scanned numbers, by their names in a guess; those that a fit moves, where the refit left them."""
        found = self.refitted.values if self.refitted else {}
        return {name: found.get(name, value) for name, value in self.candidate.place.items()}


def rank_candidates(
    comparison: Comparison, score_test: ScoreTest, found: Sequence[Candidate], without: Asked | None = None
) -> list[Ranked]:
    """Test all candidates that have a solution; `without` as in `Comparison.columns`."""
    ranking = []
    for candidate in found:
        columns = comparison.columns(candidate, without)
        if columns is not None:
            ranking.append(Ranked(candidate, within_bounds(score_test, candidate.effect, columns), columns))
    return ranking


def within_bounds(score_test: ScoreTest, effect: Effect, columns: np.ndarray) -> Finding:
    """The score test of an effect, each of its numbers within its bounds; `columns` as in `ScoreTest.test`."""
    return score_test.test(columns, *bounds_of_size(effect))


def bounds_of_size(effect: Effect) -> np.ndarray:
    """Bounds of an effect's numbers, from their absent values, shape (2, parameters), in their units."""
    return np.array([(p.lower - p.null, p.upper - p.null) for p in effect.parameters]).T


def spread_of(misfit: float, ranking: Sequence[Ranked], values: int) -> float:
    """Misfit per value of the best model, at least 1.

    Of the values that the first pass has fitted, where there was one; else from the `misfit` of all `values` by the
    model without any candidate, and what slopes predict.
    """
    refitted = [one.refitted.misfit / max(one.refitted.count, 1) for one in ranking if one.refitted]
    if refitted:
        return max(1.0, min(refitted))
    best = max((one.finding.fall for one in ranking), default=0.0)
    return max(1.0, (misfit - best) / max(values, 1))


def best_places(ranking: Sequence[Ranked]) -> list[Ranked]:
    """The best place of each effect only, by predicted fall."""
    best: dict[str, Ranked] = {}
    for one in ranking:
        name = one.candidate.effect.name
        if name not in best or one.finding.fall > best[name].finding.fall:
            best[name] = one
    return sorted(best.values(), key=lambda one: -one.finding.fall)


def other_places(score_test: ScoreTest, everywhere: Sequence[Ranked], best: Ranked) -> list[Ranked]:
    """Further places of an effect from which it is refitted, since a fit cannot come there from its best place.

    That is each other layer, border or side, or number of families of fibres, all else of these being the same: slopes
    where the effect is absent may point to the wrong one of them.
    Where the place is fitted, also the best ones that look otherwise, or are of the other sign: between a stiff lump
    and a soft one elsewhere the effect is absent, and between two directions of fibres the misfit has a ridge. In
    another layer these are fewer.
    """
    effect = best.candidate.effect
    others = [one for one in everywhere if one.candidate.effect is effect and one.candidate is not best.candidate]
    others.sort(key=lambda one: -one.finding.fall)
    chosen: dict[tuple[tuple[str, float], ...], list[Ranked]] = {(): [best]}
    for one in others:
        where = tuple((key, one.candidate.place[key]) for key in _differing(one, best))
        if len(where) > 1:
            continue
        there = chosen.setdefault(where, [])
        room = len(there) < (STARTS_ELSEWHERE if where else STARTS) and one.finding.fall > 0.0 and bool(effect.refine)
        if not there or (room and all(_apart(score_test, one, known) for known in there)):
            there.append(one)
    return [one for there in chosen.values() for one in there if one is not best]


def elsewhere(one: Ranked, other: Ranked) -> bool:
    """Whether an effect is in another layer, or at another border or side, to which no fit can move it."""
    return bool(_differing(one, other))


def _differing(one: Ranked, other: Ranked) -> list[str]:
    """What of their places no fit can move."""
    effect, here, there = one.candidate.effect, one.candidate.place, other.candidate.place
    return [key for key in effect.unmoved() if here[key] != there[key]]


def _apart(score_test: ScoreTest, a: Ranked, b: Ranked) -> bool:
    """Whether two places of an effect look otherwise, or want it of another sign."""
    return bool((a.finding.size * b.finding.size < 0).all()) or alike(score_test, a, b) < ALIKE


def alike(score_test: ScoreTest, a: Ranked, b: Ranked) -> float:
    """How much of one effect's signature the other can imitate."""
    return likeness(score_test.signature(a.columns), score_test.signature(b.columns))


def confusions(score_test: ScoreTest, ranking: Sequence[Ranked], count: int = 6) -> list[dict[str, float | str]]:
    """Pairs of the first few effects that are alike on these data."""
    found: list[dict[str, float | str]] = []
    first = [one for one in ranking[:count] if one.finding.visible > VISIBLE]
    for n, a in enumerate(first):
        for b in first[n + 1 :]:
            value = alike(score_test, a, b)
            if value > ALIKE:
                found.append({"a": a.candidate.effect.name, "b": b.candidate.effect.name, "likeness": value})
    return sorted(found, key=lambda entry: -float(entry["likeness"]))


def summary(score_test: ScoreTest, ranking: Sequence[Ranked]) -> list[dict[str, Any]]:
    """Ranking as data: what each candidate would explain, at which place and of which size."""
    spread = spread_of(score_test.misfit, ranking, score_test.freedom)
    return [
        {
            "effect": one.candidate.effect.name,
            "place": {key.split(".")[1]: value for key, value in one.place.items()},
            "size": one.size,
            "predicted_fall": one.finding.fall,
            "share_of_excess": min(
                1.0, one.refitted.share if one.refitted else one.finding.fall / score_test.beyond_noise
            ),
            "visible": one.finding.visible,
            "first_pass": one.refitted
            and {
                "converged": one.refitted.converged,
                "at_bound": [name.partition(".")[2] or name for name in one.refitted.at_bound],
                "log_odds": one.odds(spread),
            },
        }
        for one in ranking
    ]


def stiffness_map(comparison: Comparison, ranking: Sequence[Ranked]) -> np.ndarray:
    """Where stiffer or softer material would reduce the misfit, from the effects that were tried all over the body.

    Returns
    -------
    ndarray, shape (places, dim + 2)
        Position in mm; predicted change of log mu there; the evidence for it in standard deviations, negative where
        softer material would reduce it.
    """
    mesh = comparison.problem.meshes[SEARCH]
    rows = []
    for one in ranking:
        at = place_of(one.candidate.effect, one.candidate.place, mesh)
        if at is not None and "field" in one.candidate.effect.changes:
            change = float(one.finding.size[0])
            rows.append([*at, change, np.sign(change) * np.sqrt(one.finding.fall)])
    return np.array(rows).reshape(-1, mesh.dim + 2)
