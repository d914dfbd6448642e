"""Pictures of the page. Those that are laid over each other share one frame, so that they can be blinked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure

from fingerfit.report.drawing import COLOURS
from fingerfit.report.page.inputs import Compare
from fingerfit.report.page.regions import borders, patch_layers, patch_size
from fingerfit.report.page.sheets import WIDTH, Frame, Scale, Sheet, Sheets, colour_scale

WARM = LinearSegmentedColormap.from_list("warm", ["#FFFFFF", "#FBE7B5", COLOURS[0], COLOURS[5]])
_NOT_KNOWN = ListedColormap(["#DDDDDD"])
MARK = 20.0
"""Width and height of a mark with a number in it, where there is room for it, points."""
NOISE_BAND = "noise (2 standard deviations)"


def plain(text: object) -> str:
    """Text that matplotlib draws as it is, without formulas."""
    return str(text).replace("$", r"\$")


def grey_panel(sheets: Sheets, frame: Frame, compare: Compare, values: np.ndarray, top: float) -> str:
    """A picture in grey."""
    return _picture(sheets.sheet(frame, Scale("brightness (0 to 1)", "gray", 0.0, top)), compare, values)


def difference_panel(sheets: Sheets, frame: Frame, compare: Compare, values: np.ndarray, limit: float) -> str:
    """Measured minus synthesized."""
    scale = Scale("difference of brightness", "RdBu_r", -limit, limit, "both")
    return _picture(sheets.sheet(frame, scale), compare, values)


def _picture(sheet: Sheet, compare: Compare, values: np.ndarray) -> str:
    shown = sheet.axes.imshow(values, **sheet.scale.colours, origin="lower", extent=compare.limits, aspect="auto")
    return sheet.uri([shown])


def map_frame(compare: Compare) -> Frame:
    """Frame of the maps: the patches, in the body before compression."""
    half = patch_size(compare) / 2
    low, high = compare.patch_centre.min(axis=0) - half, compare.patch_centre.max(axis=0) + half
    edge = 0.03 * float((high - low).max())
    limits = (float(low[0] - edge), float(high[0] + edge), float(low[1] - edge), float(high[1] + edge))
    return Frame.around(limits, compare.axes)


@dataclass(frozen=True)
class Patches:
    """The patches of a model as all its maps draw them.

    Parameters
    ----------
    centre : ndarray, shape (patches, 2)
        Reference positions, mm.
    size : ndarray, shape (2,)
        mm.
    edges : tuple of ndarray
        Along x and y, mm.
    inside : ndarray of bool, shape (ny, nx)
        Whether the middle of a patch lies in the body.
    borders : list of ndarray, shape (2, 2)
        Of the layers, mm.
    """

    centre: np.ndarray
    size: np.ndarray
    edges: tuple[np.ndarray, np.ndarray]
    inside: np.ndarray
    borders: list[np.ndarray]

    @classmethod
    def of(cls, compare: Compare) -> Patches:
        """Those of a model."""
        size = patch_size(compare)
        nx, ny = (int(n) for n in compare.patch_count)
        low = compare.patch_centre.min(axis=0) - size / 2
        edges = low[0] + size[0] * np.arange(nx + 1), low[1] + size[1] * np.arange(ny + 1)
        known = len(compare.mesh_rings) or len(compare.patch_layer)
        inside = patch_layers(compare).reshape(nx, ny).T >= 0 if known else np.ones((ny, nx), dtype=bool)
        return cls(compare.patch_centre, size, edges, inside, borders(compare))


def map_panel(sheets: Sheets, frame: Frame, patches: Patches, displacement: np.ndarray, limit: float) -> str:
    """Displacements of patches: arrows, many times enlarged, over a map of their length.

    Parameters
    ----------
    sheets : Sheets
    frame : Frame
    patches : Patches
    displacement : ndarray, shape (patches, 2)
        mm; NaN where unknown.
    limit : float
        End of the scale of colours, and displacement whose arrow is as long as a patch, mm.
    """
    reach = 1.15 * float(patches.size.min()) / limit
    scale = Scale("residual displacement in mm", WARM, 0.0, limit, "max")
    sheet = sheets.sheet(frame, scale, f" (arrows enlarged {reach:.3g} times)")
    length = np.hypot(displacement[:, 0], displacement[:, 1])
    known = np.isfinite(length) & (length > 0.02 * limit)
    drawn = np.minimum(1.0, 1.3 * limit / np.maximum(length, 1e-12))[:, None] * displacement
    arrows = sheet.axes.quiver(
        *patches.centre[known].T, *drawn[known].T, angles="xy", scale_units="xy", scale=1 / reach,
        width=0.006, headwidth=3.6, headlength=4, headaxislength=3.6, pivot="middle", color="#111111",
    )  # fmt: skip
    return sheet.uri([*_cells(sheet, patches, length), arrows])


def brightness_panel(sheets: Sheets, frame: Frame, patches: Patches, values: np.ndarray, limit: float) -> str:
    """Residual brightness of patches, shape (patches,)."""
    sheet = sheets.sheet(frame, Scale("residual brightness (of 1)", "RdBu_r", -limit, limit, "both"))
    return sheet.uri(_cells(sheet, patches, values))


def _cells(sheet: Sheet, patches: Patches, values: np.ndarray) -> list[Artist]:
    """Values of patches, grey where they are not known, under the borders of the layers."""
    cells = np.ma.masked_invalid(values.reshape(patches.inside.shape[::-1]).T)
    gone = np.where(np.ma.getmaskarray(cells) & patches.inside, 1.0, np.nan)
    # one artist: a line for each edge would take longer than all the rest of the panel
    lines = LineCollection(patches.borders, colors="#777777", linewidths=0.8, capstyle="projecting")
    return [
        sheet.axes.pcolormesh(*patches.edges, gone, cmap=_NOT_KNOWN),
        sheet.axes.pcolormesh(*patches.edges, cells, **sheet.scale.colours),
        sheet.axes.add_collection(lines, autolim=False),
    ]


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
        alone = len(noise) == 1  # a band needs two ends
        axes.fill_between(
            compare.step + np.array([-0.4, 0.4]) if alone else compare.step,
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
    wide, high = _room(axes, stiffness[:, :2])
    ones = np.ones(len(x))
    shown = EllipseCollection(
        wide * ones, high * ones, 0 * ones, units="points", offsets=stiffness[:, :2], offset_transform=axes.transData,
        array=evidence, cmap="PuOr_r", edgecolor="#555555", linewidth=0.6, zorder=2.5,
    )  # fmt: skip
    shown.set_clim(-limit, limit)
    axes.add_collection(shown, autolim=False)
    size = min(7.0, 0.7 * high, wide / 2.9)  # four letters beside each other
    for at, height, value, weight in zip(x, y, change, evidence, strict=True):
        colour = "white" if abs(weight) > 0.7 * limit else "#111111"
        percent = round(100 * np.expm1(value))
        text = f"{percent:+d}" if percent else "0"
        text = f"×{np.exp(value):.0f}" if percent >= 1000 else text
        axes.annotate(text, (at, height), ha="center", va="center", fontsize=size, color=colour)
    return shown


def _room(axes: Any, places: np.ndarray) -> tuple[float, float]:
    """Width and height of marks at places, shape (places, 2), that do not lie over each other, points."""
    points = axes.transData.transform(places) * 72.0 / axes.figure.dpi
    apart = np.abs(points[:, None] - points)[np.triu_indices(len(points), 1)]
    high = 0.95 * apart[apart[:, 0] < MARK, 1].min(initial=MARK / 0.95)
    wide = 0.95 * apart[apart[:, 1] < high, 0].min(initial=MARK / 0.95)
    return float(wide), float(high)


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
