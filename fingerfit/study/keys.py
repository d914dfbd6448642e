"""Keys of study.yaml: the source of its schema and of docs/study-keys.md."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, TypeAdapter, WrapValidator, create_model
from pydantic_core import PydanticCustomError

from fingerfit.core.described import HEAD, Line, Positive, Strict, one_of, rows, wanted
from fingerfit.core.units import UNITS
from fingerfit.mesh.elements import ELEMENTS

NUMBER = "a number above 0"


def _off(value: Any) -> Any:
    """YAML reads ``off`` as false."""
    return "off" if value is False else value


def _box(corners: list[list[float]]) -> list[list[float]]:
    low, high = corners
    if len(low) != len(high) or any(a >= b for a, b in zip(low, high, strict=True)):
        raise PydanticCustomError("box", "lower and upper corner of a box")
    return corners


def _downward(direction: list[float]) -> list[float]:
    if direction[-1] >= 0:
        raise ValueError
    return direction


def _or_keys(kind: type[Strict]) -> Any:
    """Keys and values as `kind` describes them, or what the type beside this takes."""
    return WrapValidator(lambda value, inner: kind.model_validate(value) if isinstance(value, dict) else inner(value))


Off = Annotated[Literal["off"], BeforeValidator(_off)]
Above = Annotated[Positive, wanted(NUMBER)]
Spread = Annotated[Literal["estimated"] | Positive, wanted(f"{NUMBER}, or estimated")]
Repeats = Annotated[list[Line], Field(min_length=1)]
Corner = Annotated[list[float], Field(min_length=2, max_length=3)]
Box = Annotated[list[Corner], Field(min_length=2, max_length=2), AfterValidator(_box)]
Pixels = Annotated[list[Annotated[int, Field(ge=2, le=4096)]], Field(min_length=2, max_length=3)]
Two = Annotated[list[float], Field(min_length=2, max_length=2), wanted("2 numbers")]
Direction = Annotated[
    list[float],
    Field(min_length=2, max_length=3),
    AfterValidator(_downward),
    wanted("2 or 3 numbers, the last one below 0"),
]
Three = Annotated[list[Positive], Field(min_length=3, max_length=3), wanted("3 numbers above 0")]


class UnitKeys(Strict):
    """Units of all numbers of a study."""

    length: Annotated[str, one_of(UNITS["length"])] = Field(description="One of " + ", ".join(UNITS["length"]) + ".")
    force: Annotated[str, one_of(UNITS["force"])] = Field(description="One of " + ", ".join(UNITS["force"]) + ".")
    time: Annotated[str, one_of(UNITS["time"])] = Field(description="One of " + ", ".join(UNITS["time"]) + ".")


class PictureKeys(Strict):
    """Pictures and their preparation."""

    before: Line | None = Field(
        default=None, description="Picture before compression; needed where the table of the steps names pictures."
    )
    noise: (
        Annotated[
            Literal["estimated"] | Positive | Repeats,
            wanted(f"{NUMBER}, estimated, or a list of further pictures before compression"),
        ]
        | None
    ) = Field(
        default=None,
        description="Standard deviation in the intensity that the files of the pictures have; `estimated`; or a list of"
        " further pictures before compression.",
    )
    blur: Above | None = Field(
        default=None,
        description="Standard deviation of the blur of camera or scanner (point spread function), in `units.length`, a"
        " number above 0: it does not move with the body. Without it the diagnosis estimates it in the plane.",
    )
    trim: Annotated[
        Literal["body"] | Off | Box,
        wanted("body, off, or [[x, y, z], [x, y, z]]: lower and upper corner of a box"),
    ] = Field(
        default="body",
        description="`body`: the body and `fit.crop` around it; `off`; or `[[x, y, z], [x, y, z]]`, lower and upper"
        " corner of a box.",
    )
    resize: Annotated[Off | Pixels, wanted("off, or pixels along each axis: 2 or 3 whole numbers from 2 to 4096")] = (
        Field(default="off", description="Pixels along the axes of the picture, 2 to 4096 each, x first; or `off`.")
    )
    gaussian: (
        Annotated[
            Off | Annotated[float, Field(ge=0, le=20)], wanted("off, or a standard deviation in pixels from 0 to 20")
        ]
        | None
    ) = Field(
        default=None,
        description="Standard deviation in pixels after resizing, 0 to 20; or `off`; `fit.smooth` when left out.",
    )
    scale: Annotated[Literal["range"] | Off, wanted("range or off")] = Field(
        default="range",
        description="`range`: lowest and highest intensity before compression become 0 and 1; or `off`.",
    )


class NoiseKeys(Strict):
    """Standard deviations, in the units of the study."""

    force: Spread | None = Field(default=None, description="Of a force: a number, or `estimated`.")
    displacement: Spread | None = Field(default=None, description="Of a displacement of the indenter, likewise.")
    points: Spread | None = Field(default=None, description="Of a measured displacement of a point, likewise.")
    force_gain: Above | None = Field(
        default=None,
        description="Of a factor common to all measured forces (one factor for each specimen), a number above 0; only"
        " with `control: displacement`.",
    )
    frame: Above | None = Field(default=None, description="Of a shift common to all points of a step, likewise.")


class BaseKeys(Strict):
    """What the base does to a body with a mesh of its own."""

    nodes: Line = Field(description="Its node set, where that is not BOTTOM.")
    kind: Annotated[str, one_of(("held", "slides"))] = Field(description="`held` or `slides`.")


class IndenterKeys(Strict):
    """What the indenter does to the body, and which way it goes."""

    nodes: Line = Field(default="TOP", description="Its node set, where that is not TOP: of a mesh of the study's own.")
    kind: Annotated[str, one_of(("glued", "slides"))] = Field(description="`glued` or `slides`.")
    direction: Direction | None = Field(
        default=None,
        description="Direction of its way, `[x, y]` or `[x, y, z]`, the last one below 0; straight down when left out."
        " Displacement and force are then those along it.",
    )


class BoundaryKeys(Strict):
    """What base and indenter do to the body."""

    base: Annotated[Literal["held", "slides"] | BaseKeys, wanted("one of held, slides"), _or_keys(BaseKeys)] = Field(
        description="`held` or `slides`; with a mesh of the study's own also keys and values."
    )
    indenter: Annotated[
        Literal["glued", "slides"] | IndenterKeys, wanted("one of glued, slides"), _or_keys(IndenterKeys)
    ] = Field(description="`glued` or `slides`; or keys and values.")


class LayerKeys(Strict):
    """A layer, from the indenter down."""

    name: Line = Field(description="A text of letters, digits and _; constants are named after it, as mu_top.")
    elements: Line | None = Field(default=None, description="Its element set; its name in capitals when left out.")


class BlockLayerKeys(LayerKeys):
    """A layer of a block."""

    height: Above = Field(description="Its height, a number above 0.")


class BrickLayerKeys(LayerKeys):
    """A layer of a brick."""

    height: Above | None = Field(
        default=None, description="Its height, a number above 0; needed where there are several."
    )


class MeshLayerKeys(LayerKeys):
    """A layer of a mesh."""

    height: Above | None = Field(default=None, description="Not used: the mesh has it.")


class RegionKeys(Strict):
    """A region: one of outline, labels and elements says where."""

    name: Line = Field(
        description="A text of letters, digits and _; constants are named after it, as mu_scar, and the effect"
        " region_scar."
    )
    outline: Annotated[list[Two], Field(min_length=3)] | Line | None = Field(
        default=None,
        description="In the plane: its corners in turn, `[[x, y], ...]`, or a CSV file with the columns x and y.",
    )
    labels: Line | None = Field(
        default=None,
        description="Picture of labels (whole numbers), of the same pixels as the picture before compression.",
    )
    label: Annotated[int, Field(ge=1)] | None = Field(default=None, description="Its label there; 1 when left out.")
    elements: Line | None = Field(default=None, description="An element set of the mesh.")


REGIONS = "Parts of the body that are not layers; where none of its constants is given, a region is as its layer."


class BlockKeys(Strict):
    """A block of layers in the plane."""

    layers: list[BlockLayerKeys] = Field(min_length=1, description="Layers from the indenter down.")
    regions: list[RegionKeys] = Field(default=[], description=REGIONS)
    width: Above = Field(description="At base and indenter, unloaded, a number above 0.")
    thickness: Above = Field(description="Out of plane, a number above 0.")
    origin: Two | None = Field(default=None, description="Lower left corner, [x, y]; [0, 0] when left out.")
    refined: None = Field(default=None, description="It is for a body with a mesh.")


class BrickKeys(Strict):
    """A brick of layers in space."""

    brick: Three = Field(
        description="`[length, width, height]`, above 0. The indenter comes along the third axis; a corner is at the"
        " origin."
    )
    layers: list[BrickLayerKeys] = Field(min_length=1, description="Layers from the indenter down.")
    regions: list[RegionKeys] = Field(default=[], description=REGIONS)
    refined: None = Field(default=None, description="It is for a body with a mesh.")


class MeshKeys(Strict):
    """A body with a mesh of its own."""

    mesh: Line = Field(
        description="File of the mesh: .inp, or what meshio reads, with node sets for base and indenter."
    )
    refined: Line | None = Field(default=None, description="File of a finer mesh of the same body, with the same sets.")
    layers: list[MeshLayerKeys] = Field(
        min_length=1, description="Layers: parts of the body with constants of their own."
    )
    regions: list[RegionKeys] = Field(default=[], description=REGIONS)
    types: list[Annotated[str, one_of(tuple(ELEMENTS))]] = Field(
        default=[],
        description="Element types in place of those of the file, each for the elements with as many nodes, as"
        " [CPE6H, CPE8H].",
    )
    thickness: Annotated[Literal["unknown"] | Positive, wanted(f"{NUMBER}, or unknown")] | None = Field(
        default=None, description="Out of plane, of a plane mesh: a number, or `unknown`."
    )


class StudyKeys(Strict):
    """What study.yaml has whatever the body is."""

    title: Line | None = Field(default=None, description="Any text; the name of the folder when left out.")
    units: UnitKeys = Field(description="Units of all numbers of the study: length, force and time.")
    control: Annotated[str, one_of(("force", "displacement"))] = Field(
        description="force or displacement, which the simulation prescribes. The other one, if measured, is data for"
        " `score: likelihood` and for the diagnosis."
    )
    steps: Line = Field(description="File with the table of the steps.")
    pictures: PictureKeys | None = Field(default=None, description="Pictures and their preparation.")
    noise: NoiseKeys | None = Field(default=None, description="Standard deviations, in the units of the study.")
    boundary: BoundaryKeys = Field(description="What base and indenter do to the body.")
    template: Line | None = Field(
        default=None,
        description="Deck template in place of `model.template` of the config, as one of several tests may need it;"
        " looked up in the study's folder, then in templates/.",
    )


class BlockStudy(StudyKeys):
    """study.yaml of a block."""

    body: BlockKeys = Field(description="The body: width (with layers), brick or mesh.")


class BrickStudy(StudyKeys):
    """study.yaml of a brick."""

    body: BrickKeys = Field(description="The body: width (with layers), brick or mesh.")


class MeshedStudy(StudyKeys):
    """study.yaml of a body with a mesh of its own."""

    body: MeshKeys = Field(description="The body: width (with layers), brick or mesh.")


KINDS: dict[str, type[StudyKeys]] = {"width": BlockStudy, "brick": BrickStudy, "mesh": MeshedStudy}
"""By the key that tells what the body is."""


_ANY: dict[str, Any] = {
    name: (field.annotation | None, Field(default=None, description=field.description))  # type: ignore[operator]
    for name, field in StudyKeys.model_fields.items()
} | {"body": (BlockKeys | BrickKeys | MeshKeys | None, Field(default=None, description="The body."))}
OneTest = create_model("OneTest", __base__=Strict, **_ANY)
SeveralTests = create_model(
    "SeveralTests", __base__=OneTest,
    tests=(dict[str, OneTest], Field(min_length=2, description="By name, what differs in each test.")),  # type: ignore[valid-type]
)  # fmt: skip


def schema() -> dict[str, Any]:
    """JSON schema of study.yaml."""
    kinds: Any = BlockStudy | BrickStudy | MeshedStudy | SeveralTests
    return TypeAdapter(kinds).json_schema()


def describe() -> str:
    """Markdown tables of all keys, for docs/study-keys.md."""
    lines = ["# Keys of study.yaml", "", "Made by `fingerfit docs`; do not edit.", "", *HEAD, *rows(StudyKeys)]
    for kind in (BlockKeys, BrickKeys, MeshKeys):
        lines += ["", f"## {(kind.__doc__ or '').rstrip('.')}", "", *HEAD, *rows(kind, "body.")]
    several = "By name, what differs in each of several tests: any key above, in place of the one at the top."
    lines += ["", "## Several tests in one study", "", *HEAD, f"| `tests.*` | `None` | {several} |"]
    return "\n".join(lines) + "\n"
