"""Figures of studies in space: slices of the volumes, sections of the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import Slice, section, slices_through
from fingerfit.mesh.mesh import Mesh
from fingerfit.report.drawing import COLOURS
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data


def chosen_slices(data: Data, mesh: Mesh) -> list[Slice]:
    """The axial and the sagittal slice through the middle of what the indenter pushes."""
    return slices_through(Picture.before(data), mesh.points[mesh.node_sets["TOP"]].mean(axis=0))


def figure_slices(data: Data, synthesized: np.ndarray, cuts: list[Slice]) -> Figure:
    """Measured, synthesized and subtraction at the steps in slices, as the paper's Figures 6, 7 and 9."""
    count = len(data.measured)
    shapes = [abs(c.limits[3] - c.limits[2]) / abs(c.limits[1] - c.limits[0]) for c in cuts]
    heights = [3 * (2.3 * shape + 0.1) + 0.9 for shape in shapes]
    figure = Figure(figsize=(2.3 * count + 1.9, sum(heights)), layout="constrained")
    limit = float(np.quantile(np.abs(data.measured - synthesized), 0.999)) or 1.0
    bright = float(max(np.quantile(data.measured, 0.999), np.quantile(synthesized, 0.999)))
    parts = figure.subfigures(len(cuts), 1, squeeze=False, height_ratios=heights)
    for part, cut in zip(parts[:, 0], cuts, strict=True):
        panels = part.subplots(3, count, sharex=True, sharey=True, squeeze=False)
        measured, made = cut.of(data.measured), cut.of(synthesized)
        grey: Any = None
        coloured: Any = None
        place: dict[str, Any] = {"origin": "lower", "extent": cut.limits}
        for column in range(count):
            grey = panels[0, column].imshow(measured[column], cmap="gray", vmin=0, vmax=bright, **place)
            panels[1, column].imshow(made[column], cmap="gray", vmin=0, vmax=bright, **place)
            difference = measured[column] - made[column]
            coloured = panels[2, column].imshow(difference, cmap="RdBu_r", vmin=-limit, vmax=limit, **place)
            panels[0, column].set_title(f"step {data.step[data.picture_step[column]]}", fontsize=10)
            panels[2, column].set_xlabel(cut.labels[0], fontsize=9)
        for row, name in enumerate(("measured", "synthesized", "measured\n- synthesized")):
            panels[row, 0].set_ylabel(f"{name}\n{cut.labels[1]}", fontsize=9)
        part.suptitle(cut.title[0].upper() + cut.title[1:], fontsize=11)
        part.colorbar(grey, ax=panels[:2], label="intensity", shrink=0.6)
        part.colorbar(coloured, ax=panels[2], label="difference", shrink=0.9)
    return figure


def figure_sections(data: Data, mesh: Mesh, outcome: Outcome, steps: list[tuple[str, int]]) -> Figure:
    """Sections of the deformed mesh at the steps, and before, over the measured volumes."""
    shown = [("before", None), *steps]
    cuts, frame = chosen_slices(data, mesh), Picture.before(data)
    shapes = [abs((c.limits[3] - c.limits[2]) / (c.limits[1] - c.limits[0])) for c in cuts]
    figure = Figure(figsize=(2.6 * len(shown) + 0.4, sum(2.5 * s + 0.5 for s in shapes) + 0.5), layout="constrained")
    panels = figure.subplots(len(cuts), len(shown), squeeze=False, gridspec_kw={"height_ratios": shapes})
    for row, cut in enumerate(cuts):
        for column, (name, step) in enumerate(shown):
            axes = panels[row, column]
            volume = data.before if step is None else data.measured[column - 1]
            points = mesh.points if step is None else mesh.points + outcome.displacement[step]
            draw_section(axes, mesh, points, frame, cut, volume)
            axes.set_title(name if row == 0 else "", fontsize=10)
            axes.set_xlabel(cut.labels[0], fontsize=9)
        panels[row, 0].set_ylabel(f"{cut.title}\n{cut.labels[1]}", fontsize=9)
    _legend(figure, panels[0, 0], mesh)
    return figure


def draw_section(axes: Any, mesh: Mesh, points: np.ndarray, frame: Picture, cut: Slice, volume: np.ndarray) -> None:
    """A slice of a volume and the lines of the mesh in it, parts in colours."""
    values = cut.of(volume)
    bright = float(np.quantile(values, 0.999)) or 1.0
    axes.imshow(values, cmap="gray", vmin=0, vmax=bright, origin="lower", extent=cut.limits)
    lines, part = section(mesh, points, frame, cut)
    for number in np.unique(part):
        axes.add_collection(
            LineCollection(list(lines[part == number]), colors=COLOURS[number % len(COLOURS)], linewidths=1.0)
        )
    axes.set_xlim(*cut.limits[:2])
    axes.set_ylim(*cut.limits[2:])


def _legend(figure: Figure, axes: Any, mesh: Mesh) -> None:
    for number, name in enumerate(mesh.parts):
        axes.plot([], [], color=COLOURS[number % len(COLOURS)], label=name.lower())
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
