"""Checks of what makes the data: a closed form, finer meshes, and a picture of a known motion.

`python benchmarks/foreign/verify.py`, with the environment of make.py; exit code 1 where a check fails.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from body import Solved, solve
from observing import Observation
from pictures import Camera, Texture
from scipy.optimize import brentq
from world import Hold, World

PHANTOM: dict[str, Any] = {
    "dimension": 2, "width": 12.0, "heights": [4.0, 4.0, 4.0], "names": ["top", "middle", "bottom"], "thickness": 70.0,
    "mu": [0.0211, 0.0357, 0.0656], "alpha": 1.4, "poisson": 0.495, "compress": 0.2, "steps": 4,
    "times": [60.0, 120.0, 180.0, 240.0], "seen": "pictures", "control": "displacement",
    "picture": {"pixel": 0.098, "texture": "grain", "grain": 4.0, "contrast": 0.2,
                "looks": [0.6, 0.6, 0.6], "blur": 0.8},
}  # fmt: skip


def closed_form(mu: float, alpha: float, poisson: float, down: float) -> tuple[float, float]:
    """Stretch across and nominal stress (MPa, positive in compression) of a block between plates that slide.

    Plane strain, stretch along 1 - down: the stress across is zero. Principal stresses of one-term Ogden, with
    deviatoric stretches b: J s_i = 2 mu / alpha (b_i^alpha - mean b^alpha) + K J (J - 1).
    """
    bulk = 2 * mu * (1 + poisson) / (3 * (1 - 2 * poisson))

    def stress(across: float, which: int) -> float:
        stretches = np.array([across, 1 - down, 1.0])
        J = float(stretches.prod())
        b = (stretches / J ** (1 / 3)) ** alpha
        kirchhoff = 2 * mu / alpha * (b - b.mean()) + bulk * J * (J - 1)
        return float(kirchhoff[which] / stretches[which])

    across = brentq(lambda s: stress(s, 0), 0.9, 1.6, xtol=1e-14)
    return across, -stress(across, 1)


def uniform() -> float:
    """Largest relative error of the force of one layer between sliding plates, against the closed form."""
    setting = {**PHANTOM, "heights": [12.0], "mu": [0.03], "names": ["body"]}
    world = World(setting)
    loose = Hold(lambda u, place: 1e-9 * u * u)
    world.base = world.top = loose
    solved = solve(world, 6)
    worst = 0.0
    for depth, force in zip(solved.depth, solved.force, strict=True):
        _, stress = closed_form(0.03, 1.4, 0.495, depth / 12.0)
        exact = stress * 12.0 * 70.0
        print(f"  indentation {depth:.2f} mm: {force:.6f} N, closed form {exact:.6f} N")
        worst = max(worst, abs(force / exact - 1))
    return worst


def meshes() -> list[tuple[int, Solved, float]]:
    """The phantom on finer and finer meshes."""
    found = []
    for rows in (12, 16, 24, 32, 48):
        began = time.perf_counter()
        found.append((rows, solve(World(PHANTOM), rows), time.perf_counter() - began))
    return found


def picture_of_a_known_motion() -> float:
    """A body that is stretched alike everywhere, without noise: largest error inside, as a share of full scale."""
    solved = solve(World({**PHANTOM, "steps": 1, "times": [1.0], "compress": 0.01}), 6)
    x, y = solved.places
    known = np.array([0.05 * x + 0.02 * y, -0.1 * y])
    solved.moved[0] = known
    texture, camera = Texture(PHANTOM, np.random.default_rng(1)), Camera(PHANTOM, np.random.default_rng(2))
    seen = camera.clean(texture, solved, 1, Observation((12.0, 12.0)))
    mean = np.zeros(camera.shape)
    for axes in camera.points():
        x, y = np.meshgrid(*axes, indexing="ij")
        up = y / 0.9
        across = (x - 0.02 * up) / 1.05
        within = (across > 0.3) & (across < 11.7) & (up > 0.3) & (up < 11.7)
        mean += np.where(within, texture.at([across, up]), np.nan) / 9
    return float(np.nanmax(np.abs(seen - mean)))


def main() -> int:
    """Print all checks; exit code 1 where one fails."""
    error = uniform()
    print(f"uniform compression: largest error {error:.1e} of the force")
    picture = picture_of_a_known_motion()
    print(f"picture of a known motion: largest error {picture:.1e} of full scale")
    print("rows  force at 5, 10, 15, 20 % (N)           RMS distance to the finest mesh at 20 % (mm)   s")
    found = meshes()
    finest = found[-1][1]
    for rows, solved, seconds in found:
        steps = min(solved.reached, finest.reached)
        apart = solved.moved[steps - 1] - finest.moved[steps - 1]
        rms = float(np.sqrt((apart**2).sum(axis=0).mean()))
        forces = "  ".join(f"{f:8.4f}" for f in solved.force)
        print(f"{rows:4d}  {forces}   {rms:.5f}   {seconds:.1f}")
    return int(error > 1e-6 or picture > 1e-3)


if __name__ == "__main__":
    sys.exit(main())
