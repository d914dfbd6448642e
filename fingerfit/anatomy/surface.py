"""Triangulated surfaces of simple bodies, from netgen, and of plane rings."""

from __future__ import annotations

from typing import Any

import numpy as np

from fingerfit.anatomy.shape import Capsule
from fingerfit.core.errors import SolverError


def load_netgen() -> Any:
    """The mesher; SolverError where it is not installed."""
    try:
        import netgen.meshing
        import netgen.occ
    except ImportError as error:
        raise SolverError(f"meshing needs netgen (pip install fingerfit[anatomy]): {error}") from error
    return netgen


def triangulate(
    capsule: Capsule, size: float, fine: float | None = None, centre: float = 0.0, reach: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles on a capsule.

    Parameters
    ----------
    capsule : Capsule
    size, fine : float
        Sides of triangles, and on the palmar side around x = `centre` as far as `reach`, mm.

    Returns
    -------
    points : ndarray, shape (points, 3)
        mm.
    triangles : ndarray, shape (triangles, 3)
        Anticlockwise from outside.
    plane : ndarray of bool, shape (triangles,)
        Those in the plane x = 0 at the beginning of a capsule that is not closed.
    """
    netgen = load_netgen()
    occ, meshing = netgen.occ, netgen.meshing
    origin = occ.Pnt(0.0, 0.0, 0.0)
    # turned, so that the seam, where nodes lie in a row, is on the dorsal side
    axis = occ.Axes(p=origin, n=occ.X, h=occ.Dir(0, 0, -1))
    body = occ.Cylinder(axis, r=capsule.radius, h=capsule.straight)
    body = body + occ.Sphere(occ.Pnt(capsule.straight, 0.0, 0.0), capsule.radius)
    if capsule.closed:
        body = body + occ.Sphere(origin, capsule.radius)
    parameters = meshing.MeshingParameters(maxh=size, grading=0.25, perfstepsend=meshing.MeshingStep.MESHSURFACE)
    if fine is not None:
        for along in np.arange(-reach, reach + fine / 2, fine):
            for angle in np.arange(-reach, reach + fine / 2, fine) / capsule.radius:
                if along**2 + (angle * capsule.radius) ** 2 <= reach**2:
                    x = centre + along
                    y, z = _on_capsule(capsule, x, angle)
                    parameters.RestrictH(x, y, z, fine)
    mesh = occ.OCCGeometry(body).GenerateMesh(mp=parameters)
    points = np.array(mesh.Coordinates(), dtype=float).reshape(-1, 3)  # a copy: netgen frees its own
    triangles = np.array([[v.nr - 1 for v in e.vertices] for e in mesh.Elements2D()])
    used, flat = np.unique(triangles, return_inverse=True)
    points, triangles = points[used], flat.reshape(-1, 3)
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle = corners.mean(axis=1) - [capsule.straight / 2, 0.0, 0.0]
    inward = (normal * middle).sum(axis=1) < 0  # the body is convex
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    plane = np.zeros(len(triangles), dtype=bool)
    if not capsule.closed:
        plane = np.abs(points[triangles, 0]).max(axis=1) < 1e-9 * capsule.radius
    return points, triangles, plane


def _on_capsule(capsule: Capsule, x: float, angle: float) -> tuple[float, float]:
    beyond = max(0.0, x - capsule.straight)
    radius = np.sqrt(max(0.0, capsule.radius**2 - beyond**2))
    return float(radius * np.sin(angle)), float(radius * np.cos(angle))


def vertex_normals(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Unit normals at vertices, shape (points, 3), means of the triangles' weighted by their angles."""
    total = np.zeros_like(points)
    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        np.add.at(total, triangles[:, corner], normal * np.arccos(np.clip(cosine, -1, 1))[:, None])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1)


def boundary_loop(triangles: np.ndarray) -> np.ndarray:
    """Vertices of the only border of a triangulated surface, in order."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    known = {tuple(edge) for edge in edges.tolist()}
    following = {a: b for a, b in known if (b, a) not in known}
    loop = [min(following)]
    while following[loop[-1]] != loop[0]:
        loop.append(following[loop[-1]])
    if len(loop) != len(following):
        raise SolverError(f"finger: the end section has {len(following)} edges, {len(loop)} of them in one loop")
    return np.array(loop)


def fill_ring(outer: np.ndarray, inner: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles between two closed curves in the plane.

    Parameters
    ----------
    outer, inner : ndarray, shape (points, 2)
        In order around.
    size : float
        Sides of triangles, mm.

    Returns
    -------
    points : ndarray, shape (points, 2)
        Outer, inner, then new ones between.
    triangles : ndarray, shape (triangles, 3)
        Anticlockwise.

    Raises
    ------
    SolverError
        When an edge of a curve is not an edge of the triangles.
    """
    from matplotlib.path import Path
    from scipy.spatial import Delaunay, cKDTree

    low, high = outer.min(axis=0), outer.max(axis=0)
    rows = np.arange(low[1], high[1], size * np.sqrt(0.75))
    shifts = low[0] + np.arange(len(rows)) % 2 * size / 2
    between = np.array(
        [[x, row] for row, first in zip(rows, shifts, strict=True) for x in np.arange(first, high[0], size)]
    )
    around, within = Path(outer), Path(inner)
    far = cKDTree(np.concatenate([outer, inner])).query(between)[0] > 0.65 * size
    between = between[around.contains_points(between) & ~within.contains_points(between) & far]
    points = np.concatenate([outer, inner, between])
    triangles = Delaunay(points).simplices
    middle = points[triangles].mean(axis=1)
    triangles = triangles[around.contains_points(middle) & ~within.contains_points(middle)]
    a, b, c = (points[triangles[:, n]] for n in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    triangles[turned] = triangles[turned][:, [0, 2, 1]]
    edges = {tuple(sorted(e)) for t in triangles.tolist() for e in ((t[0], t[1]), (t[1], t[2]), (t[2], t[0]))}
    for first, count in ((0, len(outer)), (len(outer), len(inner))):
        for n in range(count):
            if tuple(sorted((first + n, first + (n + 1) % count))) not in edges:
                raise SolverError("finger: the end section could not be meshed: choose a finer mesh")
    return points, triangles
