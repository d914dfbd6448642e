"""Checks of what makes the data: the stress by finite differences, and a closed form of a compressed block.

`python benchmarks/camera/verify.py`; exit code 1 where a check fails.
"""

from __future__ import annotations

import sys

import numpy as np
from block import Block
from equilibrium import Hold, Solver
from ogden import bulk_modulus, deviatoric
from scipy.optimize import brentq

LARGEST_ERROR = 1e-6
"""Relative error of the stress, the tangent or the force from which a check fails."""
LARGEST_AT_REST = 1e-8
"""Stress over the modulus, at a strain of 1e-9, from which a check fails."""
STEP = 1e-6
"""Change of F of the finite differences."""


def energy(F: np.ndarray, alpha: float) -> np.ndarray:
    """Deviatoric energy over the modulus, by principal stretches."""
    stretches = np.linalg.svd(F, compute_uv=False)
    J = stretches.prod(-1)
    return 2 / alpha**2 * (J ** (-alpha / 3) * ((stretches**alpha).sum(-1) + 1) - 3)


def differences(alpha: float) -> tuple[float, float, float]:
    """Errors of stress and tangent at random deformations, over the largest entry, and the stress near rest."""
    rng = np.random.default_rng(0)
    F = np.eye(2) + 0.25 * rng.standard_normal((50, 2, 2))
    F = F[np.linalg.det(F) > 0.3]
    stress, tangent = deviatoric(F, 1.0, alpha)
    stress_error = tangent_error = 0.0
    for i in range(2):
        for j in range(2):
            above, below = F.copy(), F.copy()
            above[..., i, j] += STEP
            below[..., i, j] -= STEP
            slope = (energy(above, alpha) - energy(below, alpha)) / (2 * STEP)
            change = (deviatoric(above, 1.0, alpha)[0] - deviatoric(below, 1.0, alpha)[0]) / (2 * STEP)
            stress_error = max(stress_error, float(np.abs(slope - stress[..., i, j]).max()))
            tangent_error = max(tangent_error, float(np.abs(change - tangent[..., i, j]).max()))
    at_rest = np.abs(deviatoric(np.eye(2)[None] + 1e-9, 1.0, alpha)[0]).max()
    return stress_error / np.abs(stress).max(), tangent_error / np.abs(tangent).max(), float(at_rest)


def closed_form(modulus: float, alpha: float, poisson: float, down: float) -> float:
    """Nominal stress (MPa, positive in compression) of a block between plates that slide, in plane strain.

    The stretch along the indentation is `down`; that across is such that the stress across is zero.
    """
    bulk = bulk_modulus(modulus, poisson)

    def stress(across: float, which: int) -> float:
        J = across * down
        stretches = np.array([across, down, 1.0])
        powers = (J ** (-1 / 3) * stretches) ** alpha
        kirchhoff = 2 * modulus / alpha * (powers - powers.mean()) + bulk * (J - 1) * J
        return float(kirchhoff[which] / stretches[which])

    across = brentq(lambda stretch: stress(stretch, 0), 0.9, 2)
    return -stress(across, 1)


def sliding_block(alpha: float) -> float:
    """Largest relative error of the force of one layer between plates that slide."""
    width, height, modulus, poisson = 10.0, 8.0, 0.03, 0.495
    block = Block(width, [height], 6, 6)
    count = len(block.bottom)
    middle = np.zeros(count, bool)
    middle[count // 2] = True
    shape = (len(block.elements), 9)
    solver = Solver(block, np.full(shape, modulus), alpha, poisson, hold=Hold(middle, np.ones(count, bool)))

    def plate(d: float) -> np.ndarray:
        return np.stack([np.zeros(len(block.top)), np.full(len(block.top), -d)], -1)

    indentations = [0.8, 1.6, 2.0]
    _, forces = solver.run(indentations, plate, sliding=True)
    exact = [width * closed_form(modulus, alpha, poisson, 1 - d / height) for d in indentations]
    return float(np.abs(forces / np.array(exact) - 1).max())


def main() -> int:
    """Print all checks; exit code 1 where one fails."""
    failed = False
    for alpha in (2.0, 4.0, -3.0, 7.3):
        stress, tangent, at_rest = differences(alpha)
        print(f"alpha {alpha:g}: error of the stress {stress:.1e}, of the tangent {tangent:.1e}; at rest {at_rest:.1e}")
        failed |= not (max(stress, tangent) < LARGEST_ERROR and at_rest < LARGEST_AT_REST)
    for alpha in (2.0, 5.0):
        error = sliding_block(alpha)
        print(f"sliding block, alpha {alpha:g}: largest error {error:.1e} of the force")
        failed |= not error < LARGEST_ERROR
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
