"""How many rounds and simulations a fit will ask for, before anything is simulated.

Points of a grid are known; how often a simplex is reflected depends on scores that nobody knows yet. So the very search
of the settings runs on bowls - quadratic functions of the search coordinates - whose lowest points lie in different
places within the bounds, some narrow, some wide, some long in the direction that layers can hardly be told apart in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.fit.jobs import ITERATIONS
from fingerfit.fit.refine import AGAIN, SOLUTIONS
from fingerfit.search import Evaluation, Match, propose
from fingerfit.search.stages import Point, Space, Tie

if TYPE_CHECKING:
    from fingerfit.settings.config import Settings

_PLACES = 6
"""Bowls of each width and shape: the quartiles by 24 bowls of the phantom are within a tenth of those by 96."""
_CURVATURE = {"nmi": (0.1, 1.0), "ssd": (0.1, 1.0), "likelihood": (1e2, 1e6)}
"""Second derivative of the score by the logarithm of a constant. Scores of pictures change by less than 1 over all
bounds: normalized information lies between 1 and 2, intensities between 0 and 1. That of a likelihood is one over the
square of the standard error: 10 % and 0.1 %."""
_SHAPES = (1.0, 30.0)
"""How much wider a bowl is between constants of one kind than along their mean: the phantom's layers have 30."""


@dataclass(frozen=True)
class Expected:
    """What a fit will probably ask for: lower and upper quartile of the bowls, and the fewest and most after a search.

    Parameters
    ----------
    rounds : (int, int)
    simulations : (int, int)
        In all.
    finest : (int, int)
        Of these on the finer mesh; none without one.
    """

    rounds: tuple[int, int]
    simulations: tuple[int, int]
    finest: tuple[int, int]


def expected(settings: Settings, refined: bool, short: bool = False) -> Expected:
    """What a fit of these settings will probably ask for.

    Parameters
    ----------
    settings : Settings
    refined : bool
        Whether there is a finer mesh.
    short : bool
        Whether one round makes several iterations of the search (`fingerfit.fit.jobs.next_job`).
    """
    count = len(settings.parameters())
    # with a finer mesh each solution there is compared with one on that of the search
    pair = 2 if refined else 1
    slopes = pair + 2 * count
    if settings.model.effects:
        # first slopes by one side of each, and again where they lead
        rounds, simulations, first = (0, 0), (pair + count, pair + count), 1
    else:
        found = np.array([_searched(settings, bowl, ITERATIONS if short else 1) for bowl in bowls(settings)])
        low, high = np.quantile(found, (0.25, 0.75), axis=0)
        rounds, simulations, first = (int(low[0]), int(high[0])), (int(low[1]), int(high[1])), 0
    # slopes by the prescribed quantity, two simulations, come with the first solution after the slopes
    fewest, most = slopes + 2 + pair, AGAIN * slopes + 2 + (SOLUTIONS - 1) * pair
    return Expected(
        (rounds[0] + first + 2, rounds[1] + first + AGAIN + SOLUTIONS - 1),
        (simulations[0] + fewest, simulations[1] + most),
        (first + 2, first + AGAIN + SOLUTIONS - 1) if refined else (0, 0),
    )


def bowls(settings: Settings) -> Iterator[Bowl]:
    """Scores with a known lowest point, for the parameters of settings."""
    from scipy.stats import qmc

    parameters = settings.parameters()
    space = Space(parameters)
    tie = Tie(space, settings.plan().stages[-1].tied)
    low, high = space.low, space.high
    spread = qmc.Halton(len(parameters), scramble=False)
    spread.fast_forward(1)  # the first one is a corner
    for share in spread.random(_PLACES):
        # in the inner half: bounds are guessed with room to spare
        lowest = low + (0.25 + 0.5 * share) * (high - low)
        for curvature in _CURVATURE[settings.fit.score]:
            for shape in _SHAPES:
                yield Bowl(tie, lowest, curvature, shape)


@dataclass(frozen=True)
class Bowl:
    """A score by its lowest point, and by its curvatures along the mean of tied parameters and between them."""

    tie: Tie
    lowest: np.ndarray
    curvature: float
    shape: float

    def __call__(self, point: Point) -> float:
        """The score."""
        away = self._deviations(point)
        return float(self.curvature / 2 * away @ away)

    def match(self, point: Point) -> Match:
        """The same for least squares: displacements that are one over the modulus."""
        size, moved = np.sqrt(self.curvature), np.exp(-self._deviations(point))
        return Match(size * moved, size * (1.0 - moved), np.ones(len(moved)))

    def _deviations(self, point: Point) -> np.ndarray:
        away = self.tie.space.coordinates(point) - self.lowest
        along = np.where(self.tie.tied, away[self.tie.tied].mean(), away)
        return np.asarray(along + (away - along) / np.sqrt(self.shape))


def _searched(settings: Settings, bowl: Bowl, most: int) -> tuple[int, int]:
    """Rounds, of at most so many iterations of one stage, and simulations of a search."""
    history: list[Evaluation] = []
    rounds, stage, iterations = 0, "", 0
    while True:
        proposal = propose(history, settings.parameters(), settings.plan())
        if proposal.stop is not None:
            return rounds, len(history)
        history += [Evaluation(point, bowl(point), bowl.match(point)) for point in proposal.batch]
        iterations += 1
        if proposal.stage != stage or iterations >= most:
            rounds, stage, iterations = rounds + 1, proposal.stage, 0
