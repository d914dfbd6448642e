"""What was understood of a study, drawn: mesh with parts, sets and surfaces, measured points, the picture beneath."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import parts_of, slices_through
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.faces import faces_of
from fingerfit.mesh.mesh import Mesh
from fingerfit.report.drawing import COLOURS, draw_mesh, extent
from fingerfit.report.volumes import draw_section
from fingerfit.study.data import Data
from fingerfit.study.study import Study

_SETS = ("#E6194B", "#4363D8", "#F032E6", "#9A6324", "#00A5BC", "#808000", "#A05AF0", "#F58231")
"""Neither dark nor light: they stand out from pictures and from paper."""
_MARKS = "os^Dv<>ph*"
"""Ten markers by eight colours: sets that share a colour have another marker."""
_FAINT = "#E4E4E4"
_WIDE = 5.0
"""Width of a panel, inches."""
_LONGEST = 0.1
"""Length of the longest arrow as a share of the body: long enough to be seen, too short to cover the body."""
_MANY = 200
"""Nodes or points from which on markers are small, and arrows are drawn for some alone: they would cover each other."""
_VIEWS = (((0, 2), "from the side, against y", -1.0), ((1, 2), "from the end, against x", 1.0),
          ((0, 1), "from above, against z", 1.0))  # fmt: skip
"""Axes to the right and upwards, words, and whether what is further along the third axis is nearer to the eye."""


def figure_study(study: Study, mesh: Mesh, data: Data, finer: Mesh | None = None) -> Figure:
    """The mesh with parts, node sets and surfaces in colours, over the picture where there is one; points with arrows.

    Parameters
    ----------
    study : Study
    mesh : Mesh
        Of the search.
    data : Data
        Measurements, prepared.
    finer : Mesh or None
        Of the last steps of a fit.
    """
    return (_plane if mesh.dim == 2 else _space)(study, mesh, data, finer)


def _plane(study: Study, mesh: Mesh, data: Data, finer: Mesh | None) -> Figure:
    pictured, pointed = bool(len(data.measured)), bool(len(data.points))
    low, high = _limits(mesh, data)
    shape = (high[1] - low[1]) / (high[0] - low[0])
    count = 1 + pointed + (finer is not None)
    figure = Figure(figsize=(count * _WIDE + 3.0, float(np.clip(_WIDE * shape, 2.0, 9.0)) + 0.8), layout="compressed")
    panels = np.atleast_1d(figure.subplots(1, count, sharex=True, sharey=True))
    for number, axes in enumerate(panels):
        if pictured:
            axes.imshow(data.before, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent(data))
        if finer is not None and number == count - 1:
            draw_mesh(axes, finer, finer.points, fill=not pictured, line=0.4 if pictured else 0.2)
            axes.set_title(f"finer mesh, {finer.element_count} elements", fontsize=10)
        elif number == 0 or pictured:
            draw_mesh(axes, mesh, mesh.points, fill=not pictured, line=0.8 if pictured else 0.4)
        else:
            _draw_faint(axes, mesh.points, [(block.nodes, block.element) for block in mesh.blocks])
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x in mm", aspect="equal")
        axes.locator_params(nbins=6)  # else the layout is made with other ticks than are drawn
    panels[0].set_ylabel("y in mm")
    _draw_regions(panels[0], mesh, study)
    _draw_sets(panels[0], mesh, study, (0, 1))
    for number, (name, chosen) in enumerate(sorted(mesh.surfaces.items())):
        lines = [mesh.points[nodes] for nodes in _faces(mesh, chosen)]
        colour = COLOURS[-1 - number % len(COLOURS)]
        panels[0].add_collection(LineCollection(lines, colors=colour, linewidths=2.5, label=f"surface {name}"))
    panels[0].set_title("mesh and sets" + " over the picture before compression" * pictured, fontsize=10)
    if pointed:
        _draw_points(panels[1], data, (0, 1), mesh)
    _legend(figure, panels[:1])
    figure.draw_without_rendering()  # at the first drawing the layout does not know yet how wide labels are
    return figure


def _draw_regions(axes: Any, mesh: Mesh, study: Study) -> None:
    """Elements of each region, and its outline; the legend names it once, and not as a part of the mesh."""
    names = {region.name.lower() for region in study.body.regions}
    for part in axes.collections:
        if part.get_label() in names:
            part.set_label("_nolegend_")
    corners = [mesh.points[row[: ELEMENTS[block.element].corners]] for block in mesh.blocks for row in block.nodes]
    for number, region in enumerate(study.body.regions):
        colour, members = _SETS[-1 - number % len(_SETS)], mesh.element_sets[region.name.upper()]
        axes.add_collection(PolyCollection([corners[n] for n in members], facecolor=colour, alpha=0.4))
        axes.plot([], [], "s", color=colour, alpha=0.6, label=f"region {region.name}")
        if region.outline:
            axes.plot(*np.array([*region.outline, region.outline[0]]).T, color=colour, linewidth=1.5)


def _space(study: Study, mesh: Mesh, data: Data, finer: Mesh | None) -> Figure:
    """Rows of three views from outside: parts, node sets, surfaces, points; slices where there are volumes."""
    rows: list[Callable[[Any, tuple[int, int], float], None]] = [
        lambda axes, view, sign: _draw_parts(axes, mesh, view, sign),
        lambda axes, view, sign: _draw_sets(axes, mesh, study, view),
    ]
    if mesh.surfaces:
        rows.append(lambda axes, view, sign: _draw_surfaces(axes, mesh, view, sign))
    if len(data.points):
        rows.append(lambda axes, view, sign: _draw_points(axes, data, view, mesh))
    if finer is not None:
        rows.append(lambda axes, view, sign: _draw_finer(axes, finer, view, sign))
    low, high = _limits(mesh, data)
    size = high - low
    pictured = bool(len(data.measured))
    heights = [2.8 * max(size[b] / size[a] for (a, b), _, _ in _VIEWS) + 0.9] * len(rows)
    figure = Figure(figsize=(3 * 3.6 + 2.6, min(sum(heights) + 4.2 * pictured, 40.0)), layout="constrained")
    panels = figure.subplots(len(rows) + pictured, 3, squeeze=False)
    outside = _outside(mesh)
    for row, draw in enumerate(rows):
        for axes, (view, words, sign) in zip(panels[row], _VIEWS, strict=True):
            a, b = view
            if row:
                _draw_faint(axes, mesh.points[:, view], outside)
            draw(axes, view, sign)
            axes.set(xlim=(low[a], high[a]), ylim=(low[b], high[b]), aspect="equal")
            axes.set(xlabel=f"{'xyz'[a]} in mm", ylabel=f"{'xyz'[b]} in mm")
            axes.locator_params(nbins=5)
            axes.set_title(words if row == 0 else axes.get_title(), fontsize=10)
    if pictured:
        frame = Picture.before(data)
        middle = (mesh.body.min(axis=0) + mesh.body.max(axis=0)) / 2
        for axes, cut in zip(panels[-1], slices_through(frame, middle, (1, 0, 2)), strict=True):
            draw_section(axes, mesh, mesh.points, frame, cut, frame.values)
            axes.set(xlabel=cut.labels[0], ylabel=cut.labels[1])
            axes.set_title(cut.title, fontsize=10)
            axes.locator_params(nbins=5)
    _legend(figure, panels[: len(rows), 0])
    return figure


def _limits(mesh: Mesh, data: Data) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what is drawn, mm: body, sets, points and a plane picture, with a margin for markers."""
    every = [mesh.body, data.points, *(mesh.points[members] for members in mesh.node_sets.values())]
    flat = mesh.dim == 2 and bool(len(data.measured))
    if flat:
        left, right, bottom, top = extent(data)
        every.append(np.array([[left, bottom], [right, top]]))
    points = np.concatenate(every)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.0 if flat else 0.06 * (high - low).max()
    return low - margin, high + margin


