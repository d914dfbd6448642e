"""What each stage of the workflow depends on: settings, sources, and the contents of files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from fingerfit.core.contents import Contents
from fingerfit.core.errors import InputError
from fingerfit.core.files import digest, kept_json, read_record, write_text
from fingerfit.core.folders import PACKAGE
from fingerfit.fit.check import check_against_study, check_effects
from fingerfit.model.catalogue import with_numbers
from fingerfit.model.effect import OUTLINE
from fingerfit.prepare.prepare import make_mesh
from fingerfit.provenance.inputs import page_files, study_files, template_files
from fingerfit.provenance.results import model_folder, refuse, study_folder
from fingerfit.provenance.sources import reached
from fingerfit.settings.bound import effects_of
from fingerfit.settings.choices import KNOWN, known
from fingerfit.settings.config import CONFIG, Settings
from fingerfit.settings.extend import extended, rivals, with_model
from fingerfit.solvers.registry import get_solver
from fingerfit.study.reader import load_study
from fingerfit.study.several import AT, file_ending

COMMANDS = "fingerfit.commands"


@dataclass(frozen=True)
class Stage:
    """A stage of the workflow: the command of the same name.

    Parameters
    ----------
    after : str
        The stage whose results it reads.
    reads : str
        What it reads beside these: ``study``, ``templates`` of decks, of the ``page``.
    """

    after: str = ""
    reads: str = ""


STAGES = {
    "prepare": Stage(reads="study"),
    "propose": Stage("prepare", "templates"),
    "estimate": Stage("propose"),
    "plot": Stage("propose"),
    "diagnose": Stage("estimate"),
    "ladder": Stage("diagnose", "page"),
    "export": Stage("diagnose"),
}
"""In the order of their results. Solvers are not here: their identity names the simulations."""


@cache
def fingerprint(stage: str) -> str:
    """Hash of the sources that a stage can reach."""
    found = reached(COMMANDS, stage)
    return digest(found.text, *(part for name, path in found.modules.items() for part in (name, path.read_bytes())))


def fingerprints(contents: Contents) -> dict[str, str]:
    """Hashes of the sources of all stages; the imports are followed only where a source has changed since."""
    key = contents.of(sorted(PACKAGE.rglob("*.py")))
    return contents.remember("sources", key, lambda: {stage: fingerprint(stage) for stage in STAGES})


def made_from(settings: Settings, contents: Contents) -> dict[str, str]:
    """For each stage a hash of all that it is made from beside its own sources and settings: the contents of the files
    that it reads, and of the stages before it their sources, their settings and what they are made from.

    So results do not depend on the times of files, and a stage that was stopped knows of what was made anew before it.
    """
    code, study = fingerprints(contents), Path(settings.study)
    read = {
        "": "",
        "study": contents.of(map(Path, study_files(study))),
        "templates": contents.of(template_files(study)),
        "page": contents.of([*page_files(), *other_rungs(settings)]),
    }
    found: dict[str, str] = {}
    for name, stage in STAGES.items():
        before = (settings_of(settings, stage.after), code[stage.after], found[stage.after]) if stage.after else ()
        found[name] = digest(read[stage.reads], *before)
    return found


def other_rungs(settings: Settings) -> list[Path]:
    """Rungs of the other models of a study, which are on its ladder or beside it."""
    own = model_folder(settings)
    return [path for path in sorted(study_folder(settings).glob("*/rung.json")) if path.parent != own]


def settings_of(settings: Settings, stage: str) -> str:
    """The settings that a stage depends on, as one line of JSON."""
    every = settings.model_dump(mode="json")
    fit = every["fit"]
    pictures = {name: fit[name] for name in ("steps", "smooth", "crop")}
    chosen: dict[str, Any] = {
        "prepare": {
            "study": every["study"],
            "meshes": [every["model"][name] for name in ("mesh", "refined")],
            "pictures": pictures,
        },
        "propose": {
            "solver": get_solver(settings.solver).identity(),
            **{name: every[name] for name in ("study", "model", "fit")},
        },
        "estimate": {"model": every["model"], "fit": fit},
        "plot": {},
        "ladder": {name: every[name] for name in ("study", "solver", "model", "fit")},
        "export": {},
        "diagnose": {
            "solver": get_solver(settings.solver).identity(),
            **{name: every[name] for name in ("model", "fit", "diagnosis")},
        },
    }
    return json.dumps(chosen[stage], sort_keys=True)


def warm(settings: Settings, where: Path | str = CONFIG) -> Settings:
    """Settings whose search starts at the estimate of the model with one effect less; `where` is named in errors.

    Where there is none, a last effect with all its numbers starts there, and the constants where they would without it.
    The settings have the models that the diagnoses before could not tell from this one as its rivals.

    Raises
    ------
    InputError
        When that model has no estimate yet, and the effect not all numbers.
    """
    if not settings.model.effects:
        return settings
    effects = settings.model.effects
    *before, last = effects
    parent = with_model(settings, effects={name: effects[name] for name in before})
    path = model_folder(parent) / "estimate.json"
    given = effects[last]
    effect = with_numbers(effects_of(Path(settings.study))[last], given)
    names = [key.partition(".")[2] for p in effect.parameters for key in settings.names_of(effect.key(p.name))]
    if path.exists():
        values = {name: entry["value"] for name, entry in read_record(path, "parameters")["parameters"].items()}
        values |= _refit_constants(path.with_name("diagnosis.json"), last, given)
    elif all(name in given or name.partition(AT)[0] in given for name in names):
        shared = [name for name in settings.model.per_test if name.partition(".")[0] != last]
        values = warm(with_model(parent, per_test=shared), where).starts()
    else:
        found, wanted = (
            f"{last}, but no {path}",
            f"an estimate without it first: fingerfit drop {last}, then the same run",
        )
        raise InputError(where, f"model.effects.{last}", found, wanted)
    place = {effect.key(name): value for name, value in given.items() if name.partition(AT)[0] in effect.scan}
    wider = extended(parent, effect, place, given, values)
    return with_model(wider, rivals=_rivals(settings) | settings.model.rivals)


def _rivals(settings: Settings) -> dict[str, dict[str, tuple[float, float]]]:
    """Models that the diagnoses on the way to this one could not tell from it, as ``model.rivals`` has them."""
    found, effects = dict[str, dict[str, tuple[float, float]]](), settings.model.effects
    for count, last in enumerate(effects):
        parent = with_model(settings, effects={name: effects[name] for name in list(effects)[:count]})
        path = model_folder(parent) / "diagnosis.json"
        record = read_record(path, "ranking", "effects") if path.exists() else {"ranking": [], "effects": []}
        refits = {entry["effect"]: entry["refit"] for entry in record["ranking"] if entry.get("refit")}
        if record.get("outlined"):
            refits[OUTLINE] = record["outlined"]
        if last in refits:
            # older versions kept none
            intervals = {name: refit["intervals"] for name, refit in refits.items() if "intervals" in refit}
            found |= rivals(parent, last, refits[last]["parameters"], record["effects"], intervals)
    return found


def _refit_constants(diagnosis: Path, effect: str, numbers: dict[str, float]) -> dict[str, float]:
    """Where the refit of an effect that started from these numbers had the other ones: the model repeats it."""
    for entry in read_record(diagnosis, "ranking")["ranking"] if diagnosis.exists() else []:
        refit = entry.get("refit") or {}
        if entry.get("effect") == effect and refit.get("start") == numbers:
            found: dict[str, float] = refit.get("constants", {})
            return found
    return {}


def check_model(settings: Settings, where: Path | str = CONFIG) -> None:
    """Refuse folders of results, settings and effects that make no sense in the study; `where` is named in errors.

    Raises
    ------
    FingerfitError
        With one line for each.
    """
    refuse(settings, where)
    study = load_study(Path(settings.study))
    check_against_study(settings, study, where)
    if settings.model.effects:
        check_effects(settings, study, make_mesh(study, settings.model.mesh), where)


def figures(settings: Settings) -> list[str]:
    """Names of the figures that a finished fit has."""
    found = [] if settings.model.effects else ["search"]  # a model with effects starts at an estimate
    for test, name in zip(load_study(Path(settings.study)).every, tests_of(settings), strict=True):
        pictured = any(step.picture for step in test.steps)
        found += [f"{kind}{name}" for kind in ("force", *["deformed_mesh", "pictures"][: 2 * pictured])]
    return found


def tests_of(settings: Settings) -> list[str]:
    """Endings of the names of files that each test has for itself; empty in a study with one."""
    return [file_ending(test.test) for test in load_study(Path(settings.study)).every]


def has_refined(settings: Settings) -> bool:
    """Whether there is a finer mesh: in the settings, or beside the mesh of the study."""
    return settings.finer(load_study(Path(settings.study)))


def settings_text(settings: Settings, path: Path, with_study: bool = True) -> str:
    """Settings, and what a fit reads of the study, as they are written; errors name `path`."""
    return kept_json(path, settings.model_dump(mode="json") | ({KNOWN: known(settings)} if with_study else {}))


def write_settings(settings: Settings, path: Path, with_study: bool = False) -> str:
    """Write the settings, and what a fit reads of the study; return the path."""
    write_text(path, settings_text(settings, path, with_study))
    return str(path)
