"""What a model is wrong by, as one unknown variance of each kind of data, in the score of a fit.

Thousands of pixels that a model explains badly are not thousands of independent values: its errors are alike from
pixel to pixel and from step to step. With an error of unknown variance (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B
63) that has n independent values, what a kind of data leaves beyond its noise, e, costs n / 2 log(1 + e / n) and not
e / 2: the likelihood at its maximum by that variance (Seber and Wild 1989, Nonlinear regression).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fingerfit.fit.objective import Objective
from fingerfit.forward.score import Prediction, chi_square, deviations_by_kind
from fingerfit.imaging.similarity import share_alone
from fingerfit.study.data import Data

ALIKE = 0.25
"""Length over which the error of a model is alike, as a share of the body's height; it is alike at all steps. As of the
error of a mesh, a choice."""
DOUBT, CHANCE = 0.1, 3.0
"""A misfit counts as noise up to this share more than noise gives on average, as noise is no better known, and up to
as many standard deviations more. Choices."""


@dataclass(frozen=True)
class Kind:
    """A kind of data.

    Parameters
    ----------
    noise : float
        Chi-square that noise alone gives on average.
    errors : float
        Independent values of the error of a model.
    """

    noise: float
    errors: float

    def beyond(self, misfit: float) -> float:
        """What a chi-square has beyond noise."""
        return max(0.0, misfit - self.noise - max(CHANCE * np.sqrt(2 * self.noise), DOUBT * self.noise))

    def weight(self, misfit: float) -> float:
        """Share of what it would count without an error of the model, at most 1.

        >>> Kind(noise=100.0, errors=4.0).weight(100.0)
        1.0
        """
        return 1.0 / (1.0 + self.beyond(misfit) / self.errors)

    def cost(self, misfit: float) -> float:
        """Negative log likelihood; its slope by half of the misfit is `weight`."""
        beyond = self.beyond(misfit)
        return 0.5 * (misfit - beyond) + 0.5 * self.errors * float(np.log1p(beyond / self.errors))


@dataclass(frozen=True)
class Discrepancy:
    """The kinds of data of a test: ``pictures``, ``points`` and ``response``, those that are there.

    Parameters
    ----------
    kinds : dict
    """

    kinds: Mapping[str, Kind]

    @classmethod
    def of(cls, data: Data, body: np.ndarray) -> Discrepancy:
        """Of measurements on a body, whose nodes have the shape (nodes, dim), mm."""
        sizes = np.ptp(body, axis=0)
        places = len(sizes) * float(np.prod(np.maximum(1.0, sizes / (ALIKE * sizes[-1]))))
        nothing = Prediction(data.measured, np.zeros(len(data.response_step)), np.zeros_like(data.points_displacement))
        counts = {kind: float(own.size) for kind, own in deviations_by_kind(nothing, data).items()}
        if data.measured.size and data.picture_noise > 0:
            counts["pictures"] = _noisy_pixels(data, sizes) * share_alone(data.smooth, len(sizes))
        errors = {"response": float(1 + data.lateral_force.shape[1])}
        return cls({kind: Kind(count, min(count, errors.get(kind, places))) for kind, count in counts.items()})

    def score(self, misfits: Mapping[str, float]) -> float:
        """Negative log likelihood of the chi-squares of all kinds."""
        return sum(kind.cost(misfits[name]) for name, kind in self.kinds.items())

    def objective(self, misfits: Mapping[str, Objective]) -> Objective:
        """The same as a function of search coordinates, as the chi-squares are."""

        def gradient(delta: np.ndarray) -> np.ndarray:
            parts = [0.5 * kind.weight(misfits[name](delta)) for name, kind in self.kinds.items()]
            slopes = [misfits[name].gradient(delta) for name in self.kinds]
            return np.asarray(np.dot(parts, slopes))

        return Objective(lambda delta: self.score({name: one(delta) for name, one in misfits.items()}), gradient)

    def weights(self, prediction: Prediction, data: Data) -> dict[str, float]:
        """What each kind counts at a prediction."""
        misfits = chi_square(prediction, data)
        return {name: kind.weight(misfits[name]) for name, kind in self.kinds.items()}

    def weighed(self, prediction: Prediction, data: Data) -> Data:
        """The data with so much noise as they count at a prediction: its likelihood has the slopes of the score."""
        wider = {name: weight**-0.5 for name, weight in self.weights(prediction, data).items()}
        points = wider.get("points", 1.0)
        return replace(
            data,
            picture_noise=data.picture_noise * wider.get("pictures", 1.0),
            response_scale=data.response_scale * wider.get("response", 1.0),
            points_noise=data.points_noise * points,
            points_covariance=data.points_covariance * points**2,
            frame_noise=data.frame_noise * points,
        )


def _noisy_pixels(data: Data, sizes: np.ndarray) -> float:
    """Pixels of all pictures; beside a body of these sizes, mm, they count half: one picture is noisy there."""
    whole = float(data.measured[0].size)
    shown = min(whole, float(np.prod(sizes / data.spacing)))
    return len(data.measured) * (whole + shown) / 2
