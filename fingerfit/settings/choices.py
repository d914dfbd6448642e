"""What follows from settings, and settings that were checked before, read again without the checks.

`propose` runs in every round: importing what checks config.yaml, study.yaml and effects, and checking them, would take
a third of its time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import read_json
from fingerfit.core.plain import from_plain, to_plain
from fingerfit.model.catalogue import chosen, with_numbers, wrong_numbers
from fingerfit.model.effect import Effect, EffectParameter
from fingerfit.model.laws import LAWS
from fingerfit.model.parameters import Parameter
from fingerfit.search import Plan, Stage
from fingerfit.study.several import AT
from fingerfit.study.study import Body, Chain, Layer, Noise, Region, Step, Study

CONFIG = "config.yaml"
KNOWN = "known"
"""Key of what the workflow read of the study beside the settings of a model."""
WIDE = 100.0
"""Ratio of bounds from which a number that an effect scans is searched in the logarithm: times."""


def quantity_of(name: str) -> str:
    """Constant of a material that a parameter is.

    >>> quantity_of("mu_top")
    'mu'
    """
    return name.partition("_")[0]


class Model:
    """What follows from the settings of a model."""

    @property
    def full_name(self: Any) -> str:
        """Name with the effects: that of its folder."""
        return str(self.path[-1])

    @property
    def path(self: Any) -> list[str]:
        """Names of the models on the way to this one: without effects, with the first, ..., with all."""
        effects = list(self.effects)
        return ["+".join([self.name, *effects[:count]]) for count in range(len(effects) + 1)]


class Choices:
    """What follows from settings."""

    def read_study(self: Any) -> Study:
        """The study."""
        from fingerfit.study.reader import load_study

        return load_study(Path(self.study))

    def known_effects(self: Any) -> dict[str, Effect]:
        """All effects that are known in the study, by name."""
        from fingerfit.settings.bound import effects_of

        return effects_of(Path(self.study))

    def parameters(self: Any) -> tuple[Parameter, ...]:
        """Parameters in the order of the file, then those of the effects."""
        own = [
            Parameter(
                name, p.unit, p.lower, p.upper, p.start, p.log,
                prior=(p.prior.value, p.prior.deviation) if p.prior else None,
            )
            for name, p in self.model.parameters.items()
        ]  # fmt: skip
        found = [replace(p, name=name) for p in own for name in self.names_of(p.name)]
        for effect in self.effects():
            given = self.model.effects[effect.name]
            for p in effect.parameters:
                for name, start in self._started(effect.key(p.name), given, p.null):
                    # a large number changes by shares of itself, as a modulus does
                    unity = max(p.scale, abs(start - p.null))
                    found.append(Parameter(name, p.unit, p.lower, p.upper, start, False, unity))
            for short, (lower, upper) in effect.refine.items():
                for name, start in self._started(effect.key(short), given, effect.scan[short][0]):
                    start, log = min(max(start, lower), upper), 0 < WIDE * lower <= upper
                    found.append(Parameter(name, effect.units.get(short, "1"), lower, upper, start, log=log))
        return tuple(found)

    def names_of(self: Any, name: str) -> list[str]:
        """Names in a guess of a constant or a number of an effect: one, or where each test has its own, as many."""
        chosen = self.model.per_test
        if not chosen or not {name, name.partition(".")[0]} & set(chosen):
            return [name]
        return [f"{name}{AT}{test.test}" for test in self.read_study().tests] or [name]

    def _started(self: Any, key: str, given: Mapping[str, float], absent: float) -> list[tuple[str, float]]:
        """Names of a number of an effect, and where each starts."""
        short = key.partition(".")[2]
        names = self.names_of(key)
        return [(name, given.get(name.partition(".")[2], given.get(short, absent))) for name in names]

    def finer(self: Any, study: Study) -> bool:
        """Whether there is a finer mesh: here, or beside the mesh of the study."""
        return self.model.refined is not None or study.body.refined is not None

    def starts(self: Any) -> dict[str, float]:
        """Where the search starts, by the names of the parameters."""
        return {parameter.name: parameter.start for parameter in self.parameters()}

    def effects(self: Any, where: Path | str = CONFIG, known: Mapping[str, Effect] | None = None) -> tuple[Effect, ...]:
        """Effects of the model, in order; `where` is named in errors, and `known` are those of the study, if at hand.

        Raises
        ------
        InputError
            For an effect or a number of it that is not known, with the nearest one that is; for a number out of bounds.
        """
        if not self.model.effects:
            return ()
        every = self.known_effects() if known is None else known
        if not every.keys() >= self.model.effects.keys() and not Path(self.study).is_dir():
            raise InputError(where, "study", self.study, "the folder of a study")
        found = chosen(list(self.model.effects), every, where)
        tests = [f"{AT}{test.test}" for test in self.read_study().tests] if self.model.per_test else []
        for problem in wrong_numbers(self.model.effects, every, where, "model.effects.", tests):
            raise problem
        return tuple(with_numbers(effect, self.model.effects[effect.name]) for effect in found)

    def tries(self: Any, effect: str) -> bool:
        """Whether the diagnosis tries an effect, where the study can have it."""
        chosen = self.diagnosis
        return (chosen.only is None or effect in chosen.only) and effect not in chosen.without

    def fixed(self: Any, known: Mapping[str, Effect] | None = None) -> dict[str, float]:
        """Numbers of effects that are not fitted: places and the like; `known` as of `effects`."""
        return {
            effect.key(name): self.model.effects[effect.name].get(name, values[0])
            for effect in self.effects(known=known)
            for name, values in effect.scan.items()
            if name not in effect.refine
        }

    def tied(self: Any, stage: Any) -> list[str]:
        """Names of the parameters that are alike in a stage, in the order of the file."""
        if isinstance(stage.tied, list):
            return list(dict.fromkeys(stage.tied))
        quantities = [quantity_of(name) for name in self.model.parameters]
        wanted = stage.tied or min(quantities, key=list(LAWS[self.model.law]).index)
        return [name for name, own in zip(self.model.parameters, quantities, strict=True) if own == wanted]

    def plan(self: Any) -> Plan:
        """How to search."""
        stages = tuple(
            Stage(s.name, s.kind, s.tolx, s.tolf, s.points, s.step, s.restarts, tied, s.tolx_in)
            for s in self.fit.stages
            for tied in [tuple(name for own in self.tied(s) for name in self.names_of(own))]
        )
        return Plan(stages, self.fit.batch, self.fit.max_evaluations)


class _ReadModel(SimpleNamespace, Model):
    pass


class _Read(SimpleNamespace, Choices):
    known: Any = None

    def read_study(self: Any) -> Study:
        return self.known["study"] if self.known else super().read_study()  # type: ignore[no-any-return]

    def known_effects(self: Any) -> dict[str, Effect]:
        return self.known["effects"] if self.known else super().known_effects()  # type: ignore[no-any-return]


def known(settings: Choices) -> dict[str, Any]:
    """What a fit reads of a study beside its measurements, as JSON has it."""
    return {"study": to_plain(settings.read_study()), "effects": to_plain(settings.known_effects())}


def read_checked(path: Path, time_limit: int | None = None) -> Any:
    """Settings from the JSON that `fingerfit.provenance.stages.write_settings` wrote of checked ones.

    They have all keys and methods of `fingerfit.settings.config.Settings` that a fit uses, not those of
    pydantic's models. Study and effects are what the workflow read when it began, where it wrote that, too.

    Parameters
    ----------
    path : Path
    time_limit : int, optional
        Seconds for one simulation, which the workflow does not write; none or 0 for the solver's own.

    Raises
    ------
    StateError
        When the file is missing, damaged or something else.
    """
    data = read_json(path)
    try:
        model, fit = data["model"], data["fit"]
        meshes = {name: SimpleNamespace(**model[name]) if model[name] else None for name in ("mesh", "refined")}
        priors = {
            name: SimpleNamespace(**p["prior"]) if p["prior"] else None for name, p in model["parameters"].items()
        }
        parameters = {
            name: SimpleNamespace(**{**entry, "prior": priors[name]}) for name, entry in model["parameters"].items()
        }
        stages = [SimpleNamespace(**stage) for stage in fit["stages"]]
        if KNOWN in data:
            kinds = (Study, Step, Body, Layer, Region, Noise, Chain, Effect, EffectParameter)
            data[KNOWN] = from_plain(data[KNOWN], *kinds)
        read = _Read(
            **{
                **data,
                "time_limit": time_limit or None,
                "model": _ReadModel(**{**model, **meshes, "parameters": parameters}),
                "fit": SimpleNamespace(**{**fit, "stages": stages}),
                "diagnosis": SimpleNamespace(**data["diagnosis"]),
            }
        )
    except (TypeError, KeyError, AttributeError) as error:
        raise StateError(f"{path}: is not what the workflow wrote: {error}") from error
    return read
