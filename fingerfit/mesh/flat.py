"""Whether sides of a body are flat, and whether its layers lie flat on top of each other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from fingerfit.mesh.faces import faces_of
from fingerfit.mesh.mesh import Mesh

LEVEL = 0.01
"""How much lower a flat side may be anywhere, as a share of how far it reaches: forces along it are then wrong by as
much. A choice."""


def is_flat(mesh: Mesh, name: str) -> bool:
    """Whether a node set is a flat side of the body across its last axis: whole faces of elements, level everywhere."""
    nodes = mesh.node_sets.get(name, np.zeros(0, dtype=int))
    chosen = np.zeros(len(mesh.points), dtype=bool)
    chosen[nodes] = True
    held = any(
        chosen[block.nodes[:, list(local)]].all(axis=1).any()
        for block in mesh.blocks
        for local in faces_of(block.element)
    )
    if not held:
        return False
    size = np.ptp(mesh.points[nodes], axis=0)
    return bool(size[-1] <= LEVEL * size[:-1].max())


def is_stacked(mesh: Mesh, layers: Sequence[str]) -> bool:
    """Whether layers, from the indenter down, lie flat on top of each other: none reaches into another's height."""
    ends = []
    for name in layers:
        height = mesh.points[mesh.nodes_of(mesh.element_sets[name.upper()]), -1]
        ends.append((height.min(), height.max()))
    allowed = LEVEL * float(np.ptp(mesh.body[:, 0]))
    return all(below[1] <= above[0] + allowed for above, below in itertools.pairwise(ends))
