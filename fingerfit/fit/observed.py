"""Numbers of effects on the observation, by least squares.

A similarity of pictures does not see their common brightness, nor forces and displacements at all. So these numbers
are those that leave the least squares of pictures, response and points, in an estimate and in its repetitions.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fingerfit.fit.linear import LinearModel
from fingerfit.forward.score import Prediction, deviations
from fingerfit.study.data import Data

_ROUNDING = 1e-12
"""Of normal equations, relative to the largest: what is below cannot be told from rounding."""


class Observed:
    """Least squares of pictures, response and points in these numbers, near the base of a linear model.

    The noise of the prescribed quantity moves pictures and response together: one unknown more for each step.

    Parameters
    ----------
    which : ndarray of bool, shape (parameters,)
        Which parameters these numbers are.
    data : Data
    model : LinearModel
    """

    def __init__(self, which: np.ndarray, data: Data, model: LinearModel) -> None:
        self._data, self._model = data, model
        self._scale = np.sqrt(2.0) * data.picture_noise or 1.0
        self.number, self._others = np.flatnonzero(which), np.flatnonzero(~which)
        steps = len(data.step)
        unknown = [model.by_control(share, data) for share in np.diag(data.control_share)]
        changes = self._changes([*(model.slopes[n] for n in self.number), *unknown])
        likely = np.concatenate([np.zeros((steps, len(self.number))), np.eye(steps)], axis=1)
        self._columns = np.concatenate([changes, likely])

    @cached_property
    def _normal(self) -> np.ndarray:
        return np.asarray(self._columns.T @ self._columns)

    def _changes(self, slopes: Sequence[Prediction]) -> np.ndarray:
        """What slopes change, shape (values, slopes)."""
        base, data = self._model.base, self._data
        left = deviations(base, data)
        of = [[(one.pictures / self._scale).ravel(), deviations(base + one, data) - left] for one in slopes]
        return np.stack([np.concatenate(both) for both in of], axis=1)

    def _left(self, there: Prediction, data: Data) -> np.ndarray:
        pictures = ((there.pictures - data.measured) / self._scale).ravel()
        return np.concatenate([pictures, deviations(there, data), np.zeros(len(data.step))])

    def moves(self, low: np.ndarray, high: np.ndarray, there: Prediction) -> np.ndarray:
        """Moves of the numbers from those with which `there` is predicted, shape (numbers,).

        Parameters
        ----------
        low, high : ndarray, shape (parameters,)
            Bounds of the moves.
        there : Prediction
        """
        ends = np.full(len(self._data.step), np.inf)
        bounds = np.concatenate([low[self.number], -ends]), np.concatenate([high[self.number], ends])
        return between(*bounds, self._columns, self._left(there, self._data))[: len(self.number)]

    def repeated(self, offset: Prediction, data: Data) -> np.ndarray:
        """The same of a repetition whose data, and what it adds to the base, are given; bounds do not matter there."""
        return self._solve(self._left(self._model.base + offset, data))

    def follow(self, shifts: np.ndarray) -> np.ndarray:
        """How the numbers follow shifts of the others, shape (repetitions, parameters): (repetitions, numbers)."""
        changes = self._changes([self._model.slopes[n] for n in self._others])
        none = np.zeros((len(self._data.step), len(self._others)))
        return np.asarray(shifts[:, self._others] @ self._solve(np.concatenate([changes, none])).T)

    def _solve(self, left: np.ndarray) -> np.ndarray:
        # there are many values and few numbers; what changes nothing stays
        inverse = np.linalg.pinv(self._normal, rcond=_ROUNDING, hermitian=True)
        return np.asarray(-inverse[: len(self.number)] @ (self._columns.T @ left))

    @property
    def curvature(self) -> np.ndarray:
        """Second derivatives of half the squares by these numbers, shape (numbers, numbers)."""
        count, whole = len(self.number), self._normal
        beside = np.linalg.solve(whole[count:, count:], whole[count:, :count])
        return np.asarray(whole[:count, :count] - whole[:count, count:] @ beside)


def between(low: np.ndarray, high: np.ndarray, columns: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Linear least squares between bounds; what changes nothing stays, as that of a picture not fitted."""
    from scipy.optimize import lsq_linear

    found, seen = np.zeros(columns.shape[1]), columns.any(axis=0)
    # bounds that coincide, as at a corner of the space, are kept a little apart
    if seen.any():
        found[seen] = lsq_linear(columns[:, seen], -left, (low[seen] - 1e-9, high[seen] + 1e-9)).x
    return found
