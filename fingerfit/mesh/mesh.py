"""Finite element meshes: nodes, blocks of elements of one type, named sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Block:
    """Elements of one type, numbered through all blocks of a mesh in order.

    Parameters
    ----------
    element : str
        ABAQUS name of the type, for example ``CPE8``.
    nodes : ndarray, shape (elements, nodes per element), int
        Zero-based nodes in ABAQUS order (corners anticlockwise, then mid-side nodes).
    """

    element: str
    nodes: np.ndarray


@dataclass(frozen=True)
class Mesh:
    """A mesh in its reference state.

    Parameters
    ----------
    points : ndarray, shape (nodes, dim)
        Positions in mm; a deck's node number is the index plus one.
    blocks : tuple of Block
        At most one per element type is usual.
    node_sets, element_sets : mapping of str to ndarray of int
        Zero-based indices; names in upper case. Elements count through all blocks.
    surfaces : mapping of str to ndarray of int, shape (faces, 2)
        Element and face of it, both zero-based: face 0 is ABAQUS's S1.
    """

    points: np.ndarray
    blocks: tuple[Block, ...]
    node_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    element_sets: Mapping[str, np.ndarray] = field(default_factory=dict)
    surfaces: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return self.points.shape[1]

    @property
    def body(self) -> np.ndarray:
        """Points that elements have, shape (nodes, dim): without those of rigid tools."""
        used = np.zeros(len(self.points), dtype=bool)
        for block in self.blocks:
            used[block.nodes] = True
        return self.points[used]

    @property
    def parts(self) -> dict[str, np.ndarray]:
        """Element sets that do not overlap: each element in the smallest of its sets, layers without their regions."""
        taken = np.zeros(self.element_count, dtype=bool)
        chosen = {}
        for name, members in sorted(self.element_sets.items(), key=lambda item: len(item[1])):
            chosen[name] = members[~taken[members]]
            taken[members] = True
        return {name: chosen[name] for name in self.element_sets if len(chosen[name])}

    def nodes_of(self, elements: np.ndarray) -> np.ndarray:
        """Nodes that elements have, each once, in order."""
        chosen, used, first = np.zeros(self.element_count, dtype=bool), np.zeros(len(self.points), dtype=bool), 0
        chosen[elements] = True
        for block in self.blocks:
            used[block.nodes[chosen[first : first + len(block.nodes)]]] = True
            first += len(block.nodes)
        return np.flatnonzero(used)

    @property
    def element_count(self) -> int:
        """Number of elements of all blocks."""
        return sum(len(block.nodes) for block in self.blocks)
