"""Pictures of how a model moves the base and the face of the indenter, from place to place."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fingerfit.report.drawing import COLOURS
from fingerfit.report.page.inputs import Compare

EDGES = ("base", "indenter")
STYLES: tuple[dict[str, Any], ...] = (
    {"label": "to the right", "linestyle": "-", "color": COLOURS[4]},
    {"label": "upwards", "linestyle": "--", "color": COLOURS[5]},
)
STILL = 1e-6
"""Largest displacement, as a share of its largest x, of an edge that does not move: rounding. A choice."""


def edge_figures(compare: Compare) -> dict[str, Figure]:
    """Displacement along the base, and along the indenter's face beside its mean, where they are not all the same."""
    found = {}
    for side, name in enumerate(EDGES):
        rows = compare.edge_moved[compare.edge_moved[:, 0] == side]
        x, moved = rows[:, 1], rows[:, 2:]
        if name == "indenter" and len(rows):  # its mean is the load's
            moved = moved - moved.mean(axis=0)
        if np.abs(moved).max(initial=0.0) <= STILL * np.abs(x).max(initial=0.0):
            continue
        figure = Figure(figsize=(5.2, 2.9), layout="constrained")
        axes = figure.subplots()
        axes.axhline(0.0, color="#777777", linewidth=0.8)
        for along, style in zip(moved.T, STYLES, strict=True):
            axes.plot(x, along, **style)
        axes.set(xlabel="x before compression in mm", ylabel="displacement in mm")
        axes.legend(frameon=False, fontsize=9)
        found[name] = figure
    return found
