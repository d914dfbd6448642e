"""Hidden effects of the body: its material, structure, shape and first state.

Each function takes the study and the size of its effect. The base is at y = 0; layer 0 lies on the base.
"""

from __future__ import annotations

import numpy as np
from block import Block
from hidden import Effects, entry
from study_table import Study


def fibres(study: Study, size: float) -> Effects:
    """Fibres in the upper layer that act in tension only, and stiffen."""
    angle = np.deg2rad(22.0)
    direction = np.array([np.cos(angle), np.sin(angle)])
    stiffness, growth = size * study.layers[1].modulus, 3.0

    def added(F: np.ndarray, block: Block) -> np.ndarray:
        along = F @ direction
        strain = np.maximum((along**2).sum(-1) - 1, 0) * (block.layer == 1)[:, None]
        tension = 2 * stiffness * strain * np.exp(growth * strain * strain)
        return tension[..., None, None] * np.einsum("eqi,j->eqij", along, direction)

    what = (
        "the sheet is anisotropic: fibres at 22 degrees to the horizontal, exponential stiffening in tension; "
        "size: k1/mu of the sheet"
    )
    return Effects([entry("material", what, size)], added_stress=added)


def soft_spot(study: Study, size: float) -> Effects:
    """A soft spot across the interface."""

    def modulus(places: np.ndarray, given: np.ndarray) -> np.ndarray:
        r2 = ((places[..., 0] - 13.5) / 3.6) ** 2 + ((places[..., 1] - 8.0) / 2.6) ** 2
        return given * (1 - size * np.exp(-0.5 * r2**1.5))

    what = "badly cured soft spot about (13.5, 8) mm across the interface; size: share of stiffness lost at its centre"
    return Effects([entry("structure", what, size)], modulus=modulus)


def curved_interface(study: Study, size: float) -> Effects:
    """An interface that is slanted and curved; sides, base and top stay as they are."""
    interface, height = study.layers[0].height, study.height

    def warp(places: np.ndarray) -> np.ndarray:
        x = places[:, 0] / study.width - 0.5
        y = places[:, 1]
        lift = size * height * (np.sin(np.pi * x) * 0.8 + 0.9 * (4 * x * x - 1 / 3) * 0.5)
        share = np.where(y < interface, y / interface, (height - y) / (height - interface))
        return np.stack([places[:, 0], y + lift * share], -1)

    what = (
        "the interface of the layers is slanted and curved (meniscus), not flat; "
        "size: amplitude over the height of the body"
    )
    return Effects([entry("geometry", what, size)], warp=warp)


def preload(study: Study, size: float) -> Effects:
    """A body that is pressed before the first picture."""
    what = (
        "the body was already compressed (and the force zeroed) when the picture before compression was made; "
        "size: share of its height"
    )
    return Effects([entry("state", what, size)], preload=size)


def dried_skin(study: Study, size: float) -> Effects:
    """A stiffer skin at both free sides."""

    def modulus(places: np.ndarray, given: np.ndarray) -> np.ndarray:
        depth = np.minimum(places[..., 0], study.width - places[..., 0])
        return given * (1 + size * np.exp(-((depth / 1.5) ** 1.3)))

    what = "drying has stiffened a skin 1.5 mm deep at both free sides; size: relative stiffening at the surface"
    return Effects([entry("structure", what, size)], modulus=modulus)
