"""Element types: cell, stress state, integration rule, and how they treat the change of volume."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce

import numpy as np

from fingerfit.mesh.shapes import HEX, QUAD, linear, serendipity, serendipity_brick, simplex

STRAIN, STRESS, AXISYMMETRIC, SOLID = "plane strain", "plane stress", "axisymmetric", "solid"


@dataclass(frozen=True)
class Element:
    """An element type.

    Parameters
    ----------
    dim, nodes : int
        Space dimensions and number of nodes.
    order : int
        Gauss points per direction; in triangles and tetrahedra, points altogether.
    pressure : int
        Terms of the element's own pressure field: 1, constant; 1 + dim, linear; 0 for none.
    state : str
        Plane strain, plane stress, axisymmetric (axis y, radius x), or solid.
    nodal : bool
        Whether the change of volume is averaged over the elements at each node (Bonet and Burton 1998).
    """

    dim: int
    nodes: int
    order: int
    pressure: int = 0
    state: str = STRAIN
    nodal: bool = False

    @property
    def is_simplex(self) -> bool:
        """Whether it is a triangle or a tetrahedron."""
        return self.nodes in ((3, 6) if self.dim == 2 else (4, 10))

    @property
    def corners(self) -> int:
        """Number of corner nodes, which come first."""
        return self.dim + 1 if self.is_simplex else 2**self.dim


# Linear quadrilaterals and bricks average the change of volume over the element, as ABAQUS's selectively reduced
# integration does (ABAQUS Analysis User's Guide, 28.1.1); CalculiX integrates them fully. CPE3H, CAX3H and C3D4H
# average it at the nodes. CPE6H and CAX6H have three points and three terms of pressure: they answer as CPE6 and CAX6.
ELEMENTS = {
    "CPE3": Element(2, 3, 1),
    "CPE3H": Element(2, 3, 1, nodal=True),
    "CPE4": Element(2, 4, 2, 1),
    "CPE4H": Element(2, 4, 2, 1),
    "CPE6": Element(2, 6, 3),
    "CPE6H": Element(2, 6, 3, 3),
    "CPE8": Element(2, 8, 3),
    "CPE8H": Element(2, 8, 3, 3),
    "CPE8R": Element(2, 8, 2),
    "CPE8RH": Element(2, 8, 2, 3),
    "CPS3": Element(2, 3, 1, state=STRESS),
    "CPS4": Element(2, 4, 2, state=STRESS),
    "CPS6": Element(2, 6, 3, state=STRESS),
    "CPS8": Element(2, 8, 3, state=STRESS),
    "CPS8R": Element(2, 8, 2, state=STRESS),
    "CAX3": Element(2, 3, 1, state=AXISYMMETRIC),
    "CAX3H": Element(2, 3, 1, state=AXISYMMETRIC, nodal=True),
    "CAX4": Element(2, 4, 2, 1, state=AXISYMMETRIC),
    "CAX4H": Element(2, 4, 2, 1, state=AXISYMMETRIC),
    "CAX6": Element(2, 6, 3, state=AXISYMMETRIC),
    "CAX6H": Element(2, 6, 3, 3, state=AXISYMMETRIC),
    "CAX8": Element(2, 8, 3, state=AXISYMMETRIC),
    "CAX8H": Element(2, 8, 3, 3, state=AXISYMMETRIC),
    "CAX8R": Element(2, 8, 2, state=AXISYMMETRIC),
    "CAX8RH": Element(2, 8, 2, 3, state=AXISYMMETRIC),
    "C3D4": Element(3, 4, 1, state=SOLID),
    "C3D4H": Element(3, 4, 1, state=SOLID, nodal=True),
    "C3D8": Element(3, 8, 2, 1, state=SOLID),
    "C3D8H": Element(3, 8, 2, 1, state=SOLID),
    "C3D10": Element(3, 10, 4, state=SOLID),
    "C3D10H": Element(3, 10, 4, 1, state=SOLID),
    "C3D20": Element(3, 20, 3, state=SOLID),
    "C3D20H": Element(3, 20, 3, 4, state=SOLID),
    "C3D20R": Element(3, 20, 2, state=SOLID),
    "C3D20RH": Element(3, 20, 2, 4, state=SOLID),
}


def distance(element: str, xi: np.ndarray) -> np.ndarray:
    """How far out local points lie, shape (points,): up to 1 inside an element, 0 at its middle."""
    kind = ELEMENTS[element]
    if kind.is_simplex:
        return 1 - (kind.dim + 1) * np.minimum(xi.min(axis=1), 1 - xi.sum(axis=1))
    # by columns: numpy is slow over a short axis
    return reduce(np.maximum, np.abs(xi).T)


def middle(element: str) -> np.ndarray:
    """Local coordinates of the middle of an element, shape (dim,)."""
    kind = ELEMENTS[element]
    return np.full(kind.dim, 1 / (kind.dim + 1) if kind.is_simplex else 0.0)


def shape(element: str, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of an element type at local points.

    Parameters
    ----------
    element : str
        One of `ELEMENTS`.
    xi : ndarray, shape (points, dim)

    Returns
    -------
    values : ndarray, shape (points, nodes)
    gradients : ndarray, shape (points, nodes, dim)
    """
    kind = ELEMENTS[element]
    if kind.is_simplex:
        return simplex(xi, kind.nodes > kind.corners)
    if kind.dim == 2:
        return serendipity(xi) if kind.nodes == 8 else linear(QUAD[:4], xi)
    return serendipity_brick(xi) if kind.nodes == 20 else linear(HEX[:8], xi)


