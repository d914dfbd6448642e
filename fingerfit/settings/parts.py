"""Parts of config.yaml: meshes, parameters with their priors, stages of the search."""

from __future__ import annotations

import math
import sys
from typing import Any, Literal, get_args

from pydantic import Field, PrivateAttr, field_validator
from pydantic_core import PydanticCustomError

from fingerfit.core.described import Described, models_in

RATIO = 1 / sys.float_info.epsilon
"""Largest over smallest mu of one search: the condition of a stiffness matrix is no better than the ratio of the moduli
in it, and beyond this one no digit of the softer part's displacements is left. A body of one mu would not move in any
digit of its coordinates at the one bound where it is compressed as a whole at the other."""
GRADING = 2.0**16
"""Largest over smallest element. Strains are differences of coordinates: half of their digits are left where the
smallest element is sqrt(epsilon) = 2^-26 of the body, as it can be among 1000 = 2^10 elements, the most across."""
SPAN = math.ceil(math.log(RATIO))
"""Distance of bounds in the logarithm that no parameter exceeds: that of `RATIO`. A share of it is 1 at most."""
# fmt: off
Element = Literal[
    "CPE3", "CPE3H", "CPE4", "CPE4H", "CPE6", "CPE8", "CPE8H", "CPE8R", "CPE8RH",
    "CPS3", "CPS4", "CPS6", "CPS8", "CPS8R",
    "C3D4", "C3D4H", "C3D8", "C3D8H", "C3D10", "C3D10H", "C3D20", "C3D20H", "C3D20R", "C3D20RH",
]
# fmt: on
"""What `fingerfit.mesh.blocks` makes of blocks and bricks."""


class Keys(Described):
    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_numbers(cls, value: Any, info: Any) -> Any:
        annotation = cls.model_fields[info.field_name].annotation
        if annotation is bool or models_in(annotation):  # models look at their own fields
            return value
        inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
        if any(isinstance(v, bool) for v in inside):
            raise PydanticCustomError("truth", "a value that is not true or false")
        return value


class MeshSettings(Keys):
    """Mesh of a block or brick that the study describes."""

    element: Element = Field(
        description="Element type: plane strain, plane stress or, for bricks, solid ("
        + ", ".join(get_args(Element))
        + "); those with H, which have a pressure field of their own, need `solver: builtin` or `abaqus`."
    )
    across: int = Field(ge=1, le=1000, description="Elements over the width (bricks: along each side).")
    per_layer: int = Field(ge=1, le=1000, description="Elements over the height of each layer.")
    grading: float = Field(
        default=1.0,
        ge=1.0,
        le=GRADING,
        description="Largest over smallest element: they shrink towards sides, base and indenter.",
    )

    _pictured: bool = PrivateAttr(default=False)

    @property
    def pictured(self) -> bool:
        """Whether the sides of a block lie where the picture before compression shows them: the model has `OUTLINE`."""
        return self._pictured


class PriorSettings(Keys):
    """What was known of a constant before."""

    value: float = Field(description="What another test gave for it: one more datum.")
    deviation: float = Field(
        gt=0,
        description="Its standard deviation, in the same unit. With log: true the logarithm is normal, with the"
        " deviation as a share of the value: 0.05 and 0.01 are 0.041 to 0.061 (in two cases of three).",
    )


class ParameterSettings(Keys):
    """A constant to be identified."""

    unit: Literal["MPa", "1"] = Field(description="Unit: MPa for mu, 1 for all other constants.")
    start: float = Field(description="Where the search starts.")
    lower: float = Field(description="Lower bound.")
    upper: float = Field(description="Upper bound.")
    log: bool = Field(default=True, description="Search in the logarithm.")
    prior: PriorSettings | None = Field(default=None, description="What was known of it before (docs/uncertainty.md).")


class StageSettings(Keys):
    """A stage of the search."""

    name: str = Field(pattern=r"^[\w +-]+$", description="For reports.")
    kind: Literal["grid", "equal", "independent", "least_squares"] = Field(
        description="grid: forward analyses, tied parameters alike; equal: simplex, tied parameters alike; independent:"
        " simplex over all parameters; least_squares: Gauss-Newton steps over all parameters, on displacements"
        " (registered in the pictures, or of points) and the response, until a step is below tolx; tolf, step and"
        " restarts are those of a simplex."
    )
    tied: str | list[str] | None = Field(
        default=None,
        description="Parameters that are alike in grid and equal, within the bounds that they share: mu, alpha, poisson"
        " or a list of names. When left out: all mu; where none is identified all alpha, or else all poisson.",
    )
    tolx: float = Field(
        default=1e-3,
        gt=0,
        description="Stop when no parameter differs by more between the best guess and the other vertices, as a share"
        " of its value (with log: false, of the distance of its bounds) ...",
    )
    tolx_in: Literal["share", "unit"] = Field(
        default="share",
        description="share, or unit: tolx is a difference in the unit of the parameters, as in the paper (MPa).",
    )
    tolf: float = Field(default=1e-5, gt=0, description="... and no score by more than this.")
    points: int = Field(default=6, ge=2, description="Points of a grid.")
    step: float = Field(
        default=0.4,
        gt=0,
        le=SPAN,
        description="Size of the first simplex: in the logarithm, or with log: false as a share of the distance of the"
        " bounds.",
    )
    restarts: int = Field(
        default=0,
        ge=0,
        description="New simplexes at the best point, in any case. More of them follow where a bound was met and"
        " a point at either side of the best one is better.",
    )
