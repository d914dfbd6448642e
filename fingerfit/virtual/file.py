"""Reading the description of a virtual experiment: its keys, and what they must be for each other."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.described import described
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.folders import template_folders
from fingerfit.core.keys import read_yaml, unknown_key
from fingerfit.deck.pieces import compressibility
from fingerfit.deck.render import is_template
from fingerfit.fit.check import wrong_element
from fingerfit.model.catalogue import catalogue, wrong_numbers
from fingerfit.model.laws import LAWS, OGDEN, impossible
from fingerfit.model.scales import bound, extent
from fingerfit.prepare.plausible import HEIGHT, too_deep
from fingerfit.solvers.registry import get_solver
from fingerfit.study.several import TESTS, each
from fingerfit.study.study import wrong_name
from fingerfit.virtual.keys import (
    BlockDescription,
    BrickExperiment,
    Experiment,
    MeshedDescription,
    MeshedExperiment,
    PictureDescription,
    PlaneExperiment,
)
from fingerfit.virtual.truth import Truth

_SINGLE = (float(np.finfo(np.float32).tiny), float(np.finfo(np.float32).max))
"""NIfTI-1, the files of the pictures, hold the distance of pixels and the place of the first in single precision."""
_DOUBLE = (sys.float_info.min, sys.float_info.max)


def read_truths(path: Path) -> dict[str, Truth]:
    """Read the description of an experiment: that of each test by its name, which is empty where there is one.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    data = read_yaml(path)
    return each(data, path, _read) if isinstance(data, dict) and TESTS in data else {"": _read(data, path)}


def read_truth(path: Path) -> Truth:
    """Read the description of an experiment of one test.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    return _read(read_yaml(path), path)


def _read(data: Any, path: Path) -> Truth:
    body = data.get("body") if isinstance(data, dict) else None
    shape = body if isinstance(body, dict) else {}
    kinds: dict[str, type[Experiment]] = {"width": PlaneExperiment, "brick": BrickExperiment, "mesh": MeshedExperiment}
    shapes = [key for key in kinds if key in shape]
    if len(shapes) > 1:  # which other keys there are depends on it
        raise Problems([InputError(path, "body", " and ".join(shapes), "one of width (with layers), brick, mesh")])
    kind = kinds[shapes[0] if shapes else "width"]
    given, problems = described(kind, data, path)
    problems += _cross_check(given, path)
    if problems:
        raise Problems(problems)
    return _truth(given, data, path)


def _truth(given: Any, data: dict[str, Any], path: Path) -> Truth:
    """What is sealed of it stays as it was written."""
    body = given.body.model_dump(by_alias=True, exclude_none=True)
    solid = not isinstance(given.body, BlockDescription)
    return Truth(
        title=given.title,
        layers=tuple(layer.model_dump() for layer in given.body.layers),
        width=body.get("width", 0.0),
        thickness=body.get("thickness", 0.0),
        material=dict(data["material"]),
        mesh=dict(data.get("mesh") or {}),
        solver=given.solver,
        displacement=tuple(given.displacement),
        picture=given.picture.model_dump(exclude_none=True),
        force_noise=given.noise.force,
        displacement_noise=given.noise.displacement,
        seed=given.seed,
        time=tuple(given.time or ()),
        effects=given.effects,
        own=path.parent / given.own if given.own else None,
        brick=tuple(body["brick"]) if "brick" in body else None,
        mesh_file=path.parent / given.body.mesh if "mesh" in body else None,
        tissues={name.upper(): value for name, value in body["tissues"].items()} if solid else {},
        drawn=tuple(body["drawn"]) if solid else (),
        template=given.template,
        boundary=(given.boundary.base, given.boundary.indenter),
        written=dict(data.get("study") or {}),
        path=path,
    )


def _cross_check(given: Any, path: Path) -> list[FingerfitError]:
    """Values that are right by themselves, but not with others, with the solver or with files."""

    def there(*names: str) -> bool:
        return all(hasattr(given, name) for name in names)

    problems: list[FingerfitError] = []
    if there("body"):
        problems += _body_problems(given.body, path)
    if there("material"):
        for name in ("alpha", "poisson"):
            problems += impossible(path, f"material.{name}", LAWS[OGDEN][name], getattr(given.material, name))
    if there("body", "material") and not problems:
        problems += _modulus_problems(given, path)
    if there("body", "mesh", "solver") or there("solver"):
        problems += _solver_problems(given, path)
    if there("body"):
        problems += _height_problems(given, path)
    if there("displacement", "time") and given.time and len(given.time) != len(given.displacement):
        found, expected = f"{len(given.time)} numbers", f"{len(given.displacement)}, as many as displacements"
        problems.append(InputError(path, "time", found, expected))
    if there("picture"):
        problems += _picture_problems(given, path)
    if there("own", "effects"):
        problems += _effect_problems(given, path, {} if problems else _sizes(given))
    if there("template") and not is_template(given.template, template_folders(path.parent)):
        problems.append(InputError(path, "template", given.template, "a template beside it or in templates/"))
    return problems


def _body_problems(body: Any, path: Path) -> Iterator[InputError]:
    for number, layer in enumerate(body.layers):
        if expected := wrong_name(layer.name, (above.name for above in body.layers[:number])):
            yield InputError(path, f"body.layers.{number}.name", layer.name, expected)
    if isinstance(body, MeshedDescription):
        if not (path.parent / body.mesh).exists():
            yield InputError(path, "body.mesh", body.mesh, "a file that exists")
        return
    block = isinstance(body, BlockDescription)
    sides = {"width": body.width, "thickness": body.thickness} if block else dict(enumerate(body.brick[:2]))
    for number, layer in enumerate(body.layers):
        lengths = {(f"body.{k}" if block else f"body.brick.{k}"): side for k, side in sides.items()}
        lengths[f"body.layers.{number}.height"] = layer.height
        one, two, three = lengths.values()
        if not _DOUBLE[0] <= one * two * three <= _DOUBLE[1]:
            # what is largest of too large a volume is at fault, and what is smallest of one that vanishes
            field = (max if one * two * three > 1 else min)(lengths, key=lengths.__getitem__)
            expected = f"a length with which the volume of layer {layer.name} is a number of double precision"
            yield InputError(path, field, lengths[field], expected)
            return
    height = sum(layer.height for layer in body.layers)
    if not block and abs(height - body.brick[2]) > 1e-9 * height:
        found = f"{body.brick} with layers of {height:g} mm in all"
        yield InputError(path, "body.brick", found, "3 lengths, the last that of all layers")


def _modulus_problems(given: Any, path: Path) -> Iterator[InputError]:
    for number, layer in enumerate(given.body.layers):
        # decks hold D, 2 over the bulk modulus
        d = compressibility(layer.mu, given.material.poisson)
        if not _DOUBLE[0] <= d <= _DOUBLE[1]:
            expected = "a shear modulus whose bulk modulus, and 1 over it, are numbers of double precision"
            yield InputError(path, f"body.layers.{number}.mu", layer.mu, expected)


def _solver_problems(given: Any, path: Path) -> list[FingerfitError]:
    try:
        get_solver(given.solver)
    except FingerfitError as error:
        return [FingerfitError(f"{path}: {error}")]
    if not hasattr(given, "body") or getattr(given, "mesh", None) is None:
        return []
    dim = 2 if isinstance(given.body, BlockDescription) else 3
    return wrong_element(given.mesh, dim, given.solver, path, "mesh.element")


def _height_problems(given: Any, path: Path) -> list[FingerfitError]:
    """Displacements, and errors of them, of the body's height; that of a mesh is known when it is read."""
    if isinstance(given.body, MeshedDescription):
        return []
    height = sum(layer.height for layer in given.body.layers)
    problems: list[FingerfitError] = []
    if hasattr(given, "displacement"):
        problems += too_deep(dict(enumerate(given.displacement, 1)), height, HEIGHT, path, "displacement")
    if hasattr(given, "noise") and given.noise.displacement >= height:
        expected = f"less than {height:.6g} mm, {HEIGHT}"
        problems.append(InputError(path, "noise.displacement", given.noise.displacement, expected))
    return problems


