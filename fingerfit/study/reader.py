"""Reading a study's folder: study.yaml and the table of its steps. All problems are told at once."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.files import DOCUMENT, read_text
from fingerfit.core.keys import Keys, read_yaml
from fingerfit.core.units import LENGTHS, factor
from fingerfit.study.study import ESTIMATED, Body, Chain, Layer, Noise, Step, Study, wrong_name

KEYS = ("title", "units", "control", "steps", "pictures", "noise", "body", "boundary")
COLUMNS = ("step", "time", "displacement", "force", "force_noise", "picture", "points")


UNKNOWN = "unknown"
"""A thickness that is not known."""


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
    problems: list[FingerfitError] = []
    keys = Keys(file, read_yaml(file), "", problems)
    if problems:
        raise Problems(problems)
    if not set(keys.data) & set(KEYS):
        raise Problems([InputError(file, "file", "none of the keys of a study", "some of " + ", ".join(KEYS))])
    keys.known(*KEYS)
    sizes = _units(keys)
    control = keys.choice("control", ("force", "displacement"))
    boundary = keys.mapping("boundary")
    boundary.known("base", "indenter")
    base, base_nodes = _side(boundary, "base", ("held", "slides"), "BOTTOM")
    indenter, indenter_nodes = _side(boundary, "indenter", ("glued", "slides"), "TOP")
    pictures = keys.mapping("pictures", {})
    pictures.known("before", "noise", "trim", "resize", "gaussian", "scale")
    before = pictures.text("before", None)
    study = Study(
        path=file,
        title=keys.text("title", file.parent.name) or "",
        control=control,
        steps=_steps(keys, sizes, problems),
        before=file.parent / before if before else None,
        noise=_noise(keys.mapping("noise", {}), pictures, sizes),
        body=_body(keys.mapping("body"), sizes, file),
        base=base,
        indenter=indenter,
        length=sizes["length"],
        base_nodes=base_nodes,
        indenter_nodes=indenter_nodes,
        chain=_chain(pictures, sizes["length"]),
        table=file.parent / str(keys.data.get("steps")),
    )
    if not problems:
        _cross_check(study, problems)
    if problems:
        raise Problems(problems)
    return study


def _units(keys: Keys) -> dict[str, float]:
    units = keys.mapping("units")
    units.known("length", "force", "time")
    sizes = {}
    for kind in ("length", "force", "time"):
        name = units.text(kind)
        try:
            sizes[kind] = factor(kind, name, keys.where, f"units.{kind}") if name else 1.0
        except InputError as error:
            keys.problems.append(error)
            sizes[kind] = 1.0
    return sizes


def _side(boundary: Keys, key: str, kinds: tuple[str, ...], nodes: str) -> tuple[str, str]:
    """Kind of a boundary and its node set: ``base: held``, or ``base: {nodes: SET, kind: held}``."""
    if not isinstance(boundary.data.get(key), dict):
        return boundary.choice(key, kinds), nodes
    side = boundary.mapping(key)
    side.known("nodes", "kind")
    return side.choice("kind", kinds), (side.text("nodes") or nodes).upper()


def _noise(noise: Keys, pictures: Keys, sizes: Mapping[str, float]) -> Noise:
    noise.known("force", "displacement", "points", "force_gain", "frame")
    again = pictures.data.get("noise")

    def spread(keys: Keys, name: str, size: float) -> float | str | None:
        if keys.data.get(name) in (None, ESTIMATED):
            return keys.data.get(name)
        value = keys.number(name, above=0.0)
        return None if value is None else value * size

    return Noise(
        spread(noise, "force", sizes["force"]),
        spread(noise, "displacement", sizes["length"]),
        spread(noise, "points", sizes["length"]),
        _repeats(pictures, again) if isinstance(again, list) else spread(pictures, "noise", 1.0),
        (noise.number("force_gain", above=0.0) or 0.0) if "force_gain" in noise.data else 0.0,
        (noise.number("frame", above=0.0) or 0.0) * sizes["length"] if "frame" in noise.data else 0.0,
    )


def _repeats(pictures: Keys, names: list[object]) -> tuple[Path, ...]:
    """Further pictures before compression."""
    folder, found = pictures.where.parent, []
    for number, name in enumerate(names):
        if isinstance(name, str) and name.isprintable() and name.strip() and (folder / name).exists():
            found.append(folder / name)
        else:
            pictures.wrong(f"noise.{number}", name, "a further picture before compression, a file that exists")
    if not names:
        pictures.wrong("noise", "an empty list", "a number, estimated, or further pictures before compression")
    return tuple(found)


def _chain(pictures: Keys, length: float) -> Chain:
    """Preparation of the pictures; YAML reads ``off`` as false."""
    data, off = pictures.data, ("off", False)
    trim, resize, gaussian = data.get("trim", "body"), data.get("resize", "off"), data.get("gaussian")
    box = _box(trim, length)
    if trim in off:
        trim = "off"
    elif trim != "body" and box is None:
        pictures.wrong("trim", trim, "body, off, or [[x, y, z], [x, y, z]]: lower and upper corner of a box")
    if resize in off:
        resize = None
    elif not (
        isinstance(resize, list) and len(resize) in (2, 3) and all(type(n) is int and 2 <= n <= 4096 for n in resize)
    ):
        pictures.wrong("resize", resize, "off, or pixels along each axis: 2 or 3 whole numbers from 2 to 4096")
        resize = None
    if gaussian in off and gaussian is not None and type(gaussian) is not int:
        gaussian = 0.0
    elif gaussian is not None and not (type(gaussian) in (int, float) and 0 <= gaussian <= 20):
        pictures.wrong("gaussian", gaussian, "off, or a standard deviation in pixels from 0 to 20")
        gaussian = None
    scale = data.get("scale", "range")
    if scale != "range" and scale not in off:
        pictures.wrong("scale", scale, "range or off")
    return Chain(
        box or trim, tuple(resize) if resize else None, None if gaussian is None else float(gaussian), scale == "range"
    )


def _box(value: object, length: float) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Corners of a box in mm; None when it is none."""
    if not (isinstance(value, list) and len(value) == 2 and all(isinstance(corner, list) for corner in value)):
        return None
    low, high = value
    numbers = all(type(x) in (int, float) and abs(x) * length <= LENGTHS[1] for x in [*low, *high])
    if not numbers or len(low) != len(high) or len(low) not in (2, 3):
        return None
    if any(a >= b for a, b in zip(low, high, strict=True)):
        return None
    return tuple(x * length for x in low), tuple(x * length for x in high)


