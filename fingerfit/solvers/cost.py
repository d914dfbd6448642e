"""How long a simulation takes about: what decides in which job it runs, and how long a cluster lets it."""

from __future__ import annotations

import math

BUILTIN = "builtin"
PLANE, SPACE = 5e-4, 3e-3
"""Seconds of a simulation for each node: benchmarks/solver.md and, for 7000 nodes, benchmarks/indentation.md."""
SHORT = 1.0
"""Seconds of a simulation that is not worth a job of its own, whose start takes 0.3 s (benchmarks/phantom.md)."""
EXTERNAL = 10
"""How much longer another program takes than the built-in solver: 4 to 84 times in the same tables."""


def expected_seconds(solver: str, dim: int, nodes: int) -> float:
    """Expected seconds of one simulation; of the built-in solver in space they grow as nodes to the power 1.5.

    Parameters
    ----------
    solver : str
        Name of the solver.
    dim : int
        2 in the plane, 3 in space.
    nodes : int
        Of the mesh.
    """
    seconds = PLANE * nodes if dim == 2 else SPACE * nodes * math.sqrt(max(nodes / 7000, 1))
    return seconds * (1 if solver == BUILTIN else EXTERNAL)
