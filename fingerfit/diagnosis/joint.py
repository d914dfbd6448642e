"""A fitted model against all tests of its study: their values are one vector, with one covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fingerfit.diagnosis.candidates import Candidate
from fingerfit.diagnosis.comparison import Comparison, Everything, Slope, anchor_of
from fingerfit.fit.joint import only_of_each
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.model.effect import Effect
from fingerfit.model.parameters import Parameter
from fingerfit.study.data import Data


class JointComparison(Comparison):
    """The comparisons of several tests as one. Noise and errors of meshes of different tests do not know of each other.

    Parameters
    ----------
    problem : InverseProblem
        Of all tests.
    last : Round
        Its last round.
    everything : sequence of Data
        Of each test, prepared with all pictures.
    find_blur : bool
        As of `Comparison`.
    """

    def __init__(
        self, problem: InverseProblem, last: Round, everything: Sequence[Data], find_blur: bool = True
    ) -> None:
        self.problem, self.last = problem, last
        self.base, self.anchor = finest(problem, last), anchor_of(problem, last)
        self.mesh = problem.mesh_of(self.base)
        self._tests = tuple(
            Comparison(
                test, replace(last, batch=[asked.every[n] for asked in last.batch]), data, self.base.every[n], find_blur
            )
            for n, (test, data) in enumerate(zip(problem.every, everything, strict=True))
        )
        self.kept = np.concatenate([test.kept for test in self._tests])

    @property
    def every(self) -> tuple[Comparison, ...]:
        """The comparisons of the tests."""
        return self._tests

    @property
    def everything(self) -> list[Data]:
        """What was measured in each test."""
        return [test.data for test in self._tests]

    def read(self, asked: Asked) -> np.ndarray | None:
        """Displacements and response of the simulations of a guess, shape (all,); None where a test has no solution."""
        return joined([test.read(one) for test, one in zip(self._tests, asked.every, strict=True)])

    def read_beside(self, asked: Sequence[Asked], threads: int = 1, here: Asked | None = None) -> list[Asked]:
        """Nothing of several tests is read to first order."""
        return list(asked)

    def column(self, parameter: Parameter, slope: Slope | None = None) -> np.ndarray:
        """Derivative of all values by the search coordinate of a fitted number, shape (all,).

        By another `slope` it is asked of each test.
        """
        _no_other(slope)
        return np.concatenate([test.column(parameter) for test in self._tests])

    def slope(self, name: str) -> np.ndarray:
        """Slope of displacements and response by a constant, shape (all,)."""
        return np.concatenate([test.slope(name) for test in self._tests])

    def nuisance(self, slope: Slope | None = None, kept: np.ndarray | None = None) -> np.ndarray:
        """Signals of unknown size with standard deviation 1: those of each test for itself."""
        _no_other(slope)
        if kept is not None:
            raise only_of_each("nuisances of other values")
        return diagonal([test.nuisance() for test in self._tests])

    def common(self) -> np.ndarray:
        """What all values of a step of a test have in common."""
        return diagonal([test.common() for test in self._tests])

    @property
    def whole(self) -> np.ndarray:
        """What the model leaves of all that was measured in the tests, shape (all,)."""
        return np.concatenate([test.whole for test in self._tests])

    @property
    def covariance(self) -> np.ndarray:  # type: ignore[override]
        """Of the noise and of the errors of the meshes, shape (kept, kept)."""
        return diagonal([test.covariance for test in self._tests])

    def columns(self, candidate: Candidate, without: Asked | None = None) -> np.ndarray | None:
        """Slopes of a candidate, shape (kept, its parameters); 0 in tests that do not show it, None as of one test."""
        found = []
        for n, test in enumerate(self._tests):
            own = replace(candidate, asked=tuple(asked.every[n] for asked in candidate.asked))
            found.append(test.columns(own, without.every[n] if without else None))
        return joined(found)

    def observed(self, effect: Effect, values: Mapping[str, float], name: str) -> np.ndarray:
        """Slope of an effect on the observation by one of its parameters, of all values."""
        return np.concatenate([test.observed(effect, values, name) for test in self._tests])


def comparison_of(problem: InverseProblem, last: Round, everything: Everything, find_blur: bool = True) -> Comparison:
    """A fitted model against its study, of one test or of several."""
    if isinstance(everything, Data):
        return Comparison(problem, last, everything, find_blur=find_blur)
    return JointComparison(problem, last, everything, find_blur)


def _no_other(slope: Slope | None) -> None:
    if slope is not None:
        raise only_of_each("slopes by another function")


def joined(parts: list[np.ndarray | None]) -> np.ndarray | None:
    """Values of all tests, one after the other; None where those of a test are not there."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """A matrix of blocks along its diagonal, one for each test."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks))