def _body(body: Keys, sizes: Mapping[str, float], file: Path) -> Body:
    body.known("layers", "width", "thickness", "origin", "brick", "mesh", "refined")
    size, layers, names = sizes["length"], list[Layer](), set[str]()
    mesh, brick, solid = body.text("mesh", None), body.numbers("brick", 3, None), body.data.get("brick") is not None
    for number, entry in enumerate(body.items("layers")):
        layer = Keys(body.where, entry, f"body.layers.{number}.", body.problems)
        layer.known("name", "height", "elements")
        name = layer.text("name") or f"layer{number}"
        if expected := wrong_name(name, names):
            layer.wrong("name", name, expected)
        names.add(name)
        height = None
        if solid and len(body.data["layers"]) == 1:
            height = layer.number("height", None, above=0.0)
        elif mesh is None:
            height = _length(layer, "height", size)
        layers.append(Layer(name, height * size if height else None, layer.text("elements", name.upper())))
    if body.data.get("layers") == []:
        body.wrong("layers", "none", "at least one layer")
    if (mesh is not None) + (brick is not None) + ("width" in body.data) > 1:
        found = " and ".join(key for key in ("width", "brick", "mesh") if key in body.data)
        body.problems.append(InputError(file, "body", found, "one of width (with layers), brick, mesh"))
    heights = [layer.height for layer in layers if layer.height is not None]
    if brick is not None and len(heights) == len(layers) and not math.isclose(sum(heights), brick[2] * size):
        body.wrong("layers", f"heights of {sum(heights) / size:g} in all", f"{brick[2]:g}, the height of the brick")
    if brick is not None and not all(LENGTHS[0] <= side * size <= LENGTHS[1] for side in brick):
        body.wrong("brick", list(brick), f"3 lengths of {LENGTHS[0]:g} to {LENGTHS[1]:g} mm")
        brick = None
    width = _length(body, "width", size) if mesh is None and not solid else None
    origin = body.numbers("origin", 2, (0.0, 0.0)) or (0.0, 0.0)
    thickness: float | None = 1.0
    thick, refined = body.data.get("thickness") != UNKNOWN, body.text("refined", None)
    if refined and mesh is None:
        body.wrong("refined", refined, "no such key: it is for a body with a mesh")
    if not thick and mesh is not None:
        thickness = 1.0 / size  # 1 mm
    elif mesh is not None:  # which says later whether it is plane
        thickness = _length(body, "thickness", size) if "thickness" in body.data else 0.0
    elif not solid:
        thickness = _length(body, "thickness", size)
    return Body(
        tuple(layers),
        width * size if width else None,
        (origin[0] * size, origin[1] * size),
        (thickness or 0.0) * size,
        (brick[0] * size, brick[1] * size, brick[2] * size) if brick else None,
        file.parent / mesh if mesh else None,
        file.parent / refined if refined else None,
        thick,
    )


