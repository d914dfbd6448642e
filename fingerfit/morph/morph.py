"""A reference mesh brought to the shape of a subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fingerfit.anatomy.curved import bone_faces
from fingerfit.anatomy.surface import vertex_normals
from fingerfit.core.errors import InputError
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.bent import ease
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.repair import mend, spread
from fingerfit.mesh.tetrahedra import Quality, corners, faces_on, quality
from fingerfit.morph.edges import CLEAR, Profiles, averages, find_border, find_layers
from fingerfit.morph.register import Deformation, Registration, register
from fingerfit.morph.render import frame_around, render
from fingerfit.morph.straight import straightened

INTENSITY = {"EPIDERMIS": 0.45, "SUBCUTANEOUS": 0.9, "DISTAL": 0.65, "MIDDLE": 0.65, "NAIL": 0.15}
"""Of tissues in a T1-weighted MR volume, roughly; a registration by correlation wants no more."""
SMOOTH = 2.5
"""Length over which neighbours decide together about a surface, mm."""
APART = 1.8
"""Between the bones, and between bone and skin, from which the edge of a bone is looked for, mm."""
SEARCHES = 4
"""Times that surfaces are set on their edges."""


@dataclass(frozen=True)
class Morphed:
    """A subject's mesh and how well it fits.

    Parameters
    ----------
    mesh : Mesh
        With the sets and surfaces of the reference.
    quality : Quality
    mended : ndarray of int
        Nodes that were moved to mend elements.
    eased : int
        Nodes in the middle of edges that were moved because an element was bent too much.
    similarity : float
        Of the registration.
    surface : dict
        ``mean, p95, max``: what is left between the skin of the mesh and that in the volume, by its edges, mm.
    thickness : dict
        ``mean, spread`` of the epidermis in the mesh, ``measured``: whether the volume shows it; mm.
    """

    mesh: Mesh
    quality: Quality
    mended: np.ndarray
    eased: int
    similarity: float
    surface: dict[str, float] = field(default_factory=dict)
    thickness: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        told = "measured" if self.thickness["measured"] else "of the reference, since the volume does not show it"
        return (
            f"{self.quality}\n{len(self.mended)} nodes moved to mend elements, {self.eased} to bend them less\n"
            f"skin to its edge in the volume: mean {self.surface['mean']:.3f}, 95 % below {self.surface['p95']:.3f},"
            f" largest {self.surface['max']:.3f} mm\n"
            f"epidermis {self.thickness['mean']:.3f} +- {self.thickness['spread']:.3f} mm, {told}"
        )


def morph(
    mesh: Mesh,
    subject: Picture,
    settings: Registration | None = None,
    intensity: Mapping[str, float] | None = None,
) -> Morphed:
    """Bring a reference finger to the shape in a subject's volume.

    The reference is rendered and registered with the volume, its nodes go along, the skin is set on its edges in the
    volume, and bad elements are mended.

    Parameters
    ----------
    mesh : Mesh
        Reference, with surfaces and sets as `fingerfit.anatomy.finger.finger_mesh` names them.
    subject : Picture
        Before compression; the finger along x, its tip at the end.
    settings : Registration, optional
    intensity : mapping of str to float, optional
        Of the tissues in the rendered reference.

    Raises
    ------
    InputError
        For a mesh without these sets, or volumes that cannot be registered.
    SolverError
        When bad elements cannot be mended.
    """
    for name in ("EPIDERMIS_OUTER", "EPIDERMIS_INNER", "BONE_SURFACE", "NAIL"):
        if name not in mesh.node_sets:
            raise InputError("reference mesh", f"node set {name}", "nothing", "a set of the reference finger")
    intensity = {k: v for k, v in (intensity or INTENSITY).items() if k in mesh.element_sets}
    frame = frame_around(mesh, float(subject.spacing.mean()), 2.0)
    start = mesh.points[mesh.node_sets["END"], 0].max()
    # where the mesh ends, the subject's finger goes on
    there = frame.to_points(
        np.stack([np.arange(frame.values.shape[2]), *[np.zeros(frame.values.shape[2])] * 2], axis=1)
    )
    mask = np.broadcast_to(there[:, 0] > start + frame.spacing[0], frame.values.shape)
    way = register(render(mesh, frame, intensity), subject, settings, mask)
    return fit_skin(mesh, way, subject)


def labelled(picture: Picture, tissues: Mapping[int, str], intensity: Mapping[str, float] | None = None) -> Picture:
    """A segmentation as a volume that `morph` takes: each label with the intensity of its tissue, others 0.

    Parameters
    ----------
    picture : Picture
        Whole numbers.
    tissues : mapping of int to str
        Tissue of each label, as the reference's element sets are named.

    Raises
    ------
    InputError
        For a tissue without intensity, or a segmentation without these labels.
    """
    known = intensity or INTENSITY
    values = np.zeros(picture.values.shape)
    labels = np.rint(picture.values).astype(int)
    for label, name in tissues.items():
        if name not in known:
            raise InputError("segmentation", f"label {label}", name, "one of " + ", ".join(sorted(known)))
        if not (labels == label).any():
            raise InputError("segmentation", f"label {label}", "no voxel", f"voxels of {name}")
        values[labels == label] = known[name]
    return Picture(values, picture.spacing, picture.origin, picture.direction)


def fit_skin(mesh: Mesh, way: Deformation, subject: Picture) -> Morphed:
    """Nodes of the reference where a registration brings them, the skin on its edges in the volume."""
    whole, mesh = mesh, straightened(mesh)
    points = way(mesh.points)
    order = np.argsort(mesh.node_sets["EPIDERMIS_OUTER"])
    skin, under = (mesh.node_sets[name][order] for name in ("EPIDERMIS_OUTER", "EPIDERMIS_INNER"))
    surfaces = np.concatenate([skin, under, mesh.node_sets["BONE_SURFACE"]])
    points, mended = mend(mesh, points, surfaces)
    found = points
    bone = _apart(mesh, points, mesh.node_sets["BONE_SURFACE"], under)
    known, profiles = np.concatenate([skin, under, bone]), Profiles(subject)
    for _ in range(SEARCHES):
        layers, inward, near = _look(mesh, found, skin, under, profiles)
        thickness = np.linalg.norm(found[under] - found[skin], axis=1)
        depth = (near @ layers.depth)[:, None] * inward
        deeper = (near @ layers.thickness - thickness)[:, None] * inward
        shift = np.concatenate([depth, depth + deeper, _bone_shift(mesh, found, bone, profiles)])
        found, more = mend(mesh, found + spread(replace(mesh, points=found), known, shift), surfaces)
        mended = np.union1d(mended, more)
    # pieces may be sound where the element between the corners is not
    found, more = mend(whole, found, surfaces)
    mended = np.union1d(mended, more)
    moved, eased = ease(replace(whole, points=found))
    found = moved.points
    layers, _, _ = _look(mesh, found, skin, under, profiles)
    left = np.abs(layers.depth)
    thick = np.linalg.norm(found[under] - found[skin], axis=1)
    return Morphed(
        moved,
        quality(moved),
        mended,
        eased,
        way.similarity,
        {"mean": float(left.mean()), "p95": float(np.percentile(left, 95)), "max": float(left.max())},
        {"mean": float(thick.mean()), "spread": float(thick.std()), "measured": bool(layers.contrast > CLEAR)},
    )


def _bone_shift(mesh: Mesh, points: np.ndarray, bone: np.ndarray, profiles: Profiles) -> np.ndarray:
    """From the bones' surface to its edges in the volume, shape (nodes, 3), mm."""
    faces = _bone_faces(mesh)
    outward = vertex_normals(points, faces)[bone]
    near = averages(points[bone], np.flatnonzero(~np.isin(bone, mesh.node_sets["END"])), outward, SMOOTH)
    return (near @ find_border(profiles, points[bone], outward, near)[0])[:, None] * outward


