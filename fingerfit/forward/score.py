"""The score of a guess: what a simulation predicts against what was measured. Lower is better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.forward.partial_volume import PartialVolume
from fingerfit.imaging.similarity import LIMITS, nmi
from fingerfit.study.data import Data

KINDS = ("nmi", "ssd", "likelihood")
ROUNDING = 1e-9
"""Least variance of a combination of a point's errors, as a share of the largest: below it is rounding. A choice."""


@dataclass(frozen=True)
class Prediction:
    """What a simulation says should have been measured; arrays as in `Data`.

    Parameters
    ----------
    pictures : ndarray, shape (pictures, ny, nx) or (pictures, nz, ny, nx)
        Synthesized pictures.
    response : ndarray, shape (responses,)
        As `Data.response`: force in N under displacement control, displacement in mm under force control, of each step;
        then lateral forces, N.
    points : ndarray, shape (points, dim)
        Displacements of the measured points, mm.
    partial : PartialVolume, optional
        Pixels that tell less than others. A sum has those of its first part.
    """

    pictures: np.ndarray
    response: np.ndarray
    points: np.ndarray
    partial: PartialVolume | None = None

    def __add__(self, other: Prediction) -> Prediction:
        return Prediction(
            self.pictures + other.pictures, self.response + other.response, self.points + other.points, self.partial
        )

    def __sub__(self, other: Prediction) -> Prediction:
        return self + other * -1.0

    def __mul__(self, factor: float) -> Prediction:
        return Prediction(self.pictures * factor, self.response * factor, self.points * factor)

    def nearer(self, data: Data) -> np.ndarray:
        """Its pictures, as much nearer to the measured ones as pixels tell less than others."""
        if not self.partial:
            return self.pictures
        return data.measured + self.partial.sure(self.pictures.shape) * (self.pictures - data.measured)

    def by_step(self, factor: np.ndarray, data: Data) -> Prediction:
        """Each step times its own factor, shape (steps,)."""
        per_picture = factor[data.picture_step].reshape(-1, *[1] * (self.pictures.ndim - 1))
        per_point = factor[data.points_step][:, None]
        return Prediction(
            self.pictures * per_picture, self.response * factor[data.response_step], self.points * per_point
        )


@dataclass(frozen=True)
class JointPrediction:
    """Predictions of several tests, with the arithmetic of one.

    Parameters
    ----------
    tests : tuple of Prediction
    """

    tests: tuple[Prediction, ...]

    def __add__(self, other: JointPrediction) -> JointPrediction:
        return JointPrediction(tuple(a + b for a, b in zip(self.tests, other.tests, strict=True)))

    def __sub__(self, other: JointPrediction) -> JointPrediction:
        return self + other * -1.0

    def __mul__(self, factor: float) -> JointPrediction:
        return JointPrediction(tuple(one * factor for one in self.tests))


def score(kind: str, prediction: Prediction, data: Data, bins: int) -> float:
    """Score of a prediction.

    Parameters
    ----------
    kind : str
        ``nmi``: minus the mean normalized mutual information of the pictures (Studholme et al. 1999);
        ``ssd``: mean squared difference of the pictures; ``likelihood``: half the chi-square of all data
        with their noise, pictures, forces or displacements, and points.
    bins : int
        Bins of the joint histogram, for ``nmi``.
    """
    if kind == "nmi":
        pairs = zip(data.measured, prediction.nearer(data), strict=True)
        return -float(np.mean([nmi(measured, picture, bins, limits=LIMITS) for measured, picture in pairs]))
    if kind == "ssd":
        return squares(prediction, data) / data.measured.size
    with np.errstate(over="ignore"):  # infinite where noise is tiny: who asks sees it
        return 0.5 * sum(chi_square(prediction, data).values())


def weights(kind: str, data: Data) -> tuple[float, float]:
    """What the sums of squared differences of pictures and of squared `deviations` count for: not for ``nmi``."""
    if kind == "ssd":
        return 1.0 / max(data.measured.size, 1), 0.0
    return 0.25 / data.picture_noise**2 if data.picture_noise > 0 else 0.0, 0.5


def chi_square(prediction: Prediction, data: Data) -> dict[str, float]:
    """Chi-square of each kind of data; kinds without data or without known noise are left out.

    A factor common to all forces (`Data.force_gain`) is left out: it goes into the constants, and their errors know it.
    Smoothing makes the noise of neighbouring pixels alike: a Gaussian of s pixels leaves 1 / (4 pi s^2) of
    the variance and as small a share of independent values (in two dimensions, for s above half a pixel), which
    cancel. Both pictures of a comparison are noisy.
    """
    total: dict[str, float] = {}
    if data.measured.size and data.picture_noise > 0:
        total["pictures"] = squares(prediction, data) / (2.0 * data.picture_noise**2)
    return total | {kind: float(np.sum(own**2)) for kind, own in deviations_by_kind(prediction, data).items()}


def squares(prediction: Prediction, data: Data) -> float:
    """Sum of squared differences of the pictures, of which pixels of partial volume count as much as they tell."""
    left = prediction.pictures - data.measured
    lacks = prediction.partial.lacks(prediction.partial.read(left), data) if prediction.partial else 0.0
    return float(np.sum(left**2)) - lacks


def deviations(prediction: Prediction, data: Data) -> np.ndarray:
    """Response and points less what was measured, in units of the noise, where both are known."""
    return np.concatenate([np.zeros(0), *deviations_by_kind(prediction, data).values()])


def deviations_by_kind(prediction: Prediction, data: Data) -> dict[str, np.ndarray]:
    """The same of ``response`` and ``points`` each; kinds without data or without known noise are left out."""
    measured, noise = data.response
    known = np.isfinite(measured) & (noise > 0)
    points = np.zeros(0)
    if data.points.size and data.points_noise > 0:
        points = independent(prediction.points - data.points_displacement, data).ravel()
    found = {"response": (prediction.response - measured)[known] / noise[known], "points": points}
    return {kind: own for kind, own in found.items() if own.size}


def independent(away: np.ndarray, data: Data) -> np.ndarray:
    """Displacements of points in units of their noise, such that the noise of all of them is independent.

    The covariance is that of the diagnosis: a point's errors at two steps may be alike (`Data.between_steps`; the steps
    have the same points then, in the same order), and all points of a step have a shift in common (`Data.frame_noise`),
    which adds n times its variance along the mean of n points, and nothing to what differs from the mean.

    Parameters
    ----------
    away : ndarray, shape (points, dim)
        mm.
    data : Data
        Tells steps and noise of the points.
    """
    steps, between = np.unique(data.points_step), data.between_steps
    alike = np.count_nonzero(between) > np.count_nonzero(between.diagonal())
    found = np.zeros_like(away)
    for group in [steps] if alike else steps[:, None]:
        rows = np.stack([np.flatnonzero(data.points_step == step) for step in group])
        mean = away[rows].mean(axis=1, keepdims=True)
        own = between[np.ix_(group, group)]
        shift = rows.shape[1] * data.frame_noise**2 * np.eye(len(group))
        parts = (own, away[rows] - mean), (own + shift, mean)
        found[rows] = sum(np.tensordot(_inverse_root(covariance), part, 1) for covariance, part in parts)
    return found


def _inverse_root(covariance: np.ndarray) -> np.ndarray:
    """A matrix by which values with a covariance become independent, with variances of 1."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors / np.sqrt(np.maximum(values, ROUNDING * values.max()))).T)
