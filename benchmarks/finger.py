"""A finger-like body of tetrahedra with bone and epidermis, and decks that press a rigid sphere into it.

The sphere is a rigid patch of bricks, or for the built-in solver an analytical surface: the same body, the same
pressure over overclosure, nodes of the body against the surface.
"""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np

RADIUS = 2.5
"""Of the sphere, mm."""
UP = np.array([0.0, 1.0, 0.0])
STIFFNESS = 5.0
"""Pressure over overclosure, MPa/mm."""
HALF = (8.0, 6.0, 24.0)
"""Half width, half height and length, mm."""
MATERIALS = {
    "BONE": "*ELASTIC\n10000., 0.3",
    "TISSUE": "*HYPERELASTIC, OGDEN, N=1\n{0}, 1.4, {1}",
    "SKIN": "*HYPERELASTIC, OGDEN, N=1\n{2}, 1.4, {3}",
}
MU = (7.98e-3, 1.38e-1)
"""Of tissue and skin, MPa (Tada, Nagai and Maeno 2006)."""
POISSON = 0.45
TETRAHEDRA = [(0, *np.cumsum([1 << a for a in order]).tolist()) for order in permutations(range(3))]
"""Corners, as bits of x, y and z, of the six tetrahedra on the ways along the edges of a brick."""