def _length(keys: Keys, key: str, size: float) -> float | None:
    """A length that a body can have, in the study's unit of `size` mm."""
    value = keys.number(key, above=0.0)
    if value is not None and not LENGTHS[0] <= value * size <= LENGTHS[1]:
        keys.wrong(key, value, f"a length of {LENGTHS[0]:g} to {LENGTHS[1]:g} mm")
        return None
    return value


def _steps(keys: Keys, sizes: Mapping[str, float], problems: list[FingerfitError]) -> tuple[Step, ...]:
    name = keys.text("steps")
    if not name:
        return ()
    file = keys.where.parent / name
    try:
        text = read_text(file, "steps", DOCUMENT, "a readable CSV table")
        rows = [row for row in csv.reader(io.StringIO(text, newline="")) if any(cell.strip() for cell in row)]
    except InputError as error:
        problems.append(error)
        return ()
    except csv.Error as error:
        problems.append(InputError(file, "steps", error, "a readable CSV table"))
        return ()
    head = [cell.strip() for cell in rows[0]] if rows else []
    wrong = [column for n, column in enumerate(head) if column not in COLUMNS or column in head[:n]]
    if wrong or "step" not in head:
        found = wrong[0] if wrong else ",".join(head) or "an empty table"
        problems.append(InputError(file, "columns", found, "columns " + ", ".join(COLUMNS) + " (step is needed)"))
        return ()
    if len(rows) < 2:
        problems.append(InputError(file, "rows", "none", "a row for each step"))
    steps: list[Step] = []
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(head):
            problems.append(InputError(file, f"row {number}", f"{len(row)} cells", f"{len(head)} cells"))
            continue
        cells = {column: cell.strip() for column, cell in zip(head, row, strict=True)}
        step = _step(file, number, cells, sizes, problems)
        if step is None:
            continue
        _compare(file, number, steps[-1] if steps else None, step, problems)
        steps.append(step)
    return tuple(steps)


def _step(
    file: Path, row: int, cells: Mapping[str, str], sizes: Mapping[str, float], problems: list[FingerfitError]
) -> Step | None:
    values: dict[str, float | None] = {}
    kinds = (("time", "time"), ("displacement", "length"), ("force", "force"), ("force_noise", "force"))
    for column, kind in kinds:
        text = cells.get(column, "")
        values[column] = None
        if not text:
            continue
        try:
            given = math.nan if "_" in text else float(text)  # Python reads 1_0 as 10
        except ValueError:
            given = math.nan
        value = given * sizes[kind]
        if not math.isfinite(given):
            problems.append(InputError(file, f"row {row}, {column}", text, "a finite number"))
        elif column != "time" and value < 0:
            problems.append(InputError(file, f"row {row}, {column}", text, "0 or more: compression is positive"))
        elif not math.isfinite(value):
            problems.append(InputError(file, f"row {row}, {column}", text, "a number that is finite in N, mm and s"))
        elif column == "force_noise" and value == 0:
            problems.append(InputError(file, f"row {row}, {column}", text, "a standard deviation above 0"))
        else:
            values[column] = value
    if not cells["step"].isdecimal() or len(cells["step"]) > 9:
        problems.append(InputError(file, f"row {row}, step", cells["step"] or "nothing", "a whole number"))
        return None
    files = {}
    for column in ("picture", "points"):
        name = cells.get(column, "")
        files[column] = file.parent / name if name else None
        if name and not (name.isprintable() and (file.parent / name).exists()):
            problems.append(InputError(file, f"row {row}, {column}", name, "a file that exists"))
    return Step(
        int(cells["step"]),
        values["time"],
        values["displacement"],
        values["force"],
        files["picture"],
        files["points"],
        values["force_noise"],
    )


def _compare(file: Path, row: int, last: Step | None, step: Step, problems: list[FingerfitError]) -> None:
    if last is None:
        return
    if step.number <= last.number:
        problems.append(InputError(file, f"row {row}, step", step.number, f"a number above {last.number}"))
    if step.time is not None and last.time is not None and step.time <= last.time:
        problems.append(InputError(file, f"row {row}, time", f"{step.time:g}", f"more than {last.time:g} s"))


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
    response = "displacement" if study.control == "force" else "force"
    measured = [step for step in study.steps if getattr(step, response) is not None]
    if study.noise.force_gain and study.control == "force":
        problems.append(InputError(file, "noise.force_gain", f"{study.noise.force_gain:g} with control: force",
                                   "no such key: it is for measured forces, not for prescribed ones"))  # fmt: skip
    if not pictures and not measured and not any(step.points for step in study.steps):
        problems.append(InputError(file, "steps", "nothing measured beside the control",
                                   f"pictures, points or {response}"))  # fmt: skip


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


def with_gain(study: Study, gain: float) -> Study:
    """The study with the prescribed quantity multiplied."""
    name = study.control
    return replace(study, steps=tuple(replace(step, **{name: getattr(step, name) * gain}) for step in study.steps))
