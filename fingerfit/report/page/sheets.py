"""Panels that are drawn over and over: frame, axes and scale of colours once, then only what is shown in them."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from PIL import Image

DPI = 130
WIDTH = 4.4
LEFT, RIGHT, BOTTOM, TOP = 0.7, 1.05, 0.52, 0.16
"""Margins of a panel, inches; the scale of colours is in the right one."""
NUMBERS = 8.5
"""Size of the numbers at axes and scales, points."""
_BESIDE, _DIGIT = 12.0, 0.62
"""Points for the ticks of a scale and the gaps beside its numbers; width of a digit, as a share of its size."""


def uri(figure: Figure) -> str:
    """A figure as an embedded PNG with at most 256 colours."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(DPI)
    canvas.draw()
    return _embedded(canvas)


def _embedded(canvas: FigureCanvasAgg) -> str:
    small = io.BytesIO()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image.quantize(256, dither=Image.Dither.NONE).save(small, "PNG")
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
        axes.set_ylabel(self.labels[1], fontsize=9, labelpad=5)
        axes.locator_params(nbins=6)
        for part in (axes, scale):
            part.tick_params(labelsize=NUMBERS)
        return figure, axes, scale


def colour_scale(figure: Figure, shown: Any, scale: Any, label: str, extend: str = "neither") -> None:
    """The scale of colours of what is shown, its label no longer than itself and with room beside the numbers."""
    bar = figure.colorbar(shown, cax=scale, extend=extend)
    long = 72 * scale.get_position().height * figure.get_figheight()
    lines = label.splitlines()
    size = min(9.0, long / (0.55 * max(map(len, lines))))  # letters are about 0.55 of their height wide
    bar.set_label(label, fontsize=size)
    bar.ax.locator_params(nbins=5)
    room = 72 * (1.0 - scale.get_position().x1) * figure.get_figwidth() - _BESIDE - 1.2 * size * len(lines)
    digits = max(map(len, bar.ax.yaxis.get_major_formatter().format_ticks(bar.ax.get_yticks().tolist())))
    bar.ax.tick_params(labelsize=min(NUMBERS, room / (_DIGIT * digits)))


@dataclass(frozen=True)
class Scale:
    """A scale of colours.

    Parameters
    ----------
    label : str
        Quantity and unit.
    cmap : str or Colormap
        The same wherever the label is: scales are told apart by the rest.
    low, high : float
        Its ends, in that unit.
    extend : str
        Ends beyond which there are values, as of matplotlib's colour bars.
    """

    label: str
    cmap: str | Colormap = field(compare=False)
    low: float
    high: float
    extend: str = "neither"

    @property
    def colours(self) -> dict[str, Any]:
        """The same as options of what is drawn in these colours."""
        return {"cmap": self.cmap, "vmin": self.low, "vmax": self.high}


class Sheet:
    """A panel whose axes and scale of colours are drawn once.

    Parameters
    ----------
    frame : Frame
    scale : Scale
    after : str
        What follows the label of x.

    Attributes
    ----------
    axes : Axes
        Where artists are made for `uri`.
    """

    def __init__(self, frame: Frame, scale: Scale, after: str = "") -> None:
        self.scale = scale
        figure, self.axes, bar = frame.panel()
        self.axes.autoscale(False)
        for line in self.axes.spines.values():
            line.set_animated(True)
        self.axes.set_xlabel(self.axes.get_xlabel() + after, fontsize=9, labelpad=2)
        shown = ScalarMappable(Normalize(scale.low, scale.high), scale.cmap)
        colour_scale(figure, shown, bar, scale.label, scale.extend)
        figure.set_dpi(DPI)
        self.canvas = FigureCanvasAgg(figure)
        self.canvas.draw()
        self._empty = self.canvas.copy_from_bbox(figure.bbox)

    def uri(self, artists: list[Artist]) -> str:
        """The panel with artists of its axes, from the lowest to the highest, embedded; they are then removed."""
        self.canvas.restore_region(self._empty)
        # what is shown would reach over half of the lines around it
        for artist in (*artists, *self.axes.spines.values()):
            self.axes.draw_artist(artist)
        for artist in artists:
            artist.remove()
        return _embedded(self.canvas)


class Sheets:
    """Sheets by what is the same in their panels."""

    def __init__(self) -> None:
        self._made: dict[tuple[Frame, Scale, str], Sheet] = {}

    def sheet(self, frame: Frame, scale: Scale, after: str = "") -> Sheet:
        """The sheet of a frame and a scale; `after` follows the label of x."""
        key = frame, scale, after
        if key not in self._made:
            self._made[key] = Sheet(frame, scale, after)
        return self._made[key]
