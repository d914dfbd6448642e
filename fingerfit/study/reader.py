"""Reading a study's folder, from study.yaml on. All problems are told at once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from fingerfit.core.described import described
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.keys import read_yaml
from fingerfit.core.units import LENGTHS, UNITS
from fingerfit.study.direction import oblique_problems, wrong_axes
from fingerfit.study.keys import (
    KINDS,
    NUMBER,
    BlockKeys,
    BlockStudy,
    BrickKeys,
    MeshKeys,
    NoiseKeys,
    PictureKeys,
)
from fingerfit.study.regions import read_outline
from fingerfit.study.several import TESTS, several
from fingerfit.study.steps import read_steps
from fingerfit.study.study import UNKNOWN, Body, Chain, Layer, Noise, Region, Step, Study, wrong_name


def study_path(path: Path) -> Path:
    """The study's file, from the file or its folder."""
    return path / "study.yaml" if path.is_dir() else path


def load_study(path: Path) -> Study:
    """Read a study; pictures are not opened.

    Parameters
    ----------
    path : Path
        ``study.yaml`` or the folder it is in.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    file = study_path(path)
    data = read_yaml(file)
    return several(data, file, _load) if isinstance(data, dict) and TESTS in data else _load(data, file)


def _load(data: Any, file: Path) -> Study:
    """The study of one test."""
    known = set(BlockStudy.model_fields)
    if isinstance(data, dict) and not known & set(data):
        expected = "some of " + ", ".join(BlockStudy.model_fields)
        raise Problems([InputError(file, "file", "none of the keys of a study", expected)])
    body = data.get("body") if isinstance(data, dict) else None
    shapes = [key for key in KINDS if isinstance(body, dict) and key in body]
    kind, several = KINDS[shapes[0] if shapes else "width"], len(shapes) > 1
    given, problems = described(kind, data, file, ["body"] if several else [])
    if several:
        problems.append(InputError(file, "body", " and ".join(shapes), "one of width (with layers), brick, mesh"))
    sizes = _sizes(given)
    steps = read_steps(file.parent / given.steps, sizes, problems) if hasattr(given, "steps") else ()
    problems += _look_further(given, sizes, file)
    if problems:
        raise Problems(problems)
    study = _study(given, steps, sizes, file)
    _cross_check(study, problems)
    if problems:
        raise Problems(problems)
    return study


def _sizes(given: Any) -> dict[str, float]:
    """Sizes of the units; 1 where they are not known."""
    units = getattr(given, "units", None)
    return {kind: UNITS[kind][getattr(units, kind)] if units else 1.0 for kind in UNITS}


def _study(given: Any, steps: tuple[Step, ...], sizes: Mapping[str, float], file: Path) -> Study:
    pictures, length = given.pictures or PictureKeys(), sizes["length"]
    pusher = given.boundary.indenter
    (base, base_nodes), (indenter, indenter_nodes) = (
        (side, own) if isinstance(side, str) else (side.kind, side.nodes.upper())
        for side, own in ((given.boundary.base, "BOTTOM"), (pusher, "TOP"))
    )
    return Study(
        path=file,
        title=given.title or file.parent.name,
        control=given.control,
        steps=steps,
        before=file.parent / pictures.before if pictures.before else None,
        noise=_noise(given.noise or NoiseKeys(), pictures, sizes, file.parent),
        body=_body(given.body, length, file),
        base=base,
        indenter=indenter,
        length=length,
        base_nodes=base_nodes,
        indenter_nodes=indenter_nodes,
        chain=_chain(pictures, length),
        table=file.parent / given.steps,
        template=given.template or "",
        direction=_unit(None if isinstance(pusher, str) else pusher.direction),
    )


def _noise(noise: NoiseKeys, pictures: PictureKeys, sizes: Mapping[str, float], folder: Path) -> Noise:
    def spread(value: float | str | None, size: float) -> float | str | None:
        return value if value is None or isinstance(value, str) else value * size

    again, length = pictures.noise, sizes["length"]
    return Noise(
        spread(noise.force, sizes["force"]),
        spread(noise.displacement, length),
        spread(noise.points, length),
        tuple(folder / name for name in again) if isinstance(again, list) else again,
        noise.force_gain or 0.0,
        (noise.frame or 0.0) * length,
    )


def _chain(pictures: PictureKeys, length: float) -> Chain:
    trim, resize, gaussian = pictures.trim, pictures.resize, pictures.gaussian
    return Chain(
        trim if isinstance(trim, str) else (_scaled(trim[0], length), _scaled(trim[1], length)),
        None if isinstance(resize, str) else tuple(resize),
        0.0 if isinstance(gaussian, str) else gaussian,
        pictures.scale == "range",
        (pictures.blur or 0.0) * length,
    )


def _unit(direction: list[float] | None) -> tuple[float, ...]:
    """A unit vector; nothing for straight down."""
    if direction is None or not any(direction[:-1]):
        return ()
    return _scaled(direction, 1.0 / math.hypot(*direction))


def _scaled(numbers: Iterable[float], size: float) -> tuple[float, ...]:
    return tuple(number * size for number in numbers)


def _body(body: Any, size: float, file: Path) -> Body:
    meshed = isinstance(body, MeshKeys)
    layers = tuple(
        Layer(
            layer.name,
            layer.height * size if layer.height and not meshed else None,
            layer.elements or layer.name.upper(),
        )
        for layer in body.layers
    )
    regions = tuple(_region(region, size, file, number) for number, region in enumerate(body.regions))
    if isinstance(body, BrickKeys):
        length, width, height = _scaled(body.brick, size)
        return Body(layers, brick=(length, width, height), regions=regions)
    if isinstance(body, BlockKeys):
        x, y = _scaled(body.origin or (0.0, 0.0), size)
        return Body(layers, body.width * size, (x, y), body.thickness * size, regions=regions)
    thick = body.thickness != UNKNOWN
    return Body(
        layers,
        thickness=(body.thickness or 0.0) * size if thick else 1.0,
        mesh=file.parent / body.mesh,
        refined=file.parent / body.refined if body.refined else None,
        thick=thick,
        types=tuple(body.types),
        regions=regions,
    )


def _region(region: Any, size: float, file: Path, number: int) -> Region:
    outline, field = region.outline, f"body.regions.{number}.outline"
    return Region(
        region.name,
        read_outline(outline, size, file, field) if outline else (),
        file.parent / outline if isinstance(outline, str) else None,
        file.parent / region.labels if region.labels else None,
        region.label or 1,
        region.elements,
    )


def _region_problems(body: Any, size: float, file: Path) -> Iterator[InputError]:
    for number, region in enumerate(body.regions):
        field = f"body.regions.{number}"
        if expected := wrong_name(region.name, (one.name for one in (*body.layers, *body.regions[:number]))):
            yield InputError(file, f"{field}.name", region.name, expected.replace("layer", "layer or region"))
        given = [key for key in ("outline", "labels", "elements") if getattr(region, key)]
        if len(given) != 1:
            yield InputError(file, field, " and ".join(given) or "nothing", "one of outline, labels, elements")
        elif region.label and not region.labels:
            yield InputError(file, f"{field}.label", region.label, "no such key beside " + given[0])
        elif region.elements and not isinstance(body, MeshKeys):
            yield InputError(file, f"{field}.elements", region.elements, "outline or labels: the body has no mesh file")
        elif region.labels and not (file.parent / region.labels).exists():
            yield InputError(file, f"{field}.labels", region.labels, "a file that exists")
        elif region.outline:
            try:
                read_outline(region.outline, size, file, f"{field}.outline")
            except InputError as error:
                yield error


def _look_further(given: Any, sizes: Mapping[str, float], file: Path) -> Iterator[InputError]:
    """Values that are right by themselves, but not with others, with their unit or with files."""
    length, pictures = sizes["length"], getattr(given, "pictures", None)
    if hasattr(given, "body"):
        yield from _body_problems(given.body, length if hasattr(given, "units") else None, file)
    if pictures and isinstance(pictures.noise, list):
        for number, name in enumerate(pictures.noise):
            if not (file.parent / name).exists():
                expected = "a further picture before compression, a file that exists"
                yield InputError(file, f"pictures.noise.{number}", name, expected)
    corners = pictures.trim if pictures and isinstance(pictures.trim, list) else []
    if any(abs(x) * length > LENGTHS[1] for corner in corners for x in corner):
        yield InputError(file, "pictures.trim", corners, f"corners of at most {LENGTHS[1]:g} mm")


def _body_problems(body: Any, size: float | None, file: Path) -> Iterator[InputError]:
    for number, layer in enumerate(body.layers):
        if expected := wrong_name(layer.name, (above.name for above in body.layers[:number])):
            yield InputError(file, f"body.layers.{number}.name", layer.name, expected)
    yield from _region_problems(body, size or 1.0, file)
    lengths = {name: getattr(body, name, None) for name in ("width", "thickness")}
    heights = [None if isinstance(body, MeshKeys) else layer.height for layer in body.layers]
    lengths |= {f"layers.{number}.height": height for number, height in enumerate(heights)}
    lengths |= {f"brick.{number}": side for number, side in enumerate(getattr(body, "brick", ()))}
    for name, value in lengths.items():
        if size and isinstance(value, float) and not LENGTHS[0] <= value * size <= LENGTHS[1]:
            yield InputError(file, f"body.{name}", value, f"a length of {LENGTHS[0]:g} to {LENGTHS[1]:g} mm")
    if not isinstance(body, BrickKeys):
        return
    known = [height for height in heights if height]
    if len(heights) > 1:
        for number, height in enumerate(heights):
            if height is None:
                yield InputError(file, f"body.layers.{number}.height", "nothing", NUMBER)
    if len(known) == len(heights) and not math.isclose(sum(known), body.brick[2]):
        expected = f"{body.brick[2]:g}, the height of the brick"
        yield InputError(file, "body.layers", f"heights of {sum(known):g} in all", expected)


def _cross_check(study: Study, problems: list[FingerfitError]) -> None:
    file = study.path
    for step in study.steps:
        if getattr(step, study.control) is None:
            problems.append(InputError(file, "steps", f"step {step.number} without {study.control}",
                                       f"the {study.control} of every step, since it is the control"))  # fmt: skip
    pictures = [step for step in study.steps if step.picture]
    if pictures and study.before is None:
        problems.append(InputError(file, "pictures.before", "nothing", "the picture before compression"))
    if study.before is not None and not study.before.exists():
        problems.append(InputError(file, "pictures.before", study.before.name, "a file that exists"))
    for key, path in (("mesh", study.body.mesh), ("refined", study.body.refined)):
        if path is not None and not path.exists():
            problems.append(InputError(file, f"body.{key}", path.name, "a file that exists"))
    _check_sets(study, problems)
    problems += oblique_problems(study)
    if study.body.mesh is None:
        problems += wrong_axes(study, 3 if study.body.brick else 2)
    measured = any(study.measures(step) for step in study.steps)
    if study.noise.force_gain and study.control == "force":
        problems.append(InputError(file, "noise.force_gain", f"{study.noise.force_gain:g} with control: force",
                                   "no such key: it is for measured forces, not for prescribed ones"))  # fmt: skip
    if not pictures and not measured and not any(step.points for step in study.steps):
        problems.append(InputError(file, "steps", "nothing measured beside the control",
                                   f"pictures, points or {study.response}"))  # fmt: skip


def _check_sets(study: Study, problems: list[FingerfitError]) -> None:
    """Names of sets of a mesh: one for each layer and each side, and none where there is no mesh."""
    file, sides = study.path, {"base": study.base_nodes, "indenter": study.indenter_nodes}
    if study.body.mesh is None:
        for (side, nodes), own in zip(sides.items(), ("BOTTOM", "TOP"), strict=True):
            if nodes != own:
                expected = f"{own}, or a body with a mesh of its own"
                problems.append(InputError(file, f"boundary.{side}.nodes", nodes, expected))
        return
    if study.base_nodes == study.indenter_nodes:
        expected = f"other nodes than the base, {study.base_nodes}"
        problems.append(InputError(file, "boundary.indenter.nodes", study.indenter_nodes, expected))
    sets = [(layer.elements or layer.name).upper() for layer in study.body.layers]
    for number, name in enumerate(sets):
        if name in sets[:number]:
            field, expected = f"body.layers.{number}.elements", "an element set that no other layer has"
            problems.append(InputError(file, field, name, expected))
