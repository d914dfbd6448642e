"""The downhill simplex (Nelder and Mead 1965) as a generator: it asks for points and is sent their values."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Request:
    """Points that the search cannot go on without, and points it will probably need next.

    Parameters
    ----------
    needed, likely : tuple of ndarray
        Points in search coordinates, shape (dim,) each.
    spread : tuple of float or None
        What the tolerances are compared with: how far the best vertex of a simplex and its score are from the others,
        or the length of a step of least squares; None where there is nothing to compare.
    """

    needed: tuple[np.ndarray, ...]
    likely: tuple[np.ndarray, ...] = ()
    spread: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Simplex:
    """Vertices in order of their values.

    Parameters
    ----------
    points : ndarray, shape (vertices, dim)
    values : ndarray, shape (vertices,)
    iterations : int
        Reflections so far.
    """

    points: np.ndarray
    values: np.ndarray
    iterations: int = 0


Asking = Generator[Request, list[float], Simplex]


def downhill(
    vertices: np.ndarray,
    finished: Callable[[Simplex], bool],
    clip: Callable[[np.ndarray], np.ndarray] = lambda point: point,
    flat: Callable[[np.ndarray], bool] = lambda points: False,
) -> Asking:
    """Minimise, with the coefficients of Nelder and Mead: 1, 2, 1/2, 1/2.

    Parameters
    ----------
    vertices : ndarray, shape (dim + 1, dim)
        First simplex.
    finished : callable
        Asked before each iteration.
    clip : callable
        Moves a point into the bounds.
    flat : callable
        Whether vertices, shape (dim + 1, dim), span fewer than `dim` directions. A point that would make them do so,
        as one that was moved onto a bound may, is not asked for: it counts as the worst.

    Yields
    ------
    Request
        To be answered with the values of its needed points; infinity is the worst value.

    Returns
    -------
    Simplex
        The last one, best vertex first: a finished one, or one that cannot become smaller.
    """
    points = np.array([clip(vertex) for vertex in vertices], dtype=float)
    values = np.array((yield Request(tuple(points))))
    last, iterations = "inside", 0
    while True:
        order = np.argsort(values, kind="stable")
        points, values = points[order], values[order]
        simplex = Simplex(points.copy(), values.copy(), iterations)
        if finished(simplex):
            return simplex
        iterations += 1
        centre = points[:-1].mean(axis=0)
        away = centre - points[-1]
        trial = {
            name: clip(centre + factor * away)
            for name, factor in (("reflect", 1.0), ("expand", 2.0), ("outside", 0.5), ("inside", -0.5))
        }
        lost = {name for name, point in trial.items() if flat(np.array([*points[:-1], point]))}
        likely = tuple(trial[name] for name in _COMPANIONS[last] if name not in lost)
        value = further = nearer = np.inf
        if "reflect" not in lost:
            (value,) = yield Request((trial["reflect"],), likely)
        if value < values[0]:
            if "expand" not in lost:
                (further,) = yield Request((trial["expand"],))
            last = "expand" if further < value else "reflect"
            points[-1], values[-1] = trial[last], min(further, value)
            continue
        if value < values[-2]:
            last = "reflect"
            points[-1], values[-1] = trial[last], value
            continue
        last = "outside" if value < values[-1] else "inside"
        if last not in lost:
            (nearer,) = yield Request((trial[last],))
        if nearer <= value if last == "outside" else nearer < values[-1]:
            points[-1], values[-1] = trial[last], nearer
            continue
        shrunk = np.array([clip(points[0] + 0.5 * (point - points[0])) for point in points[1:]])
        if np.array_equal(shrunk, points[1:]):
            return simplex  # `clip` rounds, and no smaller one can be told from it
        points[1:] = shrunk
        values[1:] = yield Request(tuple(points[1:]))
        last = "inside"


_COMPANIONS = {
    "reflect": ("inside", "expand", "outside"),
    "expand": ("inside", "expand", "outside"),
    "outside": ("inside", "outside", "expand"),
    "inside": ("inside", "outside", "expand"),
}
"""What is most often needed after a reflection, by what the iteration before did: it is simulated beside the reflection
where there is a second processor. It changes no result."""
