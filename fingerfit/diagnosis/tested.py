"""What came of the tests of all candidates against what a model leaves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from fingerfit.core.errors import InputError
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.likelihood import Weighed
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.sides import Sides


@dataclass(frozen=True)
class Tested:
    """All candidates tested against what a model leaves: at all places, and the best place of each."""

    comparison: Comparison
    score_test: ScoreTest
    everywhere: list[Ranked]
    ranking: list[Ranked]
    tests: int
    run: int
    lacking: dict[str, InputError]
    outline: Sides

    def moved(self, one: Ranked, place: int) -> Ranked:
        """An effect in another of its places, the n-th of ``also``; it takes its place in the ranking, too."""
        there = one.also[place - 1]
        self.ranking[:] = [there if other is one else other for other in self.ranking]
        return there

    @cached_property
    def weighed(self) -> Weighed:
        """What the model leaves, for comparisons with all its refits."""
        return Weighed.of(self.comparison)
