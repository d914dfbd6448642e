"""From the answer of a solver to what should have been measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fingerfit.forward.partial_volume import PartialVolume
from fingerfit.forward.score import Prediction
from fingerfit.imaging.blur import REACH, blurred_in_place
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import BackwardMap, Probe, backward_map, warp
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.observation import Observation
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.data import Data

MARGIN = 1.5
"""Pixels beyond the body that move with it: as far as its border is soft in a picture."""


@dataclass(frozen=True)
class Synthesis:
    """A prediction and the maps by which its pictures were made.

    Parameters
    ----------
    prediction : Prediction
    maps : list of BackwardMap
        One for each picture.
    """

    prediction: Prediction
    maps: list[BackwardMap]

    @property
    def without_maps(self) -> tuple[Prediction, bool]:
        """The prediction, and whether it folds: maps of volumes take several times as much memory as these."""
        return self.prediction, self.folded

    @property
    def inverted(self) -> int:
        """Elements turned inside out, over all pictures."""
        return sum(way.inverted for way in self.maps)

    @property
    def overlaps(self) -> int:
        """Pixels that more than one element claims, over all pictures."""
        return sum(way.overlaps for way in self.maps)

    @property
    def folded(self) -> bool:
        """Whether the body has gone through itself in a picture."""
        return any(way.folded for way in self.maps)


class Predictor:
    """Synthesizes pictures and reads the other measured quantities from solutions of one mesh.

    Parameters
    ----------
    data : Data
        Measured data.
    mesh : Mesh
        Mesh of the decks.
    partial : bool
        Whether its predictions say which pixels of partial volume tell less than others: what scores them asks.
    """

    def __init__(self, data: Data, mesh: Mesh, partial: bool = False) -> None:
        self.data, self.mesh, self._partial = data, mesh, partial and data.picture_noise > 0
        self._probe = Probe(mesh, data.points)
        self.frame = Picture.before(data)

    def predict(self, outcome: Outcome, seen: Observation | None = None) -> Synthesis | None:
        """Prediction of a solution, or None when it did not reach the last step.

        Parameters
        ----------
        outcome : Outcome
            Since the first picture: its steps are those of the data.
        seen : Observation, optional
            Effects on the observation.
        """
        data = self.data
        if outcome.status != CONVERGED or outcome.steps < len(data.step):
            return None
        maps = self.maps(outcome, seen)
        synthesized = [self.picture(way, int(step), seen) for way, step in zip(maps, data.picture_step, strict=True)]
        pictures = np.array(synthesized) if synthesized else np.empty_like(data.measured)
        points = np.empty_like(data.points_displacement)
        places = data.points if seen is None else seen.origin(data.points)
        elsewhere = outcome.begun is not None or (seen is not None and seen.moves_first)
        probe = Probe(in_first_picture(self.mesh, outcome), places) if elsewhere else self._probe
        for step in sorted(set(data.points_step.tolist())):
            chosen = data.points_step == step
            moved, begin = probe.read_near(outcome.displacement[step])[chosen], places[chosen]
            points[chosen] = moved if seen is None else seen.moved(int(step) + 1, begin, moved)
        measured = response_of(outcome, data)
        if seen is not None:
            measured = seen_response(seen, measured, data)
        partial = PartialVolume.of(pictures, maps, data) if self._partial and len(maps) else None
        return Synthesis(Prediction(pictures, measured, points, partial), maps)

    def picture(self, way: BackwardMap, step: int, seen: Observation | None = None) -> np.ndarray:
        """Picture of a step, by its index, with its map."""
        data = self.data
        # smoothed after the warp: its border is then as soft as that of the measured picture
        made = warp(data.coefficients, data.background, way, data.smooth, self._lit(seen, step + 1, way))
        return blurred_in_place(made, way, data.blur / data.spacing) if data.blur else made

    def _lit(self, seen: Observation | None, k: int, way: BackwardMap) -> Callable[[np.ndarray], np.ndarray] | None:
        """What effects on the brightness make of the pixels that a map covers at the k-th step; None without any."""
        if seen is None or not seen.lit:
            return None
        return lambda own: seen.intensity(own, k, *positions(self.frame, way.pixel))

    def maps(self, outcome: Outcome, seen: Observation | None = None) -> list[BackwardMap]:
        """Backward maps of the pictures' steps."""
        return [self.map_at(outcome, int(step), seen) for step in self.data.picture_step]

    def map_at(self, outcome: Outcome, step: int, seen: Observation | None = None) -> BackwardMap:
        """Backward map of a step, by its index."""
        soft = REACH * self.data.blur / float(np.min(self.data.spacing))
        return backward_map(*self.body_at(outcome, step, seen), self.frame, max(MARGIN, soft))

    def body_at(self, outcome: Outcome, step: int, seen: Observation | None = None) -> tuple[Mesh, np.ndarray]:
        """The body as the first picture shows it, and displacements from there to where that of a step does."""
        mesh, shown = in_first_picture(self.mesh, outcome), outcome.displacement[step]
        # a displaced picture shows the body as if it had moved so
        return (mesh, shown) if seen is None else as_seen(mesh, shown, seen, step + 1)


