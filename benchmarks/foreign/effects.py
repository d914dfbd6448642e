"""Hidden effects that change the body, its boundary or its loading. Each takes world, form, numbers and amount.

At amount 0 each is absent, and the larger the amount, the larger the effect. Amounts in the units that are said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import ngsolve as ng
import numpy as np
from world import Hold, World, powers

GLUED = 2000.0
"""Stiffness of a held part of a face beside one that slips, over mu per mm."""


def stiffening(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """More energy at large strain; the modulus at rest stays as it is. Amount: over mu."""
    w.energies.append(lambda k: a * k.mu * _stiff(form, k.I1 - 3))


def _stiff(form: str, e: Any) -> Any:
    if form == "exponential":
        return ng.exp(e) - 1 - e
    if form == "quadratic":
        return e * e / 2
    if form == "cubic":
        return e * e * e
    return 0.5 * (e - ng.log(1 + 3 * e) / 3)  # saturating: the tangent goes from mu to (1 + amount) mu


def softening(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Less energy at large strain: the tangent goes from mu to (1 - amount) mu."""
    rate = n["rate"]

    def less(k: Any) -> Any:
        e = k.I1 - 3
        gone = ng.log(1 + rate * e) / rate if form == "logarithm" else (1 - ng.exp(-rate * e)) / rate
        return -a * k.mu / 2 * (e - gone)

    w.energies.append(less)


