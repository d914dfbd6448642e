"""Analytical rigid surfaces: distance, normal and curvature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class RigidSurface(Protocol):
    """A surface in its reference position; the body is on the side of positive gaps."""

    def gap(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap, unit normal towards the body and its slope at x (points, dim): (points,), then one and two axes more."""


@dataclass(frozen=True)
class Plane:
    """Plane, or line in two dimensions.

    Parameters
    ----------
    point, normal : ndarray, shape (dim,)
        mm; the normal points to the body and has length 1.
    """

    point: np.ndarray
    normal: np.ndarray

    def gap(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        dim = x.shape[1]
        return (x - self.point) @ self.normal, np.broadcast_to(self.normal, x.shape), np.zeros((len(x), dim, dim))


@dataclass(frozen=True)
class Round:
    """Sphere; cylinder where there is an axis; circle in two dimensions.

    Parameters
    ----------
    centre : ndarray, shape (dim,)
        mm.
    radius : float
        mm.
    side : int
        1 where the body is outside, -1 where it is inside.
    axis : ndarray or None, shape (3,)
        Unit vector along a cylinder.
    """

    centre: np.ndarray
    radius: float
    side: int = 1
    axis: np.ndarray | None = None

    def gap(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        across = np.eye(x.shape[1])
        if self.axis is not None:
            across = across - np.outer(self.axis, self.axis)
        away = (x - self.centre) @ across
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-300)
        outward = away / distance[:, None]
        slope = (across - outward[:, :, None] * outward[:, None, :]) / distance[:, None, None]
        return self.side * (distance - self.radius), self.side * outward, self.side * slope
