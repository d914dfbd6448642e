"""What a user sets in config.yaml: described, checked, and the source of the schema and of docs/config.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from fingerfit.choices import CONFIG, Choices, Model
from fingerfit.errors import FingerfitError, InputError, Problems
from fingerfit.keys import read_yaml, unknown_key

MATERIAL = ("mu", "alpha", "poisson")
PLAIN = r"^[\w./+@~:,=-]+$"
"""Paths and names that need no quotes in a shell and are no patterns to Snakemake."""
UNITS = {"mu": "MPa", "alpha": "1", "poisson": "1"}
LIMITS = {"mu": (0.0, math.inf), "alpha": (-math.inf, math.inf), "poisson": (-1.0, 0.5)}
# fmt: off
Element = Literal[
    "CPE3", "CPE3H", "CPE4", "CPE4H", "CPE6", "CPE8", "CPE8H", "CPE8R", "CPE8RH",
    "CPS3", "CPS4", "CPS6", "CPS8", "CPS8R",
    "C3D4", "C3D4H", "C3D8", "C3D8H", "C3D10", "C3D10H", "C3D20", "C3D20H", "C3D20R", "C3D20RH",
]
# fmt: on
"""What `fingerfit.meshing` makes of blocks and bricks."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_numbers(cls, value: Any, info: Any) -> Any:
        annotation = cls.model_fields[info.field_name].annotation
        if annotation is bool or _models_in(annotation):  # models look at their own fields
            return value
        inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
        if any(isinstance(v, bool) for v in inside):
            raise PydanticCustomError("truth", "a value that is not true or false")
        return value


class MeshSettings(_Strict):
    """Mesh of a block or brick that the study describes."""

    element: Element = Field(
        description="Element type: plane strain, plane stress or, for bricks, solid; those with H, which have a"
        " pressure field of their own, need `solver: builtin` or `abaqus`."
    )
    across: int = Field(ge=1, le=1000, description="Elements over the width (bricks: along each side).")
    per_layer: int = Field(ge=1, le=1000, description="Elements over the height of each layer.")
    grading: float = Field(
        default=1.0,
        ge=1.0,
        description="Largest over smallest element: they shrink towards sides, base and indenter.",
    )


class ParameterSettings(_Strict):
    """A constant to be identified."""

    unit: Literal["MPa", "1"] = Field(description="Unit: MPa for mu, 1 for alpha and poisson.")
    start: float = Field(description="Where the search starts.")
    lower: float = Field(description="Lower bound.")
    upper: float = Field(description="Upper bound.")
    log: bool = Field(default=True, description="Search in the logarithm.")


class ModelSettings(Model, _Strict):
    """The model of the body."""

    name: str = Field(default="base", pattern=r"^[\w+-]+$", description="Folder of its results.")
    template: str = Field(
        default="block.inp.j2",
        description="Deck template, looked up in the study's folder, then in templates/.",
    )
    material: dict[str, float] = Field(
        default_factory=dict,
        description="Fixed constants: mu (MPa), alpha, poisson, for all layers, or for one as alpha_top.",
    )
    mesh: MeshSettings | None = Field(
        default=None, description="Mesh of the search; not allowed when the study brings a mesh."
    )
    refined: MeshSettings | None = Field(
        default=None,
        description="Finer mesh of the last steps: it gives the estimate, and the difference tells the error left.",
    )
    parameters: dict[str, ParameterSettings] = Field(
        min_length=1, description="What is identified: mu, alpha or poisson, or for one layer as mu_top."
    )
    effects: dict[str, dict[str, float]] = Field(
        default_factory=dict,
        description="Effects that were added, in order; numbers of an effect where they differ from its own. With all"
        " numbers of the last one no fit without it comes before.",
    )


