"""Record of the hidden effects of a study: what makes it differ from what study.yaml says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from block import Block
from camera import PixelGrid, PointMap
from equilibrium import AddedStress, Hold, Plate


@dataclass
class Effects:
    """What is hidden in a study; what is None is as study.yaml says.

    Parameters
    ----------
    told : list of dict
        Family, description and size of each effect.
    added_stress : callable or None
        Stress beyond that of the law.
    modulus : callable or None
        Modulus (MPa), of places in the rectangle (mm) and the modulus of the layer there.
    warp : callable or None
        Natural shape: moves the nodes of the rectangle.
    preload : float or None
        Indentation before the first picture, over the height of the unloaded body.
    hold : callable or None
        How the base is held, of the block.
    plate : callable or None
        Motion of the top, of the block and the largest indentation (mm).
    response : callable or None
        Indentations (mm) and forces (N) that are measured, of the true ones.
    times : ndarray or None
        Times of the steps, s.
    lens : callable or None
        Of the pixels: point of the body that is seen at a point of the picture.
    light : callable or None
        Of the pixels and the step: factor of the intensity at a point of the picture.
    """

    told: list[dict[str, Any]] = field(default_factory=list)
    added_stress: AddedStress | None = None
    modulus: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    warp: PointMap | None = None
    preload: float | None = None
    hold: Callable[[Block], Hold] | None = None
    plate: Callable[[Block, float], Plate] | None = None
    response: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    times: np.ndarray | None = None
    lens: Callable[[PixelGrid], PointMap] | None = None
    light: Callable[[PixelGrid, int], PointMap] | None = None


def entry(family: str, what: str, size: float) -> dict[str, Any]:
    """What the truth says of an effect."""
    return {"family": family, "what": what, "size": size}
