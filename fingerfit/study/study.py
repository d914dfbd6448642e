"""A study: what was measured on which body, in mm, N and s."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

ESTIMATED = "estimated"
AXES = "xy"
"""Axes across the load; the last one of them is there in space only."""
SIDEWAYS = tuple(f"{what}_{axis}" for what in ("displacement", "force") for axis in AXES)
"""What a step has along them."""
UNKNOWN = "unknown"
"""A thickness that is not known."""


@dataclass(frozen=True)
class Step:
    """One step of the compression; None for what was not measured.

    Parameters
    ----------
    number : int
        As the study counts.
    time : float or None
        s.
    displacement, force : float or None
        Of the indenter, positive in compression; mm and N.
    picture, points : Path or None
        Picture at the step; table of measured displacements of points.
    force_noise : float or None
        Standard deviation of this force, N, where it is not that of the study.
    displacement_x, displacement_y : float or None
        Sideways displacement of the indenter, which simulations prescribe, mm.
    force_x, force_y : float or None
        Force of the indenter on the body along these axes, N.
    """

    number: int
    time: float | None = None
    displacement: float | None = None
    force: float | None = None
    picture: Path | None = None
    points: Path | None = None
    force_noise: float | None = None
    displacement_x: float | None = None
    displacement_y: float | None = None
    force_x: float | None = None
    force_y: float | None = None


@dataclass(frozen=True)
class Layer:
    """A layer of a block (height in mm), or an element set of a mesh."""

    name: str
    height: float | None = None
    elements: str | None = None


def wrong_name(name: str, others: Iterable[str]) -> str:
    """What is expected in place of the name of a layer, which names a set in decks; empty when it is right.

    >>> wrong_name("top", ["skin"])
    ''
    >>> wrong_name("Skin", ["skin"])
    'a name that no other layer has, in capitals or not'
    """
    if name.upper() in {other.upper() for other in others}:
        return "a name that no other layer has, in capitals or not"
    return "" if name.isidentifier() else "letters, digits and _"


@dataclass(frozen=True)
class Region:
    """A part of the body that is not a layer: inside an outline, where a picture has a label, or a set of the mesh.

    Parameters
    ----------
    name : str
    outline : tuple of tuple
        Corners in turn, mm; empty for a region that has none.
    table : Path or None
        Where the outline is from.
    labels : Path or None
        Picture of labels.
    label : int
        Of the region in it.
    elements : str or None
        Element set of the mesh.
    """

    name: str
    outline: tuple[tuple[float, float], ...] = ()
    table: Path | None = None
    labels: Path | None = None
    label: int = 1
    elements: str | None = None


@dataclass(frozen=True)
class Body:
    """Shape of the body: a layered block in the plane, a brick, or a mesh of the user's.

    Parameters
    ----------
    layers : tuple of Layer
        From the indenter down.
    width : float or None
        Of a block, mm.
    origin : tuple of float
        Lower left corner of a block, mm.
    thickness : float
        Out of plane, mm; 0 where a mesh comes without it.
    brick : tuple of float or None
        Lengths of the sides, mm.
    mesh, refined : Path or None
        Mesh file, and that of a finer mesh of the same body.
    thick : bool
        Whether the thickness is known; when it is not, `thickness` is 1 mm.
    types : tuple of str
        Element types in place of those of the mesh file.
    regions : tuple of Region
    """

    layers: tuple[Layer, ...]
    width: float | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    thickness: float = 1.0
    brick: tuple[float, float, float] | None = None
    mesh: Path | None = None
    refined: Path | None = None
    thick: bool = True
    types: tuple[str, ...] = ()
    regions: tuple[Region, ...] = ()


@dataclass(frozen=True)
class Noise:
    """Standard deviations: N, mm and intensity; None: not known; ``estimated``: from the data.

    That of pictures may be further pictures before compression: it is then what differs between them.
    `force_gain` is that of a factor common to the forces of all steps, such as the stiffness of a specimen, `frame`
    that of a shift common to all points of a step, such as that of the camera.
    """

    force: float | str | None = None
    displacement: float | str | None = None
    points: float | str | None = None
    picture: float | str | tuple[Path, ...] | None = None
    force_gain: float = 0.0
    frame: float = 0.0


@dataclass(frozen=True)
class Chain:
    """What was done to pictures by the camera, and what is done before they are compared, in this order.

    Parameters
    ----------
    trim : str or tuple of tuple
        ``body``: to the surroundings of the body; ``off``; or lower and upper corner of a box in space, mm.
    resize : tuple of int or None
        Pixels along each axis of the picture, x first.
    gaussian : float or None
        Standard deviation in pixels, 0 for none; None: the setting `fit.smooth`.
    scale : bool
        To 0 at the lowest and 1 at the highest intensity before compression.
    blur : float
        Standard deviation of the blur of the camera, mm; 0 where none is known.
    """

    trim: str | tuple[tuple[float, ...], tuple[float, ...]] = "body"
    resize: tuple[int, ...] | None = None
    gaussian: float | None = None
    scale: bool = True
    blur: float = 0.0


@dataclass(frozen=True)
class Study:
    """What was measured: in one test, or in the first of several.

    Parameters
    ----------
    path : Path
        The study's file.
    title : str
    control : str
        ``force`` or ``displacement``: what simulations prescribe.
    steps : tuple of Step
    before : Path or None
        Picture before compression.
    noise : Noise
    body : Body
    base, indenter : str
        ``held`` or ``slides``; ``glued`` or ``slides``.
    base_nodes, indenter_nodes : str
        Node sets of a user's mesh at the base and under the indenter.
    chain : Chain
        Preparation of the pictures.
    length : float
        Size of the study's unit of length, for tables of points.
    table : Path or None
        Table of the steps.
    template : str
        Deck template in place of that of the settings; empty for that one.
    direction : tuple of float
        Of the indenter's way, a unit vector; empty for straight down, against the last axis.
    test : str
        Name of this test, where the study has several.
    tests : tuple of Study
        All of them, this one too; empty where there is one.
    """

    path: Path
    title: str
    control: str
    steps: tuple[Step, ...]
    before: Path | None
    noise: Noise
    body: Body
    base: str
    indenter: str
    length: float = 1.0
    base_nodes: str = "BOTTOM"
    indenter_nodes: str = "TOP"
    chain: Chain = Chain()
    table: Path | None = None
    template: str = ""
    direction: tuple[float, ...] = ()
    test: str = ""
    tests: tuple[Study, ...] = ()

    @property
    def every(self) -> tuple[Study, ...]:
        """The tests of the study, at least one."""
        return self.tests or (self,)

    @property
    def course(self) -> tuple[dict[str, float], ...]:
        """What formulas know of each step.

        ``k`` of ``n``; ``now``, the share of the test that is over: of its time, of its steps where times are not
        known; ``loaded``, the share of the largest force, of the largest displacement where forces are not known;
        ``indented``, the share of the largest displacement, of the largest force where displacements are not known.
        """
        count = len(self.steps)
        times, forces, moved = ([getattr(s, name) for s in self.steps] for name in ("time", "force", "displacement"))
        even = [k / count for k in range(1, count + 1)]
        now = _shares(times, times[-1] if times else None) or even
        pushed, gone = (_shares(values, largest_of(values)) for values in (forces, moved))
        rows = enumerate(zip(now, pushed or gone or even, gone or pushed or even, strict=True), 1)
        names = ("now", "loaded", "indented")
        return tuple({"k": float(k), "n": float(count), **dict(zip(names, row, strict=True))} for k, row in rows)

    @property
    def region_names(self) -> list[str]:
        """Names of the regions of all tests."""
        return list(dict.fromkeys(region.name for test in self.every for region in test.body.regions))

    def of_test(self, name: str) -> Study:
        """One of its tests; the study itself for the name of none."""
        return next((test for test in self.tests if test.test == name), self)

    @property
    def moved_sideways(self) -> list[str]:
        """Axes along which the table of the steps moves the indenter sideways, of `AXES`."""
        return [axis for axis in AXES if any(getattr(s, f"displacement_{axis}") is not None for s in self.steps)]

    @property
    def oblique(self) -> bool:
        """Whether the indenter goes another way than straight down."""
        return bool(self.direction or self.moved_sideways)

    @property
    def on_a_rail(self) -> bool:
        """Whether the indenter is pushed along a direction that is not straight down."""
        return bool(self.direction) and self.control == "force"

    @property
    def response(self) -> str:
        """Which of ``force`` and ``displacement`` is not prescribed."""
        return "displacement" if self.control == "force" else "force"

    def measures(self, step: Step) -> bool:
        """Whether a force or displacement that is not prescribed was measured at a step."""
        return any(getattr(step, name) is not None for name in (self.response, *(f"force_{axis}" for axis in AXES)))

    @property
    def layer_names(self) -> list[str]:
        """Names from the indenter down."""
        return [layer.name for layer in self.body.layers]

    @property
    def thickness(self) -> float:
        """Out of plane, mm."""
        return self.body.thickness


def elsewhere(study: Study) -> Study:
    """The study with an indenter that goes as far down, but elsewhere aside."""
    *across, down = study.direction or (0.0,)
    steps = study.steps
    for axis in study.moved_sideways:
        name = f"displacement_{axis}"
        steps = tuple(replace(step, **{name: 1.0 + (getattr(step, name) or 0.0)}) for step in steps)  # type: ignore[arg-type]
    return replace(study, direction=(*(-part for part in across), down) if across else (), steps=steps)


def with_gain(study: Study, gain: float) -> Study:
    """The study with the prescribed quantity multiplied."""
    name = study.control
    return replace(study, steps=tuple(replace(step, **{name: getattr(step, name) * gain}) for step in study.steps))


def largest_of(values: Sequence[float | None]) -> float:
    """The largest size of those that are known; 0 where none is."""
    return max((abs(value) for value in values if value is not None), default=0.0)


def _shares(values: Sequence[float | None], whole: float | None) -> list[float]:
    """Sizes of values as shares of a whole; none where one of them is not known."""
    known = [abs(value) for value in values if value is not None]
    return [value / whole for value in known] if whole and whole > 0 and len(known) == len(values) else []
