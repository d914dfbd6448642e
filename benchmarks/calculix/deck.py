"""Input deck of CalculiX for a body that is compressed step by step. Lengths in mm, moduli in MPa."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from body import Body, Material

FRONT = "NZ0"
"""Set of the nodes with z = 0, whose displacements are printed."""
CONTACT = 300
"""Stiffness of a contact times the width of an element, over the largest modulus."""
STICK = 0.2
"""Stiffness of sticking friction over that of the contact."""


def deck(body: Body, indentations: Sequence[float]) -> str:
    """The deck; the indentations (steps,) in mm are those from the body without load on."""
    lines = [*_mesh(body), *_materials(body), *_sets(body), *_springs(body)]
    if body.friction is not None or body.gap is not None:
        lines += _contacts(body, len(body.mesh.elements) + len(body.springs))
    for step, indentation in enumerate(indentations):
        lines += _step(body, step == 0, indentation)
    return "\n".join(lines) + "\n"


def volumetric(material: Material) -> float:
    """The constant D of the volumetric term, 1/MPa: 2 over the bulk modulus."""
    return 3 * (1 - 2 * material.poisson) / (material.modulus * (1 + material.poisson))


def _mesh(body: Body) -> list[str]:
    """Nodes and bricks."""
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{number}, {x:.9g}, {y:.9g}, {z:.9g}" for number, (x, y, z) in enumerate(body.mesh.nodes, start=1)]
    lines.append("*ELEMENT, TYPE=C3D20R, ELSET=EALL")
    for number, nodes in enumerate(body.mesh.elements, start=1):
        lines.append(f"{number}, {_row(nodes[:15])},\n{_row(nodes[15:])}")
    return lines


def _materials(body: Body) -> list[str]:
    """Materials, and the elements that they belong to."""
    lines = []
    for name, material in body.materials.items():
        lines += [
            f"*ELSET, ELSET=E{name}",
            *_rows(np.flatnonzero(body.parts == name) + 1),
            f"*MATERIAL, NAME=M{name}",
            "*HYPERELASTIC, OGDEN",
            f"{material.modulus:.9g}, {material.alpha:.6g}, {volumetric(material):.9g}",
            f"*SOLID SECTION, ELSET=E{name}, MATERIAL=M{name}",
        ]
    return lines


def _sets(body: Body) -> list[str]:
    """Sets of nodes: base, indenter, middle of the base, front."""
    mesh = body.mesh
    sets: dict[str, Iterable[int]] = {
        "NBOT": mesh.level(0),
        "NTOP": mesh.level(2 * mesh.up),
        "NMID": mesh.level(0, 2 * (mesh.across // 2)),
        FRONT: mesh.front + 1,
    }
    return [line for name, nodes in sets.items() for line in (f"*NSET, NSET={name}", *_rows(nodes))]


def _springs(body: Body) -> list[str]:
    """Springs, those of one stiffness together."""
    groups: dict[float, list[tuple[int, int]]] = {}
    for spring in body.springs:
        groups.setdefault(round(spring.stiffness, 12), []).append((spring.start, spring.end))
    lines, number = [], len(body.mesh.elements)
    for group, (stiffness, pairs) in enumerate(groups.items()):
        lines.append(f"*ELEMENT, TYPE=SPRINGA, ELSET=ESP{group}")
        for start, end in pairs:
            number += 1
            lines.append(f"{number}, {start}, {end}")
        lines += [f"*SPRING, ELSET=ESP{group}", "", f"{stiffness:.9g}"]
    return lines


def _contacts(body: Body, elements: int) -> list[str]:
    """A plate with friction above the body, a wall without friction at its right, or both.

    `elements` is the number of the last element that is there already.
    """
    mesh = body.mesh
    left, width, height = mesh.nodes[:, 0].min(), np.ptp(mesh.nodes[:, 0]), mesh.nodes[:, 1].max()
    stiffness = CONTACT * max(material.modulus for material in body.materials.values()) / (width / mesh.across)
    nodes = len(mesh.nodes)
    lines = ["*MATERIAL, NAME=STIFF", "*ELASTIC", "1000., 0.3"]
    if body.friction is not None:
        elements += 1
        across, up = (left - 0.4 * width, left + 1.4 * width), (height, height + 0.2 * height)
        lines += _brick("PLATE", nodes, elements, across, up, mesh.thickness)
        nodes += 8
        top = range(len(mesh.elements) - mesh.across + 1, len(mesh.elements) + 1)
        lines += ["*SURFACE, NAME=STOPF, TYPE=ELEMENT", *(f"{element}, S5" for element in top)]
        lines += ["*SURFACE, NAME=SPL, TYPE=ELEMENT", f"{elements}, S3", *_interaction("SI1", stiffness)]
        lines += ["*FRICTION", f"{body.friction}, {stiffness * STICK:.6g}", *_pair("SI1", "STOPF, SPL")]
    if body.gap is not None:
        elements += 1
        face = left + width + body.gap
        across, up = (face, face + 0.3 * width), (-0.2 * height, 1.2 * height)
        lines += _brick("WALL", nodes, elements, across, up, mesh.thickness)
        side = range(mesh.across, len(mesh.elements) + 1, mesh.across)
        lines += ["*SURFACE, NAME=SSIDE, TYPE=ELEMENT", *(f"{element}, S4" for element in side)]
        lines += ["*SURFACE, NAME=SWL, TYPE=ELEMENT", f"{elements}, S6", *_interaction("SI2", stiffness)]
        lines += _pair("SI2", "SSIDE, SWL")
    return lines


def _brick(
    name: str, nodes: int, element: int, across: tuple[float, float], up: tuple[float, float], thickness: float
) -> list[str]:
    """A stiff brick, thicker than the slice; its nodes have the numbers after `nodes`."""
    (left, right), (low, high) = across, up
    lines = [f"*NODE, NSET=N{name}"]
    corners = [(x, y, z) for z in (-thickness, 2 * thickness) for x, y in
               ((left, low), (right, low), (right, high), (left, high))]  # fmt: skip
    for number, (x, y, z) in enumerate(corners, start=nodes + 1):
        lines.append(f"{number}, {x:.9g}, {y:.9g}, {z:.9g}")
    lines += [f"*ELEMENT, TYPE=C3D8, ELSET=E{name}", f"{element}, {_row(range(nodes + 1, nodes + 9))}"]
    return [*lines, f"*SOLID SECTION, ELSET=E{name}, MATERIAL=STIFF"]


def _interaction(name: str, stiffness: float) -> list[str]:
    """A contact whose pressure grows linearly with how deep the surfaces overlap; stiffness in MPa/mm."""
    behavior = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    return [f"*SURFACE INTERACTION, NAME={name}", behavior, f"{stiffness:.6g}"]


def _pair(interaction: str, surfaces: str) -> list[str]:
    """A pair of surfaces in contact."""
    return [f"*CONTACT PAIR, INTERACTION={interaction}, TYPE=SURFACE TO SURFACE", surfaces]


def _step(body: Body, first: bool, indentation: float) -> list[str]:
    """A step to an indentation (mm), with what is printed of it."""
    plate = body.friction is not None
    lines = ["*STEP, NLGEOM, INC=400", "*STATIC", body.increments]
    if first:
        held = "NBOT" if body.base == "held" else "NMID"
        lines += ["*BOUNDARY", "NALL, 3, 3, 0.", "NBOT, 2, 2, 0.", f"{held}, 1, 1, 0."]
        lines += ["NWALL, 1, 3, 0."] if body.gap is not None else []
        lines += ["NPLATE, 1, 1, 0.", "NPLATE, 3, 3, 0."] if plate else []
    moved = "NPLATE" if plate else "NTOP"
    lines += ["*BOUNDARY", f"{moved}, 2, 2, {-indentation:.9g}"]
    if first and not plate and body.indenter == "glued":
        lines.append("NTOP, 1, 1, 0.")
    lines += [f"*NODE PRINT, NSET={FRONT}, FREQUENCY=1000", "U"]
    return [*lines, f"*NODE PRINT, NSET={moved}, FREQUENCY=1000, TOTALS=ONLY", "RF", "*END STEP"]


def _row(numbers: Iterable[int]) -> str:
    return ", ".join(map(str, numbers))


def _rows(numbers: Iterable[int]) -> list[str]:
    """Numbers, ten in a line."""
    numbers = list(numbers)
    return [_row(numbers[start : start + 10]) for start in range(0, len(numbers), 10)]
