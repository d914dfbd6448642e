"""Shape functions and integration rules, in ABAQUS node order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

_QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
_HEX = np.array([[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], dtype=float)


def linear(corners: np.ndarray, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bi- or trilinear shape functions of quadrilaterals and bricks.

    Parameters
    ----------
    corners : ndarray, shape (nodes, dim)
        Local coordinates of the corners.
    xi : ndarray, shape (points, dim)
        Local coordinates.

    Returns
    -------
    values : ndarray, shape (points, nodes)
    gradients : ndarray, shape (points, nodes, dim)
        By the local coordinates.
    """
    dim = corners.shape[1]
    factors = (1 + xi[:, None, :] * corners[None]) / 2
    values = factors.prod(axis=-1)
    gradients = np.empty((*values.shape, dim))
    for axis in range(dim):
        others = [k for k in range(dim) if k != axis]
        gradients[..., axis] = corners[:, axis] / 2 * factors[..., others].prod(axis=-1)
    return values, gradients


def serendipity(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the quadrilateral of 8 nodes; shapes as in `linear`."""
    r, s = xi[:, 0], xi[:, 1]
    values = np.empty((8, len(xi)))
    gradients = np.empty((8, 2, len(xi)))
    for node, (a, b) in enumerate(_QUAD):
        ra, sb = 1 + a * r, 1 + b * s
        if node < 4:
            values[node] = ra * sb * (ra + sb - 3) / 4
            gradients[node] = a * sb * (2 * ra + sb - 3) / 4, b * ra * (2 * sb + ra - 3) / 4
        elif a == 0:
            bubble = (1 - r**2) / 2
            values[node] = bubble * sb
            gradients[node] = -r * sb, b * bubble
        else:
            bubble = (1 - s**2) / 2
            values[node] = bubble * ra
            gradients[node] = a * bubble, -s * ra
    return values.T, gradients.transpose(2, 0, 1)


def triangle(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the triangle of 6 nodes over 0 <= r, s and r + s <= 1; shapes as in `linear`."""
    r, s = xi[:, 0], xi[:, 1]
    t = 1 - r - s
    values = np.stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * t, 4 * r * s, 4 * s * t], axis=1)
    zero = np.zeros_like(r)
    by_r = np.stack([1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s], axis=1)
    by_s = np.stack([1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)], axis=1)
    return values, np.stack([by_r, by_s], axis=2)


def distance(element: str, xi: np.ndarray) -> np.ndarray:
    """How far out local points lie, shape (points,): up to 1 inside an element, 0 at its middle."""
    if ELEMENTS[element].nodes == 6:
        return 1 - 3 * np.minimum(xi.min(axis=1), 1 - xi.sum(axis=1))
    return np.abs(xi).max(axis=1)


def middle(element: str) -> np.ndarray:
    """Local coordinates of the middle of an element, shape (dim,)."""
    return np.full(ELEMENTS[element].dim, 1 / 3 if ELEMENTS[element].nodes == 6 else 0.0)


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
    if kind.nodes == 6:
        return triangle(xi)
    if kind.nodes == 8 and kind.dim == 2:
        return serendipity(xi)
    return linear(_QUAD[:4] if kind.dim == 2 else _HEX, xi)


@dataclass(frozen=True)
class Element:
    """An element type.

    Parameters
    ----------
    dim, nodes : int
        Space dimensions and number of nodes.
    order : int
        Gauss points per direction.
    pressure : int
        Terms of the element's own pressure field in a hybrid element: 1, constant; 1 + dim, linear; 0 otherwise.
    """

    dim: int
    nodes: int
    order: int
    pressure: int = 0


ELEMENTS = {
    "CPE4": Element(2, 4, 2),
    "CPE4H": Element(2, 4, 2, 1),
    "CPE6": Element(2, 6, 2),
    "CPE8": Element(2, 8, 3),
    "CPE8H": Element(2, 8, 3, 3),
    "CPE8R": Element(2, 8, 2),
    "CPE8RH": Element(2, 8, 2, 3),
    "C3D8": Element(3, 8, 2),
    "C3D8H": Element(3, 8, 2, 1),
}


@cache
def rule(element: str) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points and weights of an element type: shapes (points, dim) and (points,)."""
    kind = ELEMENTS[element]
    if kind.nodes == 6:
        return np.array([[1, 1], [4, 1], [1, 4]]) / 6, np.full(3, 1 / 6)
    x, w = np.polynomial.legendre.leggauss(kind.order)
    grid = np.meshgrid(*[x] * kind.dim, indexing="ij")
    weights = np.meshgrid(*[w] * kind.dim, indexing="ij")
    return np.stack([g.ravel() for g in grid], axis=1), np.prod([g.ravel() for g in weights], axis=0)
