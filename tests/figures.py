"""What the figures of a fit show, read from the figures themselves and compared with the arrays they are made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from fingerfit.report import drawing, plots


def recorded(patch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """Figures that this process saves from now on, by the name of their file."""
    drawn, save = {}, drawing.save

    def keep(figure, path):
        drawn[Path(path).stem] = figure
        save(figure, path)

    for module in (drawing, plots):
        patch.setattr(module, "save", keep)
    return drawn


def images(axes):
    """The one picture in axes, and its borders in mm."""
    (image,) = axes.images
    return np.asarray(image.get_array()), tuple(image.get_extent())


def corners(axes, label=None):
    """Lowest and highest x and y of the polygons or lines of a mesh in axes, shape (2, 2)."""
    found = [c for c in axes.collections if label in (None, c.get_label())]
    points = np.concatenate([path.vertices for c in found for path in c.get_paths()])
    return np.array([points.min(axis=0), points.max(axis=0)])


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def check_forces(figure, data, response):
    """Model through the origin, measured values with bars of two standard deviations, both axes with their unit."""
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("displacement of the indenter in mm", "force in N")
    (model,) = (line for line in axes.lines if line.get_label() == "model")
    moved, force = (response, data.force) if data.control == "force" else (data.displacement, response)
    assert model.get_xydata() == pytest.approx(np.stack([[0, *moved], [0, *force]], axis=1))
    (measured,) = axes.containers
    points, _, bars = measured.lines
    assert points.get_xydata() == pytest.approx(np.stack([data.displacement, data.force], axis=1))
    noise = (
        np.broadcast_to(data.displacement_noise, data.force.shape),
        np.broadcast_to(data.force_noise, data.force.shape),
    )
    for axis, (bar, sigma) in enumerate(zip(bars, noise, strict=True)):
        lengths = [segment[1, axis] - segment[0, axis] for segment in bar.get_segments()]
        assert lengths == pytest.approx(4 * sigma)
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "model",
        "measured (bars: 2 standard deviations)",
    ]


def check_search(figure, last):
    """Every guess with its score and constants, in order."""
    upper, lower = figure.axes
    score = np.array([np.nan if e["score"] is None else e["score"] for e in last.history])
    guesses, best = upper.lines
    assert np.array_equal(guesses.get_ydata(), score, equal_nan=True)
    assert np.array_equal(guesses.get_xdata(), np.arange(len(score)) + 1)
    lowest = [np.nanmin(score[: n + 1]) for n in range(len(score))]
    assert np.array_equal(best.get_ydata(), lowest, equal_nan=True)
    assert upper.get_ylabel().startswith("score (") and lower.get_xlabel() == "guess" and lower.get_yscale() == "log"
    assert [line.get_label() for line in lower.lines] == list(last.history[0]["values"])
    for line in lower.lines:
        assert list(line.get_ydata()) == [e["values"][line.get_label()] for e in last.history]


def check_file(path, figure):
    """A file holds a drawing of the figure's shape; one that was saved empty has one colour."""
    pixels = imread(path)
    width, height = figure.get_size_inches()
    # whole pixels: up to one is lost on each side
    assert pixels.shape[0] / pixels.shape[1] == pytest.approx(height / width, rel=1 / min(pixels.shape[:2]))
    assert len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)) > 16


def check_deformed(figure, mesh, outcome, data):
    """The mesh before, and at each pictured step where it was moved to, layer by layer."""
    shown = [mesh.points, *(mesh.points + outcome.displacement[i] for i in data.picture_step)]
    titles = ["before", *(f"step {data.step[i]}" for i in data.picture_step)]
    assert [axes.get_title() for axes in figure.axes] == titles
    assert all(axes.get_xlabel() == "x in mm" for axes in figure.axes) and figure.axes[0].get_ylabel() == "y in mm"
    for axes, points in zip(figure.axes, shown, strict=True):
        for name, members in mesh.parts.items():
            own = points[np.unique(mesh.blocks[0].nodes[members])]
            assert corners(axes, name.lower()) == pytest.approx(np.array([own.min(axis=0), own.max(axis=0)]))
    assert legend_of(figure) == [name.lower() for name in mesh.parts]


