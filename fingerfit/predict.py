"""From the answer of a solver to what should have been measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fingerfit.data import Data
from fingerfit.effects.observe import Observation
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import BackwardMap, Probe, backward_map, warp
from fingerfit.mesh import Mesh
from fingerfit.score import Prediction
from fingerfit.solvers.contract import CONVERGED, Outcome

MARGIN = 1.5
"""Pixels beyond the body that move with it: as far as its border is soft in a picture."""


@dataclass(frozen=True)
class Faults:
    """Where the deformed mesh is no map any more.

    Parameters
    ----------
    inverted : int
        Elements turned inside out, over all pictures.
    overlaps : int
        Pixels that more than one element claims, over all pictures.
    """

    inverted: int = 0
    overlaps: int = 0


class Predictor:
    """Synthesizes pictures and reads the other measured quantities from solutions of one mesh.

    Parameters
    ----------
    data : Data
        Measured data.
    mesh : Mesh
        Mesh of the decks.
    """

    def __init__(self, data: Data, mesh: Mesh) -> None:
        self.data, self.mesh = data, mesh
        self._probe = Probe(mesh, data.points)
        self._frame = Picture(data.before, data.spacing, data.origin, data.direction)

    def predict(self, outcome: Outcome, seen: Observation | None = None) -> tuple[Prediction, Faults] | None:
        """Prediction of a solution, or None when it did not reach the last step.

        Parameters
        ----------
        outcome : Outcome
            Its steps are those of the data; one more at the beginning is the state of the first picture.
        seen : Observation, optional
            Effects on the observation.
        """
        data = self.data
        if outcome.status != CONVERGED or outcome.steps < len(data.step):
            return None
        outcome = since_first_picture(outcome, len(data.step))
        maps = self.maps(outcome, seen)
        # smoothed after the warp: its border is then as soft as that of the measured picture
        synthesized = [warp(data.coefficients, data.background, way, data.smooth) for way in maps]
        if seen is not None and synthesized:
            x, y = positions(self._frame)
            synthesized = [
                seen.intensity(picture, int(step) + 1, x, y)
                for picture, step in zip(synthesized, data.picture_step, strict=True)
            ]
        pictures = np.array(synthesized) if synthesized else np.empty_like(data.measured)
        axis = self.mesh.dim - 1
        conjugate = outcome.indenter if data.control == "force" else outcome.reaction
        points = np.empty_like(data.points_displacement)
        for step in np.unique(data.points_step):
            chosen = data.points_step == step
            points[chosen] = self._probe.read(outcome.displacement[step])[chosen]
        faults = Faults(sum(m.inverted for m in maps), sum(m.overlaps for m in maps))
        measured = -conjugate[: len(data.step), axis]
        if seen is not None:
            measured = seen.conjugate(measured, "displacement" if data.control == "force" else "force")
        return Prediction(pictures, measured, points), faults

    def maps(self, outcome: Outcome, seen: Observation | None = None) -> list[BackwardMap]:
        """Backward maps of the pictures' steps."""
        found, true = [], self._frame
        for step in self.data.picture_step:
            shift = np.zeros(self.mesh.dim) if seen is None else seen.shift(int(step) + 1)
            # a displaced picture shows at each pixel what was beside it; where that comes from is as before
            moved = replace(true, origin=true.origin - shift)
            way = backward_map(self.mesh, outcome.displacement[step], moved, MARGIN)
            found.append(replace(way, index=way.index - shift @ true.direction / true.spacing))
        return found


def positions(frame: Picture) -> tuple[np.ndarray, np.ndarray]:
    """First and last coordinate of all pixels, mm, in the shape of a picture."""
    shape = frame.values.shape
    index = np.indices(shape)[::-1].reshape(len(shape), -1).T.astype(float)
    points = frame.to_points(index)
    return points[:, 0].reshape(shape), points[:, -1].reshape(shape)


def since_first_picture(outcome: Outcome, steps: int) -> Outcome:
    """An outcome whose displacements count from the state of the first picture, where that is a step of its own."""
    if outcome.steps <= steps:
        return outcome
    return replace(
        outcome,
        displacement=outcome.displacement[1:] - outcome.displacement[:1],
        reaction=outcome.reaction[1:] - outcome.reaction[:1],
        indenter=outcome.indenter[1:] - outcome.indenter[:1],
        iterations=outcome.iterations[1:],
    )
