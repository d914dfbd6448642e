"""All candidates tested against what a model leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

from fingerfit.core.errors import InputError
from fingerfit.core.progress import tell
from fingerfit.diagnosis.candidates import Candidate, candidates, makes_sense, may_be
from fingerfit.diagnosis.comparison import Comparison, Everything, anchor_of
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.mesh_errors import errors_but_mesh
from fingerfit.diagnosis.ranking import Ranked, best_places, rank_candidates
from fingerfit.diagnosis.refit import Refit, explains
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.series import cut, with_held_out
from fingerfit.diagnosis.sides import Sides, sides_of
from fingerfit.diagnosis.trials import refit_all
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.fit.rounds import Round, simulations
from fingerfit.model.effect import OUTLINE, STATE


@dataclass(frozen=True)
class Tested:
    """All candidates tested against what a model leaves.

    Parameters
    ----------
    comparison : Comparison
        Of the model.
    score_test : ScoreTest
        Of what it leaves.
    everywhere : list of Ranked
        Each candidate at all of its places.
    ranking : list of Ranked
        The best place of each effect, the best effect first.
    tests : int
        How many candidates were tested.
    run : int
        Simulations that were not known before.
    lacking : dict
        What the solver, or the deck, lacks for effects, by their titles: they were not tried.
    outline : Sides
        Where the picture before compression has the sides of the body.
    made : dict
        Refits that were made, by name of the effect.
    unsolved : dict
        Why effects do not count whose simulations the solver ended without an answer, by title.
    """

    comparison: Comparison
    score_test: ScoreTest
    everywhere: list[Ranked]
    ranking: list[Ranked]
    tests: int
    run: int
    lacking: dict[str, InputError]
    outline: Sides
    made: dict[str, Refit] = field(default_factory=dict)
    unsolved: dict[str, str] = field(default_factory=dict)

    @cached_property
    def but_mesh(self) -> tuple[float, float | None]:
        """Errors of the model on fitted and on held-out steps: as from `errors_but_mesh`."""
        return errors_but_mesh(self.comparison)

    def moved(self, one: Ranked, place: int) -> Ranked:
        """An effect in another of its places, the n-th of ``also``; it takes its place in the ranking, too."""
        there = one.also[place - 1]
        self.ranking[:] = [there if other is one else other for other in self.ranking]
        return there

    def ended(self, one: Ranked, why: str) -> None:
        """Say, where there is a reason, why an effect does not count whose refit has no solution."""
        if why:
            self.unsolved[one.candidate.effect.title] = why
            tell(f"tried {one.candidate.effect.name}: {why}; does not count")


def test_all(
    problem: InverseProblem,
    last: Round,
    everything: Everything,
    threads: int,
    known: Tested | None = None,
    family: str = "",
    sides: Sides | None = None,
) -> Tested:
    """Test all candidates, or the members of one family.

    Parameters
    ----------
    problem : InverseProblem
    last : Round
        Its last round, all simulations solved.
    everything : Data or sequence of Data
        As of `fingerfit.diagnosis.diagnose.diagnose`.
    threads : int
        Simulations beside each other.
    known : Tested, optional
        Of a model with an effect less, whose slopes are taken.
    family : str
        Whose members alone are tested, its probe left out.
    sides : Sides, optional
        Where the sides are taken to be; found in the picture before compression when left out.
    """
    if known is None:
        found, lacking = candidates(problem, finest(problem, last).values)
    else:
        tested, lacking = [one.candidate for one in known.everywhere], known.lacking
        possible = [one for one in tested if makes_sense(one.effect, problem)]
        found = [one for one in possible if may_be(one.effect, one.place, problem)]
    if family:
        found = [one for one in found if one.effect.family == family and not one.effect.probe]
    if known is None:
        tell(f"slopes of {len({candidate.effect.name for candidate in found})} effects")
    asked = [a for one in found for a in one.asked if not (known and problem.is_solved(a))]
    without = known.comparison.anchor if known else None
    run = solve_missing(problem, [anchor_of(problem, last)], threads, needed=True)
    comparison = comparison_of(problem, last, everything)
    run += solve_missing(problem, comparison.read_beside(asked, threads, without), threads)
    score_test, outline = comparison.score_test, sides_of(comparison) if sides is None else sides
    ranked = rank_candidates(comparison, score_test, found, without)
    everywhere = [with_held_out(comparison, cut(score_test, one)) for one in ranked]
    unsolved = _unsolved(problem, found, everywhere)
    ranking = best_places(everywhere)
    # a body of another shape is fitted before anything else, but for the state it may be in
    another = outline.off and not explains(score_test) and problem.settings.tries(OUTLINE)
    first, sloped = STATE if another else "", explains(score_test)
    ranking, more = refit_all(comparison, ranking, threads, sloped, everywhere, first, unsolved)
    run += more
    return Tested(comparison, score_test, everywhere, ranking, len(found), run, lacking, outline, unsolved=unsolved)


def _unsolved(problem: InverseProblem, found: Sequence[Candidate], solved: Sequence[Ranked]) -> dict[str, str]:
    """Why effects do not count of whose simulations the solver ended some at each place, by title; told as well."""
    counted, left = {one.candidate.effect.name for one in solved}, dict[str, str]()
    for effect in {one.effect.name: one.effect for one in found}.values():
        places = [one.asked for one in found if one.effect.name == effect.name]
        told = [problem.lost.why(one.sim for one in simulations(asked)) for asked in places]
        why = next(filter(None, told), "")
        if why and effect.name not in counted:
            left[effect.title] = why
            tell(f"tried {effect.name}: {why}; does not count")
        elif why:
            tell(f"tried {effect.name}: {why}; {sum(map(bool, told))} of its {len(told)} places do not count")
    return left


def in_space(problem: InverseProblem) -> bool:
    """Whether the body of any test is a volume."""
    return any(test.meshes[SEARCH].dim == 3 for test in problem.every)
