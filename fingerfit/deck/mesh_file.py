"""Writing meshes as ABAQUS keywords and reading them from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.core.errors import InputError, LimitError
from fingerfit.core.files import MESH, check_regular
from fingerfit.mesh.elements import ELEMENTS
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


_FROM_MESHIO = {"quad": "CPE4", "quad8": "CPE8", "hexahedron": "C3D8"}


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
    import meshio

    try:
        found = meshio.read(path)
    except MemoryError as error:
        raise LimitError(path, "mesh", "more than the memory holds", "a mesh that fits into the memory") from error
    except (OSError, ValueError, KeyError, meshio.ReadError, SystemExit) as error:
        raise InputError(path, "mesh", error or "an unreadable file", "a mesh that meshio reads") from error
    blocks = [Block(_FROM_MESHIO[c.type], c.data) for c in found.cells if c.type in _FROM_MESHIO]
    if not blocks:
        kinds = ", ".join(sorted({c.type for c in found.cells})) or "no cells"
        raise InputError(path, "mesh", kinds, "one of " + ", ".join(_FROM_MESHIO))
    dim = ELEMENTS[blocks[0].element].dim
    nodes = {name.upper(): np.asarray(index) for name, index in found.point_sets.items()}
    sets = {}
    for name, per_cell in found.cell_sets.items():
        chosen = [
            np.asarray(index) for cell, index in zip(found.cells, per_cell, strict=True) if cell.type in _FROM_MESHIO
        ]
        if len(blocks) == 1:
            sets[name.upper()] = chosen[0]
    return Mesh(found.points[:, :dim], tuple(blocks), nodes, sets)
