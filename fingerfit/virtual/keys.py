"""Keys of the description of a virtual experiment: the source of docs/experiment-keys.md."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from fingerfit.core.described import HEAD, Line, Positive, Strict, rows
from fingerfit.settings.parts import GRADING, MeshSettings
from fingerfit.virtual.truth import BRIGHTEST, SHAPES

PIXELS = 2**15 - 1
"""Most pixels along an axis: the files of the pictures, NIfTI-1, count them in 16 bits."""


def _three(values: list[Any]) -> list[Any]:
    if len(values) != 3:
        raise PydanticCustomError("three", "3 numbers")
    return values


def _rising(values: list[float]) -> list[float]:
    if any(b <= a for a, b in pairwise(values)):
        raise PydanticCustomError("rising", "numbers that increase from step to step")
    return values


def _distinct(values: list[int]) -> list[int]:
    if len(set(values)) < len(values):
        raise PydanticCustomError("distinct", "steps, each of them once")
    return values


Share = Annotated[float, Field(ge=0, le=1)]
Pixels = Annotated[int, Field(ge=2, le=PIXELS)]
Place = Annotated[list[float], AfterValidator(_three)]
Lengths = Annotated[list[Positive], AfterValidator(_three)]


class LayerDescription(Strict):
    """A layer of a block or brick."""

    name: Line = Field(description="Letters, digits and _: it names a set of elements in decks.")
    height: float = Field(gt=0, description="mm.")
    mu: float = Field(gt=0, description="Shear modulus, MPa.")
    intensity: float = Field(gt=0, le=1, description="Of a pixel filled with it, above 0 to 1.")


class TissueDescription(Strict):
    """A layer of a mesh."""

    name: Line = Field(description="Letters, digits and _: it names a set of elements in decks.")
    elements: Line | None = Field(default=None, description="Element set of the mesh; the layer's name when left out.")
    mu: float = Field(gt=0, description="Shear modulus, MPa.")
    intensity: float = Field(gt=0, le=1, description="Of a voxel filled with it, above 0 to 1.")


class ShapeDescription(Strict):
    """A shape that is seen in volumes and nothing else."""

    shape: Literal["capsule", "ellipsoid", "box"] = Field(
        description="capsule: from, to, radius; ellipsoid: centre, radii; box: low, high."
    )
    intensity: Share = Field(description="Of a voxel filled with it, 0 to 1.")
    start: Place | None = Field(default=None, alias="from", description="One end of the axis: x, y, z, mm.")
    to: Place | None = Field(default=None, description="The other end, mm.")
    radius: Positive | None = Field(default=None, description="mm.")
    centre: Place | None = Field(default=None, description="mm.")
    radii: Lengths | None = Field(default=None, description="Along x, y, z, mm.")
    low: Place | None = Field(default=None, description="Lower corner, mm.")
    high: Place | None = Field(default=None, description="Upper corner, mm.")

    @model_validator(mode="after")
    def _has_its_keys(self) -> ShapeDescription:
        if set(self.model_dump(by_alias=True, exclude_none=True)) != {"shape", "intensity", *SHAPES[self.shape]}:
            keys = ", ".join(("shape", "intensity", *SHAPES[self.shape]))
            raise PydanticCustomError("shape", "{keys}, the keys of a {shape}", {"keys": keys, "shape": self.shape})
        return self


class BlockDescription(Strict):
    """A block of layers in the plane."""

    width: float = Field(gt=0, description="mm.")
    thickness: float = Field(gt=0, description="Out of plane, mm.")
    layers: list[LayerDescription] = Field(min_length=1, description="From the indenter down.")


class _Solid(Strict):
    tissues: dict[str, Share] = Field(
        default_factory=dict, description="Intensity of other element sets, 0 to 1; those without one are dark."
    )
    drawn: list[ShapeDescription] = Field(
        default_factory=list,
        description="Visible, but without mechanical effect: tendons, vessels. Later ones cover earlier ones.",
    )


class BrickDescription(_Solid):
    """A brick of layers."""

    brick: Lengths = Field(
        description="Sides along x, y, z, mm; a corner is at the origin, and the indenter pushes along -z."
    )
    layers: list[LayerDescription] = Field(min_length=1, description="From the indenter down.")


class MeshedDescription(_Solid):
    """A body with a mesh of its own."""

    mesh: Line = Field(description="Mesh file, in the folder of the description.")
    layers: list[TissueDescription] = Field(min_length=1, description="Tissues whose constants are asked for.")


class MeshDescription(Strict, MeshSettings):
    """Mesh of a block or brick."""

    grading: float = Field(ge=1.0, le=GRADING, description=MeshSettings.model_fields["grading"].description)


class MaterialDescription(Strict):
    """Constants that all layers share."""

    alpha: float = Field(description="Exponent of the Ogden model, not 0.")
    poisson: float = Field(description="Poisson's ratio, between -1 and 0.5.")


class _Picture(Strict):
    texture: float = Field(
        ge=0, le=BRIGHTEST, description="Relative spread of the brightness, attached to the material ..."
    )
    correlation: float = Field(
        gt=0, description="... and the length over which it changes, mm: at most the longest side of the picture."
    )
    noise: float = Field(
        ge=0,
        le=BRIGHTEST,
        description="Standard deviation in each channel: magnitudes have Rician noise, in the first picture too. At"
        f" most {BRIGHTEST:g}, the brightest that is stored.",
    )
    pictured: Annotated[list[Annotated[int, Field(ge=1)]], AfterValidator(_distinct)] = Field(
        description="Steps with a picture."
    )


class PictureDescription(_Picture):
    """Pictures in the plane."""

    pixels: Pixels = Field(description=f"Along each side, 2 to {PIXELS}, as far as they fit into the memory.")
    side: float = Field(gt=0, description="mm; the body is in the middle.")


class VolumeDescription(_Picture):
    """Pictures in space."""

    pixels: Annotated[list[Pixels], AfterValidator(_three)] = Field(
        description=f"Voxels along x, y, z, 2 to {PIXELS} each, as far as they fit into the memory."
    )
    spacing: Lengths = Field(description="Of the voxels along x, y, z, mm.")
    origin: Place | None = Field(
        default=None, description="Centre of the first voxel, mm; when left out the body is in the middle."
    )
    samples: int = Field(
        default=32, ge=1, le=512, description="Sample points in each voxel, for the share of each tissue at borders."
    )


class NoiseDescription(Strict):
    """Noise of forces and displacements."""

    force: float = Field(ge=0, description="Standard deviation as a share of the largest force.")
    displacement: float = Field(ge=0, description="Standard deviation, mm; less than the height of the body.")


class BoundaryDescription(Strict):
    """What base and indenter do to the body."""

    base: Literal["held", "slides"] = Field(default="held", description="held or slides, as in study.yaml.")
    indenter: Literal["glued", "slides"] = Field(default="glued", description="glued or slides, as in study.yaml.")


class WrittenDescription(Strict):
    """What goes into study.yaml in place of what is described."""

    body: dict[str, Any] | None = Field(default=None, description="As in study.yaml; its meshes are copied.")
    boundary: dict[str, Any] | None = Field(default=None, description="As in study.yaml.")
    control: Literal["force", "displacement"] = Field(default="force", description="As in study.yaml.")
    pictures: dict[str, Any] | None = Field(default=None, description="As in study.yaml.")


class WrittenBlock(Strict):
    """What goes into study.yaml of a block in place of what is described."""

    boundary: BoundaryDescription = Field(
        default_factory=BoundaryDescription, description="As in study.yaml; held and glued when left out."
    )
    control: Literal["force", "displacement"] = Field(default="force", description="As in study.yaml.")


class WrittenMeshed(WrittenDescription):
    """The same for a body with a mesh of its own, which its study must not have."""

    body: dict[str, Any] = Field(description="As in study.yaml, with a mesh of its own; its meshes are copied.")


class Experiment(Strict):
    """What experiment.yaml has whatever the body is."""

    title: Line = Field(description="Of the study.")
    material: MaterialDescription = Field(description="Constants that all layers share.")
    solver: Line = Field(description="builtin, calculix, abaqus, or another one that is installed.")
    displacement: Annotated[list[Annotated[float, Field(ge=0)]], AfterValidator(_rising)] = Field(
        min_length=1, description="Of the indenter at the steps, mm: increasing, and less than the height of the body."
    )
    noise: NoiseDescription = Field(description="Of forces and displacements.")
    seed: int = Field(
        ge=0, description="Of texture and noise: a whole number, 0 or more, of any size, as NumPy takes it."
    )
    time: Annotated[list[Positive], AfterValidator(_rising)] | None = Field(
        default=None, description="At the end of each step, s, for effects that depend on it: increasing from above 0."
    )
    effects: dict[str, dict[str, float]] = Field(
        default_factory=dict, description="Hidden effects of the catalogue and their numbers, within their bounds."
    )
    own: Line | None = Field(
        default=None, description="A folder beside the description; its folder effects has further effects."
    )
    template: Line = Field(
        default="block.inp.j2",
        description="Deck template, looked up in the folder of the description, then in templates/.",
    )
    boundary: BoundaryDescription = Field(
        default_factory=BoundaryDescription, description="What base and indenter do to the body."
    )


class PlaneExperiment(Experiment):
    """experiment.yaml of a block in the plane."""

    body: BlockDescription = Field(description="The body as it really is.")
    mesh: MeshDescription = Field(description="Mesh of the body: element, across, per_layer, grading.")
    picture: PictureDescription = Field(description="Pictures that are taken.")
    study: WrittenBlock = Field(
        default_factory=WrittenBlock, description="What goes into study.yaml, without the truth."
    )


class BrickExperiment(Experiment):
    """experiment.yaml of a brick."""

    body: BrickDescription = Field(description="The body as it really is.")
    mesh: MeshDescription = Field(description="Mesh of the body: element, across, per_layer, grading.")
    picture: VolumeDescription = Field(description="Volumes that are taken.")
    study: WrittenDescription = Field(
        default_factory=WrittenDescription, description="What goes into study.yaml, without the truth."
    )


class MeshedExperiment(Experiment):
    """experiment.yaml of a body with a mesh of its own."""

    body: MeshedDescription = Field(description="The body as it really is.")
    mesh: None = Field(default=None, description="The body brings its mesh.")
    picture: VolumeDescription = Field(description="Volumes that are taken.")
    study: WrittenMeshed = Field(
        description="What goes into study.yaml, without the truth: body, boundary, control, pictures."
    )


def describe() -> str:
    """Markdown tables of all keys, for docs/experiment-keys.md."""
    lines = ["# Keys of experiment.yaml", "", "Made by `fingerfit docs`; do not edit.", ""]
    several = "By name, what differs in each of several tests: any key of its kind, in place of the one at the top."
    lines += ["## A block in the plane", "", *HEAD, *rows(PlaneExperiment), f"| `tests.*` | `None` | {several} |", ""]
    lines += ["## A brick", "", "Its other keys are those of a block.", "", *HEAD]
    lines += [
        *rows(BrickDescription, "body."),
        *rows(VolumeDescription, "picture."),
        *rows(WrittenDescription, "study."),
    ]
    lines += ["", "## A body with a mesh of its own", "", "Its other keys are those of a brick.", "", *HEAD]
    lines += [*rows(MeshedDescription, "body."), "| `mesh` | no such key | The body brings its mesh. |"]
    lines += [*rows(WrittenMeshed, "study.")]
    return "\n".join(lines) + "\n"
