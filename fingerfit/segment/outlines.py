"""A mesh of a plane body from the outlines of its parts, regions and holes: sides of elements follow them exactly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from fingerfit.core.described import Line, Positive, Strict, described, one_of
from fingerfit.core.errors import InputError, Problems
from fingerfit.core.keys import read_yaml
from fingerfit.core.units import UNITS
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.segment.mesher import ELEMENTS, check_sides, edges_of, filled, sides_of, six
from fingerfit.study.regions import Outline, inside, read_outline
from fingerfit.study.study import Study

KINDS = ("part", "region", "hole")
SAME = 1e-9
"""Distance, in lengths of the body, within which points are one. A choice."""
BESIDE = 1e-4
"""How far beside a side it is asked what lies there, in lengths of the side. A choice."""
MOST = 4000
"""Most corners of all outlines: each side is cut by each other one."""
SIDES = {"BOTTOM": "y-", "TOP": "y+", "LEFT": "x-", "RIGHT": "x+"}


@dataclass(frozen=True)
class Shape:
    """Something with an outline.

    Parameters
    ----------
    name : str
        Of its element set; of a hole that of its node set.
    outline : tuple of (x, y)
        Corners in turn, mm.
    kind : str
        A ``part`` of the body, which takes the place of parts before it; a ``region`` over the parts; a ``hole``.
    size : float or None
        Of elements along its outline, mm; that of all others when left out.
    """

    name: str
    outline: Outline
    kind: str = "part"
    size: float | None = None


class ShapeKeys(Strict):
    """A shape of a file of outlines."""

    name: Line
    outline: list[Annotated[list[float], Field(min_length=2, max_length=2)]] | Line
    size: Positive | None = None


class OutlinesKeys(Strict):
    """A file of outlines."""

    unit: Annotated[str, one_of(UNITS["length"])] = "mm"
    parts: Annotated[list[ShapeKeys], Field(min_length=1)]
    regions: list[ShapeKeys] = Field(default=[])
    holes: list[ShapeKeys] = Field(default=[])


def read_shapes(path: Path) -> list[Shape]:
    """Shapes of a file of outlines, in mm: parts, then regions, then holes.

    Raises
    ------
    Problems, InputError
        For keys that are not known or missing, and outlines that are none.
    """
    given, problems = described(OutlinesKeys, read_yaml(path), path)
    if problems:
        raise Problems(problems)
    length, found = UNITS["length"][given.unit], []
    for kind in KINDS:
        for number, one in enumerate(getattr(given, f"{kind}s")):
            name = one.name.upper()
            if not (name.replace("_", "").isalnum() and name.isascii()):
                raise InputError(path, f"{kind}s.{number}.name", one.name, "a text of letters, digits and _")
            outline = read_outline(one.outline, length, path, f"{kind}s.{number}.outline")
            found.append(Shape(name, outline, kind, one.size and one.size * length))
    return found


def shapes_of(study: Study) -> list[Shape]:
    """Layers and outlined regions of a body in the plane.

    Raises
    ------
    InputError
        For a body in space or with a mesh, and regions without an outline.
    """
    body, layers = study.body, []
    if body.width is None:
        found = "a mesh" if body.mesh else "a brick"
        raise InputError(study.path, "body", found, "a body in the plane: width, and layers with heights")
    (left, top), right = body.origin, body.origin[0] + body.width
    heights = [float(layer.height or 0.0) for layer in body.layers]
    top += sum(heights)
    for layer, height in zip(body.layers, heights, strict=True):
        low = top - height
        layers.append(Shape(layer.name.upper(), ((left, low), (right, low), (right, top), (left, top))))
        top = low
    for number, region in enumerate(body.regions):
        if not region.outline:
            raise InputError(study.path, f"body.regions.{number}", f"{region.name} without one", "an outline")
    return [*layers, *(Shape(region.name.upper(), region.outline, "region") for region in body.regions)]


def mesh_shapes(
    shapes: Sequence[Shape],
    size: float,
    element: str = "",
    grading: float = 0.3,
    sides: Mapping[str, str] = SIDES,
    where: Path | str = "outlines",
) -> Mesh:
    """Triangles in a plane body whose sides follow all outlines.

    Parameters
    ----------
    shapes : sequence of Shape
    size : float
        Of elements at outlines, mm.
    element : str
        One of those in the plane.
    grading : float
        How fast elements grow away from outlines: 0 not at all, 1 fast.
    sides : mapping of str to str, optional
        Node sets at the ends of the body.
    where : Path or str
        Named in errors.

    Returns
    -------
    Mesh
        An element set for each part and region; node sets of the ends, and of the border of each hole, which is in
        place of the end that has its name.

    Raises
    ------
    InputError
        For too many corners, an element that is none, and shapes of which nothing is left.
    SolverError
        When netgen is not installed or cannot fill the body.
    """
    element = element or ELEMENTS[2][0]
    if element not in ELEMENTS[2]:
        raise InputError(where, "element", element, "one of " + ", ".join(ELEMENTS[2]))
    check_sides(sides, 2, where)
    if (count := sum(len(one.outline) for one in shapes)) > MOST:
        raise InputError(where, "outlines", f"{count} corners", f"{MOST} at most")
    points, lines, lengths = _cut(shapes, size)
    normal = (points[lines[:, 1]] - points[lines[:, 0]]) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    middle = points[lines].mean(axis=1)
    beside = [_what(shapes, middle + way * BESIDE * normal) for way in (1, -1)]
    kinds, number = np.unique(np.concatenate(beside), axis=0, return_inverse=True)
    # domain 0 is outside: the row of no part, which comes first
    labels = number.reshape(2, -1).T
    border = labels[:, 0] != labels[:, 1]
    points, lines, labels = _divided(points, lines[border], labels[border], lengths[border])
    found, nodes, label = filled(points, lines, labels, size, grading)
    sets = _sets(shapes, kinds[label], where)
    mesh = Mesh(found, (Block("CPE3", nodes),), {}, sets)
    edges, _, times = edges_of(nodes)
    on = np.unique(edges[times == 1])
    holes: dict[str, np.ndarray] = {}
    for one in shapes:
        if one.kind == "hole":
            near = on[_distance(one.outline, found[on]) < SAME * np.ptp(found, axis=0).max()]
            if not len(near):
                raise InputError(where, "holes", f"{one.name}, which touches no part", "a hole in or beside a part")
            holes[one.name] = np.union1d(holes.get(one.name, near), near)
    ends = {name: side for name, side in sides.items() if name not in holes}
    mesh = replace(mesh, node_sets={**sides_of(found, on, ends, size), **holes})
    if element.removesuffix("H") != "CPE3":
        mesh = six(mesh)
    return replace(mesh, blocks=(Block(element, mesh.blocks[0].nodes),))


def _what(shapes: Sequence[Shape], places: np.ndarray) -> np.ndarray:
    """What lies at places, shape (places, 1 + regions): number of the part, 0 for none, and whether each region."""
    part = np.zeros(len(places), dtype=int)
    regions = []
    for number, one in enumerate(shapes, 1):
        held = inside(one.outline, places)
        if one.kind == "region":
            regions.append(held)
        else:
            part[held] = number if one.kind == "part" else 0
    return np.stack([part, *(held & (part > 0) for held in regions)], axis=1)


def _sets(shapes: Sequence[Shape], kinds: np.ndarray, where: Path | str) -> dict[str, np.ndarray]:
    """Element sets, from what each element is."""
    sets: dict[str, np.ndarray] = {}
    regions = [one for one in shapes if one.kind == "region"]
    for number, one in enumerate(shapes, 1):
        if one.kind == "hole":
            continue
        held = kinds[:, 1 + regions.index(one)] > 0 if one.kind == "region" else kinds[:, 0] == number
        members = np.flatnonzero(held)
        if not len(members):
            found = f"{one.name} lies in no part" if one.kind == "region" else f"{one.name} is covered by later ones"
            raise InputError(where, f"{one.kind}s", found, "a shape of which something is left")
        sets[one.name] = np.union1d(sets.get(one.name, members), members)
    return sets


def _cut(shapes: Sequence[Shape], size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, sides between them that cross nowhere, shape (sides, 2), and the length of their pieces, mm."""
    start = np.concatenate([np.array(one.outline) for one in shapes])
    end = np.concatenate([np.roll(np.array(one.outline), -1, axis=0) for one in shapes])
    own = np.concatenate([np.full(len(one.outline), one.size or size) for one in shapes])
    near = SAME * float(np.ptp(start, axis=0).max())
    pieces, lengths = [], []
    for a, b, piece in zip(start, end, own, strict=True):
        along, length = b - a, float(np.linalg.norm(b - a))
        place = (np.concatenate([start, end]) - a) @ along / length**2
        off = np.abs(_cross(along, np.concatenate([start, end]) - a)) / length
        cuts = [*place[(off < near) & (place > 0) & (place < 1)]]
        other = end - start
        turn = _cross(along, other)
        with np.errstate(divide="ignore", invalid="ignore"):
            here, there = _cross(start - a, other) / turn, _cross(start - a, along) / turn
            cuts += [*here[(here > 0) & (here < 1) & (there >= 0) & (there <= 1)]]
        ways = np.unique([0.0, *cuts, 1.0])
        pieces += [(a + s * along, a + t * along) for s, t in pairwise(ways)]
        lengths += [piece] * (len(ways) - 1)
    places = np.array(pieces).reshape(-1, 2)
    # the first of those that are one
    first = np.array([min(same) for same in cKDTree(places).query_ball_point(places, 2 * near)])
    kept, which = np.unique(first, return_inverse=True)
    sides = which.reshape(-1, 2)
    real = sides[:, 0] != sides[:, 1]
    ends = np.sort(sides[real], axis=1)
    sides, at = np.unique(ends, axis=0, return_inverse=True)
    least = np.full(len(sides), np.inf)
    np.minimum.at(least, at.ravel(), np.array(lengths)[real])
    return places[kept], sides, least


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _divided(
    points: np.ndarray, sides: np.ndarray, labels: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sides in pieces of about a length each, and points that they have."""
    found, rows, kinds = [*points], [], []
    for (a, b), label, length in zip(sides.tolist(), labels, lengths, strict=True):
        count = max(1, round(float(np.linalg.norm(points[b] - points[a])) / length))
        between = [points[a] + n / count * (points[b] - points[a]) for n in range(1, count)]
        chain = [a, *range(len(found), len(found) + count - 1), b]
        found += between
        rows += [*pairwise(chain)]
        kinds += [label] * count
    used, which = np.unique(np.array(rows), return_inverse=True)
    return np.array(found)[used], which.reshape(-1, 2), np.array(kinds)


def _distance(outline: Outline, places: np.ndarray) -> np.ndarray:
    """Distance of places to the nearest side of an outline, shape (places,), mm."""
    return np.asarray(np.min([*_to_sides(outline, places)], axis=0))


def _to_sides(outline: Outline, places: np.ndarray) -> Iterator[Any]:
    corners = np.array(outline)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        share = np.clip((places - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        yield np.linalg.norm(places - a - share[:, None] * (b - a), axis=1)