def response_of(outcome: Outcome, data: Data) -> np.ndarray:
    """What a solution says of the response (`Data.response`), shape (responses,), N or mm."""
    count, oblique = len(data.step), data.direction_of_load
    along = (outcome.indenter if data.control == "force" else outcome.reaction)[:count]
    lateral = outcome.reaction[:count, : data.lateral_force.shape[1]]
    return np.concatenate([along @ oblique if len(oblique) else -along[:, -1], lateral.T.ravel()])


def seen_response(seen: Observation, response: np.ndarray, data: Data) -> np.ndarray:
    """The response as instruments show it: effects on the observation change what is measured along the load."""
    along, _ = data.split(response)
    return np.concatenate([seen.response(along, data.response_name(0)[0]), response[len(along) :]])


def positions(frame: Picture, pixel: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
    """Coordinates x, y[, z] of pixels, mm: of all in the shape of a picture, or of some by their flat indices."""
    shape = frame.values.shape
    index = np.indices(shape) if pixel is None else np.array(np.unravel_index(pixel, shape))
    points = frame.to_points(index[::-1].reshape(len(shape), -1).T.astype(float))
    return tuple(column.reshape(shape if pixel is None else -1) for column in points.T)


def since_first_picture(
    outcome: Outcome,
    steps: int,
    elsewhere: bool = False,
    lift: np.ndarray | float = 0.0,
    moved: np.ndarray | None = None,
) -> Outcome:
    """An outcome whose displacements count from the state of the first picture, where that is a step of its own.

    With `elsewhere` its nodes lie there in that picture; else the mesh is the body in that picture already, but for
    nodes that were `moved` beside it. `lift` is how far from the mesh's they lie without load. Both are mm in the shape
    of displacements.
    """
    if outcome.steps <= steps:
        return outcome if moved is None else replace(outcome, begun=moved)
    return replace(
        outcome,
        displacement=outcome.displacement[1:] - outcome.displacement[:1],
        reaction=outcome.reaction[1:] - outcome.reaction[:1],
        indenter=outcome.indenter[1:] - outcome.indenter[:1],
        iterations=outcome.iterations[1:],
        begun=outcome.displacement[0] + lift if elsewhere else moved,
    )


def as_seen(mesh: Mesh, displacement: np.ndarray, seen: Observation, k: int) -> tuple[Mesh, np.ndarray]:
    """The body as the first picture shows it, and displacements from there to where the one at the k-th step does."""
    shown = replace(mesh, points=mesh.points + seen.first(mesh.points)) if seen.moves_first else mesh
    return shown, seen.moved(k, mesh.points, displacement)


def in_first_picture(mesh: Mesh, outcome: Outcome) -> Mesh:
    """The mesh as the first picture shows it."""
    if outcome.begun is None:
        return mesh
    return replace(mesh, points=mesh.points + outcome.begun[: len(mesh.points)])
