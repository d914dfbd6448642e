"""Stresses, strains and the material tangent at the points of a body, between principal and fixed axes.

For numpy a product of matrices of 2 x 2 takes more than half as long as one of 8 x 18 by 18 x 2, so in the plane their
components are written out: a vector of all points each.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fingerfit.fem.response import divided


def pairs(dim: int) -> list[tuple[int, int]]:
    """Pairs of directions, in the order of the shear components."""
    return [(a, b) for a in range(dim) for b in range(a + 1, dim)]


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products a b of matrices, shape (..., dim, dim)."""
    dim = a.shape[-1]
    if dim > 2:
        return a @ b
    found = np.empty(a.shape)
    for i in range(dim):
        for j in range(dim):
            np.add(a[..., i, 0] * b[..., 0, j], a[..., i, 1] * b[..., 1, j], out=found[..., i, j])
    return found


def principal_tensors(directions: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Tensors of principal values, sum of v_a N_a N_a, in fixed axes.

    Parameters
    ----------
    directions : ndarray, shape (elements, points, dim, dim)
        Principal directions N_a, as columns.
    values : ndarray, shape (elements, points, dim or more)
        What is beyond the last direction does not count.

    Returns
    -------
    ndarray, shape (elements, points, dim, dim)
    """
    dim = directions.shape[-1]
    return product(directions * values[..., None, :dim], np.swapaxes(directions, -1, -2))


def shear_tensors(directions: np.ndarray, i: int, j: int, values: np.ndarray) -> np.ndarray:
    """Tensors v (N_i N_j + N_j N_i) in fixed axes, for values of shape (elements, points); see `principal_tensors`."""
    one = directions[..., :, None, i] * directions[..., None, :, j]
    return values[..., None, None] * (one + np.swapaxes(one, -1, -2))


def strain_modes(f: np.ndarray, directions: np.ndarray, axes: int) -> np.ndarray:
    """What each strain takes of the gradient of a displacement, dE = modes : grad du.

    Parameters
    ----------
    f : ndarray, shape (elements, points, dim, dim)
        Deformation gradient.
    directions : ndarray, shape (elements, points, dim, dim)
        Principal directions, as columns.
    axes : int
        Normal strains: one more than the plane has in axisymmetric bodies, whose hoop takes nothing of the gradient.

    Returns
    -------
    ndarray, shape (elements, points, strains, dim, dim)
        Normal strains dE_aa = f_a . du N_a first, then shear 2 dE_ab = f_a . du N_b + f_b . du N_a, with f_a = F N_a.
    """
    dim = f.shape[-1]
    fa = product(f, directions)
    shear = pairs(dim)
    modes = np.zeros((*f.shape[:2], axes + len(shear), dim, dim))
    for a in range(dim):
        _outer(fa, directions, a, a, modes[:, :, a])
    other = np.empty(f.shape)
    for k, (i, j) in enumerate(shear, axes):
        _outer(fa, directions, i, j, modes[:, :, k])
        _outer(fa, directions, j, i, other)
        modes[:, :, k] += other
    return modes


def _outer(fa: np.ndarray, directions: np.ndarray, i: int, j: int, out: np.ndarray) -> None:
    """f_i N_j of all points."""
    dim = fa.shape[-1]
    if dim > 2:
        np.multiply(fa[..., :, None, i], directions[..., None, :, j], out=out)
        return
    for a in range(dim):
        for b in range(dim):
            np.multiply(fa[..., a, i], directions[..., b, j], out=out[..., a, b])


def material_tangent(
    first: np.ndarray,
    second: np.ndarray,
    stress: np.ndarray,
    squared: np.ndarray,
    dim: int,
    axes: int,
    directed: Any,
    plane_stress: bool,
) -> np.ndarray:
    """Material tangent dS/dE in the principal directions: normal components first, then shear.

    Parameters
    ----------
    first, second : ndarray, shape (elements, points, 3) and (elements, points, 3, 3)
        Derivatives of the isotropic energy by the logarithms of the stretches, MPa.
    stress : ndarray, shape (elements, points, 3)
        Its principal second Piola-Kirchhoff stresses, MPa.
    squared : ndarray, shape (elements, points, 3)
        Squared principal stretches.
    dim, axes : int
        Directions that lie in the body, and normal strains.
    directed : Directed or None
        Parts with directions.
    plane_stress : bool
        Whether the stretch out of the plane follows, so that there is no stress.

    Returns
    -------
    ndarray, shape (elements, points, strains, strains), MPa
    """
    shear = pairs(dim)
    n = 3 if plane_stress else axes
    d = np.zeros((*first.shape[:2], n + len(shear), n + len(shear)))
    for a in range(n):
        d[..., a, a] = (second[..., a, a] / squared[..., a] - 2 * stress[..., a]) / squared[..., a]
        for b in range(a + 1, n):
            d[..., a, b] = d[..., b, a] = second[..., a, b] / (squared[..., a] * squared[..., b])
    for k, (i, j) in enumerate(shear, n):
        d[..., k, k] = divided(stress, second, first, squared, i, j)
    if directed:
        chosen = [*range(n), *range(3, 3 + len(shear))]
        d += directed.tangent.reshape(*first.shape[:2], 6, 6)[..., chosen, :][..., chosen]
    if plane_stress:
        kept = [0, 1, 3]
        column = d[..., kept, 2]
        d = d[..., kept, :][..., kept] - column[..., :, None] * column[..., None, :] / d[..., None, None, 2, 2]
    return d
