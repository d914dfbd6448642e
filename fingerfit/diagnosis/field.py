"""Stiffness as a field: the map of log mu that a fitted model with a series of modes has, and how sure it is.

The fit ends where the score is least, wherever that is along what the data hardly see. The map is the likeliest one
near it, of displacements and response with all of their noise, and of modes that were normal, with their likely sizes,
before anything was measured (a reduced-rank Gaussian process: Solin and Särkkä, Statistics and Computing 30, 2020).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from fingerfit.deck.modes import modes_of
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.evidence import LIKELY
from fingerfit.diagnosis.score_tests import per_value
from fingerfit.fit.slopes import coordinates
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.model.modes import NAME
from fingerfit.study.several import AT

FLAT = 1e-9
"""Precision of the model's constants before anything was measured: none, but for a system that can be solved."""


@dataclass(frozen=True)
class Field:
    """A map of stiffness.

    Parameters
    ----------
    basis : ndarray, shape (elements, numbers)
        What each number of the series adds to log mu in each element.
    size : ndarray, shape (numbers,)
        The likeliest numbers.
    covariance : ndarray, shape (numbers, numbers)
        Of these numbers, with what the modes may add that the model does not have: those come last, as likely as the
        series says where its first numbers are of their likely sizes.
    before : ndarray, shape (numbers,)
        Standard deviations of the numbers before anything was measured.
    """

    basis: np.ndarray
    size: np.ndarray
    covariance: np.ndarray
    before: np.ndarray

    @property
    def value(self) -> np.ndarray:
        """Change of log mu in each element, shape (elements,)."""
        return np.asarray(self.basis @ self.size)

    @property
    def spread(self) -> np.ndarray:
        """Its standard deviation."""
        return np.sqrt(np.einsum("ek,kl,el->e", self.basis, self.covariance, self.basis))

    @property
    def seen(self) -> np.ndarray:
        """Share of what was not known before that the data tell, 0 to 1, in each element."""
        prior = np.square(self.basis * self.before).sum(axis=1)
        return np.clip(1.0 - self.spread**2 / np.maximum(prior, 1e-300), 0.0, 1.0)


def field_of(comparison: Comparison) -> Field | None:
    """The map of a fitted model, of several tests that of one of them; None where it has no series of modes."""
    problem, score_test = comparison.problem, comparison.score_test
    effect = next(
        (one for one in problem.settings.effects() if one.series and NAME in one.changes.get("field", "")), None
    )
    if effect is None:
        return None
    parameters, whole = problem.settings.parameters(), problem.effects[effect.name]
    names = [p.name.partition(AT)[::2] for p in parameters]
    own = np.array([name in effect.null() and test in ("", problem.test) for name, test in names], dtype=bool)
    # what no model explains counts as noise
    spread = per_value(score_test.misfit, score_test.freedom)
    columns, rest = score_test.own / np.sqrt(spread), score_test.left / np.sqrt(spread)
    at = coordinates(parameters, comparison.base.values) * own
    scale = np.array([p.scale for p in whole.parameters])
    unity = np.array([p.scale for p in parameters])[own]
    precision = np.full(len(own), FLAT)
    precision[own] = np.square(unity / (LIKELY * scale[: len(unity)]))
    inverse = np.linalg.inv(columns.T @ columns + np.diag(precision))
    found = at + inverse @ (columns.T @ rest - precision * at)
    count = int(own.sum())
    size, before = np.zeros(len(scale)), LIKELY * scale
    size[:count] = found[own] * unity
    covariance = np.diag(np.square(before) * np.mean(np.square(size[:count] / before[:count])))
    covariance[:count, :count] = inverse[np.ix_(own, own)] * np.outer(unity, unity)
    constants = {name for name, _ in names}
    return Field(basis_of(whole, problem.meshes[comparison.mesh], constants), size, covariance, before)


def basis_of(effect: Effect, mesh: Mesh, constants: Collection[str]) -> np.ndarray:
    """Mean of the modes in each element, shape (elements, parameters of the effect); `constants` are what is fitted."""
    return np.stack([points.mean(axis=0) for points in modes_of(mesh, constants, len(effect.parameters))])