def finger(cells: tuple[int, int, int], element: str) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], dict]:
    """Nodes, elements, element sets and node sets of the body.

    Parameters
    ----------
    cells : (int, int, int)
        Bricks over width, height and length, each cut into six tetrahedra.
    element : str
        C3D4 or C3D10.
    """
    nx, ny, nz = cells
    index = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    u, v, w = np.meshgrid(*(np.linspace(0, 1, n + 1) for n in cells), indexing="ij")
    u, v = 2 * u - 1, 2 * v - 1
    taper = np.sqrt(1 - 0.5 * w**4)
    x = HALF[0] * taper * u * np.sqrt(1 - 0.4 * v**2)
    y = HALF[1] * taper * v * np.sqrt(1 - 0.4 * u**2)
    points = np.stack([x, y, HALF[2] * w], axis=-1).reshape(-1, 3)
    i, j, k = (part.ravel() for part in np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"))
    corners = np.stack([index[i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1)] for c in range(8)], axis=1)
    nodes = np.concatenate([corners[:, list(tetrahedron)] for tetrahedron in TETRAHEDRA])
    centre = np.stack([(2 * i + 1) / nx - 1, (2 * j + 1) / ny - 1, (k + 0.5) / nz], axis=1)
    bone = (np.abs(centre[:, 0]) < 0.34) & (np.abs(centre[:, 1] + 0.4) < 0.34) & (centre[:, 2] < 0.8)
    skin = (i == 0) | (i == nx - 1) | (j == 0) | (j == ny - 1) | (k == nz - 1)
    kind = np.tile(np.where(bone, 0, np.where(skin, 2, 1)), 6)
    edges = points[nodes[:, 1:]] - points[nodes[:, :1]]
    turned = np.linalg.det(edges) < 0
    nodes[turned] = nodes[turned][:, [0, 2, 1, 3]]
    palmar = set(index[:, -1, :].ravel().tolist())
    near = np.hypot(points[:, 0], points[:, 2] - _touch(points, palmar)[2]) < 2 * RADIUS
    sets = {"BOTTOM": np.union1d(index[:, :, 0], index[nx // 3 : nx - nx // 3 + 1, 0, nz // 2 :])}
    faces = []
    for number, tetrahedron in enumerate(nodes):
        for face, local in enumerate(((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))):
            chosen = tetrahedron[list(local)]
            if all(n in palmar for n in chosen.tolist()) and near[chosen].any():
                faces.append((number, face))
    if element == "C3D10":
        points, nodes, sets = _quadratic(points, nodes, sets)
    groups = {name: np.flatnonzero(kind == n) for n, name in enumerate(MATERIALS)}
    return points, nodes, groups, {**sets, "FACES": np.array(faces), "TOUCH": _touch(points, palmar)}


def _touch(points: np.ndarray, palmar: set[int]) -> np.ndarray:
    """Where the sphere touches first: the top of the body at three quarters of its length."""
    top = points[sorted(palmar)]
    return top[np.hypot(top[:, 0], top[:, 2] - 0.7 * HALF[2]).argmin()]


def _quadratic(points: np.ndarray, nodes: np.ndarray, sets: dict) -> tuple[np.ndarray, np.ndarray, dict]:
    """Nodes in the middle of the edges; those of a set are between two nodes of the set."""
    pairs = np.sort(nodes[:, [[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]]], axis=2)
    unique, at = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middle = len(points) + at.reshape(-1, 6)
    more = {}
    for name, members in sets.items():
        inside = np.isin(unique, members).all(axis=1)
        more[name] = np.concatenate([members, len(points) + np.flatnonzero(inside)])
    return np.vstack([points, points[unique].mean(axis=1)]), np.hstack([nodes, middle]), more


def _sphere(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Bricks of a cap of 130 degrees, its lowest point at the origin: nodes, elements; faces S1 are outside."""
    angle = np.linspace(-1, 1, count + 1) * np.deg2rad(65)
    a, b = np.meshgrid(np.tan(angle), np.tan(angle), indexing="ij")
    way = np.stack([a, -np.ones_like(a), b], axis=-1)
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    layers = [radius * way.reshape(-1, 3) + RADIUS * UP for radius in (RADIUS, 0.8 * RADIUS)]
    index = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    bricks = np.hstack([quads, quads + (count + 1) ** 2])
    points = np.vstack(layers)
    corner = points[bricks[0]]
    if np.linalg.det(corner[[1, 3, 4]] - corner[0]) < 0:
        bricks = bricks[:, [0, 3, 2, 1, 4, 7, 6, 5]]
    return points, bricks


def write_finger(
    path: Path,
    control: str,
    values: list[float],
    element: str,
    cells: tuple[int, int, int],
    meshed: int,
    driven: bool = False,
) -> int:
    """Write a deck; returns the number of nodes of the body.

    Parameters
    ----------
    control : str
        ``displacement`` (mm) or ``force`` (N).
    meshed : int
        Bricks along each side of the rigid patch of the sphere; 0 for an analytical surface.
    driven : bool
        Whether the first step is in mm also in force control, as CalculiX needs it.
    """
    points, nodes, groups, sets = finger(cells, element)
    count, elements = len(points), len(nodes)
    touch = sets["TOUCH"]
    lines = ["*NODE"] + [f"{n}, {x:.9g}, {y:.9g}, {z:.9g}" for n, (x, y, z) in enumerate(points, 1)]
    reference = count + 1
    cap, bricks = _sphere(max(meshed, 1))
    lines += [f"{reference}, {touch[0]:.9g}, {touch[1]:.9g}, {touch[2]:.9g}", f"{reference + 1}, 0., 0., 0."]
    if meshed:
        lines += [f"{reference + 2 + n}, " + ", ".join(f"{v:.9g}" for v in touch + p) for n, p in enumerate(cap)]
    first = 1
    for name, chosen in groups.items():
        lines.append(f"*ELEMENT, TYPE={element}, ELSET={name}")
        lines += [f"{e + first}, " + ", ".join(map(str, nodes[e] + 1)) for e in chosen]
        mu = [x for m in MU for x in (m, 3 * (1 - 2 * POISSON) / (m * (1 + POISSON)))]
        lines += [f"*MATERIAL, NAME={name}", MATERIALS[name].format(*mu)]
        lines.append(f"*SOLID SECTION, ELSET={name}, MATERIAL={name}")
    for name, members in (("ALL", np.arange(count)), ("BOTTOM", sets["BOTTOM"])):
        lines += [f"*NSET, NSET={name}"] + [
            ", ".join(map(str, m + 1)) for m in np.array_split(members, len(members) // 10)
        ]
    lines += ["*NSET, NSET=INDENTER", str(reference)]
    lines += ["*SURFACE, NAME=PALMAR"] + [f"{e + 1}, S{face + 1}" for e, face in sets["FACES"]]
    if meshed:
        lines.append("*ELEMENT, TYPE=C3D8, ELSET=CAP")
        lines += [f"{elements + 1 + n}, " + ", ".join(map(str, b + reference + 2)) for n, b in enumerate(bricks)]
        lines += ["*SOLID SECTION, ELSET=CAP, MATERIAL=BONE", "*NSET, NSET=CAPNODES, GENERATE"]
        lines += [f"{reference + 2}, {reference + 1 + len(cap)}", "*SURFACE, NAME=SPHERE", "CAP, S1"]
        lines += [f"*RIGID BODY, NSET=CAPNODES, REF NODE={reference}, ROT NODE={reference + 1}"]
    else:
        centre = ", ".join(f"{v:.9g}" for v in touch + RADIUS * UP)
        above = ", ".join(f"{v:.9g}" for v in touch + (RADIUS + 1) * UP)
        lines += ["*SURFACE, NAME=SPHERE, TYPE=REVOLUTION", f"{centre}, {above}"]
        lines += [f"START, 0., {-RADIUS}", f"CIRCL, {RADIUS}, 0., 0., 0."]
        lines += [f"*RIGID BODY, ANALYTICAL SURFACE=SPHERE, REF NODE={reference}, ROT NODE={reference + 1}"]
    lines += ["*SURFACE INTERACTION, NAME=PRESS", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"]
    lines += [f"{STIFFNESS}, 1e-4" if meshed else f"{STIFFNESS}"]
    lines += ["*CONTACT PAIR, INTERACTION=PRESS, TYPE=NODE TO SURFACE", "PALMAR, SPHERE"]
    held = ["BOTTOM, 1, 3", f"{reference}, 1, 1", f"{reference}, 3, 3", f"{reference + 1}, 1, 3"]
    lines += ["*BOUNDARY", *held]
    for number, value in enumerate(values):
        lines += ["*STEP, NLGEOM, INC=1000", "*STATIC", "1., 1., 1e-4, 1."]
        if control == "displacement" or (driven and number == 0):
            lines += ["*BOUNDARY", f"{reference}, 2, 2, {-value!r}"]
        else:
            if driven and number == 1:
                lines += ["*BOUNDARY, OP=NEW", *held]
            lines += ["*CLOAD", f"{reference}, 2, {-value!r}"]
        if number == 0:
            lines += ["*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*NODE PRINT, NSET=BOTTOM, FREQUENCY=1000", "RF"]
            lines += ["*NODE PRINT, NSET=INDENTER, FREQUENCY=1000", "U"]
        lines.append("*END STEP")
    path.write_text("\n".join(lines) + "\n")
    return count
