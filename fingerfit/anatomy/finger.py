"""Mesh of a finger: layers of the skin as prisms cut into tetrahedra, everything within by netgen."""

from __future__ import annotations

import numpy as np

from fingerfit.anatomy.curved import curved
from fingerfit.anatomy.shape import Anatomy, bone_capsule, is_nail, map_bone, map_skin, skin_capsule
from fingerfit.anatomy.surface import boundary_loop, fill_ring, load_netgen, triangulate, vertex_normals
from fingerfit.core.errors import InputError, SolverError
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.mesh.tetrahedra import faces_on, oriented, outer_faces, to_quadratic

ELEMENTS = ("C3D4", "C3D4H", "C3D10", "C3D10H")
SKIN, BONE = 0.87, 0.83
"""Sides of triangles where the mesh is of size 1: of the skin and of the bones, mm."""
PULP = (0.25, 3.0)
"""Sides of the pulp's triangles where the mesh is of size 1, and how far that part reaches from its centre, mm."""
SOFT, DISTAL, MIDDLE = 1, 2, 3
"""Netgen's numbers of the parts."""

FINEST = 0.15
"""Size of ten million tetrahedra, 35 000 over its third power: no solver here takes more."""


def finger_mesh(
    anatomy: Anatomy | None = None,
    size: float = 1.0,
    element: str = "C3D4H",
    across: int = 1,
    pulp: tuple[float, float] = PULP,
) -> Mesh:
    """Mesh of a finger with named tissues; the same numbers give the same mesh.

    Parameters
    ----------
    anatomy : Anatomy, optional
        The reference finger when left out.
    size : float
        Sides of elements, relative to the mesh of about 35 000 tetrahedra; those through the skin stay as they are.
    element : str
        C3D4, C3D4H, C3D10 or C3D10H, of the soft tissues; bone and nail have the same without hybrid form.
    across : int
        Elements through each layer of the skin.
    pulp : tuple of float
        Sides of the triangles under the indenter where `size` is 1, and how far that part reaches from its centre, mm.

    Returns
    -------
    Mesh
        Element sets EPIDERMIS, DERMIS (where there is one), SUBCUTANEOUS, SKIN (the layers of the skin), SOFT (all
        three), DISTAL, MIDDLE, BONE (both), NAIL. Node sets END (end section), NAIL, BONE, BONE_SURFACE,
        EPIDERMIS_OUTER and EPIDERMIS_INNER (each node opposite to that of the other set). Surfaces SKIN (all outside
        but the end section) and NAIL.

    Raises
    ------
    InputError
        For an element that is none of these, or sizes that are not positive.
    SolverError
        When netgen is not installed or cannot fill the body.
    """
    anatomy = anatomy or Anatomy()
    if element not in ELEMENTS:
        raise InputError("finger", "element", element, "one of " + ", ".join(ELEMENTS))
    if not FINEST <= size < np.inf or across < 1:
        expected = f"a size from {FINEST:g}, and 1 or more across"
        raise InputError("finger", "size, across", f"{size:g}, {across}", expected)
    shells, triangles, counts = _shells(anatomy, size, across, pulp)
    points, elements, part, fixed = _fill(anatomy, shells[-1], triangles, size)
    # the skin's inner shell is there twice: its nodes are the first ones of what netgen filled
    count = len(shells[0])
    points = np.concatenate([*shells[:-1], points])
    offset = count * (len(shells) - 1)
    skin, layer, triangle = _prisms(shells, triangles)
    nodes = oriented(points, np.concatenate([skin, elements + offset]))
    kind = np.concatenate([np.repeat(["EPIDERMIS", "DERMIS"], counts)[layer], _NAMES[part]])
    middle = shells[0][triangles].mean(axis=1)
    nailed = np.concatenate([is_nail(anatomy, middle)[triangle] & (kind[: len(skin)] == "EPIDERMIS"), part < 0])
    kind[nailed] = "NAIL"
    order, sets = _by_tissue(kind)
    nodes = nodes[order]
    node_sets = {
        "END": np.flatnonzero(points[:, 0] < 1e-9 * anatomy.length),
        "NAIL": np.unique(nodes[sets["NAIL"]]),
        "BONE": np.unique(nodes[sets["BONE"]]),
        "BONE_SURFACE": fixed + offset,
        "EPIDERMIS_OUTER": np.arange(count),
        "EPIDERMIS_INNER": np.arange(count) + count * counts[0],
    }
    mesh = Mesh(points, (Block("C3D4", nodes),), node_sets, sets)
    if element.startswith("C3D10"):
        mesh = curved(to_quadratic(mesh), triangles, len(shells))
    return _finished(mesh, element, anatomy)


