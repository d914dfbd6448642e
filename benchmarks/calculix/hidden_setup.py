"""Hidden effects of the test: base, indenter, walls, loading and camera.

Each function takes the study and the size of its effect. The base is at y = 0; layers count from the indenter.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from body import Body, Material
from hidden import Effects, entry
from scipy.interpolate import CubicSpline
from study_table import Study

TAPE_ROWS = 2
"""Rows of elements of the tape."""
RELAXING = ((0.22, 8.0), (0.16, 90.0))
"""Shares of the stress that relax, and their times, s."""
RAMP = 1.0
"""Time in which the indenter moves at the begin of a step, s."""
PARTS = 40
"""Parts of this time, for the sum over the history."""


def foam_tape(study: Study, size: float) -> Effects:
    """A soft foam tape between body and base."""
    thick = size * study.height

    def lines(columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return columns, np.r_[np.linspace(-thick, 0, TAPE_ROWS + 1)[:-1], rows]

    def change(body: Body, rng: np.random.Generator) -> None:
        body.materials["tape"] = Material(0.3 * study.layers[-1].modulus, 2.0, 0.3)
        body.parts[body.mesh.centres[:, 1] < 0] = "tape"
        body.below = TAPE_ROWS

    what = (
        "a soft, compressible foam tape (shear modulus 0.3 of the lower layer's, Poisson ratio 0.3) lies between body "
        "and base; size: its thickness over the height of the body"
    )
    return Effects([entry("base", what, size)], lines=lines, change=change)


def friction(study: Study, size: float) -> Effects:
    """Friction at the indenter."""

    def change(body: Body, rng: np.random.Generator) -> None:
        body.friction = size
        body.increments = "0.2, 1., 1e-4, 0.25"

    what = "Coulomb friction at the indenter that is believed to slide freely; size: its coefficient"
    return Effects([entry("indenter", what, size)], change=change)


def wall(study: Study, size: float) -> Effects:
    """A smooth wall at the right, which the body touches when it bulges."""

    def change(body: Body, rng: np.random.Generator) -> None:
        body.gap = size * study.width
        body.increments = "0.1, 1., 1e-4, 0.1"

    what = (
        "a smooth rigid wall at the right, which the bulging body touches; size: its distance from the body over the "
        "width of the body"
    )
    return Effects([entry("boundary", what, size)], change=change)


def relaxation(study: Study, size: float) -> Effects:
    """Linear viscoelastic relaxation, alike in all layers, with uneven times; all move in the first second of a step.

    As the layers relax alike, the field of displacements is the elastic one, and the force is a sum over the history.
    """
    times = study.times
    assert times is not None
    begins = np.r_[0, times[:-1]]
    scale = size / sum(share for share, _ in RELAXING)

    def left(age: np.ndarray) -> np.ndarray:
        """Share of the stress that is left after a time (s)."""
        parts = [scale * share * np.exp(-age / long) for share, long in RELAXING]
        return 1 - size + np.sum(parts, axis=0)

    def response(displacement: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        elastic = CubicSpline(np.r_[0, displacement], np.r_[0, force])
        depths = np.r_[0, displacement]
        ramp = np.linspace(0, 1, PARTS + 1)
        middles = (ramp[1:] + ramp[:-1]) / 2
        grown = [np.diff(elastic(low + ramp * (high - low))) for low, high in pairwise(depths)]
        read = [
            sum(float(np.sum(grown[s] * left(now - begins[s] - middles * RAMP))) for s in range(step + 1))
            for step, now in enumerate(times)
        ]
        return displacement, np.array(read)

    shares = " and ".join(f"{share:g} of {long:g} s" for share, long in RELAXING)
    what = (
        f"linear viscoelastic relaxation, alike in all layers, in the ratio {shares}; the constants are those of the "
        "first moment; size: share of the stress that relaxes"
    )
    return Effects([entry("loading", what, size)], response=response)


def compliant_frame(study: Study, size: float) -> Effects:
    """A frame that yields, with the displacement read at the crosshead."""

    def response(displacement: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return displacement + force * (size * displacement[-1] / force[-1]), force

    what = (
        "compliant frame (a linear spring) with the displacement read at the crosshead; "
        "size: what the frame yields over the true displacement, last step"
    )
    return Effects([entry("observation", what, size)], response=response)


def camera_comes_closer(study: Study, size: float) -> Effects:
    """Pictures that grow about the middle of the body."""
    what = "the camera comes closer with the load; size: what the pictures are too large by, last step"
    return Effects([entry("observation", what, size)], magnification=size)
