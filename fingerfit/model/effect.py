"""What an effect is: a named, nested extension of the model, read from one YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

LOADING = "loading"
"""Effects on what is prescribed and on its reading."""
NUMERICS = "numerics"
"""Effects of mesh and load steps: they are tested, but cured by other settings instead of being fitted."""
OBSERVATION = "observation"
"""Effects on what is measured: they need no new simulation."""
ACTS = ("material", "structure", "boundary", LOADING, NUMERICS, OBSERVATION)
"""Where an effect acts."""
NEEDS = ("time", "pictures", "displacements", "layers", "plane", "space")
"""What an effect may need of a study: times of all steps, pictures, pictures or points, a block of layers in
the plane between a base and an indenter, a body in the plane, a body in space."""


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
        return min(self.upper - self.lower, TRIALS * self.step)


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
        mu at a place), ``force``, ``displacement`` (prescribed), ``before`` (prescribed before the first picture),
        ``increment`` (of the solver, as a share of a step).
    observes : mapping
        Formulas for what is measured: ``displacement``, ``force`` (the one that is not prescribed), ``intensity``,
        ``shift_x``, ``shift_y``, ``shift_z`` (mm).
    needs : tuple of str
        What a study must have, of `NEEDS`.
    control : str
        ``force`` or ``displacement`` where it makes sense only for one of them.
    part : str or None
        Template part in the deck.
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

    def key(self, parameter: str) -> str:
        """Name of a parameter or scanned number in a guess."""
        return f"{self.name}.{parameter}"

    def bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds of its numbers that have some, by short names."""
        return {p.name: (p.lower, p.upper) for p in self.parameters} | dict(self.refine)

    def null(self) -> dict[str, float]:
        """Values at which the effect is absent."""
        return {self.key(p.name): p.null for p in self.parameters}

    def places(self) -> list[dict[str, float]]:
        """All combinations of the scanned numbers; one empty one where there are none."""
        return [
            {self.key(name): value for name, value in zip(self.scan, values, strict=True)}
            for values in product(*self.scan.values())
        ]

    def own(self, values: Mapping[str, float]) -> dict[str, float]:
        """This effect's numbers in a guess, by their short names; null and first place where it has none."""
        first = self.places()[0]
        found = {p.name: values.get(self.key(p.name), p.null) for p in self.parameters}
        return found | {name: values.get(self.key(name), first[self.key(name)]) for name in self.scan}

    def present(self, values: Mapping[str, float]) -> bool:
        """Whether a guess has it at other than null values."""
        return any(values.get(self.key(p.name), p.null) != p.null for p in self.parameters)