def _picture_problems(given: Any, path: Path) -> Iterator[InputError]:
    picture = given.picture
    if isinstance(picture, PictureDescription):
        longest = picture.side
        lengths, places = {"side": longest / picture.pixels}, {}
    else:
        longest = max(n * s for n, s in zip(picture.pixels, picture.spacing, strict=True))
        lengths = {f"spacing.{n}": s for n, s in enumerate(picture.spacing)}
        places = {f"origin.{n}": s for n, s in enumerate(picture.origin or ())}
    for name, value in {**lengths, **places}.items():
        if abs(value) > _SINGLE[1] or (name in lengths and value < _SINGLE[0]):
            expected = "one with which distances and places of pixels are numbers of single precision, as in NIfTI-1"
            yield InputError(path, f"picture.{name}", longest if name == "side" else value, expected)
    if picture.correlation > longest:
        yield InputError(
            path, "picture.correlation", picture.correlation, f"at most {longest:g} mm, the longest side of the picture"
        )
    count = len(given.displacement) if hasattr(given, "displacement") else None
    for number in picture.pictured:
        if count is not None and number > count:
            yield InputError(path, "picture.pictured", number, f"steps from 1 to {count}")


def _sizes(given: Any) -> dict[str, float]:
    """What effects may have shares of, as far as the description has it: of a mesh, which is in a file, nothing."""
    body: Any = getattr(given, "body", None)
    found: dict[str, float] = {}
    if isinstance(body, BlockDescription):
        found = extent([body.width, sum(layer.height for layer in body.layers)])
    elif getattr(body, "brick", None):
        found = extent(body.brick)
    return found | ({"duration": max(given.time)} if getattr(given, "time", None) else {})


def _effect_problems(given: Any, path: Path, sizes: dict[str, float]) -> list[FingerfitError]:
    own = path.parent / given.own if given.own else None
    if own is not None and not own.is_dir():
        return [InputError(path, "own", given.own, "a folder beside the description")]
    try:
        known = bound(catalogue(own), sizes)
    except FingerfitError as error:
        return [error]
    strange = [unknown_key(path, "effects.", name, sorted(known)) for name in given.effects if name not in known]
    numbers = {name: own for name, own in given.effects.items() if name in known}
    return [*strange, *wrong_numbers(numbers, known, path, "effects.")]