def from_corners(element: str) -> np.ndarray:
    """Temperatures at the integration points of an element from those of its corners, shape (points, corners).

    A linear element has their mean, a quadratic one a linear field, as in ABAQUS and CalculiX: strains are no rougher.
    """
    kind, (xi, _) = ELEMENTS[element], rule(element)
    if kind.nodes == kind.corners:
        return np.full((len(xi), kind.corners), 1 / kind.corners)
    if kind.is_simplex:
        return simplex(xi, False)[0]
    return linear((QUAD if kind.dim == 2 else HEX)[: kind.corners], xi)[0]


@cache
def rule(element: str) -> tuple[np.ndarray, np.ndarray]:
    """Integration points and weights of an element type: shapes (points, dim) and (points,)."""
    kind = ELEMENTS[element]
    if kind.is_simplex:
        return _simplex_rule(kind.dim, kind.order)
    x, w = map(np.array, _GAUSS[kind.order])
    grid = np.meshgrid(*[x] * kind.dim, indexing="ij")
    weights = np.meshgrid(*[w] * kind.dim, indexing="ij")
    return np.stack([g.ravel() for g in grid], axis=1), np.prod([g.ravel() for g in weights], axis=0)


_GAUSS = {
    2: ((-(3**-0.5), 3**-0.5), (1.0, 1.0)),
    3: ((-(0.6**0.5), 0.0, 0.6**0.5), (5 / 9, 8 / 9, 5 / 9)),
}
"""Points and weights on a line by their number; numpy has them in a package that takes long to import."""


def _simplex_rule(dim: int, points: int) -> tuple[np.ndarray, np.ndarray]:
    """One point in the middle, or one for each corner (Zienkiewicz and Taylor, The Finite Element Method, tables)."""
    volume = 1 / 2 if dim == 2 else 1 / 6
    if points == 1:
        return np.full((1, dim), 1 / (dim + 1)), np.full(1, volume)
    near = 2 / 3 if dim == 2 else (5 + 3 * 5**0.5) / 20
    far = (1 - near) / dim
    return np.vstack([np.full(dim, far), far + (near - far) * np.eye(dim)]), np.full(dim + 1, volume / (dim + 1))
