"""Settings against the study that they are for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.forward.decks import make_deck, with_effect
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.applicable import cure_of, unmet
from fingerfit.model.effect import NUMERICS, Effect
from fingerfit.model.laws import LAWS, foreign
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import CONFIG, MeshSettings, Settings, too_long
from fingerfit.solvers.registry import get_solver
from fingerfit.study.data import Data
from fingerfit.study.study import Study


def check_against_study(settings: Settings, study: Study, where: Path | str = CONFIG) -> None:
    """Problems of settings with a study.

    Raises
    ------
    Problems
        Constants of layers that the study does not have, constants that are missing or without effect, a mesh twice
        or not at all or of another dimension, a score without the data it compares.
    """
    layers = study.layer_names
    problems: list[FingerfitError] = _missing_data(settings, study, where)
    problems += _unusable_folder(settings, where) + _unweighted_points(settings, study)
    model = settings.model
    strange: set[str] = set()
    for group, names in (("parameters", model.parameters), ("material", model.material)):
        for name in names:
            quantity, _, layer = name.partition("_")
            if layer and layer not in layers:
                strange.add(quantity)
                expected = "a layer of the study: " + ", ".join(layers)
                problems.append(InputError(where, f"model.{group}.{name}", f"layer {layer}", expected))
    given = {**model.material, **model.parameters}
    for quantity in (quantity for quantity in LAWS[model.law] if quantity not in strange):
        without = [layer for layer in layers if quantity not in given and f"{quantity}_{layer}" not in given]
        if without:
            expected = f"a value of {quantity} for " + (", ".join(without) if without != layers else "the layers")
            problems.append(InputError(where, f"model.material.{quantity}", "nothing", expected))
        if quantity in model.parameters and all(f"{quantity}_{layer}" in model.parameters for layer in layers):
            problems.append(
                InputError(
                    where,
                    f"model.parameters.{quantity}",
                    "a constant that no layer uses",
                    "no such key, or a layer without one of its own",
                )
            )
    has_mesh = study.body.mesh is not None
    if has_mesh == (model.mesh is not None):
        found = "a mesh, and one in the study" if has_mesh else "nothing"
        problems.append(InputError(where, "model.mesh", found, "one mesh: here or in the study"))
    if has_mesh and model.refined is not None:
        problems.append(InputError(where, "model.refined", "a mesh", "no such key: the study brings its mesh"))
    for key, mesh in (("mesh", model.mesh), ("refined", model.refined)):
        if mesh is None or has_mesh:
            continue
        dim = 3 if study.body.brick is not None else 2
        problems += wrong_element(mesh, dim, settings.solver, where, f"model.{key}.element")
    if problems:
        raise Problems(problems)


def wrong_element(mesh: MeshSettings, dim: int, solver: str, where: Path | str, field: str) -> list[FingerfitError]:
    """A problem where a block (`dim` 2) or a brick (3) or a solver cannot have the elements of a mesh."""
    usable = sorted(e for e in get_solver(solver).capabilities.elements if ELEMENTS[e].dim == dim)
    if mesh.element in usable:
        return []
    body = "a brick" if dim == 3 else "a block in the plane"
    return [InputError(where, field, mesh.element, f"{', '.join(usable)}, for {body} and solver {solver}")]


def check_effects(settings: Settings, study: Study, mesh: Mesh, where: Path | str = CONFIG) -> None:
    """Problems of the effects of a model with the study and with each other.

    Raises
    ------
    Problems
        Effects of the solver's settings, effects that need what the study does not have, and effects that change
        nothing in its deck, as friction where nothing is in contact: their numbers could not be found; two effects
        that replace the same block of the deck.
    """
    problems: list[FingerfitError] = []
    for effect in _alone_in_blocks(settings.effects(where), where):
        field = f"model.effects.{effect.name}"
        lacking = unmet(effect, study, mesh.dim, settings.finer(study))
        if effect.acts == NUMERICS:
            problems.append(InputError(where, field, "an effect that is no part of a model", cure_of(effect)[1]))
        elif foreign(effect, settings.model.law):
            found = f"{effect.name}, which changes what law {settings.model.law} does not have"
            problems.append(InputError(where, field, found, "an effect beside this law, or law: ogden"))
        elif lacking:
            found = f"{effect.name}, which needs {' and '.join(lacking)}"
            problems.append(InputError(where, field, found, f"an effect that makes sense in {study.path}"))
        elif effect.simulated and not changes_the_deck(settings, study, mesh, effect):
            found = f"{effect.name}, which changes nothing in the deck of this study"
            expected = f"an effect on what {settings.model.template} has"
            problems.append(InputError(where, field, found, expected))
    if problems:
        raise Problems(problems)


def _alone_in_blocks(effects: tuple[Effect, ...], where: Path | str) -> tuple[Effect, ...]:
    """The effects; refused where two of them replace the same block, since no deck can have both."""
    owner: dict[str, str] = {}
    for effect in effects:
        for block in effect.replaces:
            if owner.setdefault(block, effect.name) != effect.name:
                found = f"{effect.name}, which replaces {block} of the deck, as {owner[block]} does"
                raise InputError(where, f"model.effects.{effect.name}", found, "one of both effects")
    return effects


def changes_the_deck(settings: Settings, study: Study, mesh: Mesh, effect: Effect) -> bool:
    """Whether the deck with an effect at its trial sizes differs from that without it."""
    known = effects_of(Path(settings.study))
    start = settings.starts()
    sizes = [effect.null(), *(with_effect(effect, {}, p.name) for p in effect.parameters)]
    without, *decks = (make_deck(settings, study, mesh, "mesh", {**start, **size}, known) for size in sizes)
    return any(deck != without for deck in decks)


def check_data(settings: Settings, study: Study, data: Data) -> None:
    """Refuse a likelihood of what has no noise: it would leave that out, or be the same for all guesses.

    Raises
    ------
    InputError
        For noise that is 0, as it is estimated from pictures without any.
    """
    if settings.fit.score != "likelihood":
        return
    if data.measured.size and not data.picture_noise > 0:
        raise InputError(study.path, "pictures.noise", f"{data.picture_noise:g}, as estimated", "a number above 0")
    measured, noise = data.response
    beside = bool((np.isfinite(measured) & (noise > 0)).any())
    if not (data.measured.size or beside or (data.points.size and data.points_noise > 0)):
        raise InputError(study.path, "noise", "0 for all that is compared", "a number above 0 for some of it")


def _unusable_folder(settings: Settings, where: Path | str) -> list[FingerfitError]:
    """Problems of the folder of the results, which is made when the first of them is written."""
    results = Path(settings.results)
    for key, path in (("results", results), ("model.name", Path(settings.model.full_name))):
        if problems := too_long(where, key, path):
            return problems
    there = next((path for path in (results, *results.parents) if path.exists()), results)
    if there.exists() and not there.is_dir():
        return [InputError(where, "results", f"{there}, which is a file", "a folder")]
    return []


def _unweighted_points(settings: Settings, study: Study) -> list[FingerfitError]:
    """Points that a likelihood would leave out without a word."""
    pointed = any(step.points for step in study.steps)
    if settings.fit.score != "likelihood" or not pointed or study.noise.points is not None:
        return []
    return [InputError(study.path, "noise.points", "nothing", "a number or estimated, since points are measured")]


def _missing_data(settings: Settings, study: Study, where: Path | str) -> list[FingerfitError]:
    fit, pictured = settings.fit, [step.number for step in study.steps if step.picture]
    usable = pictured or [step.number for step in study.steps]
    kind = "steps with a picture" if pictured else "steps of the study"
    problems: list[FingerfitError] = [
        InputError(where, "fit.steps", f"step {number}", f"{kind}: {usable}")
        for number in fit.steps or []
        if number not in usable
    ]
    if problems:
        return problems
    chosen = [step for step in study.steps if fit.steps is None or step.number in fit.steps]
    beside = study.steps if pictured else chosen  # as `prepare` leaves forces out
    pictured = fit.steps if pictured and fit.steps is not None else pictured
    response = "displacement" if study.control == "force" else "force"
    measured = [step for step in beside if getattr(step, response) is not None]
    if fit.score != "likelihood" and not pictured:
        return [InputError(where, "fit.score", fit.score, "likelihood, since no pictures are compared")]
    points = [step for step in chosen if step.points]
    noisy = [
        step
        for step in measured
        if getattr(study.noise, response) or (response == "force" and step.force_noise is not None)
    ]
    if fit.score != "likelihood" or pictured or noisy or (points and study.noise.points is not None):
        return []
    if not measured and not points:
        what = f"steps {fit.steps} without {response} and points"
        return [InputError(where, "fit.steps", what, "a step with something measured beside the control")]
    if not measured:
        return [InputError(study.path, "noise.points", "nothing", "a number or estimated, which the likelihood needs")]
    return [InputError(study.path, f"noise.{response}", "nothing", "a number, which the likelihood needs")]
