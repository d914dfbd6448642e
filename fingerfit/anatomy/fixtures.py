"""What holds a finger and is pressed into it: places of the indenter and the tube, faces that may touch them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.tetrahedra import faces_on, nodes_on, resting

RADIUS = 2.5
"""Of the hemispherical indenter, mm (Tada, Nagai and Maeno 2006)."""
TUBE = 11.0
"""Radius of the tube, mm."""
CLEARANCE = 1e-3
"""Between the tube and the nearest node, mm."""


def add_fixtures(mesh: Mesh, at: Sequence[float], radius: float = RADIUS, tube: float = TUBE) -> Mesh:
    """A finger with the reference nodes and contact surfaces that `templates/fingertip.inp.j2` names.

    Parameters
    ----------
    mesh : Mesh
        With surface SKIN and node set NAIL; the finger along x, its palmar side up z.
    at : (float, float)
        Where the indenter comes down, x and y, mm.
    radius, tube : float
        Of the indenter and of the tube along x, mm.

    Returns
    -------
    Mesh
        Four more nodes, that no element has: INDENTER where the sphere first touches the skin with INDENTER_TURN above
        it in the sphere's centre, TUBE at the tube's bottom with TUBE_TURN on its axis. Surfaces PALMAR and DORSAL;
        node sets TOP (the indenter's) and BOTTOM (NAIL and TUBE).

    Raises
    ------
    InputError
        When there is no skin under the indenter, or the tube is too narrow.
    """
    skin = mesh.surfaces["SKIN"]
    nodes = faces_on(mesh, skin)
    a, b, c = (mesh.points[nodes[:, n]] for n in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    aside = np.hypot(*(mesh.points[:, :2] - np.asarray(at)).T)
    nail = np.isin(skin[:, 0], mesh.element_sets["NAIL"])
    palmar = (normal[:, 2] > 0) & (aside[nodes].min(axis=1) < 1.6 * radius)
    dorsal = (normal[:, 2] < -0.3) & ~nail
    top, under = nodes_on(mesh, skin[palmar]), nodes_on(mesh, skin[dorsal])
    centre = resting(mesh, top, at, radius)
    y, z = mesh.points[under, 1], mesh.points[under, 2]
    middle = (y.min() + y.max()) / 2
    if np.abs(y - middle).max() > 0.99 * tube:
        raise InputError("finger", "tube", f"radius {tube:g} mm", f"more than {np.abs(y - middle).max() / 0.99:.3g} mm")
    # the lowest axis from which every node is inside
    axis = (z + np.sqrt((tube - CLEARANCE) ** 2 - (y - middle) ** 2)).min()
    x = mesh.points[under, 0].mean()
    added = np.array([[*at, centre - radius], [*at, centre], [x, middle, axis - tube], [x, middle, axis]])
    count = len(mesh.points)
    sets = {
        "INDENTER": np.array([count]),
        "INDENTER_TURN": np.array([count + 1]),
        "TUBE": np.array([count + 2]),
        "TUBE_TURN": np.array([count + 3]),
        "TOP": np.array([count]),
        "BOTTOM": np.append(mesh.node_sets["NAIL"], count + 2),
    }
    return Mesh(
        np.vstack([mesh.points, added]),
        mesh.blocks,
        {**mesh.node_sets, **sets},
        mesh.element_sets,
        {**mesh.surfaces, "PALMAR": skin[palmar], "DORSAL": skin[dorsal]},
    )