def second_invariant(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A share of the energy has another form, which acts in compression. Amount: the share."""
    w.kept = 1 - a
    p = -n["power"]
    if form == "mooney" or w.dimension == 3:
        w.energies.append(lambda k: a * k.mu / 2 * (k.I2 - 3))
    else:
        w.energies.append(lambda k: a * 2 * k.mu / p**2 * (powers(k, ng.CF(1.0), p) - 3))


def compressibility(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A lower Poisson ratio, also with another law of volume. Amount: loss of the ratio."""
    w.loss, w.volume = a, form


def _fibre(k: Any, angle: float) -> Any:
    """Squared stretch less 1 of fibres at an angle (degrees) to the layers, 0 where they are shortened."""
    t = math.radians(angle)
    c, s = math.cos(t), math.sin(t)
    long = k.J ** (-2 / 3) * (c * c * k.C[0, 0] + 2 * c * s * k.C[0, 1] + s * s * k.C[1, 1]) - 1
    return ng.IfPos(long, long, 0.0)


def fibres(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Fibres along the layers. Amount: over mu."""
    if form == "square":
        w.energies.append(lambda k: a * k.mu * _fibre(k, 0.0) ** 2)
    else:
        w.energies.append(lambda k: a * k.mu * (ng.exp(3 * _fibre(k, 0.0) ** 2) - 1) / 3)


def oblique_fibres(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Fibres at an angle to the layers; the sign of the amount is that of the angle."""
    sign = math.copysign(1.0, a)
    angles = (sign * n["angle"],) if form == "one family" else (n["angle"], -n["angle"])
    for angle in angles:
        w.energies.append(lambda k, angle=angle: abs(a) * k.mu * _fibre(k, angle) ** 2)


def one_layer_stiffens(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Stiffening in one layer only."""
    inside = w.of_layer(w.layer_at(n["layer"]))
    w.energies.append(lambda k: a * k.mu * inside(*k.place) * _stiff(form, k.I1 - 3))


def _shape(w: World, form: str, n: Mapping[str, float], across: float, along: float) -> Callable[..., Any]:
    """1 inside an outline with sharp edges (`smooth`: a bell), 0 outside; in space an ellipsoid or a box."""
    radius, aspect, turn = n["radius"], n["aspect"], math.radians(n["turn"])
    # not nearer to a face than its own radius
    reach = radius * max(aspect, 1 / aspect)
    x0 = float(np.clip(across * w.width, reach, w.width - reach))
    y0 = float(np.clip(along * w.height, reach, w.height - reach))

    def inside(*place: Any) -> Any:
        x, y = place[0] - x0, place[-1] - y0
        u = (math.cos(turn) * x + math.sin(turn) * y) / (radius * aspect)
        v = (-math.sin(turn) * x + math.cos(turn) * y) * aspect / radius
        q = (place[1] - w.setting["breadth"] / 2) / radius if w.dimension == 3 else ng.CF(0.0)
        r = u * u + v * v + q * q
        if form == "ellipse":
            return ng.IfPos(1 - r, 1.0, 0.0)
        if form == "ring":
            return ng.IfPos(1.3 - r, ng.IfPos(r - 0.4, 1.0, 0.0), 0.0)
        if form == "box":
            flat = ng.IfPos(0.81 - u * u, ng.IfPos(0.81 - v * v, 1.0, 0.0), 0.0)
            return flat * ng.IfPos(0.81 - q * q, 1.0, 0.0)
        if form == "triangle":
            return ng.IfPos(v + 0.7, ng.IfPos(1.1 - v - 1.7 * u, ng.IfPos(1.1 - v + 1.7 * u, 1.0, 0.0), 0.0), 0.0)
        return 1 / (1 + r * r)

    return inside


def inclusion(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A region that is stiffer or softer. Amount: logarithm of the factor on mu."""
    shape = _shape(w, form, n, n["across"], n["along"])
    w.log_mu.append(lambda *place: a * shape(*place))


def two_inclusions(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Two regions, the second one opposite to the first, of the other sign."""
    one = _shape(w, form, n, n["across"], n["along"])
    other = _shape(w, form, n, 1 - n["across"], 1 - n["along"])
    w.log_mu.append(lambda *place: a * (one(*place) - other(*place)))


def gradient(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Each layer changes from its upper to its lower side. Amount: change over the layer, over mu."""
    ends = [w.within(layer) for layer in range(len(w.setting["heights"]))]

    def field(*place: Any) -> Any:
        total = ng.CF(0.0)
        for number, (low, high) in enumerate(ends):
            depth = (high - place[-1]) / (high - low)
            depth = ng.IfPos(depth, ng.IfPos(1 - depth, depth, 1.0), 0.0)
            shape = depth - 0.5 if form == "linear modulus" else -0.5 * ng.cos(math.pi * depth)
            part = ng.log(1 + a * shape) if form == "linear modulus" else a * shape
            total = total + w.of_layer(number)(*place) * part
        return total

    w.log_mu.append(field)


def sideways_gradient(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Stiffer from left to right, steadily or near one edge. Amount: logarithm of the factor over the width."""

    def field(*place: Any) -> Any:
        s = place[0] / w.width
        return a * ((s - 0.5) if form == "steady" else ng.exp(-6 * s))

    w.log_mu.append(field)


def gradient_of_the_body(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Mu changes over the height of the body, across the layers. Amount: logarithm of a factor."""

    def field(*place: Any) -> Any:
        s = place[-1] / w.height
        return a * (4 * s * (1 - s) - 2 / 3 if form == "parabola" else ng.exp(-4 * s) - 0.25)

    w.log_mu.append(field)


def film(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A film under the indenter. Amount: logarithm of the factor on mu."""
    t = n["thickness"]

    def field(*place: Any) -> Any:
        below = w.height - place[-1]
        return a * (ng.IfPos(t - below, 1.0, 0.0) if form == "sharp" else ng.exp(-((below / t) ** 2)))

    w.log_mu.append(field)


def split_layer(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """One layer is two. Amount: logarithm of the ratio of both."""
    layer = w.layer_at(n["layer"])
    low, high = w.within(layer)
    cut = low + (high - low) * (0.5 if form == "half" else n["share"])

    def field(*place: Any) -> Any:
        return a * w.of_layer(layer)(*place) * ng.IfPos(place[-1] - cut, 0.5, -0.5)

    w.log_mu.append(field)


def stripes(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Stiffer and softer stripes. Amount: logarithm of a factor, up and down."""
    turn = 1.0 if form == "oblique" else 0.0
    wave = 2 * math.pi * n["waves"] / w.width
    w.log_mu.append(lambda *place: a * ng.sin(wave * (place[0] + turn * place[-1])))


def _slip(w: World, form: str, n: Mapping[str, float], a: float) -> Hold:
    """A face that gives way sideways, wholly or in a part.

    Amount: compliance, mm/MPa; of `limited` half over the limit of the shear, 1/MPa.
    """
    share, middle = n.get("share", 0.5), w.width / 2
    held = GLUED * max(w.setting["mu"])
    if a == 0.0:
        return Hold()

    def loose(x: Any) -> Any:
        if form == "left":
            return ng.IfPos(share * w.width - x, 1.0, 0.0)
        if form == "right":
            return ng.IfPos(x - (1 - share) * w.width, 1.0, 0.0)
        away = ng.sqrt((x - middle) ** 2)
        if form == "middle":
            return ng.IfPos(share * w.width / 2 - away, 1.0, 0.0)
        return ng.IfPos(away - (1 - share) * w.width / 2, 1.0, 0.0)

    def potential(u: Any, place: tuple[Any, ...]) -> Any:
        square = ng.InnerProduct(u, u)
        if form == "limited":  # the shear grows to a limit of 0.5 / amount, within 0.02 mm
            return 0.5 / a * 0.02 * (ng.sqrt(1 + square / 0.02**2) - 1)
        if form == "springs":
            return square / (2 * a)
        free = loose(place[0])
        return (free / a + (1 - free) * held) * square / 2

    return Hold(potential)


def base_slip(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Slip at the base."""
    w.base = _slip(w, form, n, a)


def indenter_slip(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Slip under the indenter."""
    w.top = _slip(w, form, n, a)


def bed(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A base that gives way downwards. Amount: compliance, mm/MPa."""

    def potential(u: Any, place: tuple[Any, ...]) -> Any:
        softer = 1.0 if form == "steady" else 0.2 + 1.6 * place[0] / w.width
        return u * u / (2 * a * softer)

    if a:
        w.base = Hold(w.base.sideways, potential)


def tilt(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """One side goes deeper. Amount: slope over the last indentation, 1/mm."""

    def lower(load: Any, *place: Any) -> Any:
        turned = {"growing": load, "settling": 1 - ng.exp(-8 * load), "late": load * load}[form]
        return a * w.depth * turned * (place[0] - w.width / 2)

    w.lower.append(lower)


def curved_indenter(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The indenter is not flat: it presses its form into the body. Amount: mm between middle and edge."""
    sign = 1.0 if form == "round" else -1.0

    def lower(load: Any, *place: Any) -> Any:
        s = 2 * place[0] / w.width - 1
        return sign * a * load * (1 / 3 - s * s)

    w.lower.append(lower)


def sideways_motion(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The indenter moves aside while it comes down. Amount: mm at the end."""
    w.aside = lambda load: a * (load if form == "growing" else load * load)


def wall(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """A soft guide beside the body, which it meets while it bulges. Amount: stiffness, MPa/mm."""
    sides = {"right": (1.0,), "left": (-1.0,), "both": (1.0, -1.0)}[form]
    w.walls += [(side, n["gap"] * w.height, a) for side in sides]


def ageing(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """Mu changes with time. Amount: logarithm of the factor at the end."""
    inside = w.of_layer(w.layer_at(n["layer"]))
    w.ageing.append(lambda *place: a if form == "all" else a * inside(*place))


def preload(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The body was pressed before the first picture. Amount: share of the height."""
    w.start = a * w.height


def _where(w: World, form: str, n: Mapping[str, float], a: float) -> Callable[..., Any]:
    inside = w.of_layer(w.layer_at(n["layer"]))
    return lambda *place: ng.CF(a) if form == "all" else a * inside(*place)


def swelling(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The body or a layer swelled or shrank after it was glued to the base. Amount: logarithm of the stretch."""
    w.grown.append(_where(w, form, n, a))
    w.released = True


def stretched_before(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The body or a layer was stretched sideways before it was glued. Amount: logarithm of the stretch."""
    w.pulled.append(_where(w, form, n, a))
    w.released = True


def drying(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The body shrinks during the test. Amount: negative logarithm of the stretch at the end."""
    w.drying = lambda now: -abs(a) * (now if form == "steady" else (1 - ng.exp(-3 * now)))


def out_of_plane(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The body gets longer out of the plane with the indentation. Amount: stretch less 1 at the end."""
    w.bulging = lambda load: 1 + a * load


def interface(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """An interface lies elsewhere than said. Amount: share of the height."""
    levels = w.levels()
    number = 1 + min(int(n["which"] * (len(levels) - 2)), len(levels) - 3)
    shapes = {"moved": lambda s: 1.0 + 0 * s, "inclined": lambda s: 2 * s - 1, "waved": lambda s: np.sin(3 * np.pi * s)}
    here = shapes[form]

    def moved(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        near = np.interp(y, levels, np.eye(len(levels))[number])
        return y + a * w.height * near * here(x / w.width)

    w.interfaces = moved


def outline(w: World, form: str, n: Mapping[str, float], a: float) -> None:
    """The sides are not where the study says. Amount: share of the width."""

    def moved(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        t, centred = y / w.height, x - w.width / 2
        if form == "sheared":
            return x + a * w.width * (t - 0.5)
        factor = {"tapered": 2 * a * (t - 0.5), "bulging": 6 * a * t * (1 - t), "wider": 2 * a + 0 * t}[form]
        return w.width / 2 + centred * (1 + factor)

    w.outline = moved
