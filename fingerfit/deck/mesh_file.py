"""Writing meshes as ABAQUS keywords and reading them from files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError, LimitError
from fingerfit.core.files import MESH, check_regular
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.inside import size_of
from fingerfit.mesh.mesh import Block, Mesh


def format_mesh(mesh: Mesh) -> str:
    """Text of a mesh as *NODE, *ELEMENT, *NSET and *ELSET; the same mesh gives the same text."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, " + ", ".join(f"{x:.12g}" for x in point) for n, point in enumerate(mesh.points, 1)]
    first = 1
    for block in mesh.blocks:
        lines.append(f"*ELEMENT, TYPE={block.element}")
        for n, nodes in enumerate(block.nodes + 1, first):
            row = list(map(str, [n, *nodes]))
            # at most 16 entries a line
            lines += [", ".join(row[at : at + 15]) + "," * (at + 15 < len(row)) for at in range(0, len(row), 15)]
        first += len(block.nodes)
    for keyword, sets in (("NSET", mesh.node_sets), ("ELSET", mesh.element_sets)):
        for name in sorted(sets):
            if name == "ALL":
                continue
            lines.append(f"*{keyword}, {keyword}={name}")
            members = sets[name] + 1
            lines += [", ".join(map(str, members[i : i + 12])) for i in range(0, len(members), 12)]
    for name in sorted(mesh.surfaces):
        lines.append(f"*SURFACE, NAME={name}")
        lines += [f"{element + 1}, S{face + 1}" for element, face in mesh.surfaces[name].tolist()]
    return "\n".join(lines) + "\n"


_FROM_MESHIO = {
    "triangle": "CPE3H", "triangle6": "CPE6", "quad": "CPE4", "quad8": "CPE8",
    "tetra": "C3D4H", "tetra10": "C3D10", "hexahedron": "C3D8", "hexahedron20": "C3D20",
}  # fmt: skip
"""Elements for cells, whose nodes have the same order. Linear triangles and tetrahedra are those that do not lock
(docs/decisions/0005-volume-in-linear-elements.md)."""
_PHYSICAL = "gmsh:physical"
_BACKWARDS = {3: [0, 2, 1], 6: [0, 2, 1, 5, 4, 3], 4: [0, 3, 2, 1], 8: [0, 3, 2, 1, 7, 6, 5, 4]}
"""Nodes of elements in the plane the other way round."""


def read_mesh(path: Path) -> Mesh:
    """Read a mesh with its sets: ABAQUS keywords (.inp), or anything meshio reads.

    Raises
    ------
    InputError
        When it cannot be read, or holds no elements of a known type.
    """
    if path.suffix.lower() == ".inp":
        from fingerfit.deck.reader import read_deck_mesh

        return read_deck_mesh(path)
    check_regular(path, "mesh", MESH, "a mesh")
    if not path.stat().st_size:  # of some formats meshio waits for a line for ever
        raise InputError(path, "mesh", "an empty file", "a mesh that meshio reads")
    import meshio

    try:
        found = meshio.read(path)
    except MemoryError as error:
        raise LimitError(path, "mesh", "more than the memory holds", "a mesh that fits into the memory") from error
    except ImportError as error:
        expected = f"a format that needs no {error.name}, as .msh or .vtu; or {error.name} (pip install {error.name})"
        raise InputError(path, "mesh", f"a {path.suffix} file", expected) from error
    except (OSError, ValueError, KeyError, IndexError, meshio.ReadError) as error:
        raise InputError(path, "mesh", str(error) or "an unreadable file", "a mesh that meshio reads") from error
    except SystemExit as error:  # meshio has printed what it tried; the exit code says nothing
        raise InputError(path, "mesh", "an unreadable file", "a mesh that meshio reads") from error
    except Exception as error:  # meshio raises whatever a damaged file leads it to
        found = f"an unreadable file ({type(error).__name__})"
        raise InputError(path, "mesh", found, "a mesh that meshio reads") from error
    dim = max((cells.dim for cells in found.cells), default=0)
    kinds = list(dict.fromkeys(cells.type for cells in found.cells if cells.dim == dim))
    strange = [kind for kind in kinds if kind not in _FROM_MESHIO]
    if strange or not kinds:
        raise InputError(path, "mesh", ", ".join(strange) or "no cells", "one of " + ", ".join(_FROM_MESHIO))
    points = np.asarray(found.points, dtype=float)
    if dim == 2 and points.shape[1] == 3 and np.ptp(points[:, 2]) > 1e-6 * np.ptp(points, axis=0).max():
        raise InputError(path, "mesh", "a surface in space", "a body in space, or a mesh in the plane z = 0")
    return _numbered(found, points[:, :dim], kinds)


