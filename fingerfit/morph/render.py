"""Volumes of a mesh, with one intensity for each tissue."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import backward_map
from fingerfit.mesh.mesh import Mesh


def frame_around(mesh: Mesh, spacing: float, margin: float) -> Picture:
    """Voxels of a size, mm, around a mesh and by `margin` mm beyond it, all zero; axes are those of the mesh."""
    body = mesh.body
    low, high = body.min(axis=0) - margin, body.max(axis=0) + margin
    size = np.ceil((high - low) / spacing).astype(int) + 1
    return Picture(np.zeros(size[::-1]), np.full(3, spacing), low, np.eye(3))


def render(mesh: Mesh, frame: Picture, intensity: Mapping[str, float], fine: int = 2) -> Picture:
    """A volume of a mesh in its reference state, 0 outside.

    Parameters
    ----------
    mesh : Mesh
    frame : Picture
        Only its voxels' places are used.
    intensity : mapping of str to float
        Of element sets; elements in none of them are dark.
    fine : int
        Samples along each side of a voxel.

    Raises
    ------
    InputError
        For a set that the mesh does not have.
    """
    values = np.zeros(mesh.element_count)
    for name, value in intensity.items():
        if name not in mesh.element_sets:
            raise InputError("mesh", f"element set {name}", "nothing", "one of " + ", ".join(sorted(mesh.element_sets)))
        values[mesh.element_sets[name]] = value
    found = np.zeros(frame.values.size)
    still = np.zeros_like(mesh.points)
    for place in product((np.arange(fine) + 0.5) / fine - 0.5, repeat=3):
        origin = frame.origin + frame.direction @ (np.array(place) * frame.spacing)
        way = backward_map(mesh, still, replace(frame, origin=origin))
        found[way.pixel] += values[way.element] / fine**3
    return replace(frame, values=found.reshape(frame.values.shape))
