"""Finer meshes of a model, for one whose mesh is too coarse."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from fingerfit.settings.parts import MeshSettings

QUADRATIC = {"CPE3": "CPE6", "CPE4": "CPE8", "CPE4H": "CPE8H", "CPS3": "CPS6", "CPS4": "CPS8"}
"""Elements of the next order on the same grid: their error falls with a higher power of their size."""
Meshes = Mapping[str, MeshSettings | None]
"""The meshes of a model by the keys ``mesh`` and ``refined``."""
MESHES = 2
"""How often a model gets a finer mesh: each takes about four times as long as the one before. A choice."""
HALVED, ONE_MORE = "half the element size", "a mesh of quadratic elements"
"""A finer mesh, in words."""


def finer_mesh(mesh: MeshSettings, elements: Collection[str]) -> tuple[MeshSettings, str]:
    """A mesh more accurate than before, and what is other in it, in words.

    Linear elements become quadratic ones. Where they are, or the solver has no such `elements`, they get half the size.

    Parameters
    ----------
    mesh : MeshSettings
        Of a block in the plane.
    elements : collection of str
        Those of the solver.
    """
    if (quadratic := QUADRATIC.get(mesh.element)) in elements:
        return mesh.model_copy(update={"element": quadratic}), ONE_MORE
    return mesh.model_copy(update={"across": 2 * mesh.across, "per_layer": 2 * mesh.per_layer}), HALVED


def finer_meshes(meshes: Meshes, elements: Collection[str]) -> Meshes:
    """The mesh of the search and the finer mesh, each as from `finer_mesh`, by key; None where there is none."""
    return {key: mesh and finer_mesh(mesh, elements)[0] for key, mesh in meshes.items()}


def is_as_fine(mesh: MeshSettings, other: MeshSettings) -> bool:
    """Whether a mesh has the elements of another one, as many of them or more, and as small ones at its edges."""
    more = mesh.across >= other.across and mesh.per_layer >= other.per_layer
    return mesh.element == other.element and more and mesh.grading >= other.grading


def are_finer(meshes: Meshes, lower: Meshes, elements: Collection[str]) -> bool:
    """Whether meshes are others as they are made finer, up to `MESHES` times."""
    for _ in range(MESHES):
        lower = finer_meshes(lower, elements)
        if lower == meshes:
            return True
    return False
