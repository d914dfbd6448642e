"""Hidden effects of what is measured: forces, indentations, places and brightness. The body is as the base model says.

Responses: a function of step times (s), indentation (mm), force (N) to both, reported. Pictures: a function of step
k of n, places (mm) and brightness to how far the picture shows them away (mm), and the brightness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Numbers = Mapping[str, float]
Response = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
Warp = Callable[[float, list[np.ndarray]], list[np.ndarray]]
Light = Callable[[float, list[np.ndarray], np.ndarray], np.ndarray]


@dataclass
class Observation:
    """What stands between the body and the files."""

    size: tuple[float, ...]  # of the body, mm
    responses: list[Response] = field(default_factory=list)
    warps: list[Warp] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)

    def response(self, times: Sequence[float], d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reported indentation and force."""
        for change in self.responses:
            d, f = change(np.asarray(times, float), d, f)
        return d, f

    def moved(self, share: float, places: list[np.ndarray]) -> list[np.ndarray]:
        """Where the picture shows places; `share` is step / steps, 0 before compression."""
        if share > 0:
            for warp in self.warps:
                places = [x + dx for x, dx in zip(places, warp(share, places), strict=True)]
        return places

    def light(self, share: float, places: list[np.ndarray], brightness: np.ndarray) -> np.ndarray:
        """Brightness that the picture shows."""
        if share > 0:
            for change in self.lights:
                brightness = change(share, places, brightness)
        return brightness


def relaxation(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The stress relaxes, by the same function everywhere. Amount: share of the modulus that relaxes.

    Force = integral of G(t - s) dF(s), F elastic and linear in time within a step: exact for a body that relaxes
    alike everywhere under prescribed indentation, since its displacements do not change.
    """
    tau = (n["time"],) if form == "one term" else (n["time"] / 4, n["time"], 4 * n["time"])

    def change(t: np.ndarray, d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        ends = np.concatenate([[0.0], t])
        rise = np.diff(np.concatenate([[0.0], f]))
        lasts = np.diff(ends)
        told = f * (1 - a)
        for one in tau:
            for k in range(len(t)):
                for j in range(k + 1):
                    mean = one / lasts[j] * (np.exp(-(t[k] - ends[j + 1]) / one) - np.exp(-(t[k] - ends[j]) / one))
                    told[k] += a / len(tau) * rise[j] * mean
        return d, told

    o.responses.append(change)


def force_offset(o: Observation, form: str, n: Numbers, a: float) -> None:
    """A constant force too much, or friction of a guide that comes with the first 0.3 mm. Amount: over the largest."""

    def change(t: np.ndarray, d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return d, np.maximum(f + a * f[-1] * (1.0 if form == "constant" else np.tanh(d / 0.3)), 0.0)

    o.responses.append(change)


def onset(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The indentation is counted from another point. Amount: over the largest."""

    def change(t: np.ndarray, d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.maximum(d + a * d[-1] * (1.0 if form == "constant" else 1 - np.exp(-3 * d / d[-1])), 0.0), f

    o.responses.append(change)


def soft_frame(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The frame of the machine gives way, and that counts as indentation. Amount: mm at the end."""

    def change(t: np.ndarray, d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return d + a * (f / f[-1]) ** (1.0 if form == "steady" else 0.6), f

    o.responses.append(change)


def bent_force(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The force sensor is not linear. Amount: over the force, at the end."""

    def change(t: np.ndarray, d: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return d, f * (1 + a * (f / f[-1]) ** (1.0 if form == "square" else 0.5))

    o.responses.append(change)


def _along(n: Numbers, count: int) -> list[float]:
    turn = math.radians(n["direction"])
    return [math.cos(turn), math.sin(turn)] if count == 2 else [math.cos(turn), 0.3, math.sin(turn)]


def shift(o: Observation, form: str, n: Numbers, a: float) -> None:
    """All pictures under load are shifted. Amount: mm."""
    o.warps.append(lambda share, x: [a * c + 0 * x[0] for c in _along(n, len(x))])


def wandering(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The shift changes from step to step. Amount: mm."""

    def warp(share: float, x: list[np.ndarray]) -> list[np.ndarray]:
        much = share if form == "growing" else math.sin(11.0 * share + n["direction"])
        return [a * much * c + 0 * x[0] for c in _along(n, len(x))]

    o.warps.append(warp)


def _about(o: Observation, x: list[np.ndarray]) -> list[np.ndarray]:
    return [p - s / 2 for p, s in zip(x, o.size, strict=True)]


def turn(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The specimen is turned in the pictures under load. Amount: degrees."""

    def warp(share: float, x: list[np.ndarray]) -> list[np.ndarray]:
        t = math.radians(a * (1.0 if form == "constant" else share))
        u, v = _about(o, x)
        return [(math.cos(t) - 1) * u - math.sin(t) * v, math.sin(t) * u + (math.cos(t) - 1) * v]

    o.warps.append(warp)


def stretch(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The pixels of the pictures under load have another size than said. Amount: share."""

    def warp(share: float, x: list[np.ndarray]) -> list[np.ndarray]:
        u, v = _about(o, x)
        return {"both": [a * u, a * v], "across": [a * u, 0 * v], "along": [0 * u, a * v], "shear": [a * v, 0 * u]}[
            form
        ]

    o.warps.append(warp)


def lens(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The pictures under load are distorted like a barrel. Amount: share at half the width from the middle."""

    def warp(share: float, x: list[np.ndarray]) -> list[np.ndarray]:
        u, v = _about(o, x)
        r = (u * u + v * v) / (o.size[0] / 2) ** 2
        return [-a * r * u, -a * r * v]

    o.warps.append(warp)


def drift(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The brightness changes from step to step. Amount: share, or the change of a power (`contrast`)."""

    def light(share: float, x: list[np.ndarray], b: np.ndarray) -> np.ndarray:
        if form == "contrast":
            return np.maximum(b, 0.0) ** (1 + a * share)
        much = 1 - math.exp(-3 * share) if form == "saturating" else math.sin(9.0 * share + 1)
        return b * (1 + a * much)

    o.lights.append(light)


def bias(o: Observation, form: str, n: Numbers, a: float) -> None:
    """The brightness changes across the field of view. Amount: share."""

    def light(share: float, x: list[np.ndarray], b: np.ndarray) -> np.ndarray:
        u, v = (p / s for p, s in zip(_about(o, x), o.size, strict=True))
        c, s = _along(n, 2)
        along = c * u + s * v
        if form == "spot":
            return b * (1 + a * np.exp(-((u - 0.4 * c) ** 2 + (v - 0.4 * s) ** 2) / 0.1))
        return b * (1 + a * (2 * along if form == "steady" else 4 * along * along - 0.3))

    o.lights.append(light)
