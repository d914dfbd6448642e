"""What templates may ask about a mesh: nodes, what they stand for, elements once more."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.mesh.faces import area_vectors, cell_rule, cell_shape, faces_of
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.tetrahedra import nodes_on, resting


def quadratic(mesh: Mesh) -> bool:
    """Whether elements have nodes in the middle of their edges."""
    return any(block.nodes.shape[1] in ((6, 8) if mesh.dim == 2 else (10, 20)) for block in mesh.blocks)


def areas(mesh: Mesh, nodes: np.ndarray, thickness: float) -> list[tuple[int, float]]:
    """Nodes, counted from 1, of a side of the body and the area that each stands for, mm^2, by their x.

    In space an even pressure on a quadratic face pulls at its corners: as of a lumped mass, each node has the share of
    the square of its shape function (Hinton, Rock and Zienkiewicz 1976). In the plane it is the same.
    """
    chosen, area = np.zeros(len(mesh.points), dtype=bool), np.zeros(len(mesh.points))
    chosen[nodes] = True
    for block in mesh.blocks:
        for local in faces_of(block.element):
            faces = block.nodes[:, local][chosen[block.nodes[:, local]].all(axis=1)]
            xi, weights = cell_rule(len(local), mesh.dim)
            values, slopes = cell_shape(len(local), mesh.dim, xi)
            size = np.linalg.norm(area_vectors(np.einsum("fni,gnj->fgij", mesh.points[faces], slopes)), axis=-1)
            square = np.einsum("g,fg,gn->fn", weights, size, values**2)
            whole = (size @ weights)[:, None]
            np.add.at(area, faces, whole * square / square.sum(axis=1, keepdims=True))
    order = nodes[np.argsort(mesh.points[nodes, 0], kind="stable")]
    return [(int(node) + 1, float(thickness * area[node])) for node in order]


def strips(mesh: Mesh, nodes: np.ndarray, thickness: float) -> list[tuple[int, float, float, float]]:
    """The same, and from where to where the strip of the side reaches that a node stands for, as shares of its width.

    Strips of nodes of the same x are one: it has the area of all of these.
    """
    pairs = areas(mesh, nodes, thickness)
    places = np.round(mesh.points[[node - 1 for node, _ in pairs], 0] / np.ptp(mesh.points[nodes, 0]), 9)
    _, which = np.unique(places, return_inverse=True)
    ends = np.cumsum(np.bincount(which, [area for _, area in pairs]))
    ends = np.concatenate([[0.0], ends]) / ends[-1]
    return [(*pair, float(ends[n]), float(ends[n + 1])) for pair, n in zip(pairs, which, strict=True)]


def lengths(mesh: Mesh, nodes: np.ndarray) -> list[tuple[int, float]]:
    """Nodes, counted from 1, of any line of element edges of a plane mesh of linear elements, and their length, mm."""
    length, chosen = np.zeros(len(mesh.points)), np.zeros(len(mesh.points), dtype=bool)
    chosen[nodes] = True
    for block in mesh.blocks:
        pairs = np.stack([block.nodes, np.roll(block.nodes, -1, axis=1)], axis=-1).reshape(-1, 2)
        pairs = pairs[chosen[pairs].all(axis=1)]
        size = np.linalg.norm(mesh.points[pairs[:, 0]] - mesh.points[pairs[:, 1]], axis=1)
        for side in pairs.T:
            np.add.at(length, side, size / 2)
    return [(int(node) + 1, float(length[node])) for node in nodes]


def shares(mesh: Mesh) -> list[tuple[float, list[int]]]:
    """Areas, mm^2, that nodes of a plane mesh of linear elements stand for, and the nodes, counted from 1, of each."""
    area = np.zeros(len(mesh.points))
    for block in mesh.blocks:
        x, y = np.moveaxis(mesh.points[block.nodes], -1, 0)
        size = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1))
        for column in block.nodes.T:
            np.add.at(area, column, size / block.nodes.shape[1])
    sizes, which = np.unique(np.round(area, 6), return_inverse=True)
    return [(float(a), [int(n) + 1 for n in np.flatnonzero(which == k)]) for k, a in enumerate(sizes) if a > 0]


def nodes_of(mesh: Mesh, name: str) -> np.ndarray:
    """Nodes of a set."""
    nodes = mesh.node_sets.get(name, np.zeros(0, dtype=int))
    if not len(nodes):
        raise InputError("mesh", f"node set {name}", "nothing", "nodes")
    return nodes


def only(mesh: Mesh, name: str) -> int:
    """The only node of a set."""
    nodes = mesh.node_sets.get(name, np.zeros(0, dtype=int))
    if len(nodes) != 1:
        raise InputError("mesh", f"node set {name}", f"{len(nodes)} nodes", "one node")
    return int(nodes[0])


def rests_on(mesh: Mesh, name: str, at: tuple[float, float], radius: float) -> float:
    """Height of the centre of a sphere that touches a surface from above, mm."""
    if name not in mesh.surfaces:
        raise InputError("mesh", f"surface {name}", "nothing", "faces")
    return resting(mesh, nodes_on(mesh, mesh.surfaces[name]), at, radius)


def elements(
    mesh: Mesh, numbers: Iterator[int], layer: Mapping[str, Any] | None = None
) -> list[tuple[str, list[list[int]]]]:
    """Elements of the body or of a layer once more, with numbers of their own: type and rows of number and nodes."""
    chosen = np.ones(mesh.element_count, dtype=bool)
    if layer is not None:
        chosen[:] = False
        chosen[[n - 1 for n in layer["elements"]] or mesh.element_sets[layer["name"]]] = True
    found, first = [], 0
    for block in mesh.blocks:
        its = block.nodes[chosen[first : first + len(block.nodes)]]
        rows = [[next(numbers), *(int(node) + 1 for node in row)] for row in its]
        found += [(block.element, rows)] if rows else []
        first += len(block.nodes)
    return found


def side(mesh: Mesh, way: float) -> dict[str, Any]:
    """The sides of a body in the plane that face larger x, or with `way` below 0 smaller x, by 45 degrees or less.

    Its outermost ``x``, ``low`` and ``high`` in mm, and its ``faces``, pairs of element and face, both counted from 1.
    """
    body, seen, found, first = mesh.body, Counter[tuple[int, ...]](), [], 1
    for block in mesh.blocks:
        middle = mesh.points[block.nodes].mean(axis=1)
        for number, local in enumerate(faces_of(block.element), 1):
            ends = np.sort(block.nodes[:, local[:2]], axis=1)
            begin, end = mesh.points[ends[:, 0]], mesh.points[ends[:, 1]]
            out = (end - begin)[:, ::-1] * [1, -1]
            out *= np.sign((((begin + end) / 2 - middle) * out).sum(axis=1, keepdims=True))
            faced = np.sign(way) * out[:, 0] >= np.abs(out[:, 1])
            keys = list(map(tuple, ends.tolist()))
            seen.update(keys)
            found += [(keys[n], int(n) + first, number) for n in np.flatnonzero(faced)]
        first += len(block.nodes)
    return {
        "x": float(body[:, 0].max() if way > 0 else body[:, 0].min()),
        "low": float(body[:, -1].min()),
        "high": float(body[:, -1].max()),
        "faces": sorted((element, number) for ends, element, number in found if seen[ends] == 1),
    }


def temperature(swelling: np.ndarray) -> list[tuple[int | str, float]]:
    """Temperatures at which a material that expands by 1 a degree swells so: of ALL, or of nodes, counted from 1."""
    if np.ptp(swelling) == 0:
        return [("ALL", float(swelling[0]))]
    return [(node, float(value)) for node, value in enumerate(swelling, 1)]
