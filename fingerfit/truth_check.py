"""Values of a virtual experiment that no body, picture or measurement has: found before anything is solved."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from fingerfit.errors import FingerfitError, InputError
from fingerfit.fem.elements import ELEMENTS
from fingerfit.keys import Keys
from fingerfit.solvers.registry import get_solver
from fingerfit.units import LENGTHS

if TYPE_CHECKING:
    from fingerfit.truth import Truth

STIFF = 1e6
"""Shear modulus in MPa that no solid reaches: that of diamond is half of it."""
PIXELS = 4096
"""Along an axis, as a study may resize its pictures to."""


def check_truth(keys: Keys, truth: Truth) -> None:
    """Note every value that cannot be.

    Parameters
    ----------
    keys : Keys
        The whole description.
    truth : Truth
        What was read of it without a problem.
    """
    if not truth.layers:
        keys.wrong("body.layers", "none", "at least one layer")
        return
    height = _height(truth)
    _check_layers(keys, truth)
    _check_model(keys, truth)
    _check_steps(keys, truth, height)
    _check_pictures(keys, truth)
    noise = Keys(keys.where, keys.data["noise"], "noise.", keys.problems)
    _within(noise, "force", 0.0, 1.0)
    _within(noise, "displacement", 0.0, height)
    seed = keys.data["seed"]
    if type(seed) is not int or seed < 0:
        keys.wrong("seed", seed, "a whole number, 0 or more")
    for name, numbers in truth.effects.items():
        for key, (low, high) in truth.known[name].bounds().items():
            if key in numbers:
                _within(Keys(keys.where, numbers, f"effects.{name}.", keys.problems), key, low, high)


def _height(truth: Truth) -> float:
    """Of the body along the indenter's axis, mm; as long as a length may be where a mesh has it."""
    if truth.mesh_file is not None:
        return LENGTHS[1]
    return truth.brick[2] if truth.brick is not None else sum(layer["height"] for layer in truth.layers)


def _within(keys: Keys, key: str, low: float, high: float) -> None:
    value = keys.number(key)
    if value is not None and not low <= value <= high:
        keys.wrong(key, keys.data[key], f"a number from {low:g} to {high:g}")


def _check_layers(keys: Keys, truth: Truth) -> None:
    names: set[str] = set()
    for number, layer in enumerate(truth.layers):
        one = Keys(keys.where, layer, f"body.layers.{number}.", keys.problems)
        name = layer["name"]
        if not name.isidentifier() or name.upper() in names:
            one.wrong("name", name, "letters, digits and _, and a name that no other layer has")
        names.add(name.upper())
        _within(one, "mu", 0.0, STIFF)
        _within(one, "intensity", 0.0, 1.0)
        if layer.get("height") is not None:
            _within(one, "height", *LENGTHS)
    if truth.dim == 2:
        body = Keys(keys.where, keys.data["body"], "body.", keys.problems)
        for key in ("width", "thickness"):
            _within(body, key, *LENGTHS)
    for name, value in truth.tissues.items():
        if not 0 <= value <= 1:
            keys.wrong(f"body.tissues.{name}", value, "a number from 0 to 1")


def _check_model(keys: Keys, truth: Truth) -> None:
    material = Keys(keys.where, truth.material, "material.", keys.problems)
    if material.number("alpha") == 0:
        material.wrong("alpha", 0, "a number that is not 0")
    poisson = material.number("poisson")
    if poisson is not None and not -1 < poisson < 0.5:
        material.wrong("poisson", poisson, "a number between -1 and 0.5")
    element = truth.mesh.get("element")
    if isinstance(element, str) and element in ELEMENTS and ELEMENTS[element].dim != truth.dim:
        keys.wrong("mesh.element", element, f"an element of {truth.dim} dimensions, as the body")
    try:
        get_solver(truth.solver)
    except FingerfitError as error:
        keys.problems.append(FingerfitError(f"{keys.where}: {error}"))
    for key, value, kinds in zip(
        ("base", "indenter"), truth.boundary, (("held", "slides"), ("glued", "slides")), strict=True
    ):
        if value not in kinds:
            keys.wrong(f"boundary.{key}", value, "one of " + ", ".join(kinds))


def _check_steps(keys: Keys, truth: Truth, height: float) -> None:
    if not truth.displacement:
        keys.wrong("displacement", "an empty list", "the indenter's displacement at each step, mm")
    for number, value in enumerate(truth.displacement):
        if not _is_number(value) or not 0 <= value < height:
            keys.wrong(f"displacement.{number}", value, f"0 or more, and less than the body's height of {height:g} mm")
    if not truth.time:
        return
    numbers = all(map(_is_number, truth.time))
    if not numbers or any(b <= a for a, b in zip((0.0, *truth.time), truth.time, strict=False)):
        keys.wrong("time", list(truth.time), "seconds above 0 that rise from step to step")
    if len(truth.time) != len(truth.displacement):
        keys.wrong("time", f"{len(truth.time)} numbers", f"{len(truth.displacement)}, as many as displacements")


def _check_pictures(keys: Keys, truth: Truth) -> None:
    picture = Keys(keys.where, truth.picture, "picture.", keys.problems)
    extent = _extent_in_plane(picture) if truth.dim == 2 else _extent_in_space(picture, truth)
    _within(picture, "texture", 0.0, 1.0)
    _within(picture, "noise", 0.0, 1.0)
    correlation = picture.number("correlation", above=0.0)
    if correlation is not None and correlation > extent:
        picture.wrong("correlation", correlation, f"at most {extent:g} mm, the extent of the picture")
    steps = range(1, len(truth.displacement) + 1)
    pictured = picture.items("pictured")
    for number in pictured:
        if type(number) is not int or number not in steps or pictured.count(number) > 1:
            picture.wrong("pictured", number, f"steps from 1 to {len(truth.displacement)}, each once")
            break
    if truth.brick is not None:
        height = sum(layer["height"] for layer in truth.layers)
        if min(truth.brick) <= 0 or abs(height - truth.brick[2]) > 1e-9 * height:
            found = f"{list(truth.brick)} with layers of {height:g} mm in all"
            keys.problems.append(InputError(keys.where, "body.brick", found, "3 lengths, the last that of all layers"))


def _extent_in_plane(picture: Keys) -> float:
    """Side of a picture, mm."""
    pixels = picture.data["pixels"]
    if type(pixels) is not int or not 2 <= pixels <= PIXELS:
        picture.wrong("pixels", pixels, f"a whole number from 2 to {PIXELS}")
    _within(picture, "side", *LENGTHS)
    side = picture.data["side"]
    return float(side) if _is_number(side) and side > 0 else math.inf


def _extent_in_space(picture: Keys, truth: Truth) -> float:
    """Longest side of a volume, mm."""
    pixels = picture.numbers("pixels", 3)
    if pixels is not None and not all(n == int(n) and 2 <= n <= PIXELS for n in pixels):
        picture.wrong("pixels", list(pixels), f"3 whole numbers from 2 to {PIXELS}")
    spacing = picture.numbers("spacing", 3)
    if spacing is not None and not all(LENGTHS[0] <= s <= LENGTHS[1] for s in spacing):
        picture.wrong("spacing", list(spacing), "3 numbers above 0")
    if "origin" in truth.picture:
        picture.numbers("origin", 3)
    samples = truth.picture.get("samples", 1)
    if type(samples) is not int or not 1 <= samples <= 512:
        picture.wrong("samples", samples, "a whole number from 1 to 512")
    if pixels is None or spacing is None:
        return math.inf
    return max(n * s for n, s in zip(pixels, spacing, strict=True))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
