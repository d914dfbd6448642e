"""From the answer of a solver to what should have been measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.data import Data
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import smooth
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

    def predict(self, outcome: Outcome) -> tuple[Prediction, Faults] | None:
        """Prediction of a solution, or None when it did not reach the last step."""
        data = self.data
        if outcome.status != CONVERGED or outcome.steps < len(data.step):
            return None
        maps = self.maps(outcome)
        # smoothed after the warp: its border is then as soft as that of the measured picture
        synthesized = [smooth(warp(data.coefficients, data.background, way), data.smooth) for way in maps]
        pictures = np.array(synthesized) if synthesized else np.empty_like(data.measured)
        axis = self.mesh.dim - 1
        conjugate = outcome.indenter if data.control == "force" else outcome.reaction
        points = np.empty_like(data.points_displacement)
        for step in np.unique(data.points_step):
            chosen = data.points_step == step
            points[chosen] = self._probe.read(outcome.displacement[step])[chosen]
        faults = Faults(sum(m.inverted for m in maps), sum(m.overlaps for m in maps))
        return Prediction(pictures, -conjugate[: len(data.step), axis], points), faults

    def maps(self, outcome: Outcome) -> list[BackwardMap]:
        """Backward maps of the pictures' steps."""
        steps = self.data.picture_step
        return [backward_map(self.mesh, outcome.displacement[step], self._frame, MARGIN) for step in steps]
