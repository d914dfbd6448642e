"""A draft of a study from a folder of pictures and a table of forces; what is uncertain is marked."""

from __future__ import annotations

import csv
import io
import itertools
import os
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import write_text
from fingerfit.core.folders import OURS, SHIPPED
from fingerfit.core.units import UNITS
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.readers.dicom import find_series
from fingerfit.readers.points import natural
from fingerfit.start.forces import Forces, read_forces

MARK = "# CHECK"
FILES = ("study.yaml", "steps.csv", "config.yaml")
_BEFORE = re.compile(r"before|undeformed|unloaded|reference|initial|rest", re.I)
_ESTIMATED = 6
"""Steps from which noise can be estimated, see `fingerfit.prepare.prepare`."""


def draft(study: Path, pictures: Path, forces: Path) -> list[str]:
    """Write study.yaml, steps.csv and config.yaml of a new study; returns what to tell.

    Parameters
    ----------
    study : Path
        Its folder; other files in it stay.
    pictures : Path
        Folder with one picture before compression and some during it; they stay where they are.
    forces : Path
        Table with a head and a row for each step, see `fingerfit.start.forces.read_forces`.

    Raises
    ------
    FingerfitError
        For files that are there already, and what cannot be read.
    """
    refuse_known(study)
    before, others, links, order = _pictures(pictures, study)
    table = read_forces(forces)
    steps = _step_numbers(table)
    named, pairing = _paired(steps, others, order)
    named = {number: Path(os.path.relpath(path, study)) for number, path in named.items()}
    first = _first(before, links)
    facts = {
        "sources": f"{pictures.as_posix()} and {forces.as_posix()}",
        "before": Path(os.path.relpath(before, study)).as_posix(),
        "pairing": f"pictures and steps: {pairing}",
        "table": table,
        "kind": _kind(first),
        "box": _box(first, UNITS["length"][table.units.get("length", "mm")]),
        "pixel": " x ".join(f"{size:.4g}" for size in first.spacing),
        "measured": sorted(named),
    }
    files = {number: path.as_posix() for number, path in named.items()}
    return write_draft(study, facts, {"steps.csv": steps_text(table, steps, "picture", files)}, links)


def write_draft(
    study: Path, facts: Mapping[str, Any], texts: Mapping[str, str], links: Mapping[Path, Sequence[Path]] | None = None
) -> list[str]:
    """Write study.yaml and, where there is none, config.yaml, with other files; returns what to tell.

    Parameters
    ----------
    study : Path
    facts : dict
        For the templates of a draft: ``sources``, ``pairing``, ``table``, ``kind``, ``box``, ``measured`` (steps with
        pictures or points), ``before`` and ``pixel`` of pictures or ``points``, and ``given``, texts of known keys.
    texts : dict
        Further files by their name in the folder.
    links : dict or None
        Folders, with the files that they get links to.
    """
    measured, table = facts["measured"], facts["table"]
    common = {
        "study": study.as_posix(),
        "name": study.name,
        "units": {"length": "mm", "force": "N", "time": "s"} | dict(table.units),
        "noise": _noise(table),
        "held_out": measured[-2::-2][::-1] if len(measured) > 3 else [],
        "fitted": measured[::-2][::-1] if len(measured) > 3 else [],
        "before": None,
        "points": None,
    }
    known = dict.fromkeys(("title", "control", "noise", "body", "boundary"), "") | facts.get("given", {})
    own = [name for name in ("study.yaml", "config.yaml") if not (study / name).exists()]
    made = {name: _render(f"{name}.j2", common | dict(facts) | {"given": known}) for name in own} | dict(texts)
    for folder, files in (links or {}).items():
        _link(folder, files)
    for name, text in made.items():
        write_text(study / name, text)
    told = [f"{study / name}" for name in FILES if name in made]
    told += [f"{study / name}: is there already and is kept" for name in FILES if name not in made]
    marks = sum(text.count(MARK) for text in made.values())
    return [*told, f"{marks} lines are marked {MARK}: look at each of them"]


def example(study: Path, name: str) -> list[str]:
    """Copy one of the example studies, with settings for it; returns what to tell.

    Raises
    ------
    FingerfitError
        For an example that is not known, and for files that are there already.
    """
    folder = SHIPPED / "studies" / name
    if name not in (known := examples()):
        raise InputError("--example", "name", name, "one of " + ", ".join(known))
    refuse_known(study)
    own = folder / "study.yaml"
    shutil.copytree(folder / "pictures", study / "pictures", dirs_exist_ok=True)
    for path in (own, folder / "steps.csv"):
        write_text(study / path.name, path.read_text(encoding="utf-8"))
    config = (SHIPPED / "config.yaml").read_text(encoding="utf-8")
    write_text(study / "config.yaml", re.sub(r"^study: .*$", f"study: {study.as_posix()}", config, flags=re.M))
    return [f"{study / file}" for file in FILES]


def examples() -> list[str]:
    """Names of the example studies that come with their pictures and can be fitted at once."""
    return sorted(path.parent.name for path in (SHIPPED / "studies").glob("*/pictures") if _plane(path.parent))


def _plane(folder: Path) -> bool:
    """Whether a study is in the plane, for which config.yaml is."""
    return (folder / "study.yaml").is_file() and not (folder / "config.yaml").exists()


def refuse_known(study: Path, files: Sequence[str] = FILES) -> None:
    """Refuse to write over a study.

    Raises
    ------
    FingerfitError
        For a file that is there already.
    """
    for name in files:
        if (study / name).exists():
            raise FingerfitError(f"{study / name}: is there already; take another folder, or remove it")