def _apart(mesh: Mesh, points: np.ndarray, bone: np.ndarray, skin: np.ndarray) -> np.ndarray:
    """Nodes of the bones' surface whose edge is seen alone: far from the skin and from the other bone."""
    from scipy.spatial import cKDTree

    distal = np.isin(bone, corners(mesh)[mesh.element_sets["DISTAL"]])
    far = cKDTree(points[skin]).query(points[bone])[0] > APART
    for own in (distal, ~distal):
        if own.any() and not own.all():
            far[own] &= cKDTree(points[bone[~own]]).query(points[bone[own]])[0] > APART
    return bone[far]


def _bone_faces(mesh: Mesh) -> np.ndarray:
    """Corners of the triangles between bones and soft tissue, seen from the tissue."""
    faces = bone_faces(mesh)
    return faces[~np.isin(faces, mesh.node_sets["END"]).all(axis=1)]


def _look(
    mesh: Mesh, points: np.ndarray, skin: np.ndarray, under: np.ndarray, profiles: Profiles
) -> tuple[Any, Any, Any]:
    """What the volume shows around the skin; inward normals; weights of neighbours without nail and end section."""
    faces = faces_on(mesh, mesh.surfaces["SKIN"])
    inward = -vertex_normals(points, faces)[skin]
    thickness = np.linalg.norm(points[under] - points[skin], axis=1)
    # neither nail nor the end section shows the skin's profile
    odd = np.isin(skin, np.concatenate([mesh.node_sets["NAIL"], mesh.node_sets["END"]]))
    near = averages(points[skin], np.flatnonzero(~odd), inward, SMOOTH)
    return find_layers(profiles, points[skin], inward, thickness, near), inward, near
