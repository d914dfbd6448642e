"""Patches of material: which pixels show them, and what solutions and measured points say of their displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fingerfit.forward.predict import in_first_picture, response_of
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.registration import FEWEST, means
from fingerfit.imaging.warp import BackwardMap, Probe
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.observation import Observation
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data

_HAIR = 1e-6
"""Share of a patch by which a point on the border of the grid may lie outside, by rounding."""
DEEP = 0.98
"""Share of the surroundings of a pixel that are of the body, from which it is well inside: where its border is soft,
brightness is no displacement. A choice."""


@dataclass(frozen=True)
class Patches:
    """A grid of patches of material.

    Parameters
    ----------
    centre : ndarray, shape (patches, dim)
        Reference positions, mm.
    low : ndarray, shape (dim,)
        Lower corner of the grid, mm.
    size : ndarray, shape (dim,)
        Of a patch, mm.
    count : tuple of int
        Patches along each axis.
    """

    centre: np.ndarray
    low: np.ndarray
    size: np.ndarray
    count: tuple[int, ...]

    @classmethod
    def seen(cls, data: Data, mesh: Mesh, across: int, across_points: int) -> Patches:
        """Patches of the body that pictures show; where points alone were measured, of the region that these are in."""
        if len(data.picture_step):
            return cls.over(mesh, across, data.spacing)
        return cls.around(data.points, across_points) if len(data.points) else cls.over(mesh, across)

    @classmethod
    def over(cls, mesh: Mesh, across: int = 10, spacing: np.ndarray | None = None) -> Patches:
        """The same over a mesh."""
        return cls.around(mesh.body, across, spacing)

    @classmethod
    def around(cls, points: np.ndarray, across: int = 10, spacing: np.ndarray | None = None) -> Patches:
        """Patches over the box around points, nearly square, `across` along the first axis.

        With the `spacing` of pictures, mm, there are fewer where each would hold less than twice the pixels it needs.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        flat = high <= low
        if flat.any():  # as points on a line: one layer of patches, as thick as the others are wide
            thick = float((high - low).max() or 1.0) / across
            low, high = np.where(flat, low - thick / 2, low), np.where(flat, high + thick / 2, high)
            across = 1 if flat[0] else across
        if spacing is not None and spacing.any():
            smallest = float(spacing.max()) * (2 * FEWEST) ** (1 / points.shape[1])
            across = max(1, min(across, int((high[0] - low[0]) / smallest)))
        count = np.maximum(1, np.rint((high - low) / ((high[0] - low[0]) / across))).astype(int)
        size = (high - low) / count
        index = np.stack([i.ravel() for i in np.indices(tuple(count))], axis=1)
        return cls(low + (index + 0.5) * size, low, size, tuple(int(c) for c in count))

    def of(self, points: np.ndarray) -> np.ndarray:
        """Patch of reference points, shape (points,); -1 outside. Those on the border of the grid are inside."""
        places = (points - self.low) / self.size
        places = np.where(np.abs(places) < _HAIR, 0.0, places)
        index = np.floor(np.where(np.abs(places - self.count) < _HAIR, np.array(self.count) - 1, places)).astype(int)
        inside = ((index >= 0) & (index < np.array(self.count))).all(axis=1)
        flat = np.ravel_multi_index(tuple(np.clip(index, 0, np.array(self.count) - 1).T), self.count)
        return np.where(inside, flat, -1)


def flat(value: np.ndarray, response: np.ndarray) -> np.ndarray:
    """One vector of displacements, brightness and response."""
    return np.concatenate([value.ravel(), response])


def points_by_patch(data: Data, values: np.ndarray, patches: Patches) -> np.ndarray:
    """Mean displacement of the points of each patch, shape (steps with points, patches, dim + 1); the last is NaN."""
    steps, owner = np.unique(data.points_step), patches.of(data.points)
    found = np.full((len(steps), len(patches.centre), values.shape[1] + 1), np.nan)
    for n, step in enumerate(steps):
        own = (data.points_step == step) & (owner >= 0)
        if own.any():  # as of markers that lie beside the grid
            found[n, :, :-1] = means(values[own], owner[own], len(patches.centre))
    return found


def owners_of(data: Data, frame: Picture, way: BackwardMap, patches: Patches) -> np.ndarray:
    """Patch of each pixel well inside the deformed body, like a picture; -1 elsewhere."""
    owner = np.full(data.before.size, -1)
    owner[way.pixel] = patches.of(frame.to_points(way.index))
    found = owner.reshape(data.before.shape)
    deep = smooth((found >= 0).astype(float), max(data.smooth, 1.0)) > DEEP
    return np.where(deep, found, -1)


class Reader:
    """Reads solutions as a vector of displacements and brightness by picture and patch, and the response of each step.

    Parameters
    ----------
    data : Data
    mesh : Mesh
        Of the solutions.
    patches : Patches
    places : (ndarray, ndarray), optional
        Where patches are read, shape (places, dim), and whose these are; else points within each patch.
    seen : Observation, optional
        Effects on the observation: where they move the first picture, material is elsewhere than that shows it.
    """

    def __init__(
        self,
        data: Data,
        mesh: Mesh,
        patches: Patches,
        places: tuple[np.ndarray, np.ndarray] | None = None,
        seen: Observation | None = None,
    ) -> None:
        self.data = data
        self._mesh, self._patches = mesh, patches
        if places is not None and len(places[0]):
            points, self._owner = places
        else:
            offsets = np.stack([o.ravel() for o in np.meshgrid(*[(-0.25, 0.25)] * mesh.dim)], axis=1)
            points = (patches.centre[:, None] + offsets * patches.size).reshape(-1, mesh.dim)
            self._owner = np.repeat(np.arange(len(patches.centre)), len(offsets))
        self._seen = seen
        self._points, self._places = (at if seen is None else seen.origin(at) for at in (data.points, points))
        self._probes = Probe(mesh, self._points), Probe(mesh, self._places)

    def read(self, outcome: Outcome) -> np.ndarray:
        """Displacements (mm), brightness 0, response (N or mm) of a solution since the first picture, shape (all,)."""
        return self._read(outcome, None)

    def shown(self, outcome: Outcome) -> np.ndarray:
        """The same, with displacements as the pictures show them."""
        return self._read(outcome, self._seen)

    def _read(self, outcome: Outcome, seen: Observation | None) -> np.ndarray:
        data, found = self.data, []
        at_points, at_places = self._probes
        if outcome.begun is not None:
            shown = in_first_picture(self._mesh, outcome)
            at_points, at_places = Probe(shown, self._points), Probe(shown, self._places)
        for step in data.picture_step:
            u = at_places.read(outcome.displacement[step])
            known = np.isfinite(u[:, 0])  # in the mesh; a patch without any such place has 0
            moved = u[known] if seen is None else seen.moved(int(step) + 1, self._places[known], u[known])
            u = np.nan_to_num(means(moved, self._owner[known], len(self._patches.centre)))
            found.append(np.concatenate([u, np.zeros((len(u), 1))], axis=1))
        if len(data.points_step):
            at = np.empty_like(data.points_displacement)
            for step in np.unique(data.points_step):
                own = data.points_step == step
                u = at_points.read_near(outcome.displacement[step])[own]
                at[own] = u if seen is None else seen.moved(int(step) + 1, self._points[own], u)
            found += list(points_by_patch(data, at, self._patches))
        return flat(np.array(found), response_of(outcome, data))