class StageSettings(_Strict):
    """A stage of the search."""

    name: str = Field(pattern=r"^[\w +-]+$", description="For reports.")
    kind: Literal["grid", "equal", "independent"] = Field(
        description="grid: forward analyses, all mu alike; equal: simplex, all mu alike; independent: simplex."
    )
    tolx: float = Field(
        default=1e-5,
        gt=0,
        description="Stop when all vertices are as near to the best, in the parameter's unit ...",
    )
    tolf: float = Field(default=1e-5, gt=0, description="... and their scores too.")
    points: int = Field(default=6, ge=2, description="Points of a grid.")
    step: float = Field(default=0.4, gt=0, description="Size of the first simplex, in the logarithm.")
    restarts: int = Field(default=0, ge=0, description="New simplexes at the best point.")


class FitSettings(_Strict):
    """How the model is fitted."""

    score: Literal["nmi", "ssd", "likelihood"] = Field(
        description="nmi: normalized mutual information; ssd: squared difference; likelihood: all data with noise."
    )
    steps: list[int] | None = Field(
        default=None, description="Steps whose pictures are compared; all with a picture when left out."
    )
    smooth: float = Field(default=1.0, ge=0, description="Gaussian on all pictures, standard deviation in pixels.")
    crop: float = Field(
        default=0.3,
        ge=0.05,
        description="How far beyond the undeformed body pictures are compared, as a share of its extent on each side.",
    )
    bins: int = Field(default=32, ge=4, le=512, description="Bins of the joint histogram.")
    batch: int = Field(default=2, ge=1, description="Guesses tried at once; the result does not depend on it.")
    max_evaluations: int = Field(default=400, ge=1, description="The search ends after as many.")
    replicates: int = Field(
        default=60,
        ge=20,
        description="Repetitions of the measurement with new noise, for the standard errors.",
    )
    seed: int = Field(default=1, ge=0, description="Of that noise.")
    stages: list[StageSettings] = Field(min_length=1, description="Stages of the search, in order.")


class Settings(Choices, _Strict):
    """config.yaml."""

    study: str = Field(pattern=PLAIN, description="Folder of the study.")
    results: str = Field(default="results", pattern=PLAIN, description="Folder of all results.")
    solver: str = Field(default="builtin", description="builtin, calculix, abaqus, or another one that is installed.")
    model: ModelSettings = Field(description="The model of the body.")
    fit: FitSettings = Field(description="How the model is fitted.")


def load_settings(source: Mapping[str, Any] | Path, where: Path | str = CONFIG) -> Settings:
    """Check settings.

    Parameters
    ----------
    source : mapping or Path
        What was read from config.yaml, or its path.
    where : Path or str
        Named in errors when `source` is a mapping.

    Raises
    ------
    Problems
        With one line for each wrong key.
    """
    if isinstance(source, Path):
        where, source = source, read_yaml(source)
    try:
        settings = Settings.model_validate(source)
    except ValidationError as error:
        raise Problems([_explain(where, details) for details in error.errors()]) from error
    problems = _cross_check(settings, where)
    if problems:
        raise Problems(problems)
    settings.effects(where)
    return settings


def _explain(where: Path | str, details: Any) -> FingerfitError:
    field = ".".join(map(str, details["loc"])) or "file"
    if details["type"] == "extra_forbidden":
        *parents, key = details["loc"]
        return unknown_key(where, "".join(f"{p}." for p in parents), str(key), _known(parents))
    if details["type"] == "missing":
        return InputError(where, field, "nothing", "a value: " + _describe(details["loc"]))
    if details["type"] == "string_pattern_mismatch":
        return InputError(where, field, repr(details["input"]), "letters, digits and . / _ + - only, no spaces")
    return InputError(where, field, details["input"], details["msg"].replace("Input should be ", ""))


def _model_at(loc: Any) -> type[BaseModel]:
    model: type[BaseModel] = Settings
    for key in loc:
        annotation = model.model_fields[key].annotation if key in model.model_fields else None
        for kind in _models_in(annotation):
            model = kind
    return model


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [kind for part in getattr(annotation, "__args__", ()) for kind in _models_in(part)]


def _known(parents: Any) -> list[str]:
    return list(_model_at(parents).model_fields)


