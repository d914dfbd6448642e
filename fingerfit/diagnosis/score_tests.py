"""The score test: how much of the residual would an effect explain, once the model's own constants follow.

The residual r = J d + S t + noise is whitened with its covariance; what the model's own constants (columns J) could
still take up is projected away, and the fall of the misfit by the columns S of an effect follows (the Lagrange
multiplier test: Rao 1948; modification indices of structural equation models are the same thing).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from fingerfit.core.errors import StateError

RANK = 1e-6
"""Singular value of slopes, as a share of the largest one, up to which a direction counts as none: rounding."""
SAME = 1e-8
"""The same of the signatures of effects."""
MODE = 1e-3
"""What a mode of length 1 must have left beside the constants to be looked at by itself. A choice."""
VISIBLE = 1e-4
"""Share of its signal that the constants cannot imitate, below which an effect is not seen at all. A choice."""


def beyond_noise(misfit: float, freedom: int) -> float:
    """Misfit beyond what noise leaves on average, of which effects explain shares; 1 where there is less."""
    return max(misfit - freedom, 1.0)


def per_value(misfit: float, freedom: int) -> float:
    """Misfit per degree of freedom, at least 1: by it all evidence weighs less where no model explains the data."""
    return max(1.0, misfit / max(freedom, 1))


@dataclass(frozen=True)
class Known:
    """What is known of a model's numbers beside the measurements: priors, and bounds.

    Parameters
    ----------
    left : ndarray, shape (priors,)
        What priors leave, in units of their standard deviations.
    slopes : ndarray, shape (priors, parameters)
        Of the model's numbers.
    held : ndarray of bool, shape (parameters,)
        Which numbers have ended at a bound.
    """

    left: np.ndarray
    slopes: np.ndarray
    held: np.ndarray

    @staticmethod
    def nothing(parameters: int) -> Known:
        """No priors, and no number at a bound."""
        return Known(np.zeros(0), np.zeros((0, parameters)), np.zeros(parameters, dtype=bool))


@dataclass(frozen=True)
class Finding:
    """What an effect would do.

    Parameters
    ----------
    fall : float
        Predicted fall of the misfit.
    size : ndarray, shape (columns,)
        Best sizes of the effect's columns.
    visible : float
        Share of the columns' signal that the model's own constants cannot imitate, 0 to 1.
    signal : float
        Misfit that the effect would cause at the size of its columns, after the constants have followed.
    """

    fall: float
    size: np.ndarray
    visible: float
    signal: float


class ScoreTest:
    """Residual and own sensitivities, whitened.

    Parameters
    ----------
    residual : ndarray, shape (values,)
    covariance : ndarray, shape (values, values)
        Of the noise.
    own : ndarray, shape (values, parameters)
        Slopes of the model's constants.
    nuisance : ndarray, shape (values, nuisances)
        Signals of unknown size with standard deviation 1: force noise by step, error of the mesh by step.
    common : ndarray, shape (values, modes), optional
        What all values of a step have in common. Of thousands of values a few that are far off hardly raise the
        misfit of all, so that these modes are looked at by themselves: `common_misfit`, with `common_freedom`.

    known : Known, optional
        Priors are more values. A number that has ended at a bound follows nothing: what it would explain beyond it,
        or has not found, counts as left.

    Attributes
    ----------
    spread : ndarray, shape (values,)
        Standard deviation of each value by all of the noise, nuisances included.
    own : ndarray, shape (values + priors, parameters)
        Slopes of the model's constants, in units of the noise; those of priors come last, as they do everywhere here.
    left : ndarray, shape (values + priors,)
        The residual, in units of the noise.
    """

    def __init__(
        self,
        residual: np.ndarray,
        covariance: np.ndarray,
        own: np.ndarray,
        nuisance: np.ndarray,
        common: np.ndarray | None = None,
        known: Known | None = None,
    ) -> None:
        try:
            self._root = np.linalg.cholesky(covariance + nuisance @ nuisance.T)
        except np.linalg.LinAlgError as error:
            text = "some measurements have no noise of their own, so that nothing can be weighed against it"
            raise StateError(f"{text}: give noise in study.yaml (noise, pictures.noise)") from error
        self.spread = np.sqrt((self._root**2).sum(axis=1))
        self._weigh(residual, own, common, known)

    def of_another(self, residual: np.ndarray, own: np.ndarray, known: Known | None = None) -> ScoreTest:
        """The same of another model's residual, slopes and priors, by this covariance, which is factored once."""
        other = copy(self)
        other._weigh(residual, own, None, known)
        return other

    def _weigh(
        self,
        residual: np.ndarray,
        own: np.ndarray,
        common: np.ndarray | None,
        known: Known | None,
    ) -> None:
        known = known or Known.nothing(own.shape[1])
        self._priors = len(known.left)
        self.own, self.left = self.whiten(own), self.whiten(residual)
        values = len(residual)
        self.own[values:], self.left[values:] = known.slopes, known.left
        self._follow(np.ones(own.shape[1], dtype=bool))
        self.freedom = len(self.left) - self._own.shape[1]  # of all numbers that were fitted
        if known.held.any():
            self._follow(~known.held)
        self.rest = self._without_own(self.left)
        self.misfit = float(self.rest @ self.rest)
        self.common_misfit, self.common_freedom = 0.0, 0
        if common is not None:
            columns = self.whiten(common)
            columns = self._without_own(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300))
            modes, sizes, _ = np.linalg.svd(columns, full_matrices=False)
            modes = modes[:, sizes > MODE]
            self.common_misfit, self.common_freedom = float(((modes.T @ self.rest) ** 2).sum()), modes.shape[1]

    def _follow(self, free: np.ndarray) -> None:
        """Learn what the model's numbers take up, where only some of them, shape (parameters,), follow."""
        basis, sizes, turn = np.linalg.svd(self.own * free, full_matrices=False)
        seen = sizes > RANK * sizes.max(initial=0.0)
        self._own = basis[:, seen]
        self._inverse = (turn[seen].T / sizes[seen]) @ self._own.T

    @property
    def beyond_noise(self) -> float:
        """Misfit beyond the noise, at least 1."""
        return beyond_noise(self.misfit, self.freedom)

    def whiten(self, columns: np.ndarray) -> np.ndarray:
        """Columns in units of the noise; priors do not see them."""
        from scipy.linalg import solve_triangular

        values = solve_triangular(self._root, columns, lower=True, check_finite=False)
        return np.concatenate([values, np.zeros((self._priors, *columns.shape[1:]))])

    def _without_own(self, columns: np.ndarray) -> np.ndarray:
        return columns - self._own @ (self._own.T @ columns)

    def signature(self, columns: np.ndarray) -> np.ndarray:
        """What the own constants cannot imitate of columns, in units of the noise."""
        return self._without_own(self.whiten(columns))

    def follow(self, signal: np.ndarray) -> np.ndarray:
        """How the own constants follow a signal, shape (values,), to make up for it, shape (parameters,)."""
        return np.asarray(-self._inverse @ self.whiten(signal))

    def test(self, columns: np.ndarray, low: np.ndarray, high: np.ndarray) -> Finding:
        """Test an effect.

        Parameters
        ----------
        columns : ndarray, shape (values, k)
            Its slopes.
        low, high : ndarray, shape (k,)
            Bounds of their sizes.
        """
        whitened = self.whiten(columns)
        signature = self._without_own(whitened)
        total, left = float((whitened**2).sum()), float((signature**2).sum())
        visible = left / total if total > 0 else 0.0
        if visible < VISIBLE:
            return Finding(0.0, np.zeros(columns.shape[1]), visible, left)
        size = np.linalg.lstsq(signature, self.rest, rcond=SAME)[0]
        inside = np.clip(size, low, high)
        if not np.allclose(inside, size) and len(size) > 1:
            free = inside == size
            rest = self.rest - signature[:, ~free] @ inside[~free]
            inside[free] = np.clip(np.linalg.lstsq(signature[:, free], rest, rcond=SAME)[0], low[free], high[free])
        after = self.rest - signature @ inside
        return Finding(max(0.0, self.misfit - float(after @ after)), inside, visible, left)


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    """Largest squared cosine between two sets of signatures, 0 to 1: 1 where one can do all that the other does."""
    bases = []
    for columns in (a, b):
        basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        bases.append(basis[:, sizes > SAME * sizes.max(initial=1e-300)])
    cosines = np.linalg.svd(bases[0].T @ bases[1], compute_uv=False)
    return float(cosines.max(initial=0.0) ** 2)
