"""A study as it is simulated: steps, body, pictures without noise, and what is measured."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from block import Block
from camera import Picture, PixelGrid, take
from equilibrium import Plate, Solver
from hidden import Effects
from study_table import Study
from texture import Texture

FEWEST = 8
"""Elements along the width and the height, at least."""
FIELD = (1.9, 1.85)
"""Width and height of the pictures over those of the body."""
BELOW = 0.36
"""Height of the pictures below the base, over the height of the body."""
BLACK = 5
"""Black level of a camera, in standard deviations of the noise."""


@dataclass
class Simulated:
    """What the body does.

    Parameters
    ----------
    block : Block
        The mesh of the unloaded body.
    before : ndarray (nodes, 2)
        Displacements in the first picture, from the unloaded body, mm.
    moved : list of ndarray (nodes, 2)
        Displacements at each step, from the unloaded body, mm.
    force : ndarray (steps,)
        Force beyond that in the first picture, N, positive in compression.
    """

    block: Block
    before: np.ndarray
    moved: list[np.ndarray]
    force: np.ndarray


def indentations_of(study: Study) -> np.ndarray:
    """Indentations of the steps since the first picture, mm: about equal steps."""
    rng = np.random.default_rng(study.seed)
    count = study.steps
    shifts = np.r_[0.25 * (rng.random(count - 1) - 0.5), 0]
    return study.height * study.compression * (np.arange(1, count + 1) + shifts) / count


def simulate(study: Study, effects: Effects, moduli: np.ndarray, indentations: np.ndarray, elements: int) -> Simulated:
    """Simulate the body of a study.

    Parameters
    ----------
    study : Study
        Body and test.
    effects : Effects
        What is hidden.
    moduli : ndarray (layers,)
        Shear moduli, from the base on, MPa.
    indentations : ndarray (steps,)
        Since the first picture, mm.
    elements : int
        Elements along the side of a square as large as the body.
    """
    preload = effects.preload
    block = _mesh(study, effects, elements, 1 / (1 - preload) if preload else 1)
    modulus = np.asarray(moduli)[block.layer][:, None] * np.ones((len(block.elements), 9))
    if effects.modulus:
        modulus = effects.modulus(block.nominal_points, modulus)
    hold = effects.hold(block) if effects.hold else None
    solver = Solver(block, modulus, study.alpha, study.poisson, effects.added_stress, hold)
    plate = effects.plate(block, indentations[-1]) if effects.plate else _rigid(block)
    if preload:
        first = preload * block.height
        moved, force = solver.run(np.r_[first, first + indentations], plate)
        return Simulated(block, moved[0], moved[1:], (force - force[0])[1:] * study.thickness)
    moved, force = solver.run(indentations, plate)
    return Simulated(block, np.zeros_like(moved[0]), moved, force * study.thickness)


def _mesh(study: Study, effects: Effects, elements: int, scale: float) -> Block:
    """Mesh with about square elements; the heights are multiplied by a scale."""
    heights = [height * scale for height in study.heights]
    width, height = study.width, sum(heights)
    density = elements / np.sqrt(width * height)
    across, up = max(FEWEST, round(width * density)), max(FEWEST, round(height * density))
    across += across % 2
    return Block(width, heights, across, up, warp=effects.warp)


def _rigid(block: Block) -> Plate:
    """A rigid plate that moves straight down."""

    def motion(d: float) -> np.ndarray:
        return np.stack([0 * block.top, 0 * block.top - d], -1).astype(float)

    return motion


def grid_of(study: Study) -> PixelGrid:
    """Pixels of the pictures, with the body's lower left corner at (0, 0)."""
    pixel = study.look.pixel
    columns = round(study.width * FIELD[0] / pixel)
    rows = round(study.height * FIELD[1] / pixel)
    x = -(columns * pixel - study.width) / 2 + pixel / 2
    y = -BELOW * study.height + pixel / 2
    return PixelGrid(x, y, pixel, columns, rows)


def background_of(study: Study) -> float:
    """Intensity beside the body: zero with magnitude noise, else the black level."""
    return 0.0 if study.noise.magnitude else BLACK * study.noise.picture * study.look.mean


def pictures(
    study: Study, effects: Effects, simulated: Simulated, within: int, wanted: Collection[int] | None = None
) -> list[Picture]:
    """Pictures without noise: before compression (0) and of each step, or only those that are wanted.

    `within` is the number of points along the side of a pixel.
    """
    grid, look = grid_of(study), study.look
    texture = Texture(look, study.width, simulated.block.height, study.seed)
    lens = effects.lens(grid) if effects.lens else None
    return [
        take(
            simulated.block,
            displacements,
            texture,
            grid,
            within,
            lens,
            effects.light(grid, step) if effects.light else None,
            background_of(study),
            look.mean,
            look.blur,
        )
        for step, displacements in enumerate([simulated.before, *simulated.moved])
        if wanted is None or step in wanted
    ]


def measured(effects: Effects, indentations: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indentations (mm) and forces (N) that are measured, without noise."""
    return effects.response(indentations, force) if effects.response else (indentations, force)
