"""Parts of the body with constants of their own: layers, regions, and where effects change mu from place to place."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from fingerfit.deck.borders import rows_of
from fingerfit.deck.changed import changed_by
from fingerfit.deck.modes import modes_of
from fingerfit.mesh.inside import points_inside
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import names_in
from fingerfit.model.modes import NAME
from fingerfit.model.observation import places
from fingerfit.model.regions import INSIDE

Own = tuple[np.ndarray, list[dict[str, Any]]]
"""A region's elements, and in each layer the constants that it has there."""


def pieces_of(
    layers: list[dict[str, Any]],
    mesh: Mesh,
    present: list[Effect],
    values: Mapping[str, float],
    regions: list[Own],
) -> list[dict[str, Any]]:
    """Layers, or their parts with constants of their own: regions, and where an effect changes mu from place to place.

    Effects that change nothing, as that of a layer which is not there, leave the layers whole.
    """
    if not (regions or any("field" in effect.changes for effect in present)):
        return layers
    inside = points_inside(mesh)
    low, high = mesh.body.min(axis=0), mesh.body.max(axis=0)
    named = {name for effect in present for name in names_in(effect.changes.get("field", ""))}
    waved = max((int(name[len(NAME) :]) for name in named if re.fullmatch(NAME + r"\d{1,2}", name)), default=0)
    every = modes_of(mesh, values, waved) if waved else []
    found, changed = [], False
    for number, layer in enumerate(layers, 1):
        members = np.asarray(mesh.element_sets[layer["name"]])
        count = np.array([len(inside[member]) for member in members])
        place = np.concatenate([inside[member] for member in members])
        # whole elements reach beyond these points: the layer's own top and bottom come from its nodes
        heights = mesh.points[mesh.nodes_of(members), -1]
        bottom, top = heights.min(), heights.max()
        names = {
            **places(place, low, high),
            **_from_indenter(place, mesh),
            "depth": (top - place[:, -1]) / (top - bottom),
            "from_top": top - place[:, -1],
            "from_bottom": place[:, -1] - bottom,
            "log_above": float(np.log(layers[max(number - 2, 0)]["mu"] / layer["mu"])),
            "log_below": float(np.log(layers[min(number, len(layers) - 1)]["mu"] / layer["mu"])),
            "rows": max(len(rows_of(mesh, members)) - 1, 1),
            "number": number,
            "layers": len(layers),
            **(_named(np.concatenate([every[m] for m in members])) if waved else {}),
            **{name: np.repeat(_held(mesh, name, members), count) for name in named if name.startswith(INSIDE)},
        }
        total = np.zeros(len(place))
        for effect in present:
            if "field" in effect.changes:
                total = total + changed_by("field", 0.0, names, [effect], values)
        field = np.bincount(np.repeat(np.arange(len(members)), count), total) / count
        own = np.zeros(len(members), dtype=int)
        for one, (held, _) in enumerate(regions, 1):
            own[np.isin(members, held)] = one
        levels, which = np.unique(np.stack([own, np.round(field, 4)]), axis=1, return_inverse=True)
        changed = changed or bool(np.any(levels))
        for level, (region, value) in enumerate(levels.T, 1):
            constants = regions[int(region) - 1][1][number - 1] if region else layer
            mu = constants["mu"] * float(np.exp(value))
            piece = {"name": f"{layer['name']}_{level}", "mu": mu, "d": compressibility(mu, constants["poisson"])}
            found.append({**constants, **piece, "elements": [int(m) + 1 for m in members[which == level - 1]]})
    return found if changed else layers


def compressibility(mu: float, nu: float) -> float:
    """D of the deck, 2 over the bulk modulus, 1/MPa."""
    return 2 / (2 * mu * (1 + nu) / (3 * (1 - 2 * nu)))


def comes_down(mesh: Mesh) -> np.ndarray:
    """Where the indenter comes down on the undeformed body, mm: in the middle of its nodes, or at the only one."""
    return np.asarray(mesh.points[mesh.node_sets["TOP"]].mean(axis=0))


def _named(modes: np.ndarray) -> dict[str, np.ndarray]:
    """Modes by the names that formulas have for them, from shape (points, count)."""
    return {f"{NAME}{n}": mode for n, mode in enumerate(modes.T, 1)}


def _held(mesh: Mesh, name: str, members: np.ndarray) -> np.ndarray:
    """1 for the elements of a region that a formula names, 0 for others; all 0 in a test whose body lacks it."""
    return np.isin(members, mesh.element_sets.get(name.removeprefix(INSIDE).upper(), ())).astype(float)


def _from_indenter(points: np.ndarray, mesh: Mesh) -> dict[str, np.ndarray]:
    """Names of places in space as seen from where the indenter comes down, mm; none in the plane."""
    if mesh.dim == 2:
        return {}
    found = points - comes_down(mesh)
    return {"aside_x": found[:, 0], "aside_y": found[:, 1], "beneath": -found[:, 2]}
