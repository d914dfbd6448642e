"""The block that the conformance suites press, as a deck, and what it answers in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fingerfit.deck.mesh_file import format_mesh
from fingerfit.material.ogden import Ogden
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.elements import ELEMENTS

MATERIAL = Ogden((0.03,), (1.4,), (0.7,))
SIZE, DEPTH = 10.0, 2.0
"""Side of the block and thickness, mm."""


def write_block(
    folder: Path, control: str, values: list[float], element: str = "CPE8", glued: bool = True, cells: int = 3
) -> Path:
    """Write a deck: a block of one layer on a base, pressed by a flat indenter.

    Parameters
    ----------
    folder : Path
        Where deck.inp and its mesh go.
    control : str
        ``force`` (N) or ``displacement`` (mm), with a value for each step.
    element : str
        In the plane or in space.
    glued : bool
        Whether the body sticks to base and indenter; else it slides and its deformation is homogeneous.
    cells : int
        Elements along each side.
    """
    if ELEMENTS[element].dim == 3:
        mesh = brick((SIZE, SIZE, SIZE), (cells,) * 3, "ALL_LAYERS", element)
    else:
        mesh = layered_block(SIZE, [("ALL_LAYERS", SIZE)], cells, cells, element)
    dim, indenter = mesh.dim, int(mesh.node_sets["INDENTER"][0]) + 1
    lines = ["*HEADING", "conformance", "*INCLUDE, INPUT=block.inp", "*MATERIAL, NAME=M", "*HYPERELASTIC, OGDEN, N=1"]
    lines += [f"{MATERIAL.mu[0]}, {MATERIAL.alpha[0]}, {MATERIAL.d[0]}"]
    lines += ["*SOLID SECTION, ELSET=ALL_LAYERS, MATERIAL=M"] + ([f"{DEPTH}"] if dim == 2 else [])
    lines += ["*BOUNDARY", f"BOTTOM, {dim}, {dim}"]
    if glued:
        lines += [f"BOTTOM, 1, {dim - 1}", f"TOP, 1, {dim - 1}"]
    else:
        lines += ["MIDDLE, 1, 1"] if dim == 2 else ["X0, 1, 1", "Y0, 2, 2"]
    lines += ["*EQUATION"]
    for node in mesh.node_sets["TOP"] + 1:
        if node != indenter:
            lines += ["2", f"{node}, {dim}, 1., {indenter}, {dim}, -1."]
    for value in values:
        lines += ["*STEP, NLGEOM, INC=1000", "*STATIC", "0.5, 1., 1e-5, 1."]
        lines += ["*CLOAD" if control == "force" else "*BOUNDARY"]
        lines += [f"INDENTER, {dim}, " + ("" if control == "force" else f"{dim}, ") + repr(-float(value))]
        lines += ["*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*NODE PRINT, NSET=BOTTOM, FREQUENCY=1000", "RF"]
        lines += ["*END STEP"]
    (folder / "block.inp").write_text(format_mesh(mesh))
    (folder / "deck.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "deck.inp"


def _amplitude(text: str) -> str:
    text = text.replace("*STEP", "*AMPLITUDE, NAME=HALF\n0., 0., 1., 0.5\n*STEP", 1)
    return text.replace("*BOUNDARY\nINDENTER", "*BOUNDARY, AMPLITUDE=HALF\nINDENTER")


def _relaxing(text: str) -> str:
    text = text.replace("*SOLID SECTION", "*VISCOELASTIC, TIME=PRONY\n0.4, 0., 2.\n*SOLID SECTION")
    text = text.replace("*STEP, NLGEOM", "*STEP, NLGEOM, AMPLITUDE=RAMP")
    return text.replace("*STATIC\n0.5, 1., 1e-5, 1.", "*VISCO, CETOL=1e-3\n0.25, 5., 1e-5, 0.25")


def _stressed(text: str) -> str:
    rows = "*INITIAL CONDITIONS, TYPE=STRESS\nALL_LAYERS, 0.002, -0.004, 0.001, 0., 0., 0.\n"
    return text.replace("*STEP", rows + "*STEP", 1)


def _loaded(text: str) -> str:
    return text.replace("*NODE PRINT", "*DLOAD\n1, P2, 0.02\n*NODE PRINT", 1)


def _sprung(text: str) -> str:
    rows = "*ELEMENT, TYPE=SPRING1, ELSET=SPRUNG\n900, 20\n*SPRING, ELSET=SPRUNG\n2\n2.\n"
    return text.replace("*MATERIAL", rows + "*MATERIAL", 1)


def _bent(text: str) -> str:
    """Within its table at the first node, beyond its end at the second one."""
    rows = "*ELEMENT, TYPE=SPRING1, ELSET=SPRUNG\n900, 20\n901, 24\n*SPRING, ELSET=SPRUNG, NONLINEAR\n2\n"
    return text.replace("*MATERIAL", rows + "-0.04, -0.6\n-0.03, -0.1\n0., 0.\n0.02, 0.5\n*MATERIAL", 1)


def _swelling(text: str) -> str:
    """Hardly pressed: programs subtract the strain of swelling from another one, and differ by the product of both."""
    text = text.replace("*SOLID SECTION", "*EXPANSION, ZERO=0.\n1.\n*SOLID SECTION")
    text = text.replace("*STEP", "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 0.\n*STEP", 1)
    return text.replace("*BOUNDARY\nINDENTER, 2, 2, -1.0", "*TEMPERATURE\nALL, 2e-4\n*CLOAD\nINDENTER, 2, -0.005")


def _warmed(text: str) -> str:
    """Twice as stiff at the end as at first."""
    mu, alpha, d = MATERIAL.mu[0], MATERIAL.alpha[0], MATERIAL.d[0]
    text = text.replace(f"{mu}, {alpha}, {d}", f"{mu}, {alpha}, {d}, 20.\n{2 * mu}, {alpha}, {d / 2}, 40.")
    text = text.replace("*STEP", "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 20.\n*STEP", 1)
    return text.replace("*NODE PRINT", "*TEMPERATURE\nALL, 40.\n*NODE PRINT", 1)


CHANGES: dict[str, Callable[[str], str]] = {
    "*AMPLITUDE": _amplitude,
    "*DLOAD": _loaded,
    "*EXPANSION": _swelling,
    "*HYPERELASTIC at temperatures": _warmed,
    "*INITIAL CONDITIONS, TYPE=STRESS": _stressed,
    "*SPRING": _sprung,
    "*SPRING, NONLINEAR": _bent,
    "*VISCOELASTIC": _relaxing,
}
"""Features that a program may leave out without a word, each with what brings it into the deck of the glued block."""


def homogeneous_force(stretch: float, dim: int) -> tuple[float, float]:
    """Force in N on the sliding block and lateral stretch, in closed form by bisection."""
    low, high = 0.5, 2.0
    for _ in range(200):
        wide = (low + high) / 2
        stretches = np.array([stretch, wide, wide if dim == 3 else 1.0])
        low, high = (low, wide) if MATERIAL.derivatives(stretches)[0][1] > 0 else (wide, high)
    area = SIZE * (SIZE if dim == 3 else DEPTH)
    return float(MATERIAL.derivatives(stretches)[0][0] / stretch * area), wide
