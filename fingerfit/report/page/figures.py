"""Pictures of the page. Those that are laid over each other share one frame, so that they can be blinked."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from PIL import Image

from fingerfit.report.drawing import COLOURS
from fingerfit.report.page.inputs import Compare
from fingerfit.report.page.regions import patch_layers, patch_size

DPI = 130
WIDTH = 4.4
LEFT, RIGHT, BOTTOM, TOP = 0.62, 0.98, 0.52, 0.16
"""Margins of a panel, inches; the scale of colours is in the right one."""
WARM = LinearSegmentedColormap.from_list("warm", ["#FFFFFF", "#FBE7B5", COLOURS[0], COLOURS[5]])
UNKNOWN = "#DDDDDD"
NOISE_BAND = "noise (2 standard deviations)"


def plain(text: object) -> str:
    """Text that matplotlib draws as it is, without formulas."""
    return str(text).replace("$", r"\$")


def uri(figure: Figure) -> str:
    """A figure as an embedded PNG with at most 256 colours."""
    canvas, small = FigureCanvasAgg(figure), io.BytesIO()
    figure.set_dpi(DPI)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image.quantize(256, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(small.getvalue()).decode()


@dataclass(frozen=True)
class Frame:
    """Limits in mm and the place of the axes in a panel.

    Parameters
    ----------
    limits : tuple of float
        Left, right, bottom, top, mm; widened where a panel would be too flat or too high.
    labels : tuple of str
        Of the axes.
    """

    limits: tuple[float, float, float, float]
    labels: tuple[str, str] = ("x in mm", "y in mm")

    @classmethod
    def around(
        cls, limits: tuple[float, float, float, float], labels: tuple[str, str] = ("x in mm", "y in mm")
    ) -> Frame:
        """A frame around limits, no flatter than 1:2 and no higher than 4:3."""
        left, right, bottom, top = limits
        wide, high = max(right - left, 1e-9), max(top - bottom, 1e-9)
        more_high, more_wide = max(0.0, wide / 2 - high) / 2, max(0.0, high * 0.75 - wide) / 2
        return cls((left - more_wide, right + more_wide, bottom - more_high, top + more_high), labels)

    @property
    def inches(self) -> tuple[float, float]:
        """Width and height of the axes, inches."""
        left, right, bottom, top = self.limits
        wide = WIDTH - LEFT - RIGHT
        return wide, wide * (top - bottom) / (right - left)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the panel, inches."""
        return WIDTH, self.inches[1] + BOTTOM + TOP

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, bottom, width and height of the axes as fractions of the panel."""
        wide, high = self.inches
        return LEFT / WIDTH, BOTTOM / self.size[1], wide / WIDTH, high / self.size[1]

    def panel(self) -> tuple[Figure, Any, Any]:
        """A figure, its axes and the axes of the scale of colours."""
        figure = Figure(figsize=self.size)
        axes = figure.add_axes(self.box)
        left, bottom, wide, high = self.box
        scale = figure.add_axes((left + wide + 0.1 / WIDTH, bottom, 0.14 / WIDTH, high))
        axes.set_xlim(*self.limits[:2])
        axes.set_ylim(*self.limits[2:])
        axes.set_xlabel(self.labels[0], fontsize=9, labelpad=2)
        axes.set_ylabel(self.labels[1], fontsize=9, labelpad=2)
        axes.locator_params(nbins=6)
        for part in (axes, scale):
            part.tick_params(labelsize=8.5)
        return figure, axes, scale


def colour_scale(figure: Figure, shown: Any, scale: Any, label: str, extend: str = "neither") -> None:
    """The scale of colours of what is shown, its label no longer than itself."""
    bar = figure.colorbar(shown, cax=scale, extend=extend)
    long = 72 * scale.get_position().height * figure.get_figheight()
    letters = max(map(len, label.splitlines()))  # about 0.55 of their height wide
    bar.set_label(label, fontsize=min(9.0, long / (0.55 * letters)))
    bar.ax.locator_params(nbins=5)


def grey_panel(frame: Frame, compare: Compare, values: np.ndarray, top: float) -> Figure:
    """A picture in grey."""
    figure, axes, scale = frame.panel()
    shown = axes.imshow(values, cmap="gray", vmin=0, vmax=top, origin="lower", extent=compare.limits, aspect="auto")
    axes.set_xlim(*frame.limits[:2])
    axes.set_ylim(*frame.limits[2:])
    colour_scale(figure, shown, scale, "brightness (0 to 1)")
    return figure


def difference_panel(frame: Frame, compare: Compare, values: np.ndarray, limit: float) -> Figure:
    """Measured minus synthesized."""
    figure, axes, scale = frame.panel()
    shown = axes.imshow(
        values, cmap="RdBu_r", vmin=-limit, vmax=limit, origin="lower", extent=compare.limits, aspect="auto"
    )
    axes.set_xlim(*frame.limits[:2])
    axes.set_ylim(*frame.limits[2:])
    colour_scale(figure, shown, scale, "difference of brightness", "both")
    return figure


def map_frame(compare: Compare) -> Frame:
    """Frame of the maps: the patches, in the body before compression."""
    half = patch_size(compare) / 2
    low, high = compare.patch_centre.min(axis=0) - half, compare.patch_centre.max(axis=0) + half
    edge = 0.03 * float((high - low).max())
    limits = (float(low[0] - edge), float(high[0] + edge), float(low[1] - edge), float(high[1] + edge))
    return Frame.around(limits, compare.axes)


def borders(compare: Compare) -> list[np.ndarray]:
    """Edges of the reference mesh between layers and around it."""
    if len(compare.edges):
        return list(compare.edges)
    owners: dict[tuple[int, int], list[int]] = {}
    for ring, layer in zip(compare.mesh_rings, compare.mesh_layer, strict=True):
        ring = ring[ring >= 0]
        for a, b in zip(ring, np.roll(ring, -1), strict=True):
            owners.setdefault((min(a, b), max(a, b)), []).append(int(layer))
    return [compare.mesh_points[list(edge)] for edge, own in owners.items() if len(own) == 1 or len(set(own)) > 1]


def map_panel(frame: Frame, compare: Compare, displacement: np.ndarray, limit: float) -> Figure:
    """Displacements of patches: arrows, many times enlarged, over a map of their length.

    Parameters
    ----------
    frame : Frame
    compare : Compare
    displacement : ndarray, shape (patches, 2)
        mm; NaN where unknown.
    limit : float
        End of the scale of colours, and displacement whose arrow is as long as a patch, mm.
    """
    figure, axes, scale = frame.panel()
    size = patch_size(compare)
    length = np.hypot(displacement[:, 0], displacement[:, 1])
    shown = _cells(axes, compare, length, cmap=WARM, vmin=0, vmax=limit)
    known = np.isfinite(length) & (length > 0.02 * limit)
    reach = 1.15 * float(size.min()) / limit
    drawn = np.minimum(1.0, 1.3 * limit / np.maximum(length, 1e-12))[:, None] * displacement
    axes.quiver(
        *compare.patch_centre[known].T, *drawn[known].T, angles="xy", scale_units="xy", scale=1 / reach,
        width=0.006, headwidth=3.6, headlength=4, headaxislength=3.6, pivot="middle", color="#111111",
    )  # fmt: skip
    axes.set_xlim(*frame.limits[:2])
    axes.set_ylim(*frame.limits[2:])
    axes.set_xlabel(f"{frame.labels[0]} (arrows enlarged {reach:.3g} times)", fontsize=9, labelpad=2)
    colour_scale(figure, shown, scale, "residual displacement in mm", "max")
    return figure


def _cells(axes: Any, compare: Compare, values: np.ndarray, **colours: Any) -> Any:
    """Values of patches over the borders of the layers, grey where they are not known."""
    size = patch_size(compare)
    nx, ny = (int(n) for n in compare.patch_count)
    low = compare.patch_centre.min(axis=0) - size / 2
    edges = [low[k] + size[k] * np.arange(n + 1) for k, n in enumerate((nx, ny))]
    cells = np.ma.masked_invalid(values.reshape(nx, ny).T)
    axes.set_facecolor("white")
    gone = np.where(np.ma.getmaskarray(cells), 1.0, np.nan)
    known_layers = len(compare.mesh_rings) or len(compare.patch_layer)
    inside = patch_layers(compare).reshape(nx, ny).T >= 0 if known_layers else True
    axes.pcolormesh(*edges, np.where(inside, gone, np.nan), cmap=LinearSegmentedColormap.from_list("n", [UNKNOWN] * 2))
    shown = axes.pcolormesh(*edges, cells, **colours)
    # one artist: a line for each edge would take longer than all the rest of the panel
    axes.add_collection(LineCollection(borders(compare), colors="#777777", linewidths=0.8, capstyle="projecting"))
    return shown


def brightness_panel(frame: Frame, compare: Compare, values: np.ndarray, limit: float) -> Figure:
    """Residual brightness of patches, shape (patches,)."""
    figure, axes, scale = frame.panel()
    shown = _cells(axes, compare, values, cmap="RdBu_r", vmin=-limit, vmax=limit)
    axes.set_xlim(*frame.limits[:2])
    axes.set_ylim(*frame.limits[2:])
    colour_scale(figure, shown, scale, "residual brightness (of 1)", "both")
    return figure


def curve_panel(compare: Compare, values: np.ndarray, limit: float) -> Figure:
    """Residual of the response against the step, with the band of its noise.

    Parameters
    ----------
    compare : Compare
    values : ndarray, shape (steps,)
        N or mm.
    limit : float
        End of the scale, the same unit.
    """
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    axes = figure.subplots()
    _residual_curve(axes, compare, values, "o-")
    axes.set_ylim(-limit, limit)
    axes.tick_params(labelsize=8.5)
    return figure


def _residual_curve(axes: Any, compare: Compare, values: np.ndarray, style: str) -> None:
    name, unit = compare.response_name
    noise = np.nan_to_num(compare.response_noise)
    if noise.any():
        axes.fill_between(
            compare.step,
            -2 * noise,
            2 * noise,
            color=COLOURS[4],
            alpha=0.18,
            linewidth=0,
            label=NOISE_BAND,
        )
        axes.legend(frameon=False, fontsize=8.5, loc="best")
    axes.axhline(0, color="#555555", linewidth=0.8)
    shown = np.isfinite(values)
    axes.plot(compare.step[shown], values[shown], style, markersize=4.5, color=COLOURS[5])
    axes.set_xlabel("step", fontsize=9)
    axes.set_ylabel(f"residual\n{name} in {unit}", fontsize=9)
    axes.set_xticks(compare.step if len(compare.step) <= 12 else compare.step[:: len(compare.step) // 8])


def stiffness_figure(compare: Compare, stiffness: np.ndarray) -> Figure:
    """Where stiffer or softer material would reduce the misfit, over the layers of the body.

    Parameters
    ----------
    compare : Compare
    stiffness : ndarray, shape (places, 4)
        Position in mm, predicted change of log mu, evidence in standard deviations.
    """
    figure, axes, scale = map_frame(compare).panel()
    shown = _stiffness_map(axes, borders(compare), stiffness, _sure(stiffness))
    colour_scale(figure, shown, scale, _EVIDENCE)
    return figure


def stiffness_in_space(sections: list[Compare], stiffness: np.ndarray) -> list[Figure]:
    """The same for a body in space: a figure for each x of the places.

    Parameters
    ----------
    sections : list of Compare
        The body in sections there, from the lowest x on.
    stiffness : ndarray, shape (places, 5)
        Position in mm, predicted change of log mu, evidence in standard deviations.
    """
    found = []
    for section, level in zip(sections, np.unique(stiffness[:, 0]), strict=True):
        figure, axes, scale = map_frame(section).panel()
        here = stiffness[stiffness[:, 0] == level]
        shown = _stiffness_map(axes, borders(section), here[:, 1:], _sure(stiffness))
        axes.set_xlabel(f"{axes.get_xlabel()} (section at x = {level:.1f} mm)", fontsize=9, labelpad=2)
        colour_scale(figure, shown, scale, _EVIDENCE)
        found.append(figure)
    return found


_EVIDENCE = "evidence, standard deviations\n(softer −, stiffer +)"


def _sure(stiffness: np.ndarray) -> float:
    """End of the scale of evidence: a chance finding stays pale."""
    return max(6.0, float(np.abs(stiffness[:, -1]).max()))


def _stiffness_map(axes: Any, edges: list[np.ndarray], stiffness: np.ndarray, limit: float) -> Any:
    """Places, shape (places, 4), in a plane over the borders of the layers."""
    for edge in edges:
        axes.plot(*edge.T, color="#777777", linewidth=0.8)
    x, y, change, evidence = stiffness.T
    shown = axes.scatter(
        x, y, c=evidence, s=430, cmap="PuOr_r", vmin=-limit, vmax=limit, edgecolor="#555555", linewidth=0.6
    )
    for at, height, value, weight in zip(x, y, change, evidence, strict=True):
        colour = "white" if abs(weight) > 0.7 * limit else "#111111"
        percent = round(100 * np.expm1(value))
        text = f"{percent:+d}" if percent else "0"
        text = f"×{np.exp(value):.0f}" if percent >= 1000 else text
        axes.annotate(text, (at, height), ha="center", va="center", fontsize=7, color=colour)
    return shown


def force_figure(compare: Compare) -> Figure | None:
    """Force against indentation with the band of noise, and below its residual; None when nothing is known."""
    known = np.isfinite(compare.force) & np.isfinite(compare.displacement) if len(compare.force) else np.zeros(0, bool)
    modelled = bool(len(compare.force_model)) and bool(np.isfinite(compare.force_model).any())
    if not modelled and not known.any():
        return None
    both = bool(np.isfinite(compare.response).any())
    figure = Figure(figsize=(5.2, 5.1 if both else 3.4), layout="constrained")
    upper, *lower = np.ravel(figure.subplots(1 + both, 1, gridspec_kw={"height_ratios": [2, 1.2][: 1 + both]}))
    if modelled:
        _model_line(upper, compare)
    if known.any():
        upper.errorbar(
            compare.displacement[known], compare.force[known], xerr=_bars(compare.displacement_noise, known),
            yerr=_bars(compare.force_noise, known), fmt="o", markersize=4.5, capsize=2, color=COLOURS[5],
            label="measured (bars: 2 standard deviations)",
        )  # fmt: skip
    upper.set(xlabel="indentation in mm", ylabel="force in N")
    upper.legend(frameon=False, fontsize=9)
    for axes in lower:
        _residual_curve(axes, compare, compare.response, "o")
        axes.margins(y=0.25)
    return figure


def _bars(noise: np.ndarray, known: np.ndarray) -> np.ndarray | None:
    return 2 * noise[known] if noise.any() else None


def _model_line(axes: Any, compare: Compare) -> None:
    order = np.argsort(compare.displacement_model)
    x = np.concatenate([[0.0], compare.displacement_model[order]])
    y = np.concatenate([[0.0], compare.force_model[order]])
    fine = np.isfinite(x) & np.isfinite(y)
    x, y = x[fine], y[fine]
    slope = np.gradient(y, x) if len(x) > 1 and (np.diff(x) > 0).all() else np.zeros(len(x))
    noise = (np.concatenate([n[:1], n[order]])[fine] for n in (compare.force_noise, compare.displacement_noise))
    band = 2 * np.hypot(next(noise), slope * next(noise))
    if band.any():
        axes.fill_between(x, y - band, y + band, color=COLOURS[4], alpha=0.18, linewidth=0, label=NOISE_BAND)
    axes.plot(x, y, "-", color=COLOURS[4], label="model")
