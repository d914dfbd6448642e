"""The fit of a study with several tests: one guess is simulated in each, and one likelihood holds for all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import digest
from fingerfit.fit.discrepancy import Discrepancy
from fingerfit.fit.kept import Kept
from fingerfit.fit.linear import LinearModel
from fingerfit.fit.objective import Objective
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.forward.predict import Synthesis
from fingerfit.forward.score import JointPrediction
from fingerfit.mesh.mesh import Mesh
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data

if TYPE_CHECKING:
    from fingerfit.settings.config import Settings


def problem_of(
    settings: Settings,
    data: Sequence[Data],
    mesh_files: Sequence[dict[str, Path]],
    sims: Path,
    data_files: Sequence[Path] = (),
) -> InverseProblem:
    """The fit of a study: of its only test, or of all of them together.

    Parameters
    ----------
    settings : Settings
    data : sequence of Data
        Measurements of the tests, in their order.
    mesh_files : sequence of dict
        Their meshes: ``search`` and, where there is one, ``refined``.
    sims : Path
        Folder of the simulations.
    data_files : sequence of Path
        Files of the measurements, beside which predictions are kept; without them nothing is kept.
    """
    kept: list[Kept | None] = [None] * len(data)
    if data_files:
        kept = [Kept.beside(file, own) for file, own in zip(data_files, data, strict=True)]
    if len(data) == 1:
        return InverseProblem(settings, data[0], mesh_files[0], sims, kept=kept[0])
    names = [test.test for test in settings.read_study().tests]
    made = zip(data, mesh_files, names, kept, strict=True)
    return JointProblem.of(
        [InverseProblem(settings, own, files, sims, test=name, kept=there) for own, files, name, there in made]
    )


@dataclass(frozen=True)
class JointProblem(InverseProblem):
    """The fits of several tests as one; for questions of mesh and dimension its meshes are those of the first.

    Parameters
    ----------
    tests : tuple of InverseProblem
    """

    tests: tuple[InverseProblem, ...] = ()

    @classmethod
    def of(cls, tests: Sequence[InverseProblem]) -> JointProblem:
        """Of the fits of tests, which share their settings."""
        one = tests[0]
        # whoever asks for the data of all tests must ask each of them
        nothing: Any = None
        return cls(one.settings, nothing, one.mesh_files, one.sims, tests=tuple(tests), lost=one.lost)

    @property
    def every(self) -> tuple[InverseProblem, ...]:
        """The fits of the tests."""
        return self.tests

    @property
    def mesh_paths(self) -> dict[str, Path]:
        """Files of the meshes by the hashes of their contents."""
        return {name: path for test in self.tests for name, path in test.mesh_paths.items()}

    @property
    def exact(self) -> bool:
        """Whether forces and points alone are fitted, in all tests."""
        return all(test.exact for test in self.tests)

    @cached_property
    def matcher(self) -> Any:
        """Matches of guesses on the meshes of the search; made of those of the tests."""
        return [test.matcher for test in self.tests]

    def ask(self, values: Mapping[str, float], role: str = SEARCH, *how: Any, **named: Any) -> Asked:
        """The simulations of a guess, one of each test."""
        asked = tuple(test.ask(values, role, *how, **named) for test in self.tests)
        return Asked(dict(values), digest(*(one.sim for one in asked)), asked[0].mesh, "", role, asked)

    def with_mesh(self, name: str, mesh: Mesh) -> InverseProblem:
        """Not of several tests, as the following three."""
        raise only_of_each("a mesh more")

    def outcome(self, asked: Asked) -> Outcome:
        """Not of several tests."""
        raise only_of_each("a solution")

    def _synthesis(self, asked: Asked) -> Synthesis | None:
        raise only_of_each("a synthesis")

    @cached_property
    def discrepancy(self) -> Discrepancy | None:
        """Not of several tests."""
        raise only_of_each("an error of the model")

    def refusal(self, asked: Asked) -> InputError | None:
        """Why the solver does not take the deck of a test; None where it takes all."""
        return next(filter(None, (test.refusal(one) for test, one in self._pairs(asked))), None)

    def with_settings(self, settings: Settings) -> JointProblem:
        """The fit of another model to the same measurements."""
        return JointProblem.of([test.with_settings(settings) for test in self.tests])

    def as_counted(self, prediction: Any) -> InverseProblem:
        """The fits with the noise that their data count with at a prediction."""
        if self.settings.fit.discrepancy == "none":
            return self
        pairs = zip(self.tests, prediction.tests, strict=True)
        return JointProblem.of([test.as_counted(own) for test, own in pairs])

    def prediction(self, asked: Asked) -> Any:
        """What should have been measured in each test."""
        return JointPrediction(tuple(test.prediction(one) for test, one in self._pairs(asked)))

    def folds(self, asked: Asked) -> bool:
        """Whether a body goes through itself in the pictures of a test."""
        return any(test.folds(one) for test, one in self._pairs(asked))

    def predict_all(self, batch: Sequence[Asked], processes: int) -> None:
        """Keep the predictions of all guesses that have a solution."""
        for n, test in enumerate(self.tests):
            test.predict_all([asked.every[n] for asked in batch], processes)

    def keep(self, batch: Sequence[Asked]) -> None:
        """Those of each test."""
        for n, test in enumerate(self.tests):
            test.keep([asked.every[n] for asked in batch])

    def fit_to_data(self, prediction: Any) -> float:
        """Score of all tests together: the sum of their negative log likelihoods."""
        return sum(test.fit_to_data(own) for test, own in zip(self.tests, prediction.tests, strict=True))

    def deviations(self, prediction: Any) -> np.ndarray:
        """Response and points less what was measured, in units of the noise, of all tests."""
        pairs = zip(self.tests, prediction.tests, strict=True)
        return np.concatenate([test.deviations(own) for test, own in pairs])

    def _objective(self, model: LinearModel) -> Objective:
        pairs = zip(self.tests, model.every, strict=True)
        return Objective.total([test.objective(own, known=False) for test, own in pairs])

    def _pairs(self, asked: Asked) -> list[tuple[InverseProblem, Asked]]:
        return list(zip(self.tests, asked.every, strict=True))


def only_of_each(what: str) -> FingerfitError:
    """The error of a question that has an answer for each test alone."""
    return FingerfitError(f"{what} of several tests: ask each of them")
