"""Where effects say that layers begin and end, nodes follow (docs/decisions/0045-borders-in-the-mesh.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.changed import changed_by
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.flat import is_stacked
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.model.observation import places

BORDER, WITHIN = "border_down", "border_within"
"""What effects may change about the borders between layers, and about one within a layer."""
LEAST = 0.2
"""Share of its height that a layer keeps, wherever its borders are said to lie, for the elements. A choice."""
_LEVEL = 1e-6
"""Share of a layer's height within which corners of elements lie at one depth: rounding."""


def moves_borders(effect: Effect) -> bool:
    """Whether nodes follow where an effect says that borders are."""
    return bool({BORDER, WITHIN} & effect.changes.keys())


def followed(mesh: Mesh, layers: Sequence[str], present: Sequence[Effect], values: Mapping[str, float]) -> Mesh:
    """A mesh whose nodes lie where effects say that borders are; itself where none of them says so.

    Between two borders, heights are stretched evenly; top and base stay.

    Parameters
    ----------
    mesh : Mesh
    layers : sequence of str
        Element sets from the indenter down.
    present : sequence of Effect
    values : mapping
        The guess.

    Raises
    ------
    InputError
        For an effect on borders of layers that do not lie flat on top of each other.
    """
    present = [effect for effect in present if moves_borders(effect)]
    if not present:
        return mesh
    if not is_stacked(mesh, layers):
        where = f"effect {present[0].name}"
        raise InputError(where, "changes", "layers that reach into each other", "flat layers on top of each other")
    elements = [np.asarray(mesh.element_sets[name]) for name in layers]
    heights = [mesh.points[mesh.nodes_of(members), -1] for members in elements]
    stated = [float(heights[0].max()), *(float(own.min()) for own in heights)]
    wanted = _wanted(mesh, stated, present, values)
    points = mesh.points.copy()
    for number, members in enumerate(elements, 1):
        nodes = mesh.nodes_of(members)
        top, bottom = stated[number - 1 : number + 1]
        depth = (top - mesh.points[nodes, -1]) / (top - bottom)
        within = float(changed_by(WITHIN, 0.0, {"number": number, "layers": len(layers)}, present, values))
        levels = rows_of(mesh, members)
        now = depth
        if 0.0 < within < 1.0 and len(levels) > 2:
            nearest = levels[1:-1][np.abs(levels[1:-1] - within).argmin()]
            now = np.interp(depth, [0.0, nearest, 1.0], [0.0, within, 1.0])
        above, below = wanted[number - 1 : number + 1, nodes]
        # of a node that stays no digit changes
        points[nodes, -1] = mesh.points[nodes, -1] + ((above + now * (below - above)) - (top + depth * (bottom - top)))
    return mesh if np.array_equal(points, mesh.points) else replace(mesh, points=points)


def rows_of(mesh: Mesh, members: np.ndarray) -> np.ndarray:
    """Depths in a layer, from 0 to 1, at which rows of its elements end; none where they do not lie in rows."""
    corners = [
        block.nodes[np.isin(np.arange(first, first + len(block.nodes)), members), : ELEMENTS[block.element].corners]
        for first, block in zip(np.cumsum([0, *(len(block.nodes) for block in mesh.blocks)]), mesh.blocks, strict=False)
    ]
    height = [mesh.points[own, -1] for own in corners if len(own)]
    top, bottom = max(own.max() for own in height), min(own.min() for own in height)
    depth = [(top - own) / (top - bottom) for own in height]
    whole = np.concatenate([own.ravel() for own in depth])
    levels, first = np.unique(np.round(whole / _LEVEL), return_index=True)
    # each element reaches from one level to the next
    place = [np.searchsorted(levels, np.round(own / _LEVEL)) for own in depth]
    in_rows = all((own.max(axis=1) - own.min(axis=1) == 1).all() for own in place)
    return whole[first] if in_rows else np.empty(0)


def _wanted(mesh: Mesh, stated: list[float], present: Sequence[Effect], values: Mapping[str, float]) -> np.ndarray:
    """Heights of top, borders and base over or under each node, shape (layers + 1, nodes), mm."""
    low, high = mesh.body.min(axis=0), mesh.body.max(axis=0)
    wanted = np.repeat(np.array(stated)[:, None], len(mesh.points), axis=1)
    for border, height in enumerate(stated[1:-1], 1):
        at = mesh.points.copy()
        at[:, -1] = height
        names = {**places(at, low, high), "number": border, "layers": len(stated) - 1}
        wanted[border] -= changed_by(BORDER, 0.0, names, present, values)
    least = LEAST * -np.diff(stated)
    for border in range(1, len(stated) - 1):
        wanted[border] = np.minimum(wanted[border], wanted[border - 1] - least[border - 1])
    for border in range(len(stated) - 2, 0, -1):
        wanted[border] = np.maximum(wanted[border], wanted[border + 1] + least[border])
    return wanted
