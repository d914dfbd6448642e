"""Rigid bodies: nodes that follow a reference node's displacement and rotation.

u = u_ref + (R(theta) - 1) (X - X_ref) with a rotation vector in space and an angle in the plane; rotations are finite.
"""

from __future__ import annotations

import numpy as np


class RigidBody:
    """Nodes that move as one.

    Parameters
    ----------
    nodes : ndarray of int, shape (nodes,)
        Zero-based, without the reference node.
    reference : int
        Node.
    rotation : ndarray of int, shape (1,) or (3,)
        Degrees of freedom of the rotation.
    points : ndarray, shape (nodes of the mesh, dim)
        Reference positions, mm.
    """

    def __init__(self, nodes: np.ndarray, reference: int, rotation: np.ndarray, points: np.ndarray) -> None:
        dim = points.shape[1]
        self.dofs = nodes[:, None] * dim + np.arange(dim)
        self.reference = reference * dim + np.arange(dim)
        self.rotation = rotation
        self.offset = points[nodes] - points[reference]

    def place(self, full: np.ndarray) -> np.ndarray:
        """Displacements of the nodes, shape (nodes, dim)."""
        turn = rotation_matrix(full[self.rotation])
        return full[self.reference] + self.offset @ (turn - np.eye(len(turn))).T

    def slopes(self, angle: np.ndarray) -> np.ndarray:
        """Derivatives of the displacements by the rotation, shape (nodes, dim, rotations)."""
        h = 1e-30
        columns = []
        for axis in range(len(angle)):
            turn = rotation_matrix(angle + 1j * h * np.eye(len(angle))[axis])
            columns.append(self.offset @ (turn.imag / h).T)
        return np.stack(columns, axis=-1)

    def curvature(self, angle: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Second derivatives of the work of forces (nodes, dim) by the rotation, symmetric."""
        h, count = 1e-6, len(angle)
        found = np.zeros((count, count))
        for axis in range(count):
            step = h * np.eye(count)[axis]
            change = (self.slopes(angle + step) - self.slopes(angle - step)) / (2 * h)
            found[axis] = np.einsum("ni,nik->k", force, change)
        return (found + found.T) / 2


def rotation_matrix(angle: np.ndarray) -> np.ndarray:
    """Rotation of an angle (1,) in the plane or a rotation vector (3,) in space (Rodrigues), also of complex ones."""
    if len(angle) == 1:
        c, s = np.cos(angle[0]), np.sin(angle[0])
        return np.array([[c, -s], [s, c]])
    x, y, z = angle
    spin = np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])
    square = x * x + y * y + z * z
    if abs(square) < 1e-6:
        one, two = 1 - square / 6 + square**2 / 120, 0.5 - square / 24 + square**2 / 720
    else:
        length = np.sqrt(square)
        one, two = np.sin(length) / length, (1 - np.cos(length)) / square
    return np.eye(3) + one * spin + two * spin @ spin
