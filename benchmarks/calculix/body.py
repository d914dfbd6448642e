"""The body as it is simulated: mesh, materials of its parts, and what holds and touches it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from mesh import Mesh

STRAIGHT = "1., 1., .04, 1."
"""Increments as ccx reads them: the first one, the length of a step, the smallest and the largest one."""


@dataclass(frozen=True)
class Material:
    """Ogden law with one term: shear modulus at small strain (MPa), exponent, Poisson ratio at small strain."""

    modulus: float
    alpha: float
    poisson: float


@dataclass(frozen=True)
class Spring:
    """A spring between two nodes (their numbers), with its stiffness in N/mm."""

    start: int
    end: int
    stiffness: float


@dataclass
class Body:
    """A body in a test.

    Parameters
    ----------
    mesh : Mesh
        The slice without load.
    parts : ndarray (elements,) of str
        Name of the material of each element.
    materials : dict of Material
        By name.
    base, indenter : str
        The base is held or slides; the indenter is glued or slides.
    springs : list of Spring
        In the slice.
    below : int
        Rows of elements at the base that are not seen.
    dark : str or None
        Part that is dark in the pictures.
    friction : float or None
        Coefficient at the indenter, which then is a plate of its own.
    gap : float or None
        Distance of a wall from the right side, mm.
    increments : str
        As ccx reads them.
    """

    mesh: Mesh
    parts: np.ndarray
    materials: dict[str, Material]
    base: str
    indenter: str
    springs: list[Spring] = field(default_factory=list)
    below: int = 0
    dark: str | None = None
    friction: float | None = None
    gap: float | None = None
    increments: str = STRAIGHT
