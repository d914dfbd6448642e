"""Columns of tables of digital image correlation by the program that wrote them; sources: docs/readers.md."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fingerfit.core.units import as_written

PIXEL = "pixel"
AXES = ("x", "y", "z")
MOTIONS = ("u", "v", "w")
_UNIT = re.compile(r"[\[(]\s*([a-zA-Zµμ]+)\s*[\])]\s*$")
_LENGTHS = {"um": "um", "µm": "um", "μm": "um", "mm": "mm", "cm": "cm", "m": "m", "pixel": PIXEL, "pixels": PIXEL,
            "px": PIXEL}  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """How a program names its columns.

    Parameters
    ----------
    program : str
    names : dict
        Patterns of the heads without unit, for x, y, z, u, v, w as far as there are any; matched with capitals.
    unit : str
        Of the coordinates where the heads do not say it; empty: not known.
    down : bool
        Whether y points downwards, as in pictures.
    quality : dict
        Patterns of heads with what tells that a point was not correlated.
    """

    program: str
    names: Mapping[str, str]
    unit: str
    down: bool
    quality: Mapping[str, Callable[[np.ndarray], np.ndarray]]


def _negative(values: np.ndarray) -> np.ndarray:
    return values < 0


def _zero(values: np.ndarray) -> np.ndarray:
    return values == 0


LAYOUTS = (
    Layout("DICe (stereo)", {"x": "MODEL_COORDINATES_X", "y": "MODEL_COORDINATES_Y", "z": "MODEL_COORDINATES_Z",
                             "u": "MODEL_DISPLACEMENT_X", "v": "MODEL_DISPLACEMENT_Y", "w": "MODEL_DISPLACEMENT_Z"},
           "", True, {"SIGMA": _negative, "MATCH": _negative}),
    Layout("DICe", {"x": "(SUBSET_)?COORDINATES?_X", "y": "(SUBSET_)?COORDINATES?_Y",
                    "u": "(SUBSET_)?DISPLACEMENT_X", "v": "(SUBSET_)?DISPLACEMENT_Y"},
           PIXEL, True, {"SIGMA": _negative, "MATCH": _negative}),
    Layout("MatchID", {"x": r"coor\.X", "y": r"coor\.Y", "z": r"coor\.Z", "u": r"disp\.Horizontal Displacement U",
                       "v": r"disp\.Vertical Displacement V", "w": r"disp\.Out-Of-Plane: W"}, "", True, {}),
    Layout("MatchID", {"x": r"(Coordinates\.)?Image X", "y": r"(Coordinates\.)?Image Y",
                       "u": r"(disp\.)?Horizontal Displacement U", "v": r"(disp\.)?Vertical Displacement V"},
           PIXEL, True, {}),
    Layout("pyvale (stereo)", {"x": "stereo_x_mm", "y": "stereo_y_mm", "z": "stereo_z_mm", "u": "stereo_disp_u_mm",
                               "v": "stereo_disp_v_mm", "w": "stereo_disp_w_mm"},
           "mm", True, {"(stereo_)?converged": _zero}),
    Layout("pyvale", {"x": "(subset|ss)_x", "y": "(subset|ss)_y", "u": "u|disp(lacement)?_u(_px)?",
                      "v": "v|disp(lacement)?_v(_px)?"}, PIXEL, True, {"converged": _zero}),
    Layout("VIC-2D", {"x": "x_c", "y": "y_c", "u": "u_c", "v": "v_c"}, "", False, {"sigma": _negative}),
    Layout("VIC-3D", {"x": "X", "y": "Y", "z": "Z", "u": "U", "v": "V", "w": "W"}, "", False, {"sigma": _negative}),
    Layout("plain", {"x": "[xX]", "y": "[yY]", "z": "[zZ]", "u": "u_?[xX]?|U", "v": "v|u_?[yY]|V|U[yY]",
                     "w": "w|u_?[zZ]|W"}, "", False, {"sigma": _negative}),
)  # fmt: skip
"""The first whose x, y, u and v are all there is taken."""
_NOT_PLAIN = {"x_pic": ("MatchID", "", True), "sigma": ("VIC-2D", PIXEL, True)}
"""Columns that tell, beside x, y, u, v, which program wrote them: its name, the unit and whether y points downwards."""


def layout_of(head: Sequence[str]) -> tuple[Layout, dict[str, int]] | None:
    """The layout of a head, and the places of its columns; None where it has no such columns.

    >>> found = layout_of(["X [mm]", "Y [mm]", "Z [mm]", "U [mm]", "V [mm]", "W [mm]", "sigma [pixel]"])
    >>> found[0].program, found[0].unit, found[1]["w"]
    ('VIC-3D', 'mm', 5)
    """
    bare = [_UNIT.sub("", cell).strip() for cell in head]
    for layout in LAYOUTS:
        places = {
            name: place
            for name, words in layout.names.items()
            if (place := next((n for n, cell in enumerate(bare) if re.fullmatch(words, cell)), None)) is not None
        }
        if not {"x", "y", "u", "v"} <= places.keys():
            continue
        if ("z" in places) != ("w" in places):  # positions in space whose third displacement was not exported
            places = {name: place for name, place in places.items() if name not in ("z", "w")}
        program, unit, down = layout.program, layout.unit, layout.down
        if program == "plain":
            known = next((own for name, own in _NOT_PLAIN.items() if name in bare), None) if "z" not in places else None
            known = _NOT_PLAIN["x_pic"] if "x_pic" in bare else known
            program, unit, down = known or (program, unit, down)
        given = unit_of(head[places["x"]])
        return Layout(program, layout.names, given or unit, down, layout.quality), places
    return None


def unit_of(cell: str) -> str:
    """The unit that a head names, one that is not known as it stands there; empty where it names none.

    >>> unit_of("X [Pixel]"), unit_of("X (in)"), unit_of("X")
    ('pixel', 'in', '')
    """
    found = _UNIT.search(cell)
    return unit_named(found[1]) or found[1] if found else ""


def unit_named(text: str) -> str:
    """A unit of length as it is named here; empty for what is none.

    >>> unit_named("Pixels"), unit_named("µm"), unit_named("furlong"), unit_named("Mm")
    ('pixel', 'um', '', '')
    """
    return as_written(text.strip(), _LENGTHS)


def uncorrelated(layout: Layout, head: Sequence[str], column: Callable[[int], np.ndarray]) -> np.ndarray | bool:
    """Which points the program marks as not correlated."""
    bad: np.ndarray | bool = False
    for place, cell in enumerate(head):
        for words, rule in layout.quality.items():
            if re.fullmatch(words, _UNIT.sub("", cell).strip()):
                bad = bad | rule(column(place))
    return bad