def _pictures(folder: Path, study: Path) -> tuple[Path, list[Path], dict[Path, Sequence[Path]], str]:
    """The picture before compression, the others in order, links to make for some, and what their order is."""
    if not folder.is_dir():
        raise InputError("--pictures", "folder", folder, "a folder with pictures")
    found = sorted((p for p in folder.iterdir() if _is_picture(p)), key=lambda path: natural(path.name))
    links: dict[Path, Sequence[Path]] = {}
    order = "in the order of their names"
    if all(path.is_dir() for path in found) and (series := find_series(folder)):
        found, order = [one.files[0].parent for one in series], "in the order in which they were acquired"
        if len(set(found)) < len(found):  # several series in a folder: each gets one of its own
            links = {study / f"pictures/{one.text or 'series'}_{n}": one.files for n, one in enumerate(series)}
            found = list(links)
    if len(found) < 2:
        expected = "one before compression and at least one during it (.nii.gz, .nrrd, .mha, ... or folders of DICOM)"
        raise InputError(folder, "pictures", f"{len(found)} pictures", expected)
    before = next((path for path in found if _BEFORE.search(path.name)), found[0])
    return before, [path for path in found if path != before], links, order


def _link(folder: Path, files: Sequence[Path]) -> Path:
    folder.mkdir(parents=True)
    for file in files:
        (folder / file.name).symlink_to(os.path.relpath(file, folder))
    return folder


def _first(picture: Path, links: Mapping[Path, Sequence[Path]]) -> Picture:
    if picture not in links:
        return read_picture(picture)
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as name:
        return read_picture(_link(Path(name).resolve() / picture.name, [file.resolve() for file in links[picture]]))


def _is_picture(path: Path) -> bool:
    """Whether ITK may read it: of headers with pixels beside them only the header counts."""
    if path.name.startswith("."):
        return False
    if path.is_dir():
        return any(part.is_file() for part in path.iterdir())
    endings = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".hdr", ".png", ".tif", ".tiff", ".bmp", ".jpg")
    return path.name.lower().endswith(endings)


def _step_numbers(table: Forces) -> list[int]:
    given = table.columns.get("step", [])
    numbers = [int(value) for value in given if value == int(value) and value >= 0]
    rising = len(numbers) == len(given) > 0 and all(a < b for a, b in itertools.pairwise(numbers))
    return numbers if rising else list(range(1, len(table.columns["force"]) + 1))


def _paired(steps: Sequence[int], pictures: Sequence[Path], order: str) -> tuple[dict[int, Path], str]:
    """Pictures by step, and how that was found out in words."""
    numbers = [int(found[-1]) if (found := re.findall(r"\d+", _stem(path))) else -1 for path in pictures]
    if len(set(numbers)) == len(numbers) and set(numbers) <= set(steps):
        return dict(zip(numbers, pictures, strict=True)), "by the number in its name"
    if len(pictures) == len(steps):
        return dict(zip(steps, pictures, strict=True)), order
    names = ", ".join(path.name for path in pictures)
    return {}, f"none: {len(pictures)} pictures ({names}) and {len(steps)} steps; fill in the column picture"


def _stem(path: Path) -> str:
    return path.name.split(".")[0]


def _noise(table: Forces) -> dict[str, str]:
    """Standard deviation of the readings as it can be known: estimated from many, else a share of the largest."""
    many = len(table.columns["force"]) >= _ESTIMATED and "displacement" in table.columns
    names = [name for name in ("force", "displacement") if name in table.columns]
    return {name: "estimated" if many else f"{0.01 * max(map(abs, table.columns[name])):.3g}" for name in names}


def _box(picture: Picture, unit: float = 1.0) -> dict[str, list[float]]:
    """Lower corner and sizes of the largest part that is bright, to three digits, in a unit of so many mm."""
    import SimpleITK as sitk

    bright = sitk.OtsuThreshold(sitk.GetImageFromArray(picture.values), 0, 1)
    parts = sitk.RelabelComponent(sitk.ConnectedComponent(bright), sortByObjectSize=True)
    found = np.argwhere(sitk.GetArrayFromImage(parts) == 1)[:, ::-1]
    if not len(found):
        found = np.argwhere(np.ones(picture.values.shape))[:, ::-1]
    corners = picture.to_points(np.array([found.min(axis=0) - 0.5, found.max(axis=0) + 0.5]))
    low, high = corners.min(axis=0), corners.max(axis=0)
    return {"low": [_short(x / unit) for x in low], "size": [_short(x / unit) for x in high - low]}


def _short(value: float) -> float:
    return float(f"{value:.3g}")


def _kind(picture: Picture) -> str:
    """What the body is drafted as: a block in the plane, a brick where it stands at the origin, else a mesh."""
    if picture.dim == 2:
        return "block"
    box = _box(picture)
    near = all(abs(x) <= 0.1 * size for x, size in zip(box["low"], box["size"], strict=True))
    return "brick" if near else "mesh"


def steps_text(table: Forces, steps: Sequence[int], kind: str, files: Mapping[int, str]) -> str:
    """Text of steps.csv; `kind` is ``picture``, ``points`` or empty, with the files of the steps."""
    kinds = [name for name in ("time", "displacement", "force") if name in table.columns]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["step", *kinds, *[kind] * bool(kind)])
    for place, number in enumerate(steps):
        values = [f"{table.columns[name][place]:.10g}" for name in kinds]
        writer.writerow([number, *values, *[files.get(number, "")] * bool(kind)])
    return out.getvalue()


def _render(name: str, facts: Mapping[str, Any]) -> str:
    from jinja2 import FileSystemLoader, StrictUndefined
    from jinja2.sandbox import SandboxedEnvironment

    loader = FileSystemLoader(OURS / "draft")
    environment = SandboxedEnvironment(
        loader=loader, undefined=StrictUndefined, autoescape=False, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.get_template(name).render(facts, mark=MARK)
