"""Shape functions over the reference cells, nodes in ABAQUS order."""

from __future__ import annotations

import numpy as np

QUAD = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
_CORNERS = [[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
_RING = [[0, -1], [1, 0], [0, 1], [-1, 0]]
_EDGES = [[*xy, z] for z in (-1, 1) for xy in _RING] + [[x, y, 0] for x, y, _ in _CORNERS[:4]]
HEX = np.array([*_CORNERS, *_EDGES], dtype=float)
EDGES = {2: ((0, 1), (1, 2), (2, 0)), 3: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))}
"""Corners of the edges of a triangle and of a tetrahedron, in the order of their mid-side nodes."""


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
    for node, (a, b) in enumerate(QUAD):
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


def serendipity_brick(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of the brick of 20 nodes; shapes as in `linear`."""
    factors = 1 + xi[:, None, :] * HEX[None]
    values = np.empty((len(xi), 20))
    gradients = np.empty((len(xi), 20, 3))
    sums = factors[:, :8].sum(axis=-1) - 5
    values[:, :8] = factors[:, :8].prod(axis=-1) * sums / 8
    # mid-side nodes: the direction of the edge has 1 - xi^2 in place of its factor
    edge = HEX == 0
    factors[:, edge] = (1 - xi**2)[:, np.nonzero(edge)[1]]
    slopes = np.broadcast_to(HEX, factors.shape).copy()
    slopes[:, edge] = -2 * xi[:, np.nonzero(edge)[1]]
    values[:, 8:] = factors[:, 8:].prod(axis=-1) / 4
    for axis in range(3):
        others = factors[..., [k for k in range(3) if k != axis]].prod(axis=-1)
        gradients[..., axis] = slopes[..., axis] * others
    gradients[:, 8:] /= 4
    gradients[:, :8] = (gradients[:, :8] * sums[..., None] + factors[:, :8].prod(axis=-1)[..., None] * HEX[:8]) / 8
    return values, gradients


def simplex(xi: np.ndarray, quadratic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions of triangles (3 or 6 nodes) and tetrahedra (4 or 10) over 0 <= xi, sum(xi) <= 1; as `linear`."""
    points, dim = xi.shape
    corner = np.column_stack([1 - xi.sum(axis=1), xi])
    slope = np.broadcast_to(np.vstack([-np.ones(dim), np.eye(dim)]), (points, dim + 1, dim))
    if not quadratic:
        return corner, slope.copy()
    i, j = np.array(EDGES[dim]).T
    values = np.column_stack([corner * (2 * corner - 1), 4 * corner[:, i] * corner[:, j]])
    at_corners = (4 * corner - 1)[..., None] * slope
    at_edges = 4 * (corner[:, i, None] * slope[:, j] + corner[:, j, None] * slope[:, i])
    return values, np.concatenate([at_corners, at_edges], axis=1)
