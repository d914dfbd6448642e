"""What a guess says of the measured displacements: read from its solution, and registered at its pictures."""

from __future__ import annotations

import numpy as np

from fingerfit.forward.patches import Patches, Reader, flat, owners_of, points_by_patch
from fingerfit.forward.predict import Synthesis
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.registration import FARTHEST, register
from fingerfit.mesh.mesh import Mesh
from fingerfit.search.descent import Match
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data

ACROSS = 6
"""Patches over the width of the body: a few hundred values for a few constants. A choice."""


class Matcher:
    """Matches of guesses.

    Parameters
    ----------
    data : Data
    mesh : Mesh
        Of the solutions.
    """

    def __init__(self, data: Data, mesh: Mesh) -> None:
        self._data = data
        self._patches = Patches.seen(data, mesh, ACROSS, ACROSS)
        self._reader = Reader(data, mesh, self._patches)

    def match(self, outcome: Outcome, made: Synthesis) -> Match:
        """Match of a guess that has a solution; brightness, and what registration does not reach, is left out."""
        data, shape = self._data, (len(self._patches.centre), self._patches.centre.shape[1] + 1)
        fields = [self._registered(n, made) for n in range(len(data.picture_step))]
        left, noise = (np.array([field[k] for field in fields]).reshape(-1, *shape) for k in (0, 1))
        if len(data.points_step):
            away = points_by_patch(data, data.points_displacement - made.prediction.points, self._patches)
            steps, owner = np.unique(data.points_step), self._patches.of(data.points)
            number = np.bincount(owner[owner >= 0], minlength=shape[0]) / len(steps)
            own = data.between_steps.diagonal()[steps, None] / np.maximum(number, 1.0)
            left = np.concatenate([left, away])
            noise = np.concatenate([noise, np.broadcast_to(np.sqrt(own + data.frame_noise**2)[..., None], away.shape)])
        left[..., -1] = np.nan
        measured, spread = data.response
        left, noise = flat(left, measured - made.prediction.response), flat(noise, spread)
        return Match(self._reader.read(outcome), np.where(noise > 0, left, np.nan), noise)

    def _registered(self, n: int, made: Synthesis) -> tuple[np.ndarray, np.ndarray]:
        """What is left of a picture by patch, and the noise of that, shapes (patches, dim + 1), mm.

        Smoothing makes the noise of pixels smaller and alike, which cancels (`fingerfit.forward.score.chi_square`);
        both pictures are noisy.
        """
        data, patches, way = self._data, self._patches, made.maps[n]
        frame = Picture.before(data)
        owner, scale = owners_of(data, frame, way, patches), np.concatenate([data.spacing, [1.0]])
        found = register(made.prediction.pictures[n], data.measured[n], owner, len(patches.centre))
        variance = 2.0 * data.picture_noise**2 * found.normal + found.own_error
        left = np.where((np.abs(found.values[:, :-1]) <= FARTHEST).all(axis=1)[:, None], found.values, np.nan)
        return left * scale, np.sqrt(np.diagonal(variance, axis1=1, axis2=2)) * scale
