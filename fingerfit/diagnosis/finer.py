"""What a finer mesh changes, also where its body goes through itself from some step on."""

from __future__ import annotations

import numpy as np

from fingerfit.fit.problem import REFINED, InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.forward.predict import Predictor
from fingerfit.study.data import Data


def first_fold(problem: InverseProblem, asked: Asked, data: Data) -> int:
    """Index of the first step in whose picture the body of a solution goes through itself; past the last for none."""
    predictor = Predictor(data, problem.meshes[REFINED])
    made = predictor.predict(problem.outcome(asked), problem.seen(asked.values))
    folded = [int(step) for step, way in zip(data.picture_step, made.maps, strict=True) if way.folded] if made else []
    return min(folded, default=len(data.step))


def continued(value: np.ndarray, response: np.ndarray, data: Data, wrong: int) -> tuple[np.ndarray, np.ndarray]:
    """A change that is known before a step, from there on in proportion to the prescribed quantity.

    A body that goes through itself is on another way than the one that is measured.

    Parameters
    ----------
    value : ndarray, shape (entries, patches, dim + 1)
        Of the pictures, then of the points.
    response : ndarray, shape (responses,)
    data : Data
    wrong : int
        Index of the first step at which it is not known. Where it is not known before either, it is taken to be 0.
    """
    value, response = value.copy(), response.copy()
    pictures, steps = len(data.picture_step), len(data.step)
    parts = [(value[:pictures], data.picture_step), (value[pictures:], np.unique(data.points_step).astype(int))]
    parts += [(own, np.arange(steps)) for own in response.reshape(-1, steps)]
    for part, step in parts:
        known = np.flatnonzero(step < wrong)
        for n in np.flatnonzero(step >= wrong):
            last = step[known[-1]] if len(known) else 0
            size = data.controlled[last] if len(known) else 0.0
            part[n] = part[known[-1]] * (data.controlled[step[n]] / size) if size else 0.0
    return value, response