Faces = list[tuple[np.ndarray, str]]
"""Corner nodes of faces or elements, shape (faces, corners), with the element's type."""


def _outside(mesh: Mesh) -> Faces:
    """Faces that one element has alone."""
    return [(faces[alone], element) for faces, element, _, alone in _all_faces(mesh)]


def _all_faces(mesh: Mesh) -> Iterator[tuple[np.ndarray, str, np.ndarray, np.ndarray]]:
    """Faces of each block with the number of their element, and which of them no other element has."""
    every, first = [], 0
    for block in mesh.blocks:
        for local in faces_of(block.element):
            nodes = block.nodes[:, list(local[: _corners(len(local))])]
            every.append((nodes, block.element, first + np.arange(len(nodes))))
        first += len(block.nodes)
    keys = np.full((sum(len(nodes) for nodes, _, _ in every), 4), -1)
    at = np.cumsum([0, *(len(nodes) for nodes, _, _ in every)])
    for start, (nodes, _, _) in zip(at, every, strict=False):
        keys[start : start + len(nodes), : nodes.shape[1]] = np.sort(nodes, axis=1)
    _, which, times = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    alone = times[which.ravel()] == 1
    for start, (nodes, element, owner) in zip(at, every, strict=False):
        yield nodes, element, owner, alone[start : start + len(nodes)]


