"""Where our files are, in a clone and installed; and templates: in a study's folder, ours, those of other packages."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

from fingerfit.core.errors import InputError

PACKAGE = Path(__file__).resolve().parents[1]
CLONE = not (PACKAGE / "shipped").is_dir()
SHIPPED = PACKAGE.parent if CLONE else PACKAGE / "shipped"
"""Folder of Snakefile, workflow, templates and examples: the root of a clone, which setup.py puts into the package."""
OURS = SHIPPED / "templates"
GROUP = "fingerfit.effects"


def template_folders(*own: Path) -> list[Path]:
    """Folders in the order in which templates are looked for: a study's own, ours, those of packages."""
    return [*own, OURS, *offered()]


@cache
def offered() -> tuple[Path, ...]:
    """Folders of installed packages that offer effects, by the entry point group ``fingerfit.effects``.

    The entry point's value is the name of a package with a folder ``effects`` in it, as a study has. Nothing of the
    package is executed, only its files are read.

    Raises
    ------
    InputError
        For a package that is not there or has no such folder.
    """
    found = []
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        # a package inside another one would have that one imported
        spec = find_spec(entry.value) if entry.value.isidentifier() else None
        folders = [Path(place) for place in (spec.submodule_search_locations or () if spec else ())]
        if not any((folder / "effects").is_dir() for folder in folders):
            expected = "the name of an installed package with a folder effects"
            raise InputError(f"entry point {entry.name}", GROUP, entry.value, expected)
        found += folders
    return tuple(found)
