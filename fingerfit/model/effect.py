"""What an effect is: a named, nested extension of the model, read from one YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product

from fingerfit.model.formulas import evaluate, names_in

LOADING = "loading"
"""Effects on what is prescribed and on its reading."""
STATE = "state"
"""The family of what the body went through before the first picture."""
NUMERICS = "numerics"
"""Effects of mesh and load steps: they are tested, but cured by other settings instead of being fitted."""
OBSERVATION = "observation"
"""Effects on what is measured."""
ACTS = ("material", "structure", "boundary", LOADING, NUMERICS, OBSERVATION)
"""Where an effect acts."""
FAMILIES = {
    "material": "the material law",
    "structure": "stiffness from place to place",
    "base": "the base",
    "indenter": "the indenter and other boundaries",
    LOADING: "loading and time",
    STATE: "the state before the first picture",
    "geometry": "interfaces and outline",
    OBSERVATION: "the observation",
    NUMERICS: "mesh and load steps",
}
"""Families of effects, and the words for them. Members of one look alike more often than those of two."""
FAMILY_OF = {"boundary": "indenter"}
"""Family of an effect that names none, where it is not called as what it acts on."""
NEEDS = (
    *("time", "pictures", "displacements", "block", "layers", "base", "indenter", "sliding_base", "sliding_indenter"),
    *("plane", "space", "refined"),
)
"""What an effect may need of a study: times of all steps, pictures, pictures or points, a block or a brick,
flat layers, a flat base, a flat side under the indenter, such sides that slide, a body in the plane, a body in space, a
finer mesh."""
OUTLINE = "outline"
"""Name of the effect whose mesh has the sides that the picture before compression shows. It has no number and changes
no deck, and is found without a refit."""
LAYER = "layer"
"""Name of the scanned number that says in which layer an effect is, from 1 from the indenter down; 0 is in all."""
CONSTANTS = ("alpha", "poisson")
"""Constants of each layer that effects may change; a model may fit them, too."""
ASIDE = ("displacement_x", "displacement_y")
"""What effects may change of where the indenter goes aside, by axis; the second one in space only."""
MESH_ERROR = "mesh"
"""The expected error of the mesh: the only signal that is known without a simulation of its own."""
DIGITS = 6
"""Of a number that is a share of something: shares in YAML have no more."""

TRIALS = 30
"""Slopes are taken over 3 % of a parameter's scale: no farther than about a trial size, however wide the bounds are."""


@dataclass(frozen=True)
class EffectParameter:
    """One number of an effect.

    Parameters
    ----------
    name : str
        As its formulas call it.
    unit : str
        ``1`` for a pure number.
    null : float
        Where the effect is absent.
    lower, upper : float
        Bounds.
    step : float
        Trial size: the change from null at which slopes are taken; small, but well above a solver's tolerance.
    """

    name: str
    unit: str
    null: float
    lower: float
    upper: float
    step: float

    @property
    def scale(self) -> float:
        """What a fit counts as 1: the distance of the bounds, or `TRIALS` trial sizes where that is less."""
        return min(self.upper - self.lower, TRIALS * abs(self.step))


