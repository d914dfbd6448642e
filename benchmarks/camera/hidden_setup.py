"""Hidden effects of the test: plate, base, loading and pictures, and what is hidden together with one of these.

Each function takes the study and the sizes of its effects. The base is at y = 0; layer 0 lies on the base.
"""

from __future__ import annotations

import numpy as np
from block import Block
from camera import PixelGrid, PointMap
from equilibrium import Hold, Plate
from hidden import Effects, entry
from ogden import cofactor, determinant
from scipy.interpolate import CubicSpline
from study_table import Study


def bending_plate(study: Study, size: float) -> Effects:
    """A plate whose rims bend upwards as the load grows."""

    def plate(block: Block, largest: float) -> Plate:
        x = block.nodes[block.top, 0] / block.width * 2 - 1
        form = 0.62 * x**2 + 0.38 * np.abs(x) ** 3  # clamped at its middle

        def motion(d: float) -> np.ndarray:
            return np.stack([0 * x, -d + size * d * (1 + 0.8 * d / largest) / 1.8 * form], -1)

        return motion

    what = (
        "the plate is held at its middle and bends upward towards its rims as the load grows; "
        "size: deflection of the rim over the indentation, last step"
    )
    return Effects([entry("indenter", what, size)], plate=plate)


def distorting_lens(study: Study, size: float) -> Effects:
    """Radial distortion about the centre of the picture, the same in all pictures."""

    def lens(grid: PixelGrid) -> PointMap:
        centre = np.array([grid.x + grid.pixel * (grid.columns - 1) / 2, grid.y + grid.pixel * (grid.rows - 1) / 2])
        radius = grid.pixel * grid.columns / 2

        def seen(points: np.ndarray) -> np.ndarray:
            q = (points - centre) / radius
            r2 = (q**2).sum(-1, keepdims=True)
            return centre + radius * q * (1 + size * r2 * (1 - 0.25 * r2))

        return seen

    what = (
        "radial distortion of the lens (same for all pictures), about the centre of the picture; "
        "size: relative radial distortion at half the width of the picture, leading term"
    )
    return Effects([entry("observation", what, size)], lens=lens)


def stiffening_and_guide(study: Study, stiffening: float, friction: float) -> Effects:
    """An upper layer that stiffens more than its law says, and friction in the guide of the force sensor."""
    upper = study.layers[1].modulus

    def added(F: np.ndarray, block: Block) -> np.ndarray:
        J = determinant(F)
        squares = (F**2).sum((-1, -2))
        scale = J ** (-2 / 3)
        I1 = scale * (squares + 1)
        slope = 2 * scale[..., None, None] * F - (2 / 3 * I1 / J)[..., None, None] * cofactor(F)
        on = (block.layer == 1)[:, None]
        return (upper * stiffening * (I1 - 3) * on)[..., None, None] * slope

    def response(d: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rubbing = friction * force.max()
        return d, force + rubbing * (1 - 0.35 * np.exp(-d / (0.05 * d.max())))

    layer = "layer over stiffens more than its law says: extra energy mu s/2 (I1bar-3)^2; size: s"
    guide = (
        "friction of the guide of the force sensor adds a nearly constant force in compression; "
        "size: share of the largest force"
    )
    told = [entry("material", layer, stiffening), entry("loading", guide, friction)]
    return Effects(told, added_stress=added, response=response)


def loose_base(study: Study, size: float) -> Effects:
    """A base whose glue failed at the right."""

    def hold(block: Block) -> Hold:
        x = block.nodes[block.bottom, 0]
        return Hold(x <= block.width * (1 - size), np.ones(len(x), bool))

    what = (
        "the glue of the base failed at the right: free to slip sideways there, not lifting; size: share of the width"
    )
    return Effects([entry("base", what, size)], hold=hold)


def relaxation(study: Study, size: float) -> Effects:
    """Stress that relaxes by a power law, read after different waiting times (quasi-linear viscoelasticity)."""
    times = np.array([20.0, 55.0, 400.0, 430.0, 1200.0, 1235.0, 1270.0])
    starts = np.array([4.0, 36.0, 60.0, 412.0, 440.0, 1215.0, 1250.0])
    ramp = 12.0  # s

    def response(d: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        elastic = CubicSpline(np.r_[0, d], np.r_[0, force])
        corners = np.stack([starts, starts + ramp], -1).ravel()
        depths = np.stack([np.r_[0.0, d[:-1]], d], -1).ravel()
        time = np.linspace(0, times[-1], 40001)
        history = elastic(np.interp(time, np.r_[0, corners], np.r_[0, depths]))
        growth = np.diff(history)
        middle = (time[1:] + time[:-1]) / 2
        read = []
        for moment in times:
            past = middle < moment
            kernel = size * (1 + (moment - middle[past]) / 25.0) ** -0.7
            read.append(np.interp(moment, time, history) + (kernel * growth[past]).sum())
        return d, np.array(read)

    what = (
        "stress relaxes by a power law (quasi-linear, G = 1 + s (1 + t/25 s)^-0.7) while the waiting times before the "
        "readings differ; mu of the truth is the one of long times; size: s"
    )
    return Effects([entry("loading", what, size)], response=response, times=times)


def soft_adhesive_and_lamp(study: Study, compliance: float, shading: float) -> Effects:
    """A base whose adhesive is soft in shear, and a lamp that ages."""

    def hold(block: Block) -> Hold:
        lengths = block.edge_lengths(block.bottom)
        springs = study.layers[0].modulus / (compliance * study.height) * lengths
        return Hold(np.zeros(len(lengths), bool), np.ones(len(lengths), bool), springs)

    def light(grid: PixelGrid, step: int) -> PointMap:
        wide = grid.pixel * grid.columns

        def factor(points: np.ndarray) -> np.ndarray:
            across, up = (points[:, 0] - grid.x) / wide, (points[:, 1] - grid.y) / wide
            return 1 + shading * (step / study.steps) ** 1.4 * (across * 1.5 - 0.55 + 0.5 * (up - 0.5) ** 2)

        return factor

    adhesive = "the adhesive of the base is soft in shear: traction = k u, k = mu_low/(s H); size: s"
    lamp = (
        "a lamp ages: a slanted shading grows with the steps; "
        "size: change of intensity from left to right over 1.5 at the last step"
    )
    told = [entry("base", adhesive, compliance), entry("observation", lamp, shading)]
    return Effects(told, hold=hold, light=light)