def check_pictures(figure, data, synthesized):
    """Measured, synthesized and their difference, a column for each pictured step, where they lie in mm."""
    count, (ny, nx) = len(data.measured), data.before.shape
    left, low = data.origin - data.spacing / 2
    place = (left, left + nx * data.spacing[0], low, low + ny * data.spacing[1])
    panels = np.array(figure.axes[: 3 * count]).reshape(3, count)
    rows = (data.measured, synthesized, data.measured - synthesized)
    for row, values in zip(panels, rows, strict=True):
        for axes, picture in zip(row, values, strict=True):
            found, borders = images(axes)
            assert np.array_equal(found, picture)
            assert borders == pytest.approx(place)
    assert [axes.get_title() for axes in panels[0]] == [f"step {data.step[i]}" for i in data.picture_step]
    names = [axes.get_ylabel() for axes in panels[:, 0]]
    assert names == [f"{name}\ny in mm" for name in ("measured", "synthesized", "measured - synthesized")]
    bars = [axes.get_ylabel() for axes in figure.axes[3 * count :]]
    assert bars == ["intensity (1: brightest before compression)", "difference of intensity"]


def check_sections(figure, mesh, outcome, data, cuts):
    """Slices of the volumes before and at the steps, and the lines of the mesh as it lies then in them."""
    steps = [None, *data.picture_step]
    panels = np.array(figure.axes).reshape(len(cuts), len(steps))
    assert [axes.get_title() for axes in panels[0]] == ["before", *(f"step {data.step[i]}" for i in data.picture_step)]
    for row, cut in zip(panels, cuts, strict=True):
        assert row[0].get_ylabel() == f"{cut.title}\n{cut.labels[1]}"
        across = [axis for axis in range(3) if axis != cut.axis]
        for number, (axes, step) in enumerate(zip(row, steps, strict=True)):
            found, borders = images(axes)
            assert np.array_equal(found, cut.of(data.before if step is None else data.measured[number - 1]))
            assert borders == pytest.approx(cut.limits)
            assert axes.get_xlabel() == cut.labels[0]
            points = mesh.points if step is None else mesh.points + outcome.displacement[step]
            inside = np.array([points.min(axis=0), points.max(axis=0)])[:, across]
            # the body bulges: a section through its middle reaches nearly as far as all of it, and never further
            low, high = corners(axes)
            assert (low >= inside[0] - 1e-9).all() and (high <= inside[1] + 1e-9).all()
            assert (high - low > 0.8 * (inside[1] - inside[0])).all()
    assert legend_of(figure) == [name.lower() for name in mesh.parts]


def check_slices(figure, data, synthesized, cuts):
    """Measured, synthesized and their difference in each slice, a column for each pictured step."""
    count = len(data.measured)
    for part, cut in zip(figure.subfigs, cuts, strict=True):
        assert part.get_suptitle().lower() == cut.title.lower()
        panels = np.array(part.axes[: 3 * count]).reshape(3, count)
        rows = (data.measured, synthesized, data.measured - synthesized)
        for row, values in zip(panels, rows, strict=True):
            for axes, volume in zip(row, values, strict=True):
                found, borders = images(axes)
                assert np.array_equal(found, cut.of(volume))
                assert borders == pytest.approx(cut.limits)
        assert [axes.get_title() for axes in panels[0]] == [f"step {data.step[i]}" for i in data.picture_step]
        names = [axes.get_ylabel() for axes in panels[:, 0]]
        expected = ("measured", "synthesized", "measured\n- synthesized")
        assert names == [f"{name}\n{cut.labels[1]}" for name in expected]
