"""Checks of the parts, and of the meshes of studies: python verify.py [NAME ...]."""

from __future__ import annotations

import sys

import numpy as np
from body import layered
from camera import Camera
from cases import load
from make import simulate
from material import Material, bulk_modulus
from scipy.interpolate import LinearNDInterpolator
from scipy.optimize import brentq
from solver import Contact, Load, Problem

Array = np.ndarray


def _law(rng: np.random.Generator) -> Material:
    """Random constants at 6 points: power and exponential law, with growth."""
    mu = rng.uniform(0.5, 2, (2, 3))
    b = np.array([[0, 0, 0], [0.8, 2.0, 4.0]])
    return Material(mu, rng.uniform(-3, 4, (2, 3)), 10 * mu, b, 0.1 * mu, 1 + 0.05 * mu, 1 + mu)


def derivatives() -> None:
    """Stress and tangent against central differences."""
    rng = np.random.default_rng(1)
    law = _law(rng)
    f = np.eye(3)[:, :, None, None] + 0.2 * rng.normal(size=(3, 3, 2, 3))
    f[:, :, 0, 1] = np.diag([1.0, 1.0, 0.9])  # two stretches alike
    stress, tangent = law.gradient([f, None])[0], law.hessian([f, None])[0]
    near, step = np.zeros_like(stress), 1e-6
    slope = np.zeros_like(tangent)
    for i in range(3):
        for k in range(3):
            more, less = f.copy(), f.copy()
            more[i, k] += step
            less[i, k] -= step
            near[i, k] = (law.total(more) - law.total(less)) / (2 * step)
            slope[:, :, i, k] = (law.gradient([more, None])[0] - law.gradient([less, None])[0]) / (2 * step)
    print(f"stress: {np.abs(stress - near).max() / np.abs(stress).max():.1e}")
    print(f"tangent: {np.abs(tangent - slope).max() / np.abs(tangent).max():.1e}")


def _stresses(across: float, mu: float, alpha: float, k: float, down: float, space: bool) -> tuple[float, float]:
    """Stress across (Kirchhoff) and down (nominal) of a block under uniform stretch."""
    stretch = np.array([across, down, across if space else 1.0])
    j = stretch.prod()
    w = 2 * mu / alpha * (stretch / j ** (1 / 3)) ** alpha
    beta = w - w.mean() + k * (j - 1) * j
    return beta[0], beta[1] / down


def sliding() -> None:
    """A block between sliding plates against the closed form, in the plane and in space."""
    for alpha, nu, sides in ((2.0, 0.45, (20.0,)), (-3.0, 0.49, (20.0,)), (6.0, 0.3, (20.0, 16.0))):
        mu, height, d, thick = 0.02, 12.0, 1.5, 7.0
        k = bulk_modulus(mu, nu)
        body = layered(sides, [height], 4, [3])
        problem = Problem(body, Contact("slides", "slides"), 1.0 if len(sides) == 2 else thick)
        full = np.ones(problem.where.shape[1:])
        law = problem.material(mu * full, alpha * full, k * full)
        state = problem.solve(law, [Load(1, d)], forced=False)[-1]
        again = problem.solve(law, [Load(1, state.force)], forced=True)[-1]
        down = 1 - d / height

        given = (mu, alpha, k, down, len(sides) == 2)
        across = brentq(lambda a, given=given: _stresses(a, *given)[0], 0.8, 1.5)
        area = np.prod(sides) * (1 if len(sides) == 2 else thick)
        force = -_stresses(across, *given)[1] * area
        print(
            f"sliding block, alpha {alpha:g}, nu {nu:g}, {body.dim} axes: force {state.force / force - 1:.1e}, "
            f"displacement under force {again.displacement / d - 1:.1e}"
        )


def weight() -> None:
    """Sum of the forces of gravity, and the pressure on the base of a soft block."""
    body = layered((20.0,), [10.0], 4, [3])
    problem = Problem(body, Contact("slides", "slides"), 5.0)
    total = problem.gravity(1e-5).sum()
    print(f"gravity: {total / (-1e-5 * 20 * 10 * 5) - 1:.1e}")


def tracing() -> None:
    """Trace a bent body back: places against the map that bent it."""
    body = layered((20.0,), [12.0], 20, [12])

    def bend(p: Array) -> Array:
        return np.stack([0.4 * np.sin(p[:, 1] / 4), -0.05 * p[:, 1] + 0.3 * np.cos(p[:, 0] / 5)], 1)

    camera = Camera(np.array([-3.0, -3.0]), 0.2, (130, 90), 5)
    found, _ = camera.trace(body, bend(body.points), 1)
    on = np.isfinite(found[:, 0])
    off = np.linalg.norm(found[on] + bend(found[on]) - camera.places()[on], axis=1).max()
    print(f"tracing back: at most {off / 0.2:.1e} pixels off, area {on.sum() * 0.04**2:.2f} mm2")


def refined(names: list[str]) -> None:
    """Studies with their hidden parts on a mesh 1.5 times as fine in each direction, else as coarse."""
    cases = load()
    for name in names:
        case = cases[name]
        try:
            coarse, fine, words = simulate(case), None, "1.5 times as fine"
            if not case.space:  # in space that would take an hour
                fine = simulate(case, 1.5)
        except FloatingPointError as error:
            print(f"{name}: {error} on the finer mesh")
        if fine is None:
            coarse, fine, words = simulate(case, 1 / 1.5), coarse, "against 1.5 times as coarse"
        forced = case.control == "force"
        a, b = (made.displacement if forced else made.force for made in (coarse, fine))
        read = LinearNDInterpolator(fine.body.points, fine.states[-1].u - fine.states[0].u)
        gap = np.linalg.norm(coarse.states[-1].u - coarse.states[0].u - read(coarse.body.points), axis=1) / case.pixel
        gap = gap[np.isfinite(gap)]
        mean, most = np.sqrt((gap**2).mean()), np.quantile(gap, 0.99)
        print(
            f"{name}: {words}: response {np.abs(a / b - 1).max():.2%}; displacements at the last step, ",
            end="",
        )
        print(f"pixels: root mean square {mean:.3f}, 99 % below {most:.3f}, largest {gap.max():.2f}", flush=True)


if __name__ == "__main__":
    derivatives()
    sliding()
    weight()
    tracing()
    refined(sys.argv[1:])
