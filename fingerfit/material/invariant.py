"""Stress and tangent of energies f(I) of an invariant I = M : J^(-2/3) C, in the principal directions of C.

With A = J^(-2/3) (M - (M : C) C^-1 / 3), S = 2 f' A, and the tangent follows by the product rule (Holzapfel, Nonlinear
Solid Mechanics, section 6.8). Fibres are such an energy, and so is the memory of a viscoelastic material. Components
are ordered 11, 22, 33, 12, 13, 23.
"""

from __future__ import annotations

import numpy as np

FIRST = np.array([0, 1, 2, 0, 0, 1])
SECOND = np.array([0, 1, 2, 1, 2, 2])
"""Tensor indices of the six components."""
TENSOR = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Which of them each entry of the tensor is."""


def invariant_part(structure: np.ndarray, squared: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An invariant with its derivatives.

    Parameters
    ----------
    structure : ndarray, shape (points, 3, 3)
        M, symmetric, in the principal directions.
    squared : ndarray, shape (points, 3)
        Squared principal stretches.

    Returns
    -------
    value : ndarray, shape (points,)
    first : ndarray, shape (points, 6)
        2 dI/dC.
    second : ndarray, shape (points, 6, 6)
        4 d2I/dC dC.
    """
    scale = squared.prod(axis=1) ** (-1 / 3)
    trace = (structure[:, [0, 1, 2], [0, 1, 2]] * squared).sum(axis=1)
    inverse = np.zeros((len(squared), 6))
    inverse[:, :3] = 1 / squared
    m = structure[:, FIRST, SECOND]
    first = 2 * scale[:, None] * (m - trace[:, None] / 3 * inverse)
    mixed = m[:, :, None] * inverse[:, None, :]
    second = -4 / 3 * (mixed + mixed.transpose(0, 2, 1))
    second += 4 / 9 * trace[:, None, None] * inverse[:, :, None] * inverse[:, None, :]
    index = np.arange(6)
    # C^-1 (.) C^-1 is diagonal here: 1/l_a^4 for normal components, half of 1/(l_a l_b)^2 for shear
    product = inverse[:, FIRST] * inverse[:, SECOND] * np.where(index < 3, 1.0, 0.5)
    second[:, index, index] += 4 / 3 * trace[:, None] * product
    return scale * trace, first, scale[:, None, None] * second


def rotate(tensor: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Components of symmetric tensors in the directions that are the columns of `directions`."""
    return np.swapaxes(directions, -1, -2) @ tensor @ directions
