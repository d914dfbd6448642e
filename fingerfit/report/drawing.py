"""What figures have in common. Colours are those of Okabe and Ito, which colour-blind people can tell apart."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from fingerfit.core.files import write_atomic
from fingerfit.mesh.mesh import Mesh
from fingerfit.study.data import Data

COLOURS = ("#E69F00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#D55E00")


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130)
    write_atomic(path, lambda handle: handle.write(buffer.getvalue()))


def _outlines(mesh: Mesh, points: np.ndarray) -> list[np.ndarray]:
    """Outline of each element of a plane mesh: corners with the mid-side nodes between them."""
    rings = []
    for block in mesh.blocks:
        rings += list(points[block.nodes[:, outline(block.nodes.shape[1])]])
    return rings


def outline(count: int) -> np.ndarray:
    """Order of the nodes of a plane element along its outline: corners with the mid-side nodes between them."""
    half = count // 2
    return np.ravel([[n, n + half] for n in range(half)]) if count in (6, 8) else np.arange(count)


def draw_mesh(axes: Any, mesh: Mesh, points: np.ndarray, fill: bool = True, line: float = 0.4) -> None:
    """Draw a plane mesh, its layers in colours."""
    rings = _outlines(mesh, points)
    for number, (name, members) in enumerate(mesh.parts.items()):
        colour = COLOURS[number % len(COLOURS)]
        axes.add_collection(
            PolyCollection(
                [rings[i] for i in members],
                facecolor=colour if fill else "none",
                edgecolor="#333333" if fill else colour,
                linewidth=line,
                label=name.lower(),
            )
        )
    axes.set_aspect("equal")


def extent(data: Data) -> tuple[float, float, float, float]:
    """Borders of a plane picture in mm: left, right, bottom, top."""
    ny, nx = data.before.shape
    x, y = data.origin - data.spacing / 2
    return x, x + nx * data.spacing[0], y, y + ny * data.spacing[1]
