"""Up and down the ladder of models: effects are added to config.yaml and taken out again."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path

from fingerfit.core.errors import InputError, SolverError
from fingerfit.core.files import read_record, write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.check import check_effects
from fingerfit.fit.problem import REFINED
from fingerfit.forward.decks import make_deck, refusal, template_of, with_effect
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.model.applicable import unmet
from fingerfit.model.catalogue import chosen
from fingerfit.model.effect import Effect
from fingerfit.prepare.prepare import make_mesh
from fingerfit.provenance.results import model_folder
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import CONFIG, Settings, load_settings
from fingerfit.settings.edit import remove_effect, write_effect, write_meshes
from fingerfit.settings.finer import finer_meshes, is_as_fine
from fingerfit.solvers.registry import get_solver
from fingerfit.study.reader import load_study, study_path
from fingerfit.study.several import of_test
from fingerfit.study.study import Study


def add(config: Path, name: str) -> str:
    """Add an effect to a config file, with the numbers that the last diagnosis found; says what was done.

    Raises
    ------
    FingerfitError
        For an effect that is not known, is there already, or needs what the solver lacks.
    """
    settings = load_settings(config)
    if not study_path(Path(settings.study)).exists():
        found = f"{settings.study}, where there is no study.yaml"
        raise InputError(config, "study", found, "the folder of a study, seen from the folder of this call")
    effect = chosen([name], effects_of(Path(settings.study)), config)[0]
    if name in settings.model.effects:
        raise InputError(config, f"model.effects.{name}", "it twice", "an effect that the model does not have yet")
    numbers, reused = _found(settings, name)
    _refuse(_with(settings, name, numbers, config), effect, config)
    write_effect(config, name, numbers)
    what = ", ".join(f"{key} {value:.4g}" for key, value in numbers.items())
    start = f", starting at {what}" if what else ""
    known = f"; {reused} simulations of its refit are reused" if reused else ""
    return f"{config}: added {name} ({effect.title}){start}{known}"


def drop(config: Path, name: str) -> str:
    """Take an effect out of a config file; says what was done.

    Raises
    ------
    InputError
        When the model does not have it.
    """
    settings = load_settings(config)
    if name not in settings.model.effects:
        has = ", ".join(settings.model.effects) or "none"
        raise InputError(config, f"model.effects.{name}", "no such effect in the model", f"one that it has: {has}")
    remove_effect(config, name)
    return f"{config}: dropped {name}; its results stay where they are"


def refine(config: Path) -> str:
    """Write a finer mesh into a config file; says what was done.

    Raises
    ------
    FingerfitError
        Where the file has it in a layout in which it cannot be changed alone, or it is larger than a mesh may be; of a
        mesh of the study's own, and of a brick, which would take many times as long; where one as fine has no solution.
    """
    settings = load_settings(config)
    mesh = settings.model.mesh
    if mesh is None or ELEMENTS[mesh.element].dim == 3:
        found = "none, but a mesh of the study's own" if mesh is None else f"{mesh.element}, a brick"
        raise InputError(config, "model.mesh", found, "a block in the plane, or a finer mesh made by hand")
    elements = get_solver(settings.solver).capabilities.elements
    made = finer_meshes({"mesh": mesh, "refined": settings.model.refined}, elements)
    meshes = {key: one for key, one in made.items() if one is not None}
    refined = settings.model.refined
    if refined and is_as_fine(meshes["mesh"], refined) and _fails_on_finer_mesh(settings):
        expected = "a solution there: the mesh of the search would become as fine"
        raise InputError(config, "model.refined", "a mesh without a solution at the best guess", expected)
    write_meshes(config, meshes)
    said = (f"{key}: {one.element}, across {one.across}, per_layer {one.per_layer}" for key, one in meshes.items())
    return f"{config}: finer mesh, {'; '.join(said)}"


def _fails_on_finer_mesh(settings: Settings) -> bool:
    """Whether a fit found no solution on its finer mesh, or one in which the body goes through itself."""
    path = model_folder(settings) / "estimate.json"
    return path.exists() and read_record(path, "sim_mesh")["sim_mesh"] != REFINED


def run_again(config: Path) -> str:
    """The command that fits and diagnoses the model of a config file."""
    chosen = "" if config == Path(CONFIG) else f" --config {config}"
    return f"fingerfit run{chosen} --diagnose"


def _with(settings: Settings, name: str, numbers: dict[str, float], where: Path) -> Settings:
    data = settings.model_dump(mode="json")
    data["model"]["effects"][name] = numbers
    return load_settings(data, where)


def _refuse(settings: Settings, effect: Effect, config: Path) -> None:
    """Refuse an effect of a model that makes no sense in the study, or needs what the solver lacks.

    Where that cannot be found out here, the fit's start will tell.
    """
    study = load_study(Path(settings.study))
    check_effects(settings, study, make_mesh(study, settings.model.mesh), config)
    for test in study.every if effect.simulated else ():
        _refuse_deck(settings, effect, test, config)


def _refuse_deck(settings: Settings, effect: Effect, study: Study, config: Path) -> None:
    """Refuse an effect that needs what the solver lacks in the deck of a test, unless the test cannot have it."""
    mesh = make_mesh(study, settings.model.mesh)
    if unmet(effect, study, mesh, settings.finer(study)):
        return
    known = effects_of(Path(settings.study))
    start = of_test(settings.starts(), study.test)
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as name, contextlib.suppress(SolverError):
        file = Path(name) / "mesh.inp"
        write_text(file, format_mesh(mesh))
        for parameter in effect.parameters:
            values = {**start, **with_effect(effect, effect.places()[0], parameter.name)}
            deck = make_deck(settings, study, mesh, "mesh", values, known)
            refused = refusal(settings.solver, template_of(settings, study), deck, file, "mesh")
            if refused is not None:
                found = f"{effect.name}, which needs {refused.found}"
                expected = f"an effect that solver {settings.solver} has what it needs for"
                raise InputError(config, f"model.effects.{effect.name}", found, expected)


def _found(settings: Settings, name: str) -> tuple[dict[str, float], int]:
    """Numbers of an effect in the diagnosis of the model without it, and how many simulations its refit asked for.

    The refit's start where there was one, so that its simulations are those of the model; else place and size as they
    were predicted; nothing where there is no diagnosis.
    """
    path = model_folder(settings) / "diagnosis.json"
    for entry in read_record(path, "ranking")["ranking"] if path.exists() else []:
        if entry["effect"] == name:
            refit = entry.get("refit") or {}
            predicted = {key: float(f"{value:.4g}") for key, value in {**entry["place"], **entry["size"]}.items()}
            return refit.get("start") or predicted, refit.get("simulations", 0)
    return {}, 0
