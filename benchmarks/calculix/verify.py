"""Check of what makes the data: the force on a block between plates that slide, against its closed form.

`python benchmarks/calculix/verify.py`; exit code 1 where the check fails.
"""

from __future__ import annotations

import sys

import numpy as np
from body import STRAIGHT, Body, Material
from deck import volumetric
from mesh import Mesh
from scipy.optimize import brentq
from solve import NotSolved, solve

LIMITS = {STRAIGHT: 1e-4, "0.05, 1., .01, .05": 1e-6}
"""Relative error of the force from which the check fails, by increments.

ccx ends its iterations with some error left (up to 5e-5 was seen), but not with small increments (1e-7).
"""
WIDTH, HEIGHT = 20.0, 10.0
"""Of the block, mm."""
ACROSS = 8
"""Elements over the width and over the height."""
INDENTATIONS = (0.5, 1.0, 2.0)
"""Of the steps, mm."""


def closed_form(material: Material, down: float) -> float:
    """Nominal stress (MPa, positive in compression) of a block between plates that slide, in plane strain.

    The stretch along the indentation is `down`; that across is such that the stress across is zero.
    """
    bulk = 2 / volumetric(material)

    def stress(across: float, which: int) -> float:
        J = across * down
        stretches = np.array([across, down, 1.0])
        powers = (J ** (-1 / 3) * stretches) ** material.alpha
        kirchhoff = 2 * material.modulus / material.alpha * (powers - powers.mean()) + bulk * (J - 1) * J
        return float(kirchhoff[which] / stretches[which])

    across = brentq(lambda stretch: stress(stretch, 0), 0.9, 1.6)
    return -stress(across, 1)


def error(material: Material, increments: str) -> float:
    """Largest relative error of the force on a block of one material; increments as ccx reads them."""
    mesh = Mesh(np.linspace(0, WIDTH, ACROSS + 1), np.linspace(0, HEIGHT, ACROSS + 1))
    parts = np.full(len(mesh.elements), "gel", object)
    body = Body(mesh, parts, {"gel": material}, base="slides", indenter="slides", increments=increments)
    _, forces = solve(body, INDENTATIONS)
    exact = [WIDTH * closed_form(material, 1 - indentation / HEIGHT) for indentation in INDENTATIONS]
    return float(np.abs(forces / np.array(exact) - 1).max())


def main() -> int:
    """Print the errors; exit code 1 where one is too large."""
    failed = False
    for alpha, poisson in ((2.0, 0.49), (3.0, 0.495), (9.0, 0.49)):
        for increments, limit in LIMITS.items():
            try:
                found = error(Material(0.03, alpha, poisson), increments)
            except NotSolved as problem:
                print(f"alpha {alpha:g}, increments {increments}: {problem}")
                return 1
            print(f"alpha {alpha:g}, increments {increments}: largest error {found:.1e} of the force")
            failed |= not found < limit
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
