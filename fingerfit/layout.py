"""Which files and settings each part of the workflow depends on."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from fingerfit.effects.catalogue import catalogue
from fingerfit.errors import InputError
from fingerfit.extend import extended
from fingerfit.files import digest, read_json, write_text
from fingerfit.prepare import make_mesh
from fingerfit.settings import CONFIG, Settings
from fingerfit.settings_check import check_against_study, check_effects
from fingerfit.solvers.registry import get_solver
from fingerfit.study_file import load_study
from fingerfit.templates import template_folders

PACKAGE = Path(__file__).resolve().parent

# What a change of which must run a stage again. Solvers are not here: their identity names the simulations.
_READ = (
    "beside.py",
    "data.py",
    "files.py",
    "keys.py",
    "study.py",
    "study_file.py",
    "units.py",
    "imaging",
    "fem/elements.py",
    "fem/shapes.py",
)
_MESH = ("mesh.py", "mesh_check.py", "mesh_io.py", "meshing.py")
_FIT = (
    *_READ,
    *_MESH,
    "deck/render.py",
    "decks.py",
    "estimate.py",
    "effects",
    "fit.py",
    "refine.py",
    "choices.py",
    "course.py",
    "guess.py",
    "predict.py",
    "rounds.py",
    "score.py",
    "templates.py",
)
SOURCES: dict[str, tuple[str, ...]] = {
    "prepare": (*_READ, *_MESH, "pictured.py", "prepare.py"),
    "propose": (*_FIT, "search", "uncertainty.py"),
    "estimate": (*_FIT, "report.py", "uncertainty.py"),
    "plot": (*_FIT, "plots.py", "slices.py", "volumes.py"),
    "ladder": ("choices.py", "findings.py", "page"),
    "export": (*_READ, *_MESH, "export.py", "fields.py", "slices.py", "deck", "fem", "solvers/model.py"),
    "diagnose": (
        *_FIT,
        "diagnose.py",
        "examine.py",
        "extend.py",
        "findings.py",
        "judge.py",
        "pictured.py",
        "prepare.py",
        "residual.py",
        "simulate.py",
        "suspects.py",
        "verdict.py",
        "uncertainty.py",
    ),
}


@cache
def fingerprint(stage: str) -> str:
    """Hash of the sources that a stage runs."""
    parts: list[str | bytes] = []
    for name in SOURCES[stage]:
        path = PACKAGE / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            parts += [file.relative_to(PACKAGE).as_posix(), file.read_bytes()]
    return digest(*parts)


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
        "diagnose": {"solver": get_solver(settings.solver).identity(), "model": every["model"], "fit": fit},
    }
    return json.dumps(chosen[stage], sort_keys=True)


def study_folder(settings: Settings) -> Path:
    """``results/{study}``."""
    return Path(settings.results) / Path(settings.study).name


def model_folder(settings: Settings) -> Path:
    """``results/{study}/{model}``."""
    return study_folder(settings) / settings.model.full_name


def warm(settings: Settings, where: Path | str = CONFIG) -> Settings:
    """Settings whose search starts at the estimate of the model with one effect less; `where` is named in errors.

    Where there is none, a last effect with all its numbers starts there, and the constants where they would without it.

    Raises
    ------
    InputError
        When that model has no estimate yet, and the effect not all numbers.
    """
    if not settings.model.effects:
        return settings
    data = settings.model_dump(mode="json")
    effects = data["model"]["effects"]
    *before, last = effects
    parent = settings.model_copy(
        update={"model": settings.model.model_copy(update={"effects": {name: effects[name] for name in before}})}
    )
    path, effect = model_folder(parent) / "estimate.json", catalogue(Path(settings.study))[last]
    if path.exists():
        values = {name: entry["value"] for name, entry in read_json(path)["parameters"].items()}
    elif all(parameter.name in effects[last] for parameter in effect.parameters):
        values = warm(parent, where).starts()
    else:
        found, wanted = f"{last}, but no {path}", f"an estimate without it first: fingerfit drop {last}, then snakemake"
        raise InputError(where, f"model.effects.{last}", found, wanted)
    place = {effect.key(name): effects[last][name] for name in effect.scan if name in effects[last]}
    return extended(parent, effect, place, effects[last], values)


def check_model(settings: Settings, where: Path | str = CONFIG) -> None:
    """Refuse settings and effects of a model that make no sense in the study; `where` is named in errors.

    Raises
    ------
    FingerfitError
        With one line for each.
    """
    if not Path(settings.study).exists():
        raise InputError(where, "study", settings.study, "the folder of a study")
    study = load_study(Path(settings.study))
    check_against_study(settings, study, where)
    if settings.model.effects:
        check_effects(settings, study, make_mesh(study, settings.model.mesh), where)


def study_files(folder: Path) -> list[str]:
    """All files in the folder of a study that a fit may read: never the sealed truth."""
    return sorted(
        str(path)
        for path in folder.rglob("*")
        if path.is_file()
        and "sealed" not in path.parts
        and path.suffix not in {".j2", ".md"}
        and (path.suffix != ".yaml" or path.name == "study.yaml")
    )


def template_files(settings: Settings) -> list[str]:
    """All templates of decks and effects, those of the study and of installed packages included."""
    own, ours, *packages = template_folders(Path(settings.study))
    found = [path for path in ours.rglob("*.j2") if path.relative_to(ours).parts[0] != "report"]
    found += [*ours.rglob("*.yaml"), *own.rglob("*.j2"), *own.glob("effects/*.yaml")]
    found += [path for folder in packages for path in folder.glob("effects/*") if path.suffix in (".j2", ".yaml")]
    return sorted(map(str, found))


def figures(settings: Settings) -> list[str]:
    """Names of the figures that a finished fit has."""
    pictured = any(step.picture for step in load_study(Path(settings.study)).steps)
    searched = not settings.model.effects  # a model with effects starts at an estimate
    return ["force", *["search"][:searched], *["deformed_mesh", "pictures"][: 2 * pictured]]


def has_refined(settings: Settings) -> bool:
    """Whether there is a finer mesh: in the settings, or beside the mesh of the study."""
    return settings.model.refined is not None or load_study(Path(settings.study)).body.refined is not None


def write_settings(settings: Settings, path: Path) -> str:
    """Write the settings where they differ from what is there, and return the path."""
    text = json.dumps(settings.model_dump(mode="json"), indent=1) + "\n"
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
    return str(path)
