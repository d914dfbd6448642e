"""How large an effect is in units of the noise, once the constants have taken up what they can.

The base model is fitted to data without noise, by least squares in the logarithms of all moduli, on displacements of
points of the body and the response. What is left, over the noise, is the size: of pictures, the root mean square
change of brightness that the displacements left make, over the noise of the difference of two pictures, both smoothed
by one pixel; of points and of the response (indentation under force control, else force) over their own noise. Size
of an effect is the largest of these. All on a coarse mesh, on which both worlds are solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from body import Solved
from observing import Observation
from pictures import Camera, Texture
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import brentq, least_squares

STEP = 0.05
"""Change of the logarithm of a modulus for its slope."""
CLOSE = 0.15
"""Relative distance from the size asked for at which the search ends."""


@dataclass(frozen=True)
class Size:
    """Sizes over the noise, and the changes of the constants that hide what they can (logarithms, from the top)."""

    pictures: float | None
    points: float | None
    response: float
    absorbed: tuple[float, ...]

    @property
    def largest(self) -> float:
        """The size."""
        return max(x for x in (self.pictures, self.points, self.response) if x is not None)


class Ruler:
    """Measures worlds against the base model of the same study."""

    def __init__(self, setting: Mapping[str, Any], solve: Callable[[Mapping[str, Any]], Solved], seed: int) -> None:
        self.setting = setting
        self.null = solve(setting)
        axes = self.null.places.shape[0]
        self.near = (
            slice(None),
            *[slice(n // 30, -(n // 30) or None, max(1, n // 30)) for n in self.null.places.shape[1:]],
        )
        others = []
        for layer in range(len(setting["mu"]) - 1):
            stiffer = list(setting["mu"])
            stiffer[layer] *= math.exp(STEP)
            others.append(solve({**setting, "mu": stiffer}))
        steps = min(solved.reached for solved in (self.null, *others))
        base, *curves = (self._curve(solved, steps) for solved in (self.null, *others))
        self.depth = self.null.depth[:steps]
        depth = np.concatenate([[0.0], self.depth])
        self.force, self.moves = (CubicSpline(depth, values) for values in base)
        slopes = [tuple((b - a) / STEP for a, b in zip(base, curve, strict=True)) for curve in curves]
        self.slopes = [(CubicSpline(depth, f), CubicSpline(depth, u)) for f, u in slopes]
        noise = setting["noise"]
        self.sigma = {
            "force": noise["force_share"] * float(base[0].max()),
            "displacement": noise["displacement"],
            # of the difference of two pictures smoothed by a Gaussian of one pixel
            "picture": math.sqrt(2) * noise["picture"] * (4 * math.pi) ** (-axes / 4),
            "points": noise["points"],
        }
        if setting["seen"] == "pictures":
            self._look(np.random.default_rng(seed))

    def _curve(self, solved: Solved, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Force and displacements of the samples at the first steps, with the 0 before."""
        moved = (solved.moved - solved.before)[(slice(0, steps), *self.near)]
        return np.concatenate([[0.0], solved.force[:steps]]), np.concatenate([0 * moved[:1], moved])

    def _look(self, rng: np.random.Generator) -> None:
        """Brightness and its slopes at the samples."""
        camera, texture = Camera(self.setting, rng), Texture(self.setting, rng)
        clean = camera.clean(texture, self.null, 0, Observation(()))
        smooth = gaussian_filter(clean, 1.0)
        places = self.null.places[self.near]
        where = [(p - o) / camera.pixel for p, o in zip(places, camera.origin, strict=True)]

        def read(values: np.ndarray) -> np.ndarray:
            return map_coordinates(values, where, order=1)

        self.bright = read(smooth)
        self.steep = np.array([read(g) / camera.pixel for g in np.gradient(smooth)])

    def _model(self, values: np.ndarray, d: float, f: float) -> tuple[float, np.ndarray, float]:
        """Indentation, displacements and force of the base model with changed moduli at a measured step."""
        scale, ratios = math.exp(values[-1]), values[:-1] - values[-1]

        def force(at: float) -> float:
            more = sum(r * float(slope[0](at)) for r, slope in zip(ratios, self.slopes, strict=True))
            return scale * (float(self.force(at)) + more)

        at = d
        if self.setting["control"] == "force":
            top = 1.3 * float(self.depth[-1])
            at = brentq(lambda x: force(x) - f, 0.0, top) if force(top) > f > 0 else (top if f > 0 else 0.0)
        moves = self.moves(at) + sum(r * slope[1](at) for r, slope in zip(ratios, self.slopes, strict=True))
        return at, moves, force(at)

    def size(self, solved: Solved, seen: Observation) -> Size:
        """Size of what a world has more than the base model."""
        times = self.setting["times"][: solved.reached]
        d, f = seen.response(times, solved.depth.copy(), solved.force.copy())
        steps = min(solved.reached, len(self.depth))
        shown, forced = self.setting["seen"], self.setting["control"] == "force"

        def parts(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            field, answer = [], []
            for k in range(steps):
                at, model, force = self._model(values, d[k], f[k])
                slope = float(self.force(at, 1))
                noise_f, noise_d = self.sigma["force"], self.sigma["displacement"]
                if forced:
                    answer.append((d[k] - at) / math.hypot(noise_d, noise_f / slope))
                else:
                    answer.append((f[k] - force) / math.hypot(noise_f, noise_d * slope))
                if shown == "forces" or (k + 1 not in self.setting["pictured"] and shown == "pictures"):
                    continue
                share = (k + 1) / solved.asked
                there = list((solved.places + solved.moved[k])[self.near])
                moved = np.array(seen.moved(share, there)) - (solved.places + solved.before)[self.near] - model
                if shown == "points":
                    field.append(moved / self.sigma["points"])
                    continue
                light = seen.light(share, there, self.bright) - self.bright
                field.append(((self.steep * moved).sum(axis=0) + light) / self.sigma["picture"])
            return np.array(field).ravel(), np.array(answer)

        def residual(values: np.ndarray) -> np.ndarray:
            field, answer = parts(values)
            return np.concatenate([self._weight(len(field)) * field, answer])

        found = least_squares(residual, np.zeros(len(self.slopes) + 1), bounds=(-3, 3), diff_step=1e-3)
        field, answer = parts(found.x)
        spread = float(np.sqrt(np.mean(field**2))) if len(field) else None
        return Size(
            spread if shown == "pictures" else None,
            spread if shown == "points" else None,
            float(np.sqrt(np.mean(answer**2))),
            tuple(round(float(x), 5) for x in found.x),
        )

    def _weight(self, count: int) -> float:
        """How many independent pixels, or points, one sample stands for, as a square root."""
        if not count or self.setting["seen"] != "pictures":
            return 1.0
        axes = self.setting["dimension"]
        pixel = self.setting["picture"]["pixel"]
        volume = float(np.prod([a.max() for a in self.null.nominal]))
        independent = volume / pixel**axes / (4 * math.pi) ** (axes / 2)
        per_step = count / max(1, len([k for k in self.setting["pictured"] if k <= len(self.depth)]))
        return math.sqrt(independent / per_step)


def amount_for(
    size: float, start: float, largest: float, measured: Callable[[float], float | None]
) -> tuple[float, float | None, list[tuple[float, float | None]]]:
    """Amount of an effect that has a size; `measured` gives the size of an amount, None where it cannot be solved.

    Returns the amount, its size, and all that was tried. The amount ends at the largest where the size is not reached.
    """
    tried: list[tuple[float, float | None]] = []
    amount, ceiling = min(start, largest), largest
    best: tuple[float, float | None] = (amount, None)
    for _ in range(7):
        found = measured(amount)
        tried.append((amount, found))
        if found is None:
            ceiling = amount * 0.85
            amount = min(amount * 0.6, ceiling)
            continue
        if best[1] is None or abs(math.log(max(found, 1e-9) / size)) < abs(math.log(max(best[1], 1e-9) / size)):
            best = (amount, found)
        if abs(found / size - 1) < CLOSE:
            break
        further = min(amount * float(np.clip(size / max(found, 1e-9), 0.08, 12.0)), ceiling)
        if abs(further / amount - 1) < 0.02:
            break
        amount = further
    return *best, tried
