"""Record of the hidden effects of a study: what makes it differ from what study.yaml says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from body import Body
from mesh import Warp

Lines = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Other lines between columns and rows of elements, of those of the body; mm."""
Change = Callable[[Body, np.random.Generator], None]
"""Changes a body."""
Response = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Displacements (mm) and forces (N) that are read, of the true ones; each (steps,)."""


@dataclass
class Effects:
    """What is hidden in a study; what is None is as study.yaml says.

    Parameters
    ----------
    told : list of dict
        Family, description and size of each effect.
    lines : callable or None
        Lines of the mesh.
    warp : callable or None
        Natural shape: moves the nodes of the rectangle.
    change : callable or None
        Changes the parts, materials or boundary of the body.
    preload : float
        Indentation before the first picture, over the height in that picture.
    response : callable or None
        What is read.
    magnification : float
        How much larger, over their size, the pictures show the body at the last step.
    """

    told: list[dict[str, Any]] = field(default_factory=list)
    lines: Lines | None = None
    warp: Warp | None = None
    change: Change | None = None
    preload: float = 0.0
    response: Response | None = None
    magnification: float = 0.0


def entry(family: str, what: str, size: float) -> dict[str, Any]:
    """What the truth says of an effect."""
    return {"family": family, "what": what, "size": size}
