"""Figures of a finished fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fingerfit.core.errors import InputError
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import in_first_picture
from fingerfit.mesh.mesh import Mesh
from fingerfit.report.drawing import COLOURS, draw_mesh, extent, save
from fingerfit.report.volumes import chosen_slices, figure_sections, figure_slices
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data
from fingerfit.study.several import file_ending


def figure_deformed(mesh: Mesh, outcome: Outcome, steps: list[tuple[str, int]]) -> Figure:
    """The deformed mesh at the steps, and before, as the paper's Figure 4."""
    figure = Figure(figsize=(2.4 * (len(steps) + 1), 2.9), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(steps) + 1, sharex=True, sharey=True))
    shown = [("before", mesh.points), *((name, mesh.points + outcome.displacement[i]) for name, i in steps)]
    every = np.concatenate([points for _, points in shown])
    for axes, (name, points) in zip(panels, shown, strict=True):
        draw_mesh(axes, mesh, points)
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("x in mm", fontsize=9)
    panels[0].set_ylabel("y in mm", fontsize=9)
    panels[0].set_xlim(every[:, 0].min() - 0.5, every[:, 0].max() + 0.5)
    panels[0].set_ylim(every[:, 1].min() - 0.5, every[:, 1].max() + 0.5)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    return figure


def figure_pictures(data: Data, synthesized: np.ndarray) -> Figure:
    """Measured, synthesized and subtraction at the steps, as the paper's Figure 5."""
    count = len(data.measured)
    figure = Figure(figsize=(2.5 * count + 1.2, 7.4), layout="constrained")
    panels = figure.subplots(3, count, sharex=True, sharey=True, squeeze=False)
    top = float(max(data.measured.max(), synthesized.max()))
    difference = data.measured - synthesized
    limit = float(np.quantile(np.abs(difference), 0.999)) or 1.0
    grey: Any = None
    coloured: Any = None
    for column in range(count):
        for row, values in enumerate((data.measured[column], synthesized[column])):
            grey = panels[row, column].imshow(
                values, cmap="gray", vmin=0, vmax=top, origin="lower", extent=extent(data)
            )
        coloured = panels[2, column].imshow(
            difference[column], cmap="RdBu_r", vmin=-limit, vmax=limit, origin="lower", extent=extent(data)
        )
        panels[0, column].set_title(f"step {data.step[data.picture_step[column]]}", fontsize=10)
        panels[2, column].set_xlabel("x in mm", fontsize=9)
    for row, name in enumerate(("measured", "synthesized", "measured - synthesized")):
        panels[row, 0].set_ylabel(f"{name}\ny in mm", fontsize=9)
    figure.colorbar(grey, ax=panels[:2], label="intensity (1: brightest before compression)", shrink=0.6)
    figure.colorbar(coloured, ax=panels[2], label="difference of intensity", shrink=0.9)
    return figure


def figure_forces(data: Data, response: np.ndarray) -> Figure:
    """Force against displacement of the indenter, measured and of the model, whose one is `response`."""
    figure = Figure(figsize=(5.2, 3.8), layout="constrained")
    axes = figure.subplots()
    along, _ = data.split(response)
    moved, force = (along, data.force) if data.control == "force" else (data.displacement, along)
    axes.plot([0, *moved], [0, *force], "-", color=COLOURS[4], label="model")
    axes.errorbar(
        data.displacement,
        data.force,
        xerr=2 * data.displacement_noise or None,
        yerr=2 * data.force_noise if np.any(data.force_noise) else None,
        fmt="o",
        markersize=4,
        capsize=2,
        color=COLOURS[5],
        label="measured (bars: 2 standard deviations)",
    )
    axes.set_xlabel("displacement of the indenter in mm")
    axes.set_ylabel("force in N")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=9)
    return figure


def figure_search(last: Round, kind: str) -> Figure:
    """Score and constants of all guesses in order."""
    names = list(last.history[0]["values"])
    figure = Figure(figsize=(6.4, 5.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    number = np.arange(1, len(last.history) + 1)
    score = np.array([np.nan if e["score"] is None else e["score"] for e in last.history])
    upper.plot(number, score, ".", color="#777777", label="guess")
    upper.plot(number, np.fmin.accumulate(score), "-", color=COLOURS[4], label="best so far")
    upper.set_ylabel(f"score ({'-NMI' if kind == 'nmi' else kind})")
    upper.legend(frameon=False, fontsize=9)
    for colour, name in zip(COLOURS, names, strict=False):
        lower.plot(number, [e["values"][name] for e in last.history], ".-", color=colour, linewidth=0.7, label=name)
    lower.set_yscale("log")
    lower.set_xlabel("guess")
    lower.set_ylabel("value")
    lower.legend(frameon=False, fontsize=9)
    return figure


def figures_of(problem: InverseProblem, last: Round) -> dict[str, Callable[[], Figure]]:
    """What draws each figure of a finished fit, by name; in a study with several tests ``force-wide`` and the like."""
    shown = finest(problem, last)
    figures: dict[str, Callable[[], Figure]] = {}
    for n, (test, asked) in enumerate(zip(problem.every, shown.every, strict=True)):
        end = file_ending(test.test)
        drawn = {f"{name}{end}": draw for name, draw in _figures_of_test(test, asked).items()}
        figures[f"force{end}"] = drawn.pop(f"force{end}")
        if last.history and not n:
            figures["search"] = lambda: figure_search(last, problem.settings.fit.score)
        figures |= drawn
    return figures


def _figures_of_test(problem: InverseProblem, shown: Asked) -> dict[str, Callable[[], Figure]]:
    outcome, prediction, data = problem.outcome(shown), problem.prediction(shown), problem.data
    mesh = in_first_picture(problem.meshes[problem.mesh_of(shown)], outcome)
    steps = [(f"step {data.step[i]}", int(i)) for i in data.picture_step]
    figures: dict[str, Callable[[], Figure]] = {"force": lambda: figure_forces(data, prediction.response)}
    if mesh.dim == 2 and len(data.measured):
        figures["deformed_mesh"] = lambda: figure_deformed(mesh, outcome, steps)
        figures["pictures"] = lambda: figure_pictures(data, prediction.pictures)
    if mesh.dim == 3 and len(data.measured):
        figures["deformed_mesh"] = lambda: figure_sections(data, mesh, outcome, steps)
        figures["pictures"] = lambda: figure_slices(data, prediction.pictures, chosen_slices(data, mesh))
    return figures


def chosen_figure(figures: Mapping[str, Callable[[], Figure]], name: str) -> Figure:
    """The figure of a name.

    Raises
    ------
    InputError
        Where the fit has no figure of that name.
    """
    if name not in figures:
        raise InputError("figure", "name", name, f"one of {', '.join(figures)}")
    return figures[name]()


def plot_fit(problem: InverseProblem, last: Round, folder: Path) -> None:
    """All figures of a finished fit, into a folder."""
    for name, draw in figures_of(problem, last).items():
        save(draw(), folder / f"{name}.png")