@dataclass(frozen=True)
class Effect:
    """A physical effect, or what is often mistaken for one.

    Parameters
    ----------
    name, title : str
        Key and words.
    acts : str
        One of `ACTS`.
    words, look, confirm : str
        What it is; what it looks like in the data; which experiment would confirm it.
    parameters : tuple of EffectParameter
        At their null values the model is the one without the effect.
    scan : mapping
        Places and the like that the score test tries: name to values.
    refine : mapping
        Bounds of those scanned numbers that a fit then changes, too; the others stay.
    changes : mapping
        Formulas for what goes into the deck: ``alpha``, ``poisson`` of each layer, ``field`` (logarithm of a factor on
        mu at a place), ``force``, ``displacement`` (prescribed), ``displacement_x``, in space ``displacement_y`` (of
        the indenter sideways, mm),
        ``before`` (prescribed before the first picture), ``pictured`` (1 where the stated height of a
        block is that in the first picture, under what is prescribed before), ``increment`` (of the solver, as a share
        of a step),
        ``deeper`` (mm that the indenter goes deeper at a node under it than at its own, at a step), ``beside_x``,
        ``beside_y`` (where the indenter comes down, mm from where it was said to),
        ``swelling`` (change of volume at a place and step, as a share), ``expansion`` (1 in layers that swell so, 0 in
        others), ``ageing`` (logarithm of a factor on the stiffness of a layer at a step).
    observes : mapping
        Formulas for what is measured: ``displacement``, ``force`` (the one that is not prescribed), ``intensity``,
        ``shift_x``, ``shift_y``, ``shift_z`` (mm, under load), ``first_x``, ``first_y``, ``first_z`` (in the first
        picture).
    needs : tuple of str
        What a study must have, of `NEEDS`.
    control : str
        ``force`` or ``displacement`` where it makes sense only for one of them.
    part : str or None
        Template part in the deck.
    fills : mapping
        Template parts in named blocks of the deck: block to template.
    replaces : tuple of str
        Blocks that lose what they have without it.
    shares_of : mapping
        Formulas of what numbers are shares of (`scales`), by short names; none is left once it is `bound`.
    units : mapping
        Units of scanned numbers that are shares of something, by short names.
    place : tuple of str
        Formulas of where a scanned place is, mm from the corner of the body; empty for effects without a place.
    told : mapping
        Words for scanned numbers, by short names; ``{value}``, ``{percent}``, ``{layer}`` in them stand for a number.
    signal : str
        `MESH_ERROR` for an effect that is this signal and changes no deck.
    fault, cure : str
        What is wrong, and what to do, where an effect of mesh and load steps shows.
    family : str
        One of `FAMILIES`.
    probe : bool
        Whether it stands for its whole family: numbers that can imitate any of its members, known or not.
    series : str
        The scanned number that says how many of its parameters it has, the first ones; empty where it has all of them.
    polynomial : bool
        Whether its parameters are coefficients of a polynomial by rising degree: each one is likely only where those
        of lower degrees are there.
    """

    name: str
    title: str
    acts: str
    words: str
    look: str
    confirm: str
    parameters: tuple[EffectParameter, ...]
    scan: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    refine: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    changes: Mapping[str, str] = field(default_factory=dict)
    observes: Mapping[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    control: str = ""
    part: str | None = None
    fills: Mapping[str, str] = field(default_factory=dict)
    replaces: tuple[str, ...] = ()
    shares_of: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    place: tuple[str, ...] = ()
    told: Mapping[str, str] = field(default_factory=dict)
    signal: str = ""
    fault: str = ""
    cure: str = ""
    family: str = ""
    probe: bool = False
    series: str = ""
    polynomial: bool = False

    def first(self, count: float) -> Effect:
        """The same with the first few of its parameters, where they are a series; else as it is."""
        if not self.series:
            return self
        return replace(
            self, parameters=self.parameters[: int(count)], scan={**self.scan, self.series: (float(int(count)),)}
        )

    @property
    def moves_first(self) -> bool:
        """Whether the first picture shows places elsewhere, too."""
        return any(what.startswith("first_") for what in self.observes)

    @property
    def simulated(self) -> bool:
        """Whether it takes simulations to see what it does."""
        return not self.observes_alone and not self.signal and bool(self.parameters)

    @property
    def observes_alone(self) -> bool:
        """Whether it changes what is measured and nothing of the deck."""
        return bool(self.observes) and not (self.changes or self.part or self.fills or self.replaces)

    @property
    def on_brightness(self) -> bool:
        """Whether it changes the brightness of pictures and nothing else."""
        return self.observes_alone and set(self.observes) == {"intensity"}

    @property
    def observes_response(self) -> bool:
        """Whether it changes how force or displacement is read."""
        return not {"force", "displacement"}.isdisjoint(self.observes)

    @property
    def on_loading(self) -> bool:
        """Whether it acts on what is prescribed, or only on how force or displacement is read.

        A state before the first picture is one of the body.
        """
        acts = self.acts == LOADING and self.family != STATE
        return acts or (self.observes_alone and self.observes_response)

    def under(self, control: str) -> Effect:
        """The same as it acts where `control`, ``force`` or ``displacement``, is prescribed and the other one measured.

        What it changes of the measured one, and shows of the prescribed one, falls away.
        """
        measured = "displacement" if control == "force" else "force"
        changes = {what: formula for what, formula in self.changes.items() if what != measured}
        observes = {what: formula for what, formula in self.observes.items() if what != control}
        if (len(changes), len(observes)) == (len(self.changes), len(self.observes)):
            return self
        return replace(self, changes=changes, observes=observes)

    def bound(self, scales: Mapping[str, float]) -> Effect:
        """The same with its shares as numbers, as far as what they are shares of is known (`scales`).

        Raises
        ------
        ValueError
            For a formula of a scale that is none, or is not above 0.
        """
        if not self.shares_of:
            return self
        sizes, left = dict[str, float](), dict(self.shares_of)
        for name, formula in self.shares_of.items():
            if names_in(formula) <= scales.keys():
                sizes[name] = float(evaluate(left.pop(name), scales))
                if not sizes[name] > 0:
                    raise ValueError(f"{formula!r} comes to {sizes[name]:g}")
        if not sizes:
            return self

        def size(name: str, share: float) -> float:
            return float(f"{share * sizes[name]:.{DIGITS}g}") if name in sizes else share

        def own(p: EffectParameter) -> EffectParameter:
            null, lower, upper, step = (size(p.name, share) for share in (p.null, p.lower, p.upper, p.step))
            return replace(p, null=null, lower=lower, upper=upper, step=step)

        return replace(
            self,
            parameters=tuple(own(p) for p in self.parameters),
            scan={name: tuple(size(name, value) for value in values) for name, values in self.scan.items()},
            refine={name: (size(name, low), size(name, high)) for name, (low, high) in self.refine.items()},
            shares_of=left,
        )

    def key(self, parameter: str) -> str:
        """Name of a parameter or scanned number in a guess."""
        return f"{self.name}.{parameter}"

    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of its numbers that have some, by short names; without those that are shares still."""
        found = {p.name: (p.lower, p.upper) for p in self.parameters} | dict(self.refine)
        return {name: pair for name, pair in found.items() if name not in self.shares_of}

    def null(self) -> dict[str, float]:
        """Values at which the effect is absent."""
        return {self.key(p.name): p.null for p in self.parameters}

    def places(self) -> list[dict[str, float]]:
        """All combinations of the scanned numbers; one empty one where there are none."""
        return [
            {self.key(name): value for name, value in zip(self.scan, values, strict=True)}
            for values in product(*self.scan.values())
        ]

    def unmoved(self) -> list[str]:
        """Scanned numbers that no fit can move, as a layer, by their names in a guess."""
        return [self.key(name) for name in self.scan if name not in self.refine and name != self.series]

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """This effect's numbers in a guess, by their short names; null and first place where it has none."""
        found = {p.name: values.get(self.key(p.name), p.null) for p in self.parameters}
        return found | {name: values.get(self.key(name), places[0]) for name, places in self.scan.items()}

    def present(self, values: Mapping[str, float]) -> bool:
        """Whether a guess has it at other than null values."""
        return any(values.get(self.key(p.name), p.null) != p.null for p in self.parameters)
