"""What a user sets in config.yaml: described, checked, and the source of the schema and of docs/config.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from fingerfit.core.described import described, wanted
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.files import read_record
from fingerfit.core.keys import read_yaml, unknown_key
from fingerfit.model.effect import OUTLINE
from fingerfit.model.laws import LAWS, impossible
from fingerfit.model.parameters import round_value
from fingerfit.search.stages import EQUAL, GRID
from fingerfit.settings.choices import CONFIG, KNOWN, Choices, Model, quantity_of
from fingerfit.settings.parts import RATIO, Keys, MeshSettings, ParameterSettings, StageSettings

PLAIN = r"^[\w./+@~:,=-]+$"
"""Paths and names that need no quotes in a shell and are no patterns to Snakemake."""
RUNS = "runs"
"""Key of a config.yaml with several models."""
NAME = 255
"""Bytes of a file's name that Linux's file systems have."""


class ModelSettings(Model, Keys):
    """The model of the body."""

    name: str = Field(default="base", pattern=r"^[\w-]+$", description="Folder of its results; not sims or meshes.")
    template: str = Field(
        default="block.inp.j2",
        description="Deck template, looked up in the study's folder, then in templates/.",
    )
    law: Literal["ogden", "ogden2", "neo_hooke", "mooney_rivlin", "yeoh"] = Field(
        default="ogden",
        description="Hyperelastic law of all layers. Constants: mu and poisson of each; alpha of ogden; alpha, share,"
        " alpha2 of ogden2; share of mooney_rivlin; c2, c3 of yeoh.",
    )
    material: dict[str, float] = Field(
        default_factory=dict,
        description="Fixed constants of the law (see law), mu in MPa: for all layers, or for one as alpha_top.",
    )
    mesh: MeshSettings | None = Field(
        default=None, description="Mesh of the search; not allowed when the study brings a mesh."
    )
    refined: MeshSettings | None = Field(
        default=None,
        description="Finer mesh of the last steps: the estimate comes from it, and its difference from the coarse mesh"
        " estimates the mesh error.",
    )
    parameters: dict[str, ParameterSettings] = Field(
        min_length=1, description="What is identified: constants of the law, such as mu, or of one layer, as mu_top."
    )
    per_test: list[str] = Field(
        default_factory=list,
        description="In a study with several tests: constants, effects or single numbers of effects (onset.offset)"
        " that have a value of their own in each test, as mu_top@wide. All others are shared by all tests.",
    )
    effects: dict[str, dict[str, float]] = Field(
        default_factory=dict,
        description="Effects of the model, in the order in which they were added. Only numbers that differ from the"
        " effect's own need be given. If all numbers of the last one are given, the model without it is not fitted"
        " first.",
    )
    rivals: dict[str, dict[str, Annotated[tuple[float, float], wanted("both ends of an interval: [0.9, 1.2]")]]] = (
        Field(
            default_factory=dict,
            description="Other models that the data cannot tell from this one: for each constant both ends of its 95 %"
            " interval in that model, as factors of its value in this one (with log: false as differences). The 95 %"
            " intervals reach that far. The workflow writes them from the diagnosis of the model with one effect less.",
        )
    )

    @model_validator(mode="after")
    def _follow_outline(self) -> ModelSettings:
        for mesh in (self.mesh, self.refined):
            if mesh is not None:
                mesh._pictured = OUTLINE in self.effects
        return self


class FitSettings(Keys):
    """How the model is fitted."""

    score: Literal["nmi", "ssd", "likelihood"] = Field(
        description="nmi: normalized mutual information; ssd: squared difference; likelihood: all data with noise."
    )
    steps: list[int] | None = Field(
        default=None,
        min_length=1,
        description="Steps whose pictures are compared; all with a picture when left out. The others are held out: they"
        " test the model, and choose no effect.",
    )
    smooth: float = Field(default=1.0, ge=0, description="Gaussian on all pictures, standard deviation in pixels.")
    crop: float = Field(
        default=0.3,
        ge=0.05,
        description="How far beyond the undeformed body pictures are compared, as a share of its extent on each side.",
    )
    bins: int = Field(default=32, ge=4, le=512, description="Bins of the joint histogram.")
    batch: int = Field(default=2, ge=1, description="Guesses tried at once; the result does not depend on it.")
    max_evaluations: int = Field(default=400, ge=1, description="Largest number of guesses of the search.")
    replicates: int = Field(
        default=60,
        ge=20,
        description="Simulated repetitions of the measurement, each with new random noise, for the standard errors.",
    )
    seed: int = Field(default=1, ge=0, description="Seed of the noise of these repetitions.")
    tolerance: float = Field(
        default=0.02,
        ge=0,
        lt=1,
        description="Relative change of a constant that does not matter to you. An effect that changes no constant by"
        " more than this, and hardly lowers the error on held-out steps, may be a trace: the model is adequate without"
        " it.",
    )
    discrepancy: Literal["none", "estimate"] = Field(
        default="none",
        description="none: noise alone. estimate (with likelihood only): each kind of data (pictures, points, response)"
        " has a model error of unknown variance; the larger it is, the less this kind counts (docs/uncertainty.md).",
    )
    stages: list[StageSettings] = Field(min_length=1, description="Stages of the search, in order.")


class DiagnosisSettings(Keys):
    """Which effects the diagnosis tries."""

    only: list[str] | None = Field(
        default=None,
        min_length=1,
        description="Names of the effects that are tried (`fingerfit effects`). Left out: all that the study can have.",
    )
    without: list[str] = Field(
        default_factory=list,
        description="Names of effects that are not tried, since you know that they are not there: base_slip, where the"
        " base is glued for certain. What is not tried is never named: the verdict says how many there are, and"
        " diagnosis.json lists them.",
    )


class Settings(Choices, Keys):
    """config.yaml."""

    study: str = Field(pattern=PLAIN, description="Folder of the study.")
    results: str = Field(
        default="results",
        pattern=PLAIN,
        description="Folder of all results: in it those of each study, under its path without studies/, or under its"
        " name where it lies outside of the folder of the call.",
    )
    solver: str = Field(default="builtin", description="builtin, calculix, abaqus, or another one that is installed.")
    time_limit: int | None = Field(
        default=None,
        ge=1,
        description="Time for one simulation of a solver that runs a program, in s: a longer one is ended and stops the"
        " fit with an error (in the diagnosis its candidate does not count), and no answer is kept. Left out: 3600 for"
        " calculix, 14400 for abaqus (waiting for a licence included). It changes no answer, so that another limit"
        " makes nothing run again.",
    )
    model: ModelSettings = Field(description="The model of the body.")
    fit: FitSettings = Field(description="How the model is fitted.")
    diagnosis: DiagnosisSettings = Field(
        default_factory=DiagnosisSettings, description="Which effects the diagnosis tries."
    )


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
    if isinstance(source, Mapping) and RUNS in source:
        raise InputError(where, RUNS, "several models", "one: a file without runs, with its study, model and fit")
    _refuse_listed(source, where)
    settings, problems = described(Settings, source, where)
    problems = problems or _cross_check(settings, where)
    if problems:
        raise Problems(problems)
    settings.effects(where)
    if problems := [*_strange_rivals(settings, where), *_strange_candidates(settings, where)]:
        raise Problems(problems)
    return settings  # type: ignore[no-any-return]


def _refuse_listed(source: object, where: Path | str) -> None:
    """Name `runs` to those who list studies under a key of their own, or under that of one study."""
    for key, found in (("studies", "an unknown key"), ("study", "a list")):
        if isinstance(source, Mapping) and isinstance(source.get(key), list):
            expected = f"{RUNS}: [{{study: FIRST}}, {{study: SECOND}}], in which several studies are listed"
            raise InputError(where, key, found, expected)


def read_written(path: Path) -> Settings:
    """Settings with all checks, from the JSON that the workflow wrote of them.

    Raises
    ------
    StateError
        When the file is missing or damaged.
    Problems
        With one line for each wrong key.
    """
    return load_settings({key: value for key, value in read_record(path).items() if key != KNOWN}, path)


def _cross_check(settings: Settings, where: Path | str) -> list[FingerfitError]:
    from fingerfit.solvers.registry import get_solver

    problems = too_long(where, "study", Path(settings.study))
    try:
        get_solver(settings.solver)
    except FingerfitError as error:
        problems.append(FingerfitError(f"{where}: {error}"))
    law = settings.model.law
    constants = LAWS[law]
    for name, p in settings.model.parameters.items():
        field = f"model.parameters.{name}"
        quantity = quantity_of(name)
        if not _is_constant(name, law):
            problems.append(unknown_key(where, "model.parameters.", name, tuple(constants)))
        elif p.unit != constants[quantity].unit:
            problems.append(InputError(where, f"{field}.unit", p.unit, constants[quantity].unit))
        elif p.lower > p.upper:
            found = f"lower {p.lower:g}, which is above upper {p.upper:g}"
            problems.append(InputError(where, field, found, "lower below upper"))
        elif not p.lower <= p.start <= p.upper or round_value(p.lower) == round_value(p.upper):
            problems.append(InputError(where, field, f"start {p.start:g}", f"{p.lower:g} to {p.upper:g}, the bounds"))
        elif p.log and p.lower <= 0:
            problems.append(InputError(where, f"{field}.lower", p.lower, "above 0, for a search in the logarithm"))
        elif p.prior and not p.lower <= (known := p.prior.value) <= p.upper:
            expected = f"{p.lower:g} to {p.upper:g}, the bounds"
            problems.append(InputError(where, f"{field}.prior.value", f"{known:g}", expected))
        else:
            problems += impossible(where, f"{field}.lower", constants[quantity], p.lower)
            problems += impossible(where, f"{field}.upper", constants[quantity], p.upper)
            if constants[quantity].least and p.lower < 0 < p.upper:
                problems.append(InputError(where, field, f"{p.lower:g} to {p.upper:g}", "bounds without 0 between"))
    for name, value in settings.model.material.items():
        if not _is_constant(name, law):
            problems.append(unknown_key(where, "model.material.", name, tuple(constants)))
        else:
            problems += impossible(where, f"model.material.{name}", constants[quantity_of(name)], value)
    problems += [
        InputError(where, f"model.material.{name}", "a constant that is fitted, too", "no such key, or no parameter")
        for name in settings.model.material
        if name in settings.model.parameters
    ]
    if not problems:
        problems += _too_far_apart(settings, where)
    problems += _strange_per_test(settings, where)
    if settings.fit.discrepancy != "none" and settings.fit.score != "likelihood":
        found = f"{settings.fit.discrepancy} with score {settings.fit.score}"
        problems.append(InputError(where, "fit.discrepancy", found, "score: likelihood, or none"))
    steps = settings.fit.steps or []
    for step in sorted({step for step in steps if steps.count(step) > 1}):
        problems.append(InputError(where, "fit.steps", f"step {step} twice", "each step once"))
    if not problems:
        problems += _wrong_stages(settings, where)
    most = settings.fit.max_evaluations
    problems += [
        InputError(where, f"fit.stages.{n}.points", stage.points, f"at most {most}, the max_evaluations of the search")
        for n, stage in enumerate(settings.fit.stages)
        if stage.kind == GRID and stage.points > most
    ]
    names = [stage.name for stage in settings.fit.stages]
    for name in sorted({name for name in names if names.count(name) > 1}):
        problems.append(InputError(where, "fit.stages", f"{name} twice", "a name of its own for each stage"))
    return problems


def _strange_per_test(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """Names of what each test has for itself that neither a constant nor an effect of the model has."""
    model = settings.model
    problems: list[FingerfitError] = []
    for n, name in enumerate(model.per_test):
        if name not in model.parameters and name.partition(".")[0] not in model.effects:
            expected = "one of model.parameters or effects: " + ", ".join([*model.parameters, *model.effects])
            problems.append(InputError(where, f"model.per_test.{n}", name, expected))
    return problems


def _strange_rivals(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """Constants of rivals that the model does not have, and factors that no constant has."""
    if not settings.model.rivals:
        return []
    known, problems = {p.name: p for p in settings.parameters()}, list[FingerfitError]()
    for model, away in settings.model.rivals.items():
        field = f"model.rivals.{model}."
        problems += [unknown_key(where, field, name, tuple(known)) for name in away if name not in known]
        for name, (low, high) in away.items():
            if not low <= high:
                problems.append(InputError(where, f"{field}{name}", [low, high], "a lower end and a higher one"))
            elif name in known and known[name].log and low <= 0:
                expected = "above 0, factors of a constant that is searched in the logarithm"
                problems.append(InputError(where, f"{field}{name}", [low, high], expected))
    return problems


def _strange_candidates(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """Names of effects that the diagnosis shall try, or not, and that the study does not know."""
    named = {"only": settings.diagnosis.only or [], "without": settings.diagnosis.without}
    if not any(named.values()) or not Path(settings.study).is_dir():
        return []
    known = sorted(settings.known_effects())
    return [
        unknown_key(where, f"diagnosis.{key}.", name, known)
        for key, names in named.items()
        for name in names
        if name not in known
    ]


def too_long(where: Path | str, field: str, path: Path) -> list[FingerfitError]:
    """A problem of a path with a name that no file can have."""
    sizes = [size for part in path.parts if (size := len(part.encode())) > NAME]
    return [InputError(where, field, f"a name of {size} bytes", f"at most {NAME}, as files have") for size in sizes[:1]]


def _too_far_apart(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """A problem of the largest mu, fixed or a bound, where it is out of reach of the smallest."""
    model = settings.model
    given = {f"model.material.{name}": value for name, value in model.material.items()}
    for name, p in model.parameters.items():
        given |= {f"model.parameters.{name}.lower": p.lower, f"model.parameters.{name}.upper": p.upper}
    given = {field: value for field, value in given.items() if field.split(".")[2].partition("_")[0] == "mu"}
    if not given:
        return []
    low, high = min(given, key=given.__getitem__), max(given, key=given.__getitem__)
    most = RATIO * given[low]
    if given[high] <= most:
        return []
    expected = f"at most {most:.3g} MPa: {RATIO:.2g} times {low}, where double precision ends"
    return [InputError(where, high, f"{given[high]:g} MPa", expected)]


def _wrong_stages(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """Tied parameters that are not there or cannot be alike, and units that cannot be compared."""
    known, problems = settings.model.parameters, list[FingerfitError]()
    for n, stage in enumerate(settings.fit.stages):
        field, names = f"fit.stages.{n}.tied", settings.tied(stage)
        missing = [name for name in names if name not in known]
        if missing or not names:
            found = ", ".join(missing) or str(stage.tied)
            expected = f"{', '.join(dict.fromkeys(map(quantity_of, known)))} or a list of {', '.join(known)}"
            problems.append(InputError(where, field, found, expected))
            continue
        tied = [known[name] for name in names]
        lower, upper = max(p.lower for p in tied), min(p.upper for p in tied)
        text = ", ".join(names)
        if stage.kind in (GRID, EQUAL) and len({(p.unit, p.log) for p in tied}) > 1:
            expected = f"one unit and one log for all of them, or fewer of them, for a stage {stage.kind}"
            problems.append(InputError(where, field, f"{text} with several", expected))
        elif stage.kind in (GRID, EQUAL) and not round_value(lower) < round_value(upper):
            expected = f"bounds that overlap, or fewer of them, for a stage {stage.kind}"
            problems.append(InputError(where, field, f"{text} with bounds that do not overlap", expected))
        moved = tied if stage.kind == EQUAL else list(known.values())
        if stage.kind != GRID and stage.tolx_in == "unit" and len({p.unit for p in moved}) > 1:
            units = ", ".join(sorted({p.unit for p in moved}))
            expected = "share, since the parameters have several units"
            problems.append(InputError(where, f"fit.stages.{n}.tolx_in", f"unit, for {units}", expected))
    return problems


def _is_constant(name: str, law: str) -> bool:
    quantity, joint, layer = name.partition("_")
    return quantity in LAWS[law] and bool(joint) == bool(layer)
