"""Relaxation of the stress by a Prony series at finite strain.

G(t) = G0 (1 - sum_i g_i (1 - exp(-t / tau_i))), and the bulk modulus with k_i for g_i. The second Piola-Kirchhoff
stress of the deviatoric C is convolved and its deviator taken at the end (Simo, Comput. Methods Appl. Mech. Eng. 60,
1987; ABAQUS Theory Guide 4.8.2). With a stress that is linear in time over an increment, the convolution is exact
(Taylor, Pister and Goudreau 1970), and the increment has a potential: the deviatoric energy times `Increment.scale`,
plus half of `Increment.memory` : C. So it is with the pressure and the change of volume.
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
    k : tuple of float, or of arrays of shape (points,)
        The same as `g` for the bulk modulus; none where the volume does not relax.
    """

    g: tuple[float, ...]
    tau: tuple[float, ...]
    instantaneous: bool = False
    k: tuple[float, ...] = ()

    @property
    def rest(self) -> np.ndarray:
        """Factor of the given stress after a long time."""
        total = sum((np.asarray(g) for g in self.g), np.zeros(()))
        return 1 - total if self.instantaneous else np.ones_like(total)

    def weights(self) -> list[np.ndarray]:
        """Factor of the given stress that each term adds at first."""
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
    """Potential of a time increment: scale * W_dev + memory : C / 2 with the deviatoric C, and bulk * U + pressure * J.

    Parameters
    ----------
    scale : ndarray, shape (points,)
        Factor of the deviatoric energy.
    memory : ndarray, shape (points, 3, 3)
        MPa, symmetric, in the reference state's axes.
    bulk : ndarray, shape (points,)
        Factor of the volumetric energy U.
    pressure : ndarray, shape (points,)
        MPa, positive in tension.
    """

    scale: np.ndarray
    memory: np.ndarray
    bulk: np.ndarray | float = 1.0
    pressure: np.ndarray | float = 0.0


class History:
    """Internal variables of points: of the deviatoric stress, or of the pressure.

    Parameters
    ----------
    prony : Prony
        Constants: its `g`.
    shape : tuple of int
        Of the stress: (points, 3, 3), or (points,) of the pressure.
    """

    def __init__(self, prony: Prony, shape: tuple[int, ...]) -> None:
        self.prony = prony
        self.stress = np.zeros(shape)
        self.terms = [np.zeros(shape) for _ in prony.g]

    def begin(self, dt: float, relaxed: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Factor of the elastic stress in an increment of `dt` s, shape (points,), and what is added to it, MPa.

        With `relaxed`, in an infinitely slow one.
        """
        scale, memory = np.broadcast_to(self.prony.rest, len(self.stress)).astype(float), np.zeros_like(self.stress)
        if relaxed:
            return scale, memory
        for term, weight, (left, share) in zip(self.terms, self.prony.weights(), self.prony.decays(dt), strict=True):
            scale = scale + weight * share
            memory += _times(weight * left, term) - _times(weight * share, self.stress)
        return scale, memory

    def commit(self, stress: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Go on to the end of an increment.

        Parameters
        ----------
        stress : ndarray
            Elastic stress there, MPa: of the deviator J^(2/3) times the second Piola-Kirchhoff stress.
        dt : float
            Length of the increment, s.
        relaxed : bool
            Whether it was infinitely slow.
        """
        for term, (left, share) in zip(self.terms, self.prony.decays(dt), strict=True):
            term[...] = 0.0 if relaxed else _times(left, term) + _times(share, stress - self.stress)
        self.stress = stress


def history_of_pressure(prony: Prony | None, points: int) -> History | None:
    """The history of the pressure at so many points; None where the volume does not relax."""
    if prony is None or not prony.k:
        return None
    return History(Prony(prony.k, prony.tau, prony.instantaneous), (points,))


def _times(factor: np.ndarray, tensor: np.ndarray) -> np.ndarray:
    factor = np.asarray(factor)
    return factor.reshape(factor.shape + (1,) * (tensor.ndim - 1)) * tensor