def _by_tissue(kind: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Order of elements in which each tissue is together, the soft ones first, and element sets in this order."""
    names = [name for name in (*_TISSUES, *_STIFF) if (kind == name).any()]
    order = np.concatenate([np.flatnonzero(kind == name) for name in names])
    kind = kind[order]
    sets = {name: np.flatnonzero(kind == name) for name in names}
    sets["SKIN"] = np.flatnonzero(np.isin(kind, ["EPIDERMIS", "DERMIS"]))
    sets["SOFT"] = np.flatnonzero(np.isin(kind, _TISSUES))
    sets["BONE"] = np.flatnonzero(np.isin(kind, ["DISTAL", "MIDDLE"]))
    return order, sets


def _finished(mesh: Mesh, element: str, anatomy: Anatomy) -> Mesh:
    """The mesh with its surfaces, and its elements of the types they have in soft and in stiff tissues."""
    outside = outer_faces(mesh)
    centre = mesh.points[faces_on(mesh, outside)[:, :3]].mean(axis=1)
    outside = outside[centre[:, 0] > 1e-9 * anatomy.length]
    surfaces = {"SKIN": outside, "NAIL": outside[np.isin(outside[:, 0], mesh.element_sets["NAIL"])]}
    stiff, soft, nodes = element.removesuffix("H"), len(mesh.element_sets["SOFT"]), mesh.blocks[0].nodes
    parts = [Block(element, nodes[:soft]), Block(stiff, nodes[soft:])]
    if element == stiff:
        parts = [Block(element, nodes)]
    return Mesh(mesh.points, tuple(parts), mesh.node_sets, mesh.element_sets, surfaces)


_TISSUES = ("EPIDERMIS", "DERMIS", "SUBCUTANEOUS")
_STIFF = ("DISTAL", "MIDDLE", "NAIL")
_NAMES = np.array(["", "SUBCUTANEOUS", "DISTAL", "MIDDLE"], dtype="<U12")


def _shells(
    anatomy: Anatomy, size: float, across: int, pulp: tuple[float, float]
) -> tuple[list[np.ndarray], np.ndarray, list[int]]:
    """Nodes of the skin's surface and of the shells below it, its triangles, and sheets of elements in each layer."""
    flat, triangles, plane = triangulate(
        skin_capsule(anatomy), SKIN * size, min(SKIN, pulp[0]) * size, anatomy.pulp_centre, pulp[1]
    )
    triangles = triangles[~plane]
    used, renumbered = np.unique(triangles, return_inverse=True)
    triangles = renumbered.reshape(-1, 3)
    skin = map_skin(anatomy, flat[used])
    end = skin[:, 0] < 1e-9 * anatomy.length
    skin[end, 0] = 0.0
    inward = -vertex_normals(skin, triangles)
    inward[end, 0] = 0.0
    inward[end] /= np.linalg.norm(inward[end], axis=1, keepdims=True)
    shells, depth, counts = [skin], 0.0, []
    for thickness in (anatomy.epidermis, anatomy.dermis):
        if thickness > 0:
            counts.append(across)
            shells += [skin + inward * (depth + thickness * (n + 1) / across) for n in range(across)]
            depth += thickness
    return shells, triangles, counts


def _prisms(shells: list[np.ndarray], triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tetrahedra between shells, three for each prism, the sheet and the triangle that each belongs to."""
    count = len(shells[0])
    # cut by the order of the nodes, so that neighbours cut their common side alike
    low, mid, high = np.sort(triangles, axis=1).T
    nodes, layer, triangle = [], [], []
    for sheet in range(len(shells) - 1):
        here, below = sheet * count, (sheet + 1) * count
        for four in (
            (low + here, mid + here, high + here, high + below),
            (low + here, mid + here, high + below, mid + below),
            (low + here, mid + below, high + below, low + below),
        ):
            nodes.append(np.stack(four, axis=1))
            layer.append(np.full(len(triangles), sheet))
            triangle.append(np.arange(len(triangles)))
    return np.concatenate(nodes), np.concatenate(layer), np.concatenate(triangle)


def _fill(
    anatomy: Anatomy, skin: np.ndarray, triangles: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Everything within the skin: nodes (the skin's first), tetrahedra, their part, nodes on the bones' surface."""
    points, faces = [skin], [(triangles, SOFT, 0)]
    count = len(skin)
    bones: list[np.ndarray] = []
    for distal, part in ((True, DISTAL), (False, MIDDLE)):
        flat, bone, plane = triangulate(bone_capsule(anatomy, distal), BONE * size)
        surface = map_bone(anatomy, distal, flat)
        if not distal:
            surface[np.unique(bone[plane]), 0] = 0.0
        faces += [(bone[~plane] + count, part, SOFT)] + ([(bone[plane] + count, part, 0)] if plane.any() else [])
        bones.append(np.unique(bone[~plane]) + count)
        points.append(surface)
        count += len(surface)
    known = np.concatenate(points)
    loop, rim = boundary_loop(triangles), boundary_loop(faces[-2][0])
    inside, ring = fill_ring(known[loop][:, 1:], known[rim][:, 1:], BONE * size)
    number = np.concatenate([loop, rim, count + np.arange(len(inside) - len(loop) - len(rim))])
    points.append(np.insert(inside[len(loop) + len(rim) :], 0, 0.0, axis=1))
    # anticlockwise in y and z is seen from the tip: turned, since the end section looks the other way
    faces.append((number[ring][:, [0, 2, 1]], SOFT, 0))
    return *_tetrahedra(np.concatenate(points), faces, size), np.concatenate(bones)


def _tetrahedra(
    points: np.ndarray, faces: list[tuple[np.ndarray, int, int]], size: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Netgen's tetrahedra within closed surfaces; the given points stay where they are and come first."""
    meshing = load_netgen().meshing
    mesh = meshing.Mesh(dim=3)
    numbers = [mesh.Add(meshing.MeshPoint(meshing.Pnt(*map(float, point)))) for point in points]
    for surface, (triangles, inner, outer) in enumerate(faces, 1):
        face = mesh.Add(meshing.FaceDescriptor(surfnr=surface, domin=inner, domout=outer, bc=surface))
        for triangle in triangles:
            mesh.Add(meshing.Element2D(face, [numbers[n] for n in triangle]))
    for part in (SOFT, DISTAL, MIDDLE):
        mesh.SetMaterial(part, str(part))
    try:
        mesh.GenerateVolumeMesh(mp=meshing.MeshingParameters(maxh=1.06 * size, grading=0.3))
    except Exception as error:
        raise SolverError(f"finger: netgen could not fill the body: {error}") from error
    found = np.array(mesh.Coordinates(), dtype=float).reshape(-1, 3)  # a copy: netgen frees its own
    rows = [([v.nr - 1 for v in e.vertices], e.index) for e in mesh.Elements3D()]
    if not np.array_equal(found[: len(points)], points) or not rows:
        raise SolverError("finger: netgen moved the given surfaces")
    return found, np.array([row[0] for row in rows]), np.array([int(getattr(row[1], "nr", row[1])) for row in rows])
