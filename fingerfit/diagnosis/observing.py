"""What a change of an effect on the observation makes of everything that was measured, without a new simulation."""

from __future__ import annotations

import numpy as np

from fingerfit.diagnosis.residual import Residual
from fingerfit.forward.patches import Patches, flat, points_by_patch
from fingerfit.forward.predict import positions, seen_response
from fingerfit.forward.score import Prediction
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.registration import means
from fingerfit.model.observation import Observation
from fingerfit.study.data import Data


def change_seen(
    data: Data, prediction: Prediction, residual: Residual, patches: Patches, before: Observation, after: Observation
) -> np.ndarray:
    """How displacements and brightness of patches and the response change, shape (all,).

    Without displacements where the first picture moves as well: they are read from the solution.

    Parameters
    ----------
    data : Data
    prediction : Prediction
        Of the model that is looked at.
    residual : Residual
        What it leaves.
    patches : Patches
    before, after : Observation
    """
    frame = Picture.before(data)
    value: np.ndarray = np.zeros(residual.value.shape)
    for n, (number, picture, way) in enumerate(zip(data.picture_step, prediction.pictures, residual.fits, strict=True)):
        k = int(number) + 1
        at, seen = positions(frame, way.pixel), picture.ravel()[way.pixel]
        places = np.stack(at, axis=-1)
        change = after.intensity(seen, k, *at) - before.intensity(seen, k, *at)
        moved = np.zeros_like(places) if after.moves_first else after.shift(k, places) - before.shift(k, places)
        value[n] = np.nan_to_num(means(np.column_stack([moved, change]), way.patch, value.shape[1]))
    if len(data.points_step) and not after.moves_first:
        places, moved = data.points + prediction.points, np.zeros_like(data.points_displacement)
        for number in np.unique(data.points_step):
            its, k = data.points_step == number, int(number) + 1
            moved[its] = after.shift(k, places[its]) - before.shift(k, places[its])
        value[len(data.picture_step) :] = np.nan_to_num(points_by_patch(data, moved, patches))
    response = prediction.response
    return flat(value, seen_response(after, response, data) - seen_response(before, response, data))
