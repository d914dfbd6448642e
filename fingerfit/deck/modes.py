"""Smooth modes at the points of a mesh's elements, as decks and maps have them."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from fingerfit.mesh.inside import points_inside, sizes
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.modes import centred, modes, sharing


def modes_of(mesh: Mesh, constants: Collection[str], count: int) -> list[np.ndarray]:
    """Modes at the points of each element (`points_inside`), each of shape (points, count).

    Parameters
    ----------
    mesh : Mesh
    constants : collection of str
        Names of what the model fits: layers with a modulus of their own have modes without a mean.
    count : int
        How many, the longest waves first.
    """
    inside = points_inside(mesh)
    number = np.array([len(points) for points in inside])
    places = np.concatenate(inside)
    weights, groups = sizes(mesh) / number, sharing(mesh.parts, constants, len(inside))
    every = modes(places, mesh.body.min(axis=0), mesh.body.max(axis=0), count)
    every = centred(every, np.repeat(weights, number), np.repeat(groups, number))
    return np.split(every, np.cumsum(number)[:-1])
