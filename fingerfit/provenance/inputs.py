"""The files that a fit reads, wherever they are: what a study names, and templates with what they include."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from fingerfit.core.folders import OURS, template_folders
from fingerfit.deck.cards import includes, read_text
from fingerfit.study.reader import load_study
from fingerfit.study.study import Study

HEADERS = {".mhd", ".nhdr", ".hdr", ".img", ".xdmf", ".xmf"}
"""Endings of headers of pictures (MetaImage, NRRD, Analyze) and meshes (XDMF) whose numbers are in another file."""
HEAD = 1 << 20
"""Bytes of a header that are looked at: names of slices need some ten each, and pixels may follow."""
_PART = re.compile(r"""{%-?\s*(?:include|import|from|extends)\s+["']([^"']+)["']""")


def study_files(folder: Path) -> list[str]:
    """All files of a study that a fit reads, those outside of its folder included, each once.

    The sealed truth is not among them, because no study names it; nor is anything else that no fit reads.

    Raises
    ------
    FingerfitError
        For a study that cannot be read.
    """
    found = [path for test in load_study(folder).every for path in _files_of(test)]
    return list(dict.fromkeys(_plain(path) for path in found if path.is_file()))


def template_files(study: Path) -> list[Path]:
    """All templates of decks and effects, those of the study and of installed packages included, with what they name.

    Parameters
    ----------
    study : Path
        Folder of the study.
    """
    folders = template_folders(study)
    own, ours, *packages = folders
    found = [path for path in ours.rglob("*.j2") if path.relative_to(ours).parts[0] != "report"]
    found += [*ours.rglob("*.yaml"), *own.rglob("*.j2"), *own.glob("effects/*.yaml")]
    found += [path for folder in packages for path in folder.glob("effects/*")]
    files = dict.fromkeys(sorted(path for path in found if path.is_file()))
    for path in list(files):
        if not path.is_relative_to(ours):
            files |= dict.fromkeys(_named(path, folders, set()))
    return list(files)


def page_files() -> list[Path]:
    """Templates of the page."""
    return sorted(path for path in (OURS / "report").rglob("*") if path.is_file())


def _files_of(study: Study) -> list[Path]:
    named = [study.path, *filter(None, (study.table, study.before)), *_of_steps(study)]
    if isinstance(study.noise.picture, tuple):
        named += study.noise.picture
    for region in study.body.regions:
        named += filter(None, (region.table, region.labels))
    found = [part for path in named for part in _with_parts(path)]
    for mesh in filter(None, (study.body.mesh, study.body.refined)):
        found += [*_with_parts(mesh), *(_included(mesh, set()) if mesh.suffix.lower() == ".inp" else ())]
    return found


def _of_steps(study: Study) -> Iterator[Path]:
    for step in study.steps:
        yield from filter(None, (step.picture, step.points))


def _with_parts(path: Path) -> list[Path]:
    """A file with those that belong to it: of a folder (DICOM) all, of a header those it names or is named like."""
    if path.is_dir():
        return sorted(part for part in path.iterdir() if part.is_file())
    if path.suffix.lower() not in HEADERS:
        return [path]
    beside = [part for part in sorted(path.parent.iterdir()) if part.is_file()]
    with path.open("rb") as stream:
        text = stream.read(HEAD).decode("latin-1")
    if "%" in text:  # a pattern for the names of slices
        return [path, *beside]
    return [path, *(part for part in beside if part.stem == path.stem or part.name in text)]


def _included(path: Path, seen: set[Path]) -> Iterator[Path]:
    """Files that a mesh in keywords includes, and those that these include."""
    for name in includes(read_text(path)):
        inner = path.parent / name
        if inner not in seen and inner.is_file():
            seen.add(inner)
            yield inner
            yield from _included(inner, seen)


def _named(template: Path, folders: Iterable[Path], seen: set[Path]) -> Iterator[Path]:
    """Files that a template includes: parts of it, and decks by their whole path."""
    text = read_text(template)
    parts = (next((f / name for f in folders if (f / name).is_file()), None) for name in _PART.findall(text))
    decks = (path for path in map(Path, includes(text)) if path.is_absolute() and path.is_file())
    for path in [*filter(None, parts), *decks]:
        if path not in seen:
            seen.add(path)
            yield path
            yield from _named(path, folders, seen)


def _plain(path: Path) -> str:
    """A path without ``..``, where that is the same file."""
    plain = Path(os.path.normpath(path))
    return str(plain if plain.exists() and plain.samefile(path) else path)
