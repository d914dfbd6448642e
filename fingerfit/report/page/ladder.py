"""Figures of the ladder: how the error falls from model to model, and how the constants change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fingerfit.fit.intervals import NORMAL
from fingerfit.report.drawing import COLOURS
from fingerfit.report.page.figures import plain

SHOWN = 10.0
"""Highest rise of the misfit that is drawn: beyond a wall it is of another size."""
SERIES = (("fitted", "fitted", "o-", COLOURS[4]), ("held_out", "held out", "s--", COLOURS[5]))


def rung_label(rung: dict[str, Any], first: bool) -> str:
    """Short name of a rung: the first model, then what each one adds."""
    effects = rung.get("effects") or []
    return str(rung["model"]) if first or not effects else f"+ {effects[-1]}"


def _tick(rung: dict[str, Any], first: bool, most: int) -> str:
    """The same below a figure."""
    name = plain(_short(rung_label(rung, first), most))
    return f"{name}\ncoarser mesh" if rung.get("coarser") else name


def ladder_figure(ladder: dict[str, Any]) -> Figure:
    """Error of each rung against the noise.

    Parameters
    ----------
    ladder : dict
        As in ``ladder.json``.
    """
    rungs = ladder["rungs"]
    figure = Figure(figsize=(max(4.6, 1.5 + 1.2 * len(rungs)), 3.6), layout="constrained")
    axes = figure.subplots()
    x = np.arange(len(rungs))
    values = np.array([[_number(rung, part) for part, *_ in SERIES] for rung in rungs]).reshape(len(rungs), 2)
    top = float(np.nanmax(values)) if np.isfinite(values).any() else 1.0
    wide = np.isfinite(values).any() and top > 12 * max(1e-9, min(1.0, float(np.nanmin(values))))
    axes.axhspan(0.01, 1.0, color="#BBBBBB", alpha=0.35, linewidth=0)
    axes.axhline(1.0, color="#444444", linewidth=1.0)
    for column, (_, label, style, colour) in enumerate(SERIES):
        own = values[:, column]
        if np.isfinite(own).any():
            axes.plot(x, own, style, color=colour, markersize=7, label=label)
        for i in np.flatnonzero(np.isfinite(own)):
            other = values[i, 1 - column]
            above = own[i] > other if np.isfinite(other) and own[i] != other else column == 0
            axes.annotate(
                f"{own[i]:.3g}", (i, own[i]), (0, 7 if above else -7), textcoords="offset points",
                ha="center", va="bottom" if above else "top", fontsize=9, color=colour,
            )  # fmt: skip
    if wide:
        axes.set_yscale("log")
        axes.set_ylim(0.5, top * 1.6)
        ticks = [t for t in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if t < top * 1.6]
        axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
        axes.minorticks_off()
    else:
        axes.set_ylim(0, max(1.6, 1.2 * top))
    axes.set_xlim(-0.5, len(rungs) - 0.5)
    axes.set_xticks(x, [_tick(rung, i == 0, 18) for i, rung in enumerate(rungs)])
    if len(rungs) > 4:
        axes.tick_params(axis="x", rotation=20)
    axes.set_ylabel("error in multiples of the noise level")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=9, frameon=False)
    axes.annotate(
        "noise alone", (0.99, 1.0), (0, -3), xycoords=("axes fraction", "data"), textcoords="offset points",
        ha="right", va="top", fontsize=8.5, color="#333333",
    )  # fmt: skip
    return figure


def profile_figure(data: Mapping[str, Any]) -> Figure:
    """Rise of the misfit over the constant, and where it tells the 95 % interval.

    Parameters
    ----------
    data : mapping
        As in ``profile_NAME.json``.
    """
    name = data["constant"]
    value = np.array([one["values"][name] for one in data["points"]])
    rise = np.array([one["rise"] for one in data["points"]])
    figure = Figure(figsize=(4.6, 3.2), layout="constrained")
    axes = figure.subplots()
    limit = NORMAL**2
    axes.plot(value, rise, "o-", color=COLOURS[4], markersize=5)
    axes.axhline(limit, color="#444444", linewidth=1.0)
    axes.annotate(
        "95 %", (0.99, limit), (0, 3), xycoords=("axes fraction", "data"), textcoords="offset points", ha="right"
    )
    low, high = data["interval95"]
    for end in (low, high):
        if end is not None:
            axes.axvline(end, color=COLOURS[5], linestyle="--", linewidth=1.0)
    shown = value[rise <= SHOWN]
    axes.set_xlim(*(np.array([shown.min(), shown.max()]) + 0.06 * np.ptp(shown) * np.array([-1, 1])))
    axes.set_ylim(-0.3, min(SHOWN, max(1.2 * limit, 1.1 * float(rise.max()))))
    axes.set_xlabel(name if data["unit"] == "1" else f"{name} in {data['unit']}")
    axes.set_ylabel("rise of the misfit")
    return figure


def _short(text: str, most: int = 18) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _number(rung: dict[str, Any], part: str) -> float:
    value = (rung.get("error") or {}).get(part)
    return float("nan") if value is None else float(value)


def constants_figures(ladder: dict[str, Any]) -> dict[str, Figure]:
    """Constants of each rung with their 95 % intervals, by name a figure each, small enough for a narrow screen."""
    rungs, found = ladder.get("rungs") or [], {}
    for name in dict.fromkeys(name for rung in rungs for name in rung.get("parameters") or {}):
        found[name] = Figure(figsize=(2.5, 2.0), layout="constrained")
        _constant(found[name].subplots(), name, rungs)
    return found


def _constant(axes: Any, name: str, rungs: list[dict[str, Any]]) -> None:
    unit = ""
    for i, rung in enumerate(rungs):
        entry = (rung.get("parameters") or {}).get(name)
        if not entry:
            continue
        unit = entry.get("unit", "")
        low, high = entry.get("interval95") or (entry["value"],) * 2
        axes.plot([i, i], [low, high], "-", color=COLOURS[4], linewidth=2.2, solid_capstyle="butt")
        axes.plot(i, entry["value"], "o", color=COLOURS[4], markersize=6, markeredgecolor="white")
    axes.set_title(plain(f"{name}{f' in {unit}' if unit and unit != '1' else ''}"), fontsize=9.5)
    axes.set_xlim(-0.5, len(rungs) - 0.5)
    labels = [_tick(rung, i == 0, 12) for i, rung in enumerate(rungs)]
    axes.set_xticks(range(len(rungs)), labels, fontsize=8.5)
    if len(rungs) > 3:
        axes.tick_params(axis="x", rotation=35)
    axes.tick_params(axis="y", labelsize=8.5)
    axes.locator_params(axis="y", nbins=5)
    axes.margins(y=0.2)
    axes.grid(axis="y", color="#E4E4E4", linewidth=0.7)
    axes.set_axisbelow(True)
