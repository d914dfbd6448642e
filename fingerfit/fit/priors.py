"""Priors of constants, normal in search coordinates (docs/decisions/0032-profiles-and-priors.md).

In the search and on the way to the minimum a prior is a penalty in units of what the noise of the pictures does to the
score: it holds what the data do not see. The estimate then weighs prior and data by all noise that the data have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fingerfit.fit.slopes import coordinates
from fingerfit.imaging.similarity import nmi_noise
from fingerfit.model.parameters import Parameter
from fingerfit.study.data import Data

MUCH = 0.5
"""Share of the variance that the prior had, from which it is said that a constant is known from it."""
AGAINST = 3.0
"""Standard deviations between estimate and prior from which it is said that they contradict each other."""
EXACT = 1e-8
"""Standard deviation, in search coordinates, of data without any noise: half of the digits of a number."""
LEAST = 0.05
"""Of the variance between both: where the data tell nothing they cannot contradict. These three are choices."""


@dataclass(frozen=True)
class Priors:
    """Priors of some of the parameters.

    Parameters
    ----------
    parameters : tuple of Parameter
        All of them.
    rows : ndarray, shape (priors, parameters)
        One over the standard deviation of each in search coordinates, at its parameter.
    centre : ndarray, shape (priors,)
        Their means, in units of their standard deviations.
    """

    parameters: tuple[Parameter, ...]
    rows: np.ndarray
    centre: np.ndarray

    @classmethod
    def of(cls, parameters: Sequence[Parameter]) -> Priors:
        """The priors of parameters that have one."""
        known = {n: p.prior for n, p in enumerate(parameters) if p.prior is not None}
        whole = tuple(parameters)
        # of a logarithm the deviation is a share of the value
        spread = [prior[1] / (prior[0] if whole[n].log else whole[n].scale) for n, prior in known.items()]
        at = coordinates(whole, {p.name: p.prior[0] if p.prior else p.start for p in whole})
        rows = np.eye(len(whole))[list(known)] / np.reshape(spread, (-1, 1))
        return cls(whole, rows, rows @ at)

    def __bool__(self) -> bool:
        return bool(len(self.rows))

    @property
    def curvature(self) -> float:
        """Curvature that the weakest of them gives a log likelihood, along any direction that it is much of."""
        return float((self.rows.max(axis=1) ** 2).min()) / (2 * len(self.parameters)) if self else np.inf

    def left(self, values: Mapping[str, float]) -> np.ndarray:
        """Prior less guess, in standard deviations, shape (priors,)."""
        return np.asarray(self.centre - self.rows @ coordinates(self.parameters, values))

    def match(self, values: Mapping[str, float]) -> dict[str, list[float]]:
        """What they add to the match of a guess: each is read as a value with noise."""
        left = self.left(values)
        return {"read": (self.centre - left).tolist(), "left": left.tolist(), "noise": [1.0] * len(left)}


def unit(kind: str, data: Data, smooth: float, bins: int) -> float:
    """What one unit of the log likelihood of pictures is in a score; 1 of the likelihood itself.

    Parameters
    ----------
    kind : str
        As for `fingerfit.forward.score.score`.
    smooth, bins
        Standard deviation of the smoothing, in pixels; bins of the joint histogram.
    """
    if kind == "ssd":
        return 4.0 * data.picture_noise**2 / max(data.measured.size, 1)
    return nmi_noise(data.measured, smooth, bins) if kind == "nmi" else 1.0


@dataclass(frozen=True)
class Weighed:
    """Data and priors, weighed by their covariances: a linear model with normal noise.

    Parameters
    ----------
    shift : ndarray, shape (parameters,)
        From the base to the estimate; along what neither data nor priors tell there is none.
    gain : ndarray, shape (parameters, parameters)
        How the estimate follows that of the data alone.
    known : ndarray, shape (parameters, parameters)
        Covariance that the errors of the priors give it.
    mesh : ndarray, shape (parameters,)
        Error of the mesh that is left, as a standard deviation.
    """

    shift: np.ndarray
    gain: np.ndarray
    known: np.ndarray
    mesh: np.ndarray


def weigh(
    priors: Priors,
    left: np.ndarray,
    shift: np.ndarray,
    shifts: np.ndarray,
    mesh: np.ndarray | None,
    seen: np.ndarray,
) -> Weighed:
    """Weigh data and priors.

    Parameters
    ----------
    priors : Priors
    left : ndarray, shape (priors,)
        Of `Priors` at the base.
    shift : ndarray, shape (parameters,)
        From the base to the minimum of the data alone.
    shifts : ndarray, shape (repetitions, parameters)
        How repetitions move that minimum.
    mesh : ndarray, shape (parameters,), optional
        Its error of the mesh, as a standard deviation.
    seen : ndarray, shape (parameters, directions)
        Directions that the data see.
    """
    mesh = np.zeros(len(shift)) if mesh is None else mesh
    noise = np.atleast_2d(np.cov(shifts, rowvar=False)) + np.diag(mesh**2)
    noise = seen.T @ noise @ seen + EXACT**2 * np.eye(seen.shape[1])
    data = seen @ np.linalg.inv(noise) @ seen.T
    whole = np.linalg.pinv(data + priors.rows.T @ priors.rows, rcond=1e-12, hermitian=True)
    gain, own = whole @ data, whole @ priors.rows.T
    return Weighed(gain @ shift + own @ left, gain, own @ own.T, np.sqrt(gain**2 @ mesh**2))


def told(priors: Priors, left: np.ndarray, spread: np.ndarray) -> list[str]:
    """Sentences on what comes from priors, and on priors that the data contradict.

    Parameters
    ----------
    priors : Priors
    left : ndarray, shape (priors,)
        Of `Priors` at the estimate.
    spread : ndarray, shape (parameters,)
        Standard deviations of the estimate in search coordinates.
    """
    found = []
    for row, away in zip(priors.rows, left, strict=True):
        name = priors.parameters[int(row.argmax())].name
        share = float(np.sum((row * spread) ** 2))
        # what is left between a prior and an estimate that knows it has the variance 1 - share
        off = abs(away) / np.sqrt(max(1.0 - share, LEAST))
        if share > MUCH:
            found.append(f"{name} is known from its prior: {100 * share:.0f} % of the variance of that is left")
        if off > AGAINST:
            found.append(f"{name} ends {off:.1f} standard deviations off its prior: the data contradict it")
    return found
