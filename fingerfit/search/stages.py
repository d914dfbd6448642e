"""The stages of a search, replayed over what is known: grid, all alike, each by itself."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field

import numpy as np

from fingerfit.guess import Parameter, round_value
from fingerfit.search.simplex import Request, Simplex, downhill

Point = tuple[float, ...]


@dataclass(frozen=True)
class Stage:
    """One stage of a search.

    Parameters
    ----------
    name : str
        For reports.
    kind : str
        ``grid``: forward analyses with all tied parameters alike, over the bounds; ``equal``: a simplex with
        all tied parameters alike; ``independent``: a simplex over all parameters.
    tolx : float
        Largest difference of a parameter, in its unit, between the best vertex and the others.
    tolf : float
        Largest difference of the score. A simplex stops when both are met.
    points : int
        Of a grid.
    step : float
        Size of the first simplex: in the logarithm, or as a share of the distance of the bounds.
    restarts : int
        How often a new simplex is started at the best point.
    """

    name: str
    kind: str
    tolx: float = 1e-5
    tolf: float = 1e-5
    points: int = 6
    step: float = 0.4
    restarts: int = 0


@dataclass(frozen=True)
class Space:
    """Parameters and their search coordinates: the logarithm, or the share of the distance of the bounds."""

    parameters: tuple[Parameter, ...]
    tied: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        families = [p.name.split("_")[0] for p in self.parameters]
        object.__setattr__(self, "tied", np.array([family == families[0] for family in families]))

    def clip(self, z: np.ndarray) -> np.ndarray:
        """Move search coordinates into the bounds, and to what a guess's digits can hold."""
        return self.coordinates(self.point(z))

    def point(self, z: np.ndarray) -> Point:
        """Values in their units, with the digits of a guess."""
        return tuple(
            round_value(min(max(float(np.exp(x)) if p.log else p.lower + x * (p.upper - p.lower), p.lower), p.upper))
            for p, x in zip(self.parameters, z, strict=True)
        )

    def coordinates(self, point: Sequence[float]) -> np.ndarray:
        """Search coordinates of values."""
        return np.array(
            [
                np.log(v) if p.log else (v - p.lower) / ((p.upper - p.lower) or 1.0)
                for p, v in zip(self.parameters, point, strict=True)
            ]
        )

    def alike(self, z: np.ndarray, common: float) -> np.ndarray:
        """Coordinates with all tied parameters at one value."""
        return np.where(self.tied, common, z)


Search = Generator[tuple[Request, str, int], list[float], tuple[Point, str]]


def run_stage(stage: Stage, space: Space, start: np.ndarray) -> Generator[tuple[Request, int], list[float], np.ndarray]:
    """One stage from `start`; returns the best coordinates."""
    if stage.kind == "grid":
        return (yield from _grid(stage, space, start))
    best = start
    for _ in range(stage.restarts + 1):
        if stage.kind == "equal":
            common = best[space.tied].mean()
            vertices = np.array([[common], [common - stage.step / 2]])
            asking = downhill(
                vertices,
                lambda simplex: _met(simplex, stage, lambda z: space.point(space.alike(start, z[0]))),
                lambda z: space.clip(space.alike(start, z[0]))[space.tied][:1],
            )
            simplex = yield from _relay(asking, lambda z: space.alike(start, z[0]))
            best = space.alike(start, simplex.points[0, 0])
        else:
            asking = downhill(_first(stage, space, best), lambda s: _met(s, stage, space.point), space.clip)
            simplex = yield from _relay(asking, lambda z: z)
            best = simplex.points[0]
    return best


def _grid(stage: Stage, space: Space, start: np.ndarray) -> Generator[tuple[Request, int], list[float], np.ndarray]:
    first = next(p for p, tied in zip(space.parameters, space.tied, strict=True) if tied)
    ends = (np.log(first.lower), np.log(first.upper)) if first.log else (0.0, 1.0)
    inner = np.linspace(ends[0], ends[1], stage.points + 2)[1:-1]
    points = tuple(space.alike(start, common) for common in inner)
    values = yield Request(points), 0
    return points[int(np.argmin(values))]


def _first(stage: Stage, space: Space, best: np.ndarray) -> np.ndarray:
    """First simplex: the tied parameters together, each but the last by itself, the others by themselves."""
    vertices, tied = [best], np.flatnonzero(space.tied)
    if len(tied) > 1:
        vertices.append(best - stage.step / 4 * space.tied)
    singles = tied[:-1] if len(tied) > 1 else tied
    steps = {int(axis): -stage.step for axis in singles}
    steps |= {int(axis): stage.step / 2 for axis in np.flatnonzero(~space.tied)}
    for axis, step in steps.items():
        moved = best.copy()
        moved[axis] += step
        if np.allclose(space.clip(moved), best):
            moved[axis] -= 2 * step
        vertices.append(moved)
    return np.array(vertices)


def _met(simplex: Simplex, stage: Stage, to_point) -> bool:
    values = np.array([to_point(z) for z in simplex.points])
    spread = simplex.values[-1] - simplex.values[0]
    return bool(np.abs(values - values[0]).max() <= stage.tolx and spread <= stage.tolf)


def _relay(asking, lift) -> Generator[tuple[Request, int], list[float], Simplex]:
    """Pass a simplex's requests on in full coordinates."""
    count = 0
    request = next(asking)
    while True:
        full = Request(tuple(lift(z) for z in request.needed), tuple(lift(z) for z in request.likely))
        values = yield full, count
        count += 1
        try:
            request = asking.send(values)
        except StopIteration as finished:
            return finished.value
