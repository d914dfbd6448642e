"""What is wrong with a mesh that a person brings, before a solver fails on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.units import LENGTHS
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.inside import portions
from fingerfit.mesh.mesh import Mesh

_NAMED = 5
"""Numbers that a line lists before it only counts them."""


def faults_of_mesh(mesh: Mesh, layers: dict[str, np.ndarray], where: Path) -> list[FingerfitError]:
    """Elements without volume or in two layers, nodes of nothing, and an indenter that holds no face of the body.

    Parameters
    ----------
    mesh : Mesh
        With the node sets ``BOTTOM``, ``TOP`` and ``INDENTER``.
    layers : dict
        Elements of each layer of the study.
    where : Path
        Its file, which errors name.
    """
    problems: list[FingerfitError] = []
    far = np.flatnonzero(~(np.abs(mesh.points) <= LENGTHS[1]).all(axis=1))
    if len(far):
        return [
            InputError(where, "nodes", f"{_listed(far)} beyond {LENGTHS[1]:g} mm", "coordinates in the study's unit")
        ]
    empty = _without_volume(mesh)
    if len(empty):
        found = f"no volume, or a negative one, in {_listed(empty)}"
        problems.append(InputError(where, "elements", found, "nodes in the order that ABAQUS has, anticlockwise"))
    owner: dict[int, str] = {}
    for name, members in layers.items():
        twice = [int(element) for element in members if int(element) in owner]
        if twice:
            found = f"{_listed(twice)} in {owner[twice[0]]} too"
            problems.append(InputError(where, f"element set {name}", found, "each element in one layer"))
        owner |= dict.fromkeys(map(int, members), name)
    used = np.zeros(len(mesh.points), dtype=bool)
    for block in mesh.blocks:
        used[block.nodes] = True
    loose = ~used
    for name, nodes in mesh.node_sets.items():
        loose[nodes] &= name == "ALL"  # those of rigid tools have names
    if loose.any():
        expected = "nodes of elements, or of a set"
        problems.append(InputError(where, "nodes", f"{_listed(np.flatnonzero(loose))} in no element", expected))
    top, bottom = mesh.node_sets["TOP"], mesh.node_sets["BOTTOM"]
    apart = _pieces_apart(mesh)
    if apart:
        found = f"apart from the base: {len(apart)} of its pieces, the first of nodes {_listed(apart[0])}"
        problems.append(InputError(where, "elements", found, "one body, or a surface of each piece to tie it by"))
    both = np.intersect1d(top, bottom)
    if len(both):
        found = f"{_listed(both)} of the base too"
        problems.append(InputError(where, "node set of the indenter", found, "other nodes than the base has"))
    held = [node for node in mesh.node_sets["INDENTER"] if used[node] and node not in top]
    if held:
        found = f"{_listed(held)}, not on the indenter's face"
        problems.append(InputError(where, "node set INDENTER", found, "a node of that face, or a point of no element"))
    return problems


def _without_volume(mesh: Mesh) -> np.ndarray:
    """Elements whose volume is not positive at every integration point."""
    found, first = [], 0
    for block in mesh.blocks:
        if ELEMENTS[block.element].dim == mesh.dim:
            found.append(first + np.flatnonzero(~(portions(mesh.points, block) > 0).all(axis=1)))
        first += len(block.nodes)
    return np.concatenate(found) if found else np.zeros(0, dtype=int)


def _pieces_apart(mesh: Mesh) -> list[np.ndarray]:
    """Nodes of each piece of the body that shares none with the base, and that no template can tie or hold.

    A template knows a piece by its surfaces, or by node sets beside those of base and indenter. A solver may find an
    answer without it: nothing pushes it, so that it stays where it is.
    """
    from scipy.sparse import coo_array  # most commands, and Snakemake, need nothing else of scipy
    from scipy.sparse.csgraph import connected_components

    count = len(mesh.points)
    pairs = np.concatenate([
        np.stack([np.broadcast_to(block.nodes[:, :1], block.nodes.shape), block.nodes], axis=-1).reshape(-1, 2)
        for block in mesh.blocks
        if ELEMENTS[block.element].dim == mesh.dim
    ])  # fmt: skip
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    piece = connected_components(graph, directed=False)[1]
    sets = {name: nodes for name, nodes in mesh.node_sets.items() if name != "ALL"}
    ends = np.concatenate([sets["BOTTOM"], sets["TOP"], sets["INDENTER"], sets.get("MIDDLE", sets["BOTTOM"])])
    held = [sets["BOTTOM"], *(nodes for nodes in sets.values() if not np.isin(nodes, ends).all())]
    known = set(piece[np.concatenate(held)].tolist())
    elements = [nodes for block in mesh.blocks for nodes in block.nodes]
    known |= {int(piece[elements[element][0]]) for faces in mesh.surfaces.values() for element in set(faces[:, 0])}
    apart = set(piece[pairs[:, 0]].tolist()) - known
    return [np.flatnonzero(piece == number) for number in sorted(apart)]


def _listed(numbers: np.ndarray | list[int]) -> str:
    """Numbers as a mesh counts them, which begins with 1."""
    shown = ", ".join(str(int(n) + 1) for n in numbers[:_NAMED])
    return f"number {shown}" + (f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else "")