def _describe(loc: Any) -> str:
    field = _model_at(loc[:-1]).model_fields.get(str(loc[-1]))
    return (field.description if field else None) or "it is needed"


def _cross_check(settings: Settings, where: Path | str) -> list[FingerfitError]:
    from fingerfit.solvers.registry import get_solver

    problems: list[FingerfitError] = []
    try:
        get_solver(settings.solver)
    except FingerfitError as error:
        problems.append(FingerfitError(f"{where}: {error}"))
    for name, p in settings.model.parameters.items():
        field = f"model.parameters.{name}"
        quantity = name.partition("_")[0]
        if not _is_constant(name):
            problems.append(unknown_key(where, "model.parameters.", name, MATERIAL))
        elif p.unit != UNITS[quantity]:
            problems.append(InputError(where, f"{field}.unit", p.unit, UNITS[quantity]))
        elif not p.lower <= p.start <= p.upper or p.lower == p.upper:
            problems.append(InputError(where, field, f"start {p.start:g}", f"{p.lower:g} to {p.upper:g}, the bounds"))
        elif p.log and p.lower <= 0:
            problems.append(InputError(where, f"{field}.lower", p.lower, "above 0, for a search in the logarithm"))
        else:
            problems += _impossible(where, f"{field}.lower", quantity, p.lower)
            problems += _impossible(where, f"{field}.upper", quantity, p.upper)
            if quantity == "alpha" and p.lower < 0 < p.upper:
                problems.append(InputError(where, field, f"{p.lower:g} to {p.upper:g}", "bounds without 0 between"))
    for name, value in settings.model.material.items():
        if not _is_constant(name):
            problems.append(unknown_key(where, "model.material.", name, MATERIAL))
        else:
            problems += _impossible(where, f"model.material.{name}", name.partition("_")[0], value)
    problems += [
        InputError(where, f"model.material.{name}", "a constant that is fitted, too", "no such key, or no parameter")
        for name in settings.model.material
        if name in settings.model.parameters
    ]
    steps = settings.fit.steps or []
    for step in sorted({step for step in steps if steps.count(step) > 1}):
        problems.append(InputError(where, "fit.steps", f"step {step} twice", "each step once"))
    names = [stage.name for stage in settings.fit.stages]
    for name in sorted({name for name in names if names.count(name) > 1}):
        problems.append(InputError(where, "fit.stages", f"{name} twice", "a name of its own for each stage"))
    return problems


def _is_constant(name: str) -> bool:
    quantity, joint, layer = name.partition("_")
    return quantity in MATERIAL and bool(joint) == bool(layer)


def _impossible(where: Path | str, field: str, quantity: str, value: float) -> list[FingerfitError]:
    low, high = LIMITS[quantity]
    if low < value < high and not (quantity == "alpha" and value == 0):
        return []
    expected = {"mu": "above 0", "alpha": "not 0", "poisson": "between -1 and 0.5"}[quantity]
    return [InputError(where, field, f"{value:g}", expected)]


def schema() -> dict[str, Any]:
    """JSON schema of config.yaml."""
    return Settings.model_json_schema()


def describe() -> str:
    """Markdown table of all keys, for docs/config.md."""
    lines = ["# Keys of config.yaml", "", "Made by `fingerfit docs`; do not edit.", ""]
    lines += ["| key | default | what it is |", "|---|---|---|"]

    def walk(model: type[BaseModel], prefix: str) -> None:
        for name, field in model.model_fields.items():
            inner = _models_in(field.annotation)
            text = str(field.annotation)
            suffix = ".*" if "dict" in text and inner else "[]" if "list" in text and inner else ""
            default = "needed" if field.is_required() else f"`{field.get_default(call_default_factory=True)}`"
            lines.append(f"| `{prefix}{name}{suffix}` | {default} | {field.description} |")
            for kind in inner:
                walk(kind, f"{prefix}{name}{suffix}.")

    walk(Settings, "")
    return "\n".join(lines) + "\n"
