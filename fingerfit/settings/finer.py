"""Finer meshes of a model, for one whose mesh is too coarse."""

from __future__ import annotations

from collections.abc import Collection

from fingerfit.settings.config import ModelSettings
from fingerfit.settings.parts import MeshSettings

QUADRATIC = {"CPE3": "CPE6", "CPE4": "CPE8", "CPE4H": "CPE8H", "CPS3": "CPS6", "CPS4": "CPS8"}
"""Elements of the next order on the same grid: their error falls with a higher power of their size."""


def finer_meshes(model: ModelSettings, elements: Collection[str]) -> dict[str, MeshSettings]:
    """The mesh of the search and, where there is one, the finer mesh, each more accurate than before.

    Linear elements become quadratic ones. Where they are, or the solver has no such `elements`, they get half the size.

    Parameters
    ----------
    model : ModelSettings
        Its study has a block in the plane.
    elements : collection of str
        Those of the solver.
    """
    found = {}
    for key in ("mesh", "refined"):
        mesh: MeshSettings | None = getattr(model, key)
        if mesh is None:
            continue
        quadratic = QUADRATIC.get(mesh.element)
        halved = {"across": 2 * mesh.across, "per_layer": 2 * mesh.per_layer}
        changes = {"element": quadratic} if quadratic in elements else halved
        found[key] = mesh.model_copy(update=changes)
    return found
