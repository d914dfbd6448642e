"""Checks of the solver: derivatives, closed form, refinement. Usage: python verify.py."""

from __future__ import annotations

import time

import numpy as np
from cases import CASES
from make import true_body
from material import Material
from scipy.optimize import brentq
from solver import Block, Boundary

Array = np.ndarray


def check_derivatives() -> tuple[float, float]:
    """Largest relative errors of stress and tangent against central differences."""
    rng = np.random.default_rng(0)
    n = 200
    grad = np.eye(2) + rng.normal(0, 0.1, (n, 2, 2))
    grad[:3] = np.eye(2) * np.array([1.0, 0.9, 1.2])[:, None, None]
    material = Material(
        rng.uniform(0.01, 0.1, n),
        rng.choice([-2.0, 0.7, 1.4, 3.0, 6.0], n),
        rng.uniform(0.3, 0.49, n),
        fibre_k=rng.uniform(0.01, 0.1, n),
        fibre_b=2.0,
        fibre_angle=rng.uniform(0, 3, n),
    )
    keep = np.abs(material._fibre_strain(grad)[0] - 2e-5) > 2e-5  # the second derivative jumps where fibres get slack
    stress, tangent = material.stress(grad)
    numbers, slopes = np.zeros((n, 4)), np.zeros((n, 4, 4))
    for k in range(4):
        step = np.zeros((2, 2))
        step.flat[k] = 3e-6
        numbers[:, k] = (material.energy(grad + step) - material.energy(grad - step)) / 6e-6
        slopes[:, :, k] = (material.stress(grad + step)[0] - material.stress(grad - step)[0]).reshape(n, 4) / 6e-6
    first = np.abs(numbers - stress.reshape(n, 4)).max(axis=1) / material.bulk()
    second = np.abs(slopes - tangent).max(axis=(1, 2)) / np.abs(tangent).max(axis=(1, 2))
    return float(first.max()), float(second[keep].max())


def closed_form(mu: float, alpha: float, nu: float, stretch: float) -> float:
    """Nominal stress (positive in compression) of homogeneous compression in plane strain."""
    one = np.ones(1)
    material = Material(mu * one, alpha * one, nu * one)

    def side(across: float) -> float:
        total = across**alpha + stretch**alpha + 1
        j = across * stretch
        mean = total * j ** (-alpha / 3)
        part = across**alpha * j ** (-alpha / 3) - mean / 3
        return 2 * mu / alpha * part + float(material.bulk()[0]) * (j - 1) * j

    across = brentq(side, 0.8, 3.0, xtol=1e-14)
    j = across * stretch
    scaled = j ** (-alpha / 3)
    part = stretch**alpha * scaled - (across**alpha + stretch**alpha + 1) * scaled / 3
    return -(2 * mu / alpha * part + float(material.bulk()[0]) * (j - 1) * j) / stretch


def check_homogeneous() -> float:
    """Largest relative error of the force of one layer between sliding plates."""
    worst = 0.0
    for alpha, nu in ((1.3, 0.45), (3.5, 0.49), (-2.0, 0.47)):
        block = Block(10, [8], 4, [3], Boundary(False, False))
        n = block.where.shape[1]
        material = Material(np.full(n, 0.02), np.full(n, alpha), np.full(n, nu))
        for _, displacement, force in block.solve([(0, 0.8), (0, 1.6)], material, forced=False):
            exact = 10 * closed_form(0.02, alpha, nu, 1 - displacement / 8)
            worst = max(worst, abs(force / exact - 1))
        _, displacement, _ = block.solve([(0, exact)], material, forced=True)[-1]
        worst = max(worst, abs(displacement / 1.6 - 1))
    return worst


def check_refinement(glued: bool) -> tuple[float, float]:
    """Change of force (prescribed displacement) and of inner displacements with a mesh twice as fine."""
    forces, fields = [], []
    at = np.array([[3.0, 5.0, 8.5, 11.5], [2.5, 8.0, 4.0, 6.0]])
    for factor in (1, 2):
        block = Block(14, [4, 3, 4], 24 * factor, [8 * factor] * 3, Boundary(glued, glued))
        mu = np.array([0.03, 0.015, 0.04])[block.layer_at]
        material = Material(mu, np.full(len(mu), 2.0), np.full(len(mu), 0.49))
        q, _, force = block.solve([(0, 0.8), (0, 1.6)], material, forced=False)[-1]
        u = block.into @ q
        forces.append(force)
        fields.append(block.basis.probes(at) @ u)
    change = np.abs(fields[1] - fields[0]).max() / np.abs(fields[1]).max()
    return abs(forces[1] / forces[0] - 1), float(change)


def check_study(name: str) -> tuple[float, float]:
    """Compare force and inner displacements of a study with those of a mesh twice as fine, at 60 % of the way."""
    case = CASES[name]
    height = sum(layer[1] for layer in case.layers)
    at = np.stack(np.meshgrid(np.linspace(0.15, 0.85, 5) * case.width, np.linspace(0.15, 0.85, 5) * height)).reshape(
        2, -1
    )
    forces, fields = [], []
    for fine in (1, 2):
        block, material = true_body(case, fine)
        path = [(0.0, case.strain * height * share) for share in (0.3, 0.6)]
        q, _, force = block.solve(path, material, forced=False)[-1]
        forces.append(force)
        fields.append(block.basis.probes(at) @ (block.into @ q))
    return abs(forces[1] / forces[0] - 1), float(np.abs(fields[1] - fields[0]).max() / np.abs(fields[1]).max())


def main() -> None:
    """Print all figures and fail where one is too large."""
    stress, tangent = check_derivatives()
    print(f"stress against differences of the energy, share of the bulk modulus: {stress:.1e}; tangent: {tangent:.1e}")
    homogeneous = check_homogeneous()
    print(f"homogeneous compression against the closed form: {homogeneous:.1e}")
    for glued in (False, True):
        started = time.time()
        force, field = check_refinement(glued)
        print(
            f"twice as fine, {'glued' if glued else 'sliding'}: force {force:.2%}, displacements {field:.2%}"
            f" ({time.time() - started:.0f} s)"
        )
        assert glued or max(force, field) < 3e-3
    for name in ("k02", "k06", "k08", "k09", "k13"):
        force, field = check_study(name)
        print(
            f"twice as fine, study {name} at 60 % of the way: force {force:.2%}, displacements {field:.2%}", flush=True
        )
    assert stress < 1e-6 and tangent < 1e-6 and homogeneous < 1e-5


if __name__ == "__main__":
    main()