def _numbered(found: Any, points: np.ndarray, kinds: list[str]) -> Mesh:
    """One block for each kind of cell, sets by the numbers of elements, and no nodes that nothing has.

    Sets of cells of fewer dimensions, as the lines or faces of a body that gmsh names, become node sets.
    """
    parts = [n for kind in kinds for n, cells in enumerate(found.cells) if cells.type == kind]
    ends = np.cumsum([len(found.cells[n].data) for n in parts])
    first = {n: int(end) - len(found.cells[n].data) for n, end in zip(parts, ends, strict=True)}
    nodes = {name.upper(): np.asarray(index) for name, index in found.point_sets.items()}
    elements = dict[str, np.ndarray]()
    for name, chosen in _cell_sets(found).items():
        inside = [np.asarray(chosen[n], int) + first[n] for n in parts if len(chosen[n])]
        beside = [np.ravel(found.cells[n].data[chosen[n]]) for n in range(len(chosen)) if n not in first]
        if inside:
            elements[name.upper()] = np.concatenate(inside)
        elif sum(map(len, beside)):
            nodes.setdefault(name.upper(), np.unique(np.concatenate(beside)))
    blocks = []
    for kind in kinds:
        rows = np.concatenate([cells.data for cells in found.cells if cells.type == kind])
        blocks.append(Block(_FROM_MESHIO[kind], _anticlockwise(points, rows)))
    used = np.zeros(len(points), dtype=bool)
    for index in [*nodes.values(), *(block.nodes for block in blocks)]:
        used[index] = True
    number = np.cumsum(used) - 1
    return Mesh(
        points[used],
        tuple(Block(block.element, number[block.nodes]) for block in blocks),
        {name: number[index] for name, index in nodes.items()},
        elements,
    )


def _cell_sets(found: Any) -> dict[str, list[np.ndarray]]:
    """Members of named sets, for each block of cells; physical groups of gmsh's older format have no sets in meshio."""
    none: np.ndarray = np.zeros(0, int)
    sets = {
        name: [none if one is None else np.asarray(one, int) for one in chosen]
        for name, chosen in found.cell_sets.items()
        if not name.startswith("gmsh:")
    }
    for name, (tag, dim) in found.field_data.items():
        if name not in sets and _PHYSICAL in found.cell_data:
            tags = zip(found.cells, found.cell_data[_PHYSICAL], strict=True)
            sets[name] = [np.flatnonzero(its == tag) if cells.dim == dim else none for cells, its in tags]
    return sets


def _anticlockwise(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Elements in the plane with their corners anticlockwise; those in space as they are."""
    if points.shape[1] == 3:
        return rows
    count = 3 if rows.shape[1] in (3, 6) else 4
    area = size_of(points[rows[:, :count]])
    return np.where((area < 0)[:, None], rows[:, _BACKWARDS[rows.shape[1]]], rows)


def with_types(mesh: Mesh, types: Sequence[str], where: Path) -> Mesh:
    """A mesh whose elements have other types, each for the elements with as many nodes.

    Raises
    ------
    InputError
        For a type that no element of the mesh has the nodes of.
    """
    blocks = list(mesh.blocks)
    for name in types:
        kind = ELEMENTS[name]
        fit = [n for n, block in enumerate(blocks) if (block.nodes.shape[1], mesh.dim) == (kind.nodes, kind.dim)]
        if not fit:
            there = ", ".join(block.element for block in mesh.blocks)
            raise InputError(where, "body.types", name, f"types for the elements of the mesh, {there}")
        for n in fit:
            blocks[n] = Block(name, blocks[n].nodes)
    return replace(mesh, blocks=tuple(blocks))
