"""Pictures of stiffness as a field: the map of a model that has one, and how sure it is."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from fingerfit.report.page.figures import map_frame
from fingerfit.report.page.inputs import Compare
from fingerfit.report.page.sheets import colour_scale

SEEN = 0.5
"""Share of what was not known before from which the data see a place: half of the variance is gone."""


def field_figures(compare: Compare) -> list[Figure]:
    """Factor on mu, and its standard error as a factor, by element; crossed out where the data do not see it."""
    rings = [ring[ring >= 0] for ring in compare.mesh_rings]
    outlines = [compare.mesh_points[ring] for ring in rings]
    value, spread = compare.field_value, compare.field_spread
    unseen = np.array([outline.mean(axis=0) for outline in outlines])[compare.field_seen < SEEN]
    end = max(float(np.abs(value).max()), 0.1)
    found = []
    for values, low, high, colours, label in (
        (value, -end, end, "PuOr_r", "mu, times that of its layer"),
        (spread, 0.0, max(float(spread.max()), 0.1), "Greys", "standard error: mu known to a factor of"),
    ):
        figure, axes, scale = map_frame(compare).panel()
        shown = PolyCollection(outlines, array=values, cmap=colours, edgecolor="face", linewidth=0.3)
        shown.set_clim(low, high)
        axes.add_collection(shown)
        axes.plot(*unseen.T, "x", color="#777777", markersize=4)
        colour_scale(figure, shown, scale, label)
        ticks = np.linspace(low, high, 5)
        scale.set_yticks(ticks, [f"{np.exp(tick):.2f}" for tick in ticks])
        found.append(figure)
    return found
