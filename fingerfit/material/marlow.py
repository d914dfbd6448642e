"""Marlow: W = f(I1) + 1 / D (J - 1)^2 with f from a uniaxial test (ABAQUS, *HYPERELASTIC, MARLOW).

Marlow, R. S. (2003), A general first-invariant hyperelastic constitutive model, in Constitutive Models for Rubber III.
The nominal stress T of a uniaxial test at the stretch l is 2 f' (l - l^-2), so that each point of the test gives f'.
Between the points f' is a cubic function of I1, with the slope of the parabola through three of them at each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.material.isotropic import Isotropic, by_first_invariant, deviatoric, polynomial, power_sum

if TYPE_CHECKING:
    from fingerfit.material.prony import Prony


@dataclass(frozen=True)
class Marlow(Isotropic):
    """A uniaxial test and a bulk modulus; beyond the test f' stays as it is at its end.

    Parameters
    ----------
    strain : tuple of floats, or of arrays of shape (points,)
        Nominal strains above 0, rising; two or more.
    stress : tuple of floats, or of arrays of shape (points,)
        Nominal stresses there in MPa.
    d : tuple of float
        Compressibility, 1/MPa; the initial bulk modulus is 2 / d[0].
    prony : Prony or None
        Relaxation of the deviatoric part.
    """

    strain: tuple[float, ...]
    stress: tuple[float, ...]
    d: tuple[float, ...]
    prony: Prony | None = None

    def deviatoric_energy(self, stretch: np.ndarray) -> np.ndarray:
        gap = power_sum(deviatoric(stretch), 2.0)[0] - 3
        knots, values = self._table(gap)
        pieces = np.arange(len(knots) - 1).reshape(-1, *(1,) * gap.ndim)
        # up to the end of each piece, or to where we are in it
        way = np.clip(gap - knots[:-1], 0.0, np.diff(knots, axis=0))
        piece = _Piece(knots, values, np.broadcast_to(pieces, way.shape))
        beyond = np.maximum(gap - knots[-1], 0.0)
        return piece.energy(way).sum(axis=0) + beyond * values[-1]

    def deviatoric_derivatives(self, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, first, second = power_sum(deviatoric(stretch), 2.0)
        gap = value - 3
        knots, values = self._table(gap)
        number = np.clip((gap >= knots).sum(axis=0) - 1, 0, len(knots) - 2)
        slope, curve = _Piece(knots, values, number[None]).derivatives(np.minimum(gap, knots[-1])[None])
        return by_first_invariant(first, second, slope[0], np.where(gap > knots[-1], 0.0, curve[0]))

    def volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return polynomial(jacobian, self.d)

    def _table(self, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """I1 - 3 from 0 on and f' there, shape (k, ...), for points where I1 - 3 has the shape (...)."""
        stretch, stress = 1 + np.array(self.strain, dtype=float), np.array(self.stress, dtype=float)
        knots = stretch**2 + 2 / stretch - 3
        values = stress / (2 * (stretch - stretch**-2))
        at_rest = values[0] - knots[0] * (values[1] - values[0]) / (knots[1] - knots[0])
        shape = (len(knots) + 1, *gap.shape)

        def each(first: np.ndarray, others: np.ndarray) -> np.ndarray:
            table = np.concatenate([first[None], others])
            return np.broadcast_to(table.reshape(*table.shape, *(1,) * (len(shape) - table.ndim)), shape)

        return each(np.zeros_like(at_rest), knots), each(at_rest, values)


class _Piece:
    """The cubic functions of the table's pieces of some numbers, shape (n, ...)."""

    def __init__(self, knots: np.ndarray, values: np.ndarray, number: np.ndarray) -> None:
        last = len(knots) - 2

        def at(table: np.ndarray, index: np.ndarray) -> np.ndarray:
            return np.take_along_axis(table, index, axis=0)

        def chord(piece: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            width = at(knots, piece + 1) - at(knots, piece)
            return (at(values, piece + 1) - at(values, piece)) / width, width

        (before, left), (here, width), (after, right) = (chord(np.clip(number + step, 0, last)) for step in (-1, 0, 1))
        self.begin, self.low, self.width = at(knots, number), at(values, number), width
        # slopes at both ends: of the parabola through three points, at an end of the table of the last two
        start = (before * width + here * left) / (left + width)
        end = (here * right + after * width) / (width + right)
        self.linear = width * start
        self.square = width * (3 * here - 2 * start - end)
        self.cubic = width * (start + end - 2 * here)

    def derivatives(self, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f' and f'' at values of I1 - 3 within the pieces."""
        t = (gap - self.begin) / self.width
        slope = self.low + t * (self.linear + t * (self.square + t * self.cubic))
        return slope, (self.linear + t * (2 * self.square + t * 3 * self.cubic)) / self.width

    def energy(self, way: np.ndarray) -> np.ndarray:
        """Integral of f' over the first part of each piece."""
        t = way / self.width
        return way * (self.low + t * (self.linear / 2 + t * (self.square / 3 + t * self.cubic / 4)))
