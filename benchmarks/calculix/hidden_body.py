"""Hidden effects of the body: its material, structure, shape and first state.

Each function takes the study and the size of its effect. The base is at y = 0; layers count from the indenter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from body import Body, Material, Spring
from hidden import Effects, entry
from mesh import graded
from study_table import Study

AIR = 0.1
"""Bulk modulus of air, MPa."""
SKIN = 0.03
"""Depth of the stiff skin over the width."""


def stiffening(study: Study, size: float) -> Effects:
    """A law with another exponent."""

    def change(body: Body, rng: np.random.Generator) -> None:
        body.materials = {name: replace(one, alpha=size) for name, one in body.materials.items()}

    what = "the law stiffens: another Ogden exponent in all layers than the written one; size: the true exponent"
    return Effects([entry("material", what, size)], change=change)


def fibres(study: Study, size: float) -> Effects:
    """Horizontal fibres in the second layer: springs along the lines between its rows of elements."""
    layer = study.layers[1]
    modulus = size * layer.modulus

    def change(body: Body, rng: np.random.Generator) -> None:
        mesh = body.mesh
        rows = mesh.rows
        for j in range(1, mesh.up):
            if rows[j] >= layer.height - 1e-9:
                break
            area = (rows[j + 1] - rows[j - 1]) / 2 * mesh.thickness / 2  # mm^2, for each of the two faces of the slice
            for i in range(2 * mesh.across):
                for k in (0, 2):
                    start, end = mesh.numbers[i, 2 * j, k], mesh.numbers[i + 1, 2 * j, k]
                    length = abs(mesh.nodes[start - 1, 0] - mesh.nodes[end - 1, 0])
                    body.springs.append(Spring(start, end, modulus * area / length))

    what = (
        "horizontal elastic fibres (springs) in the lower layer, so that it is stiffer across than up; "
        "size: their modulus, smeared, over the shear modulus of the layer"
    )
    return Effects([entry("material", what, size)], change=change)


def bubbles(study: Study, size: float) -> Effects:
    """Round air bubbles in the first layer."""
    width, height, layer = study.width, study.height, study.layers[0]
    modulus = 0.03 * layer.modulus
    ratio = AIR / modulus
    air = Material(modulus, 2.0, (3 * ratio - 2) / (2 * (3 * ratio + 1)))

    def change(body: Body, rng: np.random.Generator) -> None:
        found: list[tuple[np.ndarray, float]] = []
        while sum(np.pi * radius**2 for _, radius in found) < size * width * layer.height:
            radius = rng.uniform(0.03, 0.045) * width
            off = 1.3 * radius
            centre = rng.uniform([off, height - layer.height + off], [width - off, height - off])
            if all(np.hypot(*(centre - one)) > 1.25 * (radius + other) for one, other in found):
                found.append((centre, radius))
        for centre, radius in found:
            body.parts[np.hypot(*(body.mesh.centres - centre).T) < radius] = "air"
        body.materials["air"] = air
        body.dark = "air"

    what = (
        "round air bubbles (radius 3 to 4.5 % of the width) in the upper layer, dark in the pictures; "
        "size: their share of its area"
    )
    return Effects([entry("structure", what, size)], change=change)


def stiff_skin(study: Study, size: float) -> Effects:
    """A stiff skin on both free sides."""
    width = study.width
    depth = SKIN * width

    def lines(columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        inner = graded(len(columns) - 5, width - 2 * depth, study.grading) + depth
        return np.r_[0, depth / 2, inner, width - depth / 2, width], rows

    def change(body: Body, rng: np.random.Generator) -> None:
        x = body.mesh.centres[:, 0]
        outside = (x < depth) | (x > width - depth)
        body.parts[outside] = np.char.add("s", body.parts[outside].astype(str))
        skins = {f"s{name}": replace(one, modulus=size * one.modulus) for name, one in body.materials.items()}
        body.materials |= skins

    what = (
        f"a stiff skin on both free sides, {100 * SKIN:g} % of the width deep; "
        "size: its shear modulus over that of the layer"
    )
    return Effects([entry("structure", what, size)], lines=lines, change=change)


def inclined_interface(study: Study, size: float) -> Effects:
    """An interface that rises from left to right."""
    height, lower = study.height, study.layers[1].height

    def warp(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rise = size * height * x / study.width
        below, above = y * (1 + rise / lower), height - (height - y) * (1 - rise / (height - lower))
        return x, np.where(y <= lower, below, above)

    what = "the interface is inclined: right at the left side, too high at the right; size: how much, over the height"
    return Effects([entry("geometry", what, size)], warp=warp)


def preload(study: Study, size: float) -> Effects:
    """A body that is compressed in the first picture already."""
    what = (
        "the first picture and the zero of force and displacement were taken when the body was compressed already, "
        "to the heights of study.yaml; size: the indentation over these"
    )
    return Effects([entry("state", what, size)], preload=size)
