"""The stretch that a hyperelastic material has where a stress in its reference state is known."""

from __future__ import annotations

from typing import Any

import numpy as np

_CLOSE = 1e-12
"""Change of the logarithms that ends the search."""
_LONGEST, _ROUNDS = 0.5, 100
"""Longest change of a logarithm at once, and how many there are at most: choices, far beyond any stretch of a body."""


def prestretch(material: Any, stress: np.ndarray) -> np.ndarray:
    """Left stretch tensor without change of volume, at which a material has a deviatoric Cauchy stress.

    Parameters
    ----------
    material : material
        Its isotropic part counts, with the constants of one point.
    stress : ndarray, shape (3, 3)
        MPa; its deviator counts.

    Returns
    -------
    ndarray, shape (3, 3)
        Symmetric, with the determinant 1.

    Raises
    ------
    ValueError
        For a stress that the material does not reach.
    """
    wanted, axes = np.linalg.eigh(stress - np.trace(stress) / 3 * np.eye(3))
    logarithm = np.zeros(3)
    for _ in range(_ROUNDS):
        first, second = material.deviatoric_derivatives(np.exp(logarithm))
        # the three derivatives add up to 0: of all steps the shortest one keeps the volume
        step = np.linalg.lstsq(second, wanted - first, rcond=1e-9)[0]
        step *= min(1.0, _LONGEST / max(np.abs(step).max(), 1e-300))
        logarithm += step
        if np.abs(step).max() < _CLOSE:
            return np.asarray((axes * np.exp(logarithm)) @ axes.T)
    raise ValueError(
        f"deviatoric stress {', '.join(f'{one:g}' for one in wanted)} MPa, which the material does not reach"
    )
