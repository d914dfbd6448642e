"""A finger described in a file, and the mesh of it in another."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import create_model

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.core.described import Strict, described
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.files import write_text
from fingerfit.core.keys import read_yaml
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.mesh.mesh import Mesh
from fingerfit.mesh.tetrahedra import quality


def read_anatomy(path: Path) -> Anatomy:
    """Numbers of a finger from a YAML file; those that are not there are the reference's.

    Raises
    ------
    Problems, InputError
        For keys that are not known, what is no number, and bones that do not fit.
    """
    numbers: dict[str, Any] = {field.name: (float, field.default) for field in fields(Anatomy)}
    given, problems = described(create_model("Numbers", __base__=Strict, **numbers), read_yaml(path), path)
    if problems:
        raise Problems(problems)
    try:
        return Anatomy(**given.model_dump())
    except InputError as error:
        raise FingerfitError(f"{path}: {error}") from error


def write_finger(
    out: Path, anatomy: Path | None, size: float, element: str, across: int, at: tuple[float, float] | None
) -> str:
    """Mesh a finger with the indenter's place and the tube, and tell about it.

    Parameters
    ----------
    out : Path
        The .inp file.
    anatomy : Path or None
        File of numbers; the reference finger without one.
    size, element, across
        As `finger_mesh` takes them.
    at : (float, float) or None
        Where the indenter comes down, x and y, mm; the middle of the pulp when left out.
    """
    numbers = Anatomy() if anatomy is None else read_anatomy(anatomy)
    mesh = finger_mesh(numbers, size, element, across)
    write_text(out, format_mesh(add_fixtures(mesh, at or (numbers.pulp_centre, 0.0))))
    return f"{out}: {quality(mesh)}"


def read_finger(path: Path) -> Mesh:
    """A finger's mesh without the nodes of indenter and tube, if it has them.

    Raises
    ------
    InputError
        When it cannot be read, or has sets or surfaces missing.
    """
    mesh = read_mesh(path)
    for kind, names, there in (
        ("node set", ("END", "NAIL", "BONE_SURFACE", "EPIDERMIS_OUTER", "EPIDERMIS_INNER"), mesh.node_sets),
        ("element set", ("EPIDERMIS", "SUBCUTANEOUS", "DISTAL", "BONE", "NAIL"), mesh.element_sets),
        ("surface", ("SKIN",), mesh.surfaces),
    ):
        for name in names:
            if name not in there:
                raise InputError(path, f"{kind} {name}", "nothing", "a mesh that `fingerfit finger` wrote")
    count = len(mesh.body)
    sets = {name: members for name, members in mesh.node_sets.items() if np.all(members < count)}
    surfaces = {name: faces for name, faces in mesh.surfaces.items() if name not in ("PALMAR", "DORSAL")}
    return Mesh(mesh.points[:count], mesh.blocks, sets, mesh.element_sets, surfaces)


def tissues_of(text: str, option: str = "--labels") -> dict[int, str]:
    """Labels of a segmentation and their tissues, from ``1=EPIDERMIS,2=SUBCUTANEOUS`` after an option.

    >>> tissues_of("1=epidermis,3=distal")
    {1: 'EPIDERMIS', 3: 'DISTAL'}

    Raises
    ------
    InputError
        When it is written in another way.
    """
    found = {}
    for part in text.split(","):
        label, sign, name = part.partition("=")
        if not (sign and label.strip().isdigit() and name.strip()):
            raise InputError(option, "label", part or "nothing", "NUMBER=TISSUE, several with commas")
        found[int(label)] = name.strip().upper()
    return found
