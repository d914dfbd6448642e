"""One-term Ogden material in plane strain at large strain: the deviatoric part.

W = 2 mu / alpha^2 (b_1^alpha + b_2^alpha + b_3^alpha - 3) + K / 2 (J - 1)^2, with the stretches l_i, l_3 = 1, the
deviatoric stretches b_i = J^(-1/3) l_i and the bulk modulus K = 2 mu (1 + nu) / (3 (1 - 2 nu)). equilibrium.py adds the
volumetric part.

In the plane, l_1^alpha + l_2^alpha = 2 J^(alpha / 2) T(x), with x = (l_1^2 + l_2^2) / (2 J) and
T(x) = cosh(alpha / 2 acosh x), which is the Chebyshev polynomial where alpha / 2 is an integer. So W is a function of
s = F : F and of J, and no principal directions are needed.
"""

from __future__ import annotations

import numpy as np

SECOND_DERIVATIVE_OF_J = np.zeros((2, 2, 2, 2))
"""Of the determinant of a 2 x 2 matrix by its entries."""
SECOND_DERIVATIVE_OF_J[0, 0, 1, 1] = SECOND_DERIVATIVE_OF_J[1, 1, 0, 0] = 1
SECOND_DERIVATIVE_OF_J[0, 1, 1, 0] = SECOND_DERIVATIVE_OF_J[1, 0, 0, 1] = -1
TERMS = 9
"""Terms of the series near x = 1."""
NEAR = 2e-2
"""Distance from x = 1 below which the series is used."""


def bulk_modulus(modulus: np.ndarray | float, poisson: float) -> np.ndarray | float:
    """Bulk modulus, in the unit of the shear modulus."""
    return 2 * modulus * (1 + poisson) / (3 * (1 - 2 * poisson))


def determinant(F: np.ndarray) -> np.ndarray:
    """Determinants of matrices (..., 2, 2)."""
    return F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]


def cofactor(F: np.ndarray) -> np.ndarray:
    """Derivatives of the determinant by the entries of matrices (..., 2, 2)."""
    result = np.empty_like(F)
    result[..., 0, 0] = F[..., 1, 1]
    result[..., 1, 1] = F[..., 0, 0]
    result[..., 0, 1] = -F[..., 1, 0]
    result[..., 1, 0] = -F[..., 0, 1]
    return result


def chebyshev(order: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chebyshev function of real order, T(x) = cosh(order acosh x), x >= 1, and its first two derivatives.

    The closed form of the derivatives divides by zero at x = 1; near there a power series in x - 1 is used.
    """
    excess = x - 1
    near = excess < NEAR
    series = np.ones(TERMS)
    for i in range(1, TERMS):
        m = i - 1
        series[i] = series[i - 1] * (order * order - m * m) / ((2 * m + 1) * (m + 1))
    small = np.where(near, excess, 0.0)
    near_value = sum(series[i] * small**i for i in range(TERMS))
    near_slope = sum(i * series[i] * small ** (i - 1) for i in range(1, TERMS))
    near_curvature = sum(i * (i - 1) * series[i] * small ** (i - 2) for i in range(2, TERMS))
    large = np.where(near, 2.0, x)
    angle = np.arccosh(large)
    value = np.cosh(order * angle)
    slope = order * np.sinh(order * angle) / np.sinh(angle)
    curvature = (order * order * value - large * slope) / (large * large - 1)
    return (
        np.where(near, near_value, value),
        np.where(near, near_slope, slope),
        np.where(near, near_curvature, curvature),
    )


def deviatoric(F: np.ndarray, modulus: np.ndarray | float, alpha: float) -> tuple[np.ndarray, np.ndarray]:
    """Stress of the deviatoric part, and its tangent.

    Parameters
    ----------
    F : ndarray (..., 2, 2)
        Deformation gradients in the plane.
    modulus : ndarray (...) or float
        Shear modulus mu at small strain, MPa.
    alpha : float
        Exponent.

    Returns
    -------
    stress : ndarray (..., 2, 2)
        First Piola-Kirchhoff stress, MPa.
    tangent : ndarray (..., 2, 2, 2, 2)
        Derivative of the stress by F, MPa.
    """
    order = alpha / 2
    J = determinant(F)
    s = (F**2).sum((-1, -2))
    x = np.maximum(s / (2 * J), 1.0)
    T, T_x, T_xx = chebyshev(order, x)
    factor = 2 * modulus / alpha**2
    # W = factor (2 J^p T(x(s, J)) + J^q - 3)
    p = order / 3
    q = -2 * order / 3
    scale = J**p
    x_s = 1 / (2 * J)
    x_J = -x / J
    x_sJ = -1 / (2 * J**2)
    x_JJ = 2 * x / J**2
    W_s = factor * 2 * scale * T_x * x_s
    W_ss = factor * 2 * scale * T_xx * x_s**2
    W_J = factor * (2 * (p * scale / J * T + scale * T_x * x_J) + q * J ** (q - 1))
    W_sJ = factor * 2 * (p * scale / J * T_x * x_s + scale * (T_xx * x_s * x_J + T_x * x_sJ))
    W_JJ = factor * (
        2 * (p * (p - 1) * scale / J**2 * T + 2 * p * scale / J * T_x * x_J + scale * (T_xx * x_J**2 + T_x * x_JJ))
        + q * (q - 1) * J ** (q - 2)
    )
    H = cofactor(F)
    stress = 2 * W_s[..., None, None] * F + W_J[..., None, None] * H
    identity = np.einsum("ik,jl->ijkl", np.eye(2), np.eye(2))
    tangent = (
        _spread(2 * W_s) * identity
        + _spread(4 * W_ss) * _outer(F, F)
        + _spread(2 * W_sJ) * (_outer(F, H) + _outer(H, F))
        + _spread(W_JJ) * _outer(H, H)
        + _spread(W_J) * SECOND_DERIVATIVE_OF_J
    )
    return stress, tangent


def _spread(values: np.ndarray) -> np.ndarray:
    """Numbers (...) as factors of tensors (..., 2, 2, 2, 2)."""
    return values[..., None, None, None, None]


def _outer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Dyadic products of matrices."""
    return np.einsum("...ij,...kl->...ijkl", first, second)