def _corners(count: int) -> int:
    """Corners of a face in space by its nodes."""
    return {3: 3, 6: 3, 4: 4, 8: 4}[count]


def _draw_faint(axes: Any, points: np.ndarray, faces: Faces) -> None:
    for nodes, element in faces:
        order = nodes[:, : ELEMENTS[element].corners]
        line = 0.3 if len(order) < 2000 else 0.0
        axes.add_collection(PolyCollection(list(points[order]), facecolor=_FAINT, edgecolor="#AAAAAA", linewidth=line))


def _draw_parts(axes: Any, mesh: Mesh, view: tuple[int, int], sign: float) -> None:
    """The surface as seen from outside, the nearest faces last, parts in colours."""
    part = parts_of(mesh)
    drawn: list[np.ndarray] = []
    depth, colour = [], []
    for nodes, _, owner, alone in _all_faces(mesh):
        corners = mesh.points[nodes[alone]]
        drawn += list(corners[:, :, view])
        depth.append(sign * corners[:, :, 3 - sum(view)].mean(axis=1))
        colour += [COLOURS[p % len(COLOURS)] if p >= 0 else "#BBBBBB" for p in part[owner[alone]]]
    order = np.argsort(np.concatenate(depth))
    line = 0.3 if len(order) < 5000 else 0.08
    axes.add_collection(
        PolyCollection(
            [drawn[n] for n in order], facecolor=[colour[n] for n in order], edgecolor="#333333", linewidth=line
        )
    )
    for number, name in enumerate(mesh.parts):
        axes.plot([], [], "s", color=COLOURS[number % len(COLOURS)], label=name.lower())


def _draw_finer(axes: Any, finer: Mesh, view: tuple[int, int], sign: float) -> None:
    _draw_parts(axes, finer, view, sign)
    axes.set_title(f"finer mesh, {finer.element_count} elements")


def _draw_surfaces(axes: Any, mesh: Mesh, view: tuple[int, int], sign: float) -> None:
    for number, (name, chosen) in enumerate(sorted(mesh.surfaces.items(), key=lambda one: -len(one[1]))):
        corners = [mesh.points[nodes] for nodes in _faces(mesh, chosen)]
        corners.sort(key=lambda place: sign * float(place[:, 3 - sum(view)].mean()))
        colour = _SETS[number % len(_SETS)]
        outlines = [place[:, view] for place in corners]
        axes.add_collection(PolyCollection(outlines, facecolor=colour, edgecolor=colour, linewidth=0.3, alpha=0.35))
        axes.plot([], [], "s", color=colour, alpha=0.6, label=f"surface {name}")
    axes.set_title("surfaces")


