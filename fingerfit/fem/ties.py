"""Surfaces tied together: slave nodes follow the master faces they lie on (ABAQUS, *TIE)."""

from __future__ import annotations

import numpy as np

from fingerfit.mesh.faces import Faces, cell_shape


def tie_nodes(
    slaves: np.ndarray, masters: tuple[Faces, ...], points: np.ndarray, tolerance: float | None
) -> dict[int, list[tuple[int, float]]]:
    """Weights of master nodes for each slave node.

    Parameters
    ----------
    slaves : ndarray of int
        Nodes.
    masters : tuple of Faces
    points : ndarray, shape (nodes, dim)
        Reference positions, mm.
    tolerance : float or None
        mm; slaves farther away stay free. By default 5 % of the mean size of a master face.

    Returns
    -------
    dict
        Slave to (master node, weight); slaves that are master nodes themselves are left out.
    """
    dim = points.shape[1]
    best: dict[int, tuple[float, np.ndarray, np.ndarray]] = {}
    sizes = [np.linalg.norm(np.ptp(points[group.nodes], axis=1), axis=1).mean() for group in masters]
    limit = 0.05 * float(np.mean(sizes)) if tolerance is None else tolerance
    shared = set(np.concatenate([group.nodes.ravel() for group in masters]).tolist())
    for slave in slaves:
        if int(slave) in shared:
            continue
        for group in masters:
            corners = points[group.nodes]
            middle, radius = corners.mean(axis=1), np.linalg.norm(np.ptp(corners, axis=1), axis=1)
            near = np.flatnonzero(np.linalg.norm(middle - points[slave], axis=1) < radius + limit)
            for face in near:
                distance, weights = _project(points[slave], corners[face], dim)
                if distance <= limit and (int(slave) not in best or distance < best[int(slave)][0]):
                    best[int(slave)] = distance, group.nodes[face], weights
    return {
        slave: [(int(node), float(w)) for node, w in zip(nodes, weights, strict=True) if abs(w) > 1e-12]
        for slave, (_, nodes, weights) in best.items()
    }


def _project(x: np.ndarray, corners: np.ndarray, dim: int) -> tuple[float, np.ndarray]:
    """Distance from the nearest point of a face and the shape functions there."""
    count = len(corners)
    triangle = dim == 3 and count in (3, 6)
    xi = np.full((1, dim - 1), 1 / 3 if triangle else 0.0)
    for _ in range(30):
        values, gradients = cell_shape(count, dim, xi)
        slopes = gradients[0].T @ corners
        step = np.linalg.lstsq(slopes.T, x - values[0] @ corners, rcond=None)[0]
        moved = xi + step
        if triangle:
            moved = np.maximum(moved, 0.0)
            moved /= max(1.0, moved.sum())
        else:
            moved = np.clip(moved, -1.0, 1.0)
        if np.abs(moved - xi).max() < 1e-13:
            break
        xi = moved
    values, _ = cell_shape(count, dim, xi)
    return float(np.linalg.norm(x - values[0] @ corners)), values[0]
