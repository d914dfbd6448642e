"""Relaxation of the deviatoric stress by a Prony series at finite strain.

G(t) = G0 (1 - sum_i g_i (1 - exp(-t / tau_i))). The second Piola-Kirchhoff stress of the deviatoric C is convolved
and its deviator taken at the end (Simo, Comput. Methods Appl. Mech. Eng. 60, 1987; ABAQUS Theory Guide 4.8.2). With a
stress that is linear in time over an increment, the convolution is exact (Taylor, Pister and Goudreau 1970), and the
increment has a potential: the deviatoric energy times `Increment.scale`, plus half of `Increment.memory` : C.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prony:
    """Constants of a series.

    Parameters
    ----------
    g : tuple of float, or of arrays of shape (points,)
        Relative moduli; their sum is below 1.
    tau : tuple of float, or of arrays of shape (points,)
        Relaxation times, s.
    instantaneous : bool
        Whether the elastic constants are those of a fast load (ABAQUS: MODULI=INSTANTANEOUS), or of a slow one.
    """

    g: tuple[float, ...]
    tau: tuple[float, ...]
    instantaneous: bool = False

    @property
    def rest(self) -> np.ndarray:
        """Factor of the given deviatoric stress after a long time."""
        total = sum((np.asarray(g) for g in self.g), np.zeros(()))
        return 1 - total if self.instantaneous else np.ones_like(total)

    def weights(self) -> list[np.ndarray]:
        """Factor of the given deviatoric stress that each term adds at first."""
        total = sum((np.asarray(g) for g in self.g), np.zeros(()))
        return [np.asarray(g) if self.instantaneous else np.asarray(g) / (1 - total) for g in self.g]

    def decays(self, dt: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """For each term over `dt` in s: what is left of the history, and the share of the stress's change."""
        found = []
        for tau in self.tau:
            x = dt / np.asarray(tau, dtype=float)
            share = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
            found.append((np.exp(-x), share))
        return found


@dataclass(frozen=True)
class Increment:
    """Potential of a time increment: scale * W_dev + memory : C / 2 with the deviatoric C.

    Parameters
    ----------
    scale : ndarray, shape (points,)
        Factor of the deviatoric energy.
    memory : ndarray, shape (points, 3, 3)
        MPa, symmetric, in the reference state's axes.
    """

    scale: np.ndarray
    memory: np.ndarray


class History:
    """Internal variables of a body's integration points.

    Parameters
    ----------
    prony : Prony
        Constants.
    points : int
        Number of integration points.
    """

    def __init__(self, prony: Prony, points: int) -> None:
        self.prony = prony
        self.stress = np.zeros((points, 3, 3))
        self.terms = [np.zeros((points, 3, 3)) for _ in prony.g]

    def begin(self, dt: float, relaxed: bool = False) -> Increment:
        """Potential of an increment of `dt` s; with `relaxed`, of an infinitely slow one."""
        points = len(self.stress)
        scale, memory = np.broadcast_to(self.prony.rest, points).astype(float), np.zeros((points, 3, 3))
        if relaxed:
            return Increment(scale, memory)
        for term, weight, (left, share) in zip(self.terms, self.prony.weights(), self.prony.decays(dt), strict=True):
            scale = scale + weight * share
            memory += _times(weight * left, term) - _times(weight * share, self.stress)
        return Increment(scale, memory)

    def commit(self, stress: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Go on to the end of an increment.

        Parameters
        ----------
        stress : ndarray, shape (points, 3, 3)
            Deviatoric elastic stress there: J^(2/3) times the second Piola-Kirchhoff stress, MPa.
        dt : float
            Length of the increment, s.
        relaxed : bool
            Whether it was infinitely slow.
        """
        for term, (left, share) in zip(self.terms, self.prony.decays(dt), strict=True):
            term[...] = 0.0 if relaxed else _times(left, term) + _times(share, stress - self.stress)
        self.stress = stress


def _times(factor: np.ndarray, tensor: np.ndarray) -> np.ndarray:
    return np.asarray(factor)[..., None, None] * tensor