def _faces(mesh: Mesh, chosen: np.ndarray) -> list[np.ndarray]:
    """Corner nodes of faces of a surface."""
    ends = np.cumsum([0, *(len(block.nodes) for block in mesh.blocks)])
    found = []
    for element, face in chosen.tolist():
        number = int(np.searchsorted(ends, element, side="right")) - 1
        block = mesh.blocks[number]
        local = faces_of(block.element)[face]
        count = 2 if mesh.dim == 2 else _corners(len(local))
        found.append(block.nodes[element - ends[number], list(local[:count])])
    return found


def _named(mesh: Mesh, study: Study) -> list[tuple[str, np.ndarray]]:
    """Node sets with labels, the largest first, so that small ones are drawn above; equal ones once."""
    body = len(mesh.body)
    roles = {"BOTTOM": f"base: {study.base}", "TOP": f"indenter: {study.indenter}", "INDENTER": "indenter's node"}
    found: dict[bytes, list[str]] = {}
    for name, members in mesh.node_sets.items():
        if 0 < len(members) < body:
            found.setdefault(np.unique(members).astype(np.int64).tobytes(), []).append(name)
    labelled = []
    for raw, names in found.items():
        role = next((f" ({words})" for name, words in roles.items() if name in names), "")
        labelled.append((", ".join(names) + role, np.frombuffer(raw, dtype=np.int64)))
    return sorted(labelled, key=lambda one: -len(one[1]))


def _draw_sets(axes: Any, mesh: Mesh, study: Study, view: tuple[int, int]) -> None:
    for number, (label, members) in enumerate(_named(mesh, study)):
        colour, many, one = _SETS[number % len(_SETS)], len(members) > _MANY, len(members) == 1
        axes.plot(
            *mesh.points[members][:, view].T,
            _MARKS[number % len(_MARKS)],
            markersize=1.5 if many else 9.0 if one else 5.0,
            markerfacecolor=colour if many or one else "none",
            markeredgecolor=colour,
            markeredgewidth=0.0 if many else 1.0,
            linestyle="none",
            label=f"nodes {label}",
        )
    axes.set_title("node sets")


def _draw_points(axes: Any, data: Data, view: tuple[int, int], mesh: Mesh) -> None:
    """Where points were measured and how far they had moved at the last of their steps."""
    last = int(data.points_step.max())
    chosen = data.points_step == last
    points, moved = data.points[chosen][:, view], data.points_displacement[chosen][:, view]
    longest = float(np.linalg.norm(data.points_displacement[chosen], axis=1).max())
    times = _round(_LONGEST * float(np.ptp(mesh.body, axis=0).max()) / longest) if longest else 1.0
    axes.plot(*points.T, "o", color="#0072B2", markersize=1.5 if len(points) > _MANY else 3.0)
    some = slice(None, None, -(-len(points) // _MANY))
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "color": "#D55E00", "width": 0.004, "zorder": 3}
    axes.quiver(*points[some].T, *(times * moved[some]).T, **arrows)
    size = "in true size" if times == 1 else f"{times:g} times as long"
    axes.set_title(f"{len(points)} points at step {data.step[last]}, arrows {size}", fontsize=10)


def _round(value: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten that is not above.

    >>> _round(0.37), _round(7.0), _round(1.0)
    (0.2, 5.0, 1.0)
    """
    power = 10.0 ** np.floor(np.log10(value))
    return float(f"{max(n for n in (1, 2, 5) if n * power <= value * (1 + 1e-12)) * power:.1g}")


def _legend(figure: Figure, panels: Any) -> None:
    found: dict[str, Any] = {}
    for axes in panels:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    legend = figure.legend(
        found.values(), found.keys(), loc="outside right upper", fontsize=8, frameon=False, markerscale=1.0
    )
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D) and handle.get_markersize() < 5:
            handle.set_markersize(5)
