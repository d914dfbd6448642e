"""The first pass of all candidates, beside each other: a few moves of each, and all of those that come nearest.

Where simulations are long, as of large meshes in space, only those that slopes promise most of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.processes import side_by_side
from fingerfit.core.progress import begin, counted, tell
from fingerfit.diagnosis.budget import FIRST_MOVES, MOVES, going_on, starts
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.families import ENOUGH, SURE
from fingerfit.diagnosis.first_pass import FirstPass, widened
from fingerfit.diagnosis.ranking import (
    FIRST_PASS,
    Ranked,
    Refitted,
    elsewhere,
    other_places,
    said_by,
    spread_of,
)
from fingerfit.diagnosis.refit import chance
from fingerfit.diagnosis.score_tests import ScoreTest, beyond_noise
from fingerfit.diagnosis.series import of_held_out
from fingerfit.diagnosis.worth import LARGE
from fingerfit.fit.jobs import solved, solved_since
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.slopes import moved
from fingerfit.model.effect import NUMERICS
from fingerfit.solvers.contract import BY_PATH, IN_TIME

ROUNDING = 1e-9
"""Of a step: a predicted size below it is what rounding leaves of a number that changes nothing, of either sign."""
NEARER = (1.0, 0.25, -0.25)
"""Shares of the first step at which a candidate starts, the next one where the body has no solution."""


def refit_all(
    comparison: Comparison,
    ranking: Sequence[Ranked],
    threads: int = 1,
    sloped: bool = False,
    everywhere: Sequence[Ranked] = (),
    family: str = "",
    unsolved: dict[str, str] | None = None,
) -> tuple[list[Ranked], int]:
    """Candidates ranked by their refits of the first pass; those that it cannot see keep what slopes predict.

    Not seen are what mesh and load steps do, which no fit can cure, and what changes the brightness alone.

    Parameters
    ----------
    comparison : Comparison
    ranking : sequence of Ranked
        By slopes.
    threads : int
    sloped : bool
        Whether what slopes predict holds, as it does near the truth: then only those are refitted that they speak for.
        So it does where the model leaves no more of what the first pass sees than chance does.
    everywhere : sequence of Ranked
        At all places, for those that the best one may be mistaken for.
    family : str
        Of which alone candidates are refitted.
    unsolved : dict, optional
        Is told, by title, why effects do not count whose simulations the solver ended without an answer.

    Returns
    -------
    list of Ranked
        The best first, by their odds against the model without them, its constants refitted as well.
    int
        Simulations that were not known before.
    """
    problem = comparison.problem
    first = FirstPass(comparison, threads)
    base = first.refit(problem, comparison.base.values, near=True)
    first.threads = 1  # each candidate has a process of its own
    before = solved(problem)
    # what is unexplained may be brightness alone, which is not looked at here
    quiet = not sloped and base.misfit <= chance(base.count - len(base.values))
    seen, found, run = list[Ranked](), list[Ranked](), base.simulations
    for one in ranking:
        effect = one.candidate.effect
        blind = effect.acts == NUMERICS or effect.on_brightness
        there = first.promised(one) if quiet and not blind else one
        spoken_for = (not (sloped or quiet) or there.odds(1.0) > 0.0) and family in ("", effect.family)
        (seen if spoken_for and not blind else found).append(there)

    def by_odds() -> list[Ranked]:
        spread = spread_of(base.misfit, found, first.count)
        return sorted(found, key=lambda one: -one.odds(spread))

    seen, left_out, places = _within(starts(problem), seen, everywhere, comparison.score_test)
    found += left_out
    trial = _Trial(first, base, places, LARGE * max((one.finding.fall for one in seen), default=0.0))
    goes_on = dict[str, list[tuple[Ranked, float]]]()
    for one, tried in zip(seen, side_by_side(trial.begun, seen, threads), strict=True):
        problem.asked.update(tried.asked)
        if tried.ranked:
            # what another process has found is a copy: it is known by its place
            here = (one, *places[one.candidate.effect.name])
            begun, *also = (_with_columns(copy, here) for copy in (tried.ranked, *tried.ranked.also))
            found.append(replace(begun, also=tuple(also)))
            goes_on[one.candidate.effect.name] = [
                (_with_columns(copy.ranked, here), copy.share)
                for copy in (tried, *tried.rivals)
                if copy.ranked and not (copy.ranked.refitted and copy.ranked.refitted.converged)
            ]
        elif tried.why and unsolved is not None:
            unsolved[one.candidate.effect.title] = tried.why
            tell(f"tried {one.candidate.effect.name}: {tried.why}; does not count")
    found = by_odds()
    best = [n for n, one in enumerate(found) if one.refitted][: going_on(problem, len(seen))]
    left = [(n, each) for n in best for each in goes_on[found[n].candidate.effect.name]]
    ended = side_by_side(trial.gone_on, [each for _, each in left], threads)
    spread = spread_of(base.misfit, found, first.count)
    for (n, (begun, _)), tried in zip(left, ended, strict=True):
        problem.asked.update(tried.asked)
        if tried.ranked:
            there = replace(tried.ranked, columns=begun.columns)
            found[n] = _likeliest([there, found[n], *found[n].also], spread)
    return by_odds(), run + solved_since(problem, before)


def _within(
    count: int, seen: Sequence[Ranked], everywhere: Sequence[Ranked], score_test: ScoreTest
) -> tuple[list[Ranked], list[Ranked], dict[str, list[Ranked]]]:
    """The effects of so many starts, those that are left out, and by name the further places where each is begun.

    First each effect's best place, the likeliest effect by slopes first; then the others.
    """
    spread = spread_of(score_test.misfit, seen, score_test.freedom)
    likely = sorted(seen, key=lambda one: -one.odds(spread))[:count]
    names, more = {one.candidate.effect.name for one in likely}, count - len(likely)
    places = dict[str, list[Ranked]]()
    for one in likely:
        there = other_places(score_test, everywhere, one)
        places[one.candidate.effect.name] = there[:more]
        more -= len(places[one.candidate.effect.name])
    chosen, left_out = ([one for one in seen if (one.candidate.effect.name in names) is each] for each in (True, False))
    return chosen, left_out, places


def _likeliest(places: Sequence[Ranked], spread: float) -> Ranked:
    """An effect at its likeliest place, and as ``also`` at others where no fit can move it that are nearly as likely.

    In each layer, at each border or side that refit counts which leaves least; between these the odds decide, since
    some need fewer of the effect's numbers than others.

    Parameters
    ----------
    places : sequence of Ranked
        Refitted.
    spread : float
        As for `Ranked.odds`.
    """
    firsts = list[Ranked]()
    for one in sorted(places, key=_misfit):
        if all(elsewhere(one, other) for other in firsts):
            firsts.append(one)
    odds = [one.odds(spread) for one in firsts]
    best, *others = sorted(range(len(firsts)), key=lambda n: -odds[n])
    also = tuple(replace(firsts[n], also=()) for n in others if odds[best] - odds[n] < SURE)
    return replace(firsts[best], also=also)


@dataclass(frozen=True)
class _Tried:
    """What came of a refit in a process of its own: without columns, which take long to hand over."""

    ranked: Ranked | None
    asked: frozenset[str]
    share: float
    why: str = ""
    rivals: tuple[_Tried, ...] = ()
    """Those from other starts that may go on as well."""

    @property
    def misfit(self) -> float:
        """Of its refit; infinite without one."""
        return _misfit(self.ranked)


def _with_columns(copy: Ranked, places: Sequence[Ranked]) -> Ranked:
    return next(
        replace(copy, columns=there.columns) for there in places if there.candidate.place == copy.candidate.place
    )


def _misfit(one: Ranked | None) -> float:
    return one.refitted.misfit if one and one.refitted else float("inf")


@dataclass(frozen=True)
class _Trial:
    """Refits of candidates, each in one process."""

    first: FirstPass
    base: Refitted
    places: Mapping[str, Sequence[Ranked]] = field(default_factory=dict)
    """Further places where an effect is begun, by its name."""
    large: float = 0.0
    """Fall that slopes must promise for a second start."""

    def begun(self, one: Ranked) -> _Tried:
        """The first moves at the best place, and at others that these cannot come to; the likeliest of all.

        A few moves do not tell whose minimum is the lowest: others may go on as well. In another layer, at another
        border or side these are all that are nearly as likely; in the same one, where more than chance is left, the
        better half.
        """
        tried = [self._begun(place) for place in (one, *self.places.get(one.candidate.effect.name, ()))]
        asked = frozenset().union(*(there.asked for there in tried))
        ended = [(there.ranked, there) for there in sorted(tried, key=lambda there: there.misfit) if there.ranked]
        if not ended:
            return replace(tried[0], asked=asked)
        found = [ranked for ranked, _ in ended]
        best = _likeliest(found, spread_of(self.base.misfit, found, self.base.count))
        same = [there for ranked, there in ended if not elsewhere(ranked, best)]
        also = [there for ranked, there in ended if any(ranked.candidate is one.candidate for one in best.also)]
        half = same[1 : 1 + (len(same) - 1) // 2] if same[0].misfit > chance(self.base.count) else []
        return replace(same[0], ranked=best, asked=asked, rivals=(*half, *also))

    def _begun(self, one: Ranked) -> _Tried:
        """The first moves, from the nearest start that has a solution."""
        asked, why = set[str](), ""
        for share in NEARER:
            there = self._refit(one, share)
            asked, why = asked | there.asked, why or there.why
            if there.ranked:
                break
        if there.ranked and self._falls_short(one, there.ranked):
            other = self._refit(one, share, self._half_way(one))
            there, asked = min(there, other, key=lambda each: each.misfit), asked | other.asked
        return replace(there, asked=frozenset(asked), why=why)

    def _falls_short(self, one: Ranked, found: Ranked) -> bool:
        """Whether the first moves found much less than slopes promise of a large part: perhaps another minimum.

        A probe, which has many numbers, finds one way or another.
        """
        left = beyond_noise(self.base.misfit, self.base.count - len(self.base.values))
        promised, effect = min(one.finding.fall, left), one.candidate.effect
        may = effect.simulated and not effect.probe and promised >= self.large
        return may and found.finding.fall < ENOUGH * promised

    def gone_on(self, pair: tuple[Ranked, float]) -> _Tried:
        """The other moves of one that has not converged, and the share of the step at which it began."""
        return self._refit(*pair)

    def _refit(self, one: Ranked, share: float, start: InverseProblem | None = None) -> _Tried:
        problem, effect, before = self.first.comparison.problem, one.candidate.effect, one.refitted
        by = said_by(FIRST_PASS, problem.settings.model.effects)
        begin(f"{by}: {effect.name} ({effect.title})")
        wider = start or widened(problem, self.base.values, _just_present(replace(one, refitted=None), share))
        try:
            if before is None:
                there = self.first.refit(wider, wider.settings.starts(), effect, FIRST_MOVES, near=True)
            else:
                # decks that nobody answers to first order, or not at once: of a field of stiffness there would be 30
                # slopes to simulate
                deck = wider.ask(before.values).every[0].deck
                near = any(keyword.search(deck) for keyword in (BY_PATH, IN_TIME))
                there = self.first.refit(wider, before.values, effect, MOVES - FIRST_MOVES, near)
        except StateError:
            return _Tried(None, frozenset(wider.asked), share, why=wider.lost.why(sorted(wider.asked)))
        run, left = there.simulations, beyond_noise(self.base.misfit, self.base.count - len(self.base.values))
        there = replace(there, simulations=run + (before.simulations if before else 0))
        fall = max(0.0, self.base.misfit - there.misfit)
        shown = f"explains {min(100, 100 * fall / left):.0f} %" if left > 1.0 else f"lowers the misfit by {fall:.3g}"
        # from several places: which of them is told
        began = ", ".join(f"{key.partition('.')[2]} {value:.3g}" for key, value in one.candidate.place.items())
        who = f"{effect.name} ({began})" if began else effect.name
        tell(f"{by}: {who} {shown}; {counted(there.simulations, 'simulation')}")
        size = np.array([there.values[effect.key(p.name)] - p.null for p in effect.parameters])
        finding, there = replace(one.finding, fall=fall, size=size), replace(there, share=fall / left)
        found = replace(one, finding=finding, refitted=there, columns=np.zeros((0, 0)), also=())
        return _Tried(found, frozenset(wider.asked), share)

    def _half_way(self, one: Ranked) -> InverseProblem:
        """The model with half of the size that slopes predict, the constants following."""
        comparison, half = self.first.comparison, 0.5 * one.finding.size
        values = _following(comparison, comparison.score_test, one.columns @ half, self.base.values)
        begin = replace(one, refitted=None, finding=replace(one.finding, size=half))
        return widened(comparison.problem, values, begin)


def _just_present(one: Ranked, share: float = 1.0) -> Ranked:
    """A candidate a share of its first step off its absent value, to the side that its slopes point to.

    Numbers of a series that act on held-out pictures alone are where these have them.
    """
    effect, steps = one.candidate.effect, list[float]()
    for p, size, held in zip(effect.parameters, one.finding.size, of_held_out(one), strict=True):
        side = size if abs(size) > ROUNDING * abs(p.step) else p.step
        step = size if held else share * np.copysign(p.step, side)
        steps.append(np.clip(step, p.lower - p.null, p.upper - p.null))
    return replace(one, finding=replace(one.finding, size=np.array(steps)))


def _following(
    comparison: Comparison, score_test: ScoreTest, signal: np.ndarray, values: Mapping[str, float]
) -> dict[str, float]:
    """A guess whose constants make up for a signal, shape (kept,), by a factor of e at most."""
    change = np.clip(score_test.follow(signal), -1.0, 1.0)
    return {**values, **moved(comparison.problem.settings.parameters(), values, change)}
