"""Where a model fails, in words: rows of patches within a layer, step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.path import Path as Outline

from fingerfit.report.page.inputs import Compare

WORDS = ((1.3, "no more than noise"), (2.0, "just above the noise"), (4.0, "clearly above the noise"))
OUTSIDE = "outside the mesh"


def in_words(ratio: float) -> str:
    """An error in multiples of the noise, in words.

    Examples
    --------
    >>> in_words(1.1), in_words(9.0)
    ('no more than noise', 'far above the noise')
    """
    if not np.isfinite(ratio):
        return "not known"
    return next((words for limit, words in WORDS if ratio < limit), "far above the noise")


@dataclass(frozen=True)
class Place:
    """A row of patches within a layer at one picture.

    Parameters
    ----------
    picture : int
    layer : str
    low, high : float
        Reference heights between which it lies, mm.
    patches : list of int
    ratio : float
        Root mean square of the residual displacement over its standard error: 1 is noise.
    size : float
        Root mean square length of the residual displacement, mm.
    largest : float
        Its greatest length in a patch, mm.
    where : str
        Where that is and which way it points.
    """

    picture: int
    layer: str
    low: float
    high: float
    patches: list[int]
    ratio: float
    size: float
    largest: float
    where: str


def layers_of(compare: Compare, points: np.ndarray) -> np.ndarray:
    """Layer of reference points by number, -1 outside the mesh."""
    found = np.full(len(points), -1)
    for ring, layer in zip(compare.mesh_rings, compare.mesh_layer, strict=True):
        corners = compare.mesh_points[ring[ring >= 0]]
        near = ((points >= corners.min(axis=0) - 1e-9) & (points <= corners.max(axis=0) + 1e-9)).all(axis=1)
        near &= found < 0
        if near.any():
            inside = Outline(corners).contains_points(points[near], radius=1e-9)
            inside |= Outline(corners).contains_points(points[near], radius=-1e-9)
            found[np.flatnonzero(near)[inside]] = layer
    return found


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


def patch_layers(compare: Compare) -> np.ndarray:
    """Layer of the middle of each patch by number, -1 outside the mesh."""
    if len(compare.patch_layer) == len(compare.patch_centre):
        return compare.patch_layer
    return layers_of(compare, compare.patch_centre)


def patch_size(compare: Compare) -> np.ndarray:
    """Width and height of a patch, mm."""
    count, centre = compare.patch_count, compare.patch_centre
    spread = np.ptp(centre, axis=0)
    steps = np.where(count > 1, spread / np.maximum(count - 1, 1), 0.0)
    return np.where(steps > 0, steps, steps.max() or 1.0)


def places(compare: Compare) -> list[Place]:
    """All rows of patches at all pictures, the largest residual first."""
    if not compare.mapped:
        return []
    layer, row = patch_layers(compare), np.arange(len(compare.patch_centre))
    row = row % int(compare.patch_count[-1])
    half = patch_size(compare)[-1] / 2
    found = []
    for key in sorted(set(zip(layer.tolist(), row.tolist(), strict=True))):
        own = np.flatnonzero((layer == key[0]) & (row == key[1]))
        name = str(compare.layer_names[key[0]]) if 0 <= key[0] < len(compare.layer_names) else OUTSIDE
        height = float(compare.patch_centre[own, -1].mean())
        for picture in range(compare.views):
            place = _place(compare, picture, name, own, height, float(half))
            if place:
                found.append(place)
    return sorted(found, key=lambda p: -p.ratio if np.isfinite(p.ratio) else 1.0)


def _place(compare: Compare, picture: int, layer: str, own: np.ndarray, height: float, half: float) -> Place | None:
    move = compare.residual_displacement[picture, own]
    known = np.isfinite(move).all(axis=1)
    if not known.any():
        return None
    own, move = own[known], move[known]
    length = np.linalg.norm(move, axis=1)
    ratio = float("nan")
    if compare.residual_displacement_noise.shape == compare.residual_displacement.shape:
        noise = compare.residual_displacement_noise[picture, own]
        good = np.isfinite(noise) & (noise > 0)
        if good.any():
            ratio = float(np.sqrt(np.mean((move[good] / noise[good]) ** 2)))
    worst = int(np.argmax(length))
    x = compare.patch_centre[:, 0]
    side = ("left", "middle", "right")[min(2, int(3 * (x[own[worst]] - x.min()) / (np.ptp(x) + 1e-12)))]
    where = f"{'in the' if side == 'middle' else 'on the'} {side}, {heading(move[worst][[0, -1]])}"
    size = float(np.sqrt(np.mean(length**2)))
    patches = [int(n) for n in own]
    digits = 3 - int(np.floor(np.log10(half)))  # patches of points begin a hair below the body
    low, high = (round(height + side, digits) + 0.0 for side in (-half, half))
    return Place(picture, layer, low, high, patches, ratio, size, float(length[worst]), where)


def heading(move: np.ndarray) -> str:
    """Which way the measured body lies from the model's.

    Examples
    --------
    >>> heading(np.array([0.0, -1.0]))
    'downwards'
    >>> heading(np.array([0.7, 0.7]))
    'upwards and to the right'
    """
    across, up = (float(abs(c)) for c in move)
    vertical = "upwards" if move[1] > 0 else "downwards"
    sideways = "to the right" if move[0] > 0 else "to the left"
    if up > 2 * across:
        return vertical
    if across > 2 * up:
        return sideways
    return f"{vertical} and {sideways}"
