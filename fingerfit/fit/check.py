"""Settings against the study that they are for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.folders import template_folders
from fingerfit.deck.context import check_layer, check_layers
from fingerfit.deck.render import is_template
from fingerfit.forward.decks import make_deck, template_of, with_effect
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.applicable import cure_of, unmet
from fingerfit.model.effect import NUMERICS, Effect
from fingerfit.model.laws import LAWS, foreign
from fingerfit.model.regions import PREFIX
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import CONFIG, Settings, too_long
from fingerfit.settings.parts import MeshSettings
from fingerfit.solvers.registry import get_solver
from fingerfit.study.data import Data
from fingerfit.study.several import AT, of_test
from fingerfit.study.study import AXES, Study, elsewhere

APART = 0.01
"""By which share of the way to its lower bound a constant is moved more than the one before, so that no two are alike.
A choice."""


def check_against_study(settings: Settings, study: Study, where: Path | str = CONFIG) -> None:
    """Problems of settings with a study.

    Raises
    ------
    Problems
        Constants of layers that the study does not have, constants that are missing or without effect, a mesh twice
        or not at all or of another dimension, a score without the data it compares, a template that is not there.
    """
    problems = [problem for test in study.every for problem in _missing_data(settings, test, where)]
    problems += _unusable_folder(settings, where) + _of_several(settings, study, where)
    problems += _strange_layers(settings, study, where) + _no_template(settings, study, where)
    for test in study.every:
        problems += _unweighted(settings, test) + _missing_constants(settings, study, test, where)
        problems += _wrong_mesh(settings, test, where)
    if problems:  # what is wrong in every test is told once
        raise Problems(list({str(problem): problem for problem in problems}.values()))


def _of_several(settings: Settings, study: Study, where: Path | str) -> list[FingerfitError]:
    """Problems of a study with several tests, and of what each of them is to have for itself."""
    model, problems = settings.model, list[FingerfitError]()
    if not study.tests:
        expected = "no such key: the study has one test"
        found = ", ".join(model.per_test)
        return [InputError(where, "model.per_test", found, expected)] if model.per_test else []
    if settings.fit.score != "likelihood":
        expected = "likelihood: tests are weighed against each other by their noise"
        problems.append(InputError(where, "fit.score", settings.fit.score, expected))
    refined = [test.test for test in study.tests if settings.finer(test)]
    if 0 < len(refined) < len(study.tests):
        field, found = f"tests.{refined[0]}.body.refined", "a finer mesh, but not in every test"
        problems.append(InputError(study.path, field, found, "one in every test, or in none"))
    return problems


def _strange_layers(settings: Settings, study: Study, where: Path | str) -> list[FingerfitError]:
    """Constants of layers that no test has, and constants that no layer uses."""
    model, problems, layers = settings.model, list[FingerfitError](), _layers(study)
    regions = study.region_names
    for group, names in (("parameters", model.parameters), ("material", model.material)):
        for name in names:
            layer = name.partition("_")[2]
            if layer and layer not in layers + regions:
                expected = f"a layer{' or region' * bool(regions)} of the study: " + ", ".join(layers + regions)
                problems.append(InputError(where, f"model.{group}.{name}", f"layer {layer}", expected))
    problems += [
        InputError(where, f"model.{group}.mu_{name}", f"a constant beside the effect {PREFIX}{name}", "one of both")
        for group, given in (("parameters", model.parameters), ("material", model.material))
        for name in regions
        if f"mu_{name}" in given and PREFIX + name in model.effects
    ]
    for quantity in _right_quantities(settings, study):
        if quantity in model.parameters and all(f"{quantity}_{layer}" in model.parameters for layer in layers):
            expected = "no such key, or a layer without one of its own"
            found = "a constant that no layer uses"
            problems.append(InputError(where, f"model.parameters.{quantity}", found, expected))
    return problems


def _layers(study: Study) -> list[str]:
    """Names of the layers of all tests."""
    return list(dict.fromkeys(name for test in study.every for name in test.layer_names))


def _right_quantities(settings: Settings, study: Study) -> list[str]:
    """Constants of the law but those that are told wrong already, for a layer that is not there."""
    model, layers = settings.model, _layers(study)
    split = [name.partition("_") for name in (*model.parameters, *model.material)]
    strange = {quantity for quantity, _, layer in split if layer and layer not in layers + study.region_names}
    return [quantity for quantity in LAWS[model.law] if quantity not in strange]


def _missing_constants(settings: Settings, study: Study, test: Study, where: Path | str) -> list[FingerfitError]:
    """Constants of layers of a test that are given nowhere."""
    model, layers, problems = settings.model, test.layer_names, list[FingerfitError]()
    given = {**model.material, **model.parameters}
    for quantity in _right_quantities(settings, study):
        without = [layer for layer in layers if quantity not in given and f"{quantity}_{layer}" not in given]
        if without:
            expected = f"a value of {quantity} for " + (", ".join(without) if without != layers else "the layers")
            problems.append(InputError(where, f"model.material.{quantity}", "nothing", expected))
    return problems


def _no_template(settings: Settings, study: Study, where: Path | str) -> list[FingerfitError]:
    """Deck templates of a model, of a study, or of its tests, that are nowhere."""
    folders, shared = template_folders(Path(settings.study)), len({test.template for test in study.every}) == 1
    own, expected = settings.model.template, "a template in the folder of the study or in templates/"
    problems = list[FingerfitError]()
    if any(not test.template for test in study.every) and not is_template(own, folders):
        problems.append(InputError(where, "model.template", own, expected))
    return problems + [
        InputError(
            study.path,
            "template" if shared else f"tests.{test.test}.template",
            test.template,
            "a template beside it or in templates/",
        )
        for test in study.every
        if test.template and not is_template(test.template, folders)
    ]


def _wrong_mesh(settings: Settings, study: Study, where: Path | str) -> list[FingerfitError]:
    """A mesh twice or not at all, of another dimension, or a finer one that is coarser."""
    model, problems = settings.model, list[FingerfitError]()
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
    if not problems and model.mesh and model.refined and _nodes(model.refined) < _nodes(model.mesh):
        found = f"{_words(model.refined)}, coarser than model.mesh with {_words(model.mesh)}"
        problems.append(InputError(where, "model.refined", found, "a finer mesh: more across or per_layer"))
    return problems


def _nodes(mesh: MeshSettings) -> int:
    """What the number of nodes of a layer grows with: elements along all axes, twice as many of quadratic ones."""
    element = ELEMENTS[mesh.element]
    times = 2 if element.nodes > element.corners else 1
    return (times * mesh.across) ** (element.dim - 1) * times * mesh.per_layer


def _words(mesh: MeshSettings) -> str:
    return f"across {mesh.across}, per_layer {mesh.per_layer}, {mesh.element}"


def wrong_element(mesh: MeshSettings, dim: int, solver: str, where: Path | str, field: str) -> list[FingerfitError]:
    """A problem where a block (`dim` 2) or a brick (3) or a solver cannot have the elements of a mesh."""
    usable = sorted(e for e in get_solver(solver).capabilities.elements if ELEMENTS[e].dim == dim)
    if mesh.element in usable:
        return []
    body = "a brick" if dim == 3 else "a block in the plane"
    return [InputError(where, field, mesh.element, f"{', '.join(usable)}, for {body} and solver {solver}")]


def check_effects(settings: Settings, study: Study, mesh: Mesh, where: Path | str = CONFIG) -> None:
    """Problems of the effects of a model with the study and with each other, and of a loading that no deck has.

    In a study with several tests an effect may act in some of them; `mesh` is that of the first.

    Raises
    ------
    Problems
        Effects of the solver's settings, effects that need what the study does not have, and effects that change
        nothing in its deck, as friction where nothing is in contact: their numbers could not be found; two effects
        that replace the same block of the deck; an indenter that goes another way than straight down in the study,
        but not in the deck, as one that slides.
    """
    problems: list[FingerfitError] = []
    tests = [(test, make_mesh(test, settings.model.mesh) if n else mesh) for n, test in enumerate(study.every)]
    for test, own in tests:
        problems += _not_moved(settings, test, own)
    for effect in _in_their_layers(_alone_in_blocks(settings.effects(where), where), settings, study, where):
        told = (_wrong_effect(settings, test, own, effect, where) for test, own in tests)
        first = next(told)
        if first is not None and all(told):
            problems.append(first)
    if problems:
        raise Problems(problems)


def _not_moved(settings: Settings, study: Study, mesh: Mesh) -> list[FingerfitError]:
    """A direction or a sideways displacement of the indenter that the deck does not have."""
    if not study.oblique:
        return []
    start, known = of_test(settings.starts(), study.test), effects_of(Path(settings.study))
    asked, other = (make_deck(settings, one, mesh, "mesh", start, known) for one in (study, elsewhere(study)))
    if asked != other:
        return []
    field = "boundary.indenter.direction" if study.direction else "steps"
    found = "a direction" if study.direction else f"displacement_{study.moved_sideways[0]}"
    expected = "indenter: glued, or a template that moves the indenter aside"
    return [InputError(study.path, field, f"{found} with indenter: {study.indenter}", expected)]


def _wrong_effect(
    settings: Settings, study: Study, mesh: Mesh, effect: Effect, where: Path | str
) -> FingerfitError | None:
    """What is wrong with an effect in a test; None where it can act there."""
    field = f"model.effects.{effect.name}"
    if effect.acts == NUMERICS:
        return InputError(where, field, "an effect that is no part of a model", cure_of(effect)[1])
    if foreign(effect, settings.model.law):
        found = f"{effect.name}, which changes what law {settings.model.law} does not have"
        return InputError(where, field, found, "an effect beside this law, or law: ogden")
    if lacking := unmet(effect, study, mesh, settings.finer(study)):
        found = f"{effect.name}, which needs {' and '.join(lacking)}"
        return InputError(where, field, found, f"an effect that makes sense in {study.path}")
    if effect.simulated and not changes_the_deck(settings, study, mesh, effect):
        found = f"{effect.name}, which changes nothing in the deck of this study"
        return InputError(where, field, found, f"an effect on what {template_of(settings, study)} has")
    return None


def _alone_in_blocks(effects: tuple[Effect, ...], where: Path | str) -> tuple[Effect, ...]:
    """The effects; refused where two of them replace the same block, since no deck can have both."""
    owner: dict[str, str] = {}
    for effect in effects:
        for block in effect.replaces:
            if owner.setdefault(block, effect.name) != effect.name:
                found = f"{effect.name}, which replaces {block} of the deck, as {owner[block]} does"
                raise InputError(where, f"model.effects.{effect.name}", found, "one of both effects")
    return effects


def _in_their_layers(
    effects: tuple[Effect, ...], settings: Settings, study: Study, where: Path | str
) -> tuple[Effect, ...]:
    """The effects; refused where one is in a layer that no test has, or cannot be in a test or beside another one."""
    values, counts = {**settings.starts(), **settings.fixed()}, [len(test.layer_names) for test in study.every]
    try:
        for effect in effects:
            check_layer(effect, values, max(counts))
        for count in counts:
            check_layers(effects, values, count)
    except InputError as error:
        field = f"model.effects.{error.where.removeprefix('effect ')}.{error.field}"
        raise InputError(where, field, error.found, error.expected) from error
    return effects


def changes_the_deck(settings: Settings, study: Study, mesh: Mesh, effect: Effect) -> bool:
    """Whether the deck with an effect at its trial sizes differs from that without it.

    No two constants are alike there, as they often are at the start: a border between equal layers may lie anywhere.
    """
    known = effects_of(Path(settings.study))
    own = [p for p in settings.parameters() if p.name.partition(AT)[0] in settings.model.parameters]
    apart = {p.name: p.lower + (p.start - p.lower) * (1.0 - APART * n) for n, p in enumerate(own)}
    start = of_test({**settings.starts(), **apart}, study.test)
    sizes = [effect.null(), *(with_effect(effect, {}, p.name) for p in effect.parameters)]
    without, *decks = (make_deck(settings, study, mesh, "mesh", {**start, **size}, known) for size in sizes)
    return any(deck != without for deck in decks)


def check_data(settings: Settings, study: Study, data: Data) -> None:
    """Refuse a likelihood, or priors beside a squared difference, of what has no noise: nothing could be weighed.

    Raises
    ------
    InputError
        For noise that is 0, as it is estimated from pictures without any.
    """
    priors = any(p.prior for p in settings.model.parameters.values())
    if settings.fit.score != "likelihood" and not (priors and settings.fit.score == "ssd"):
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


def _unweighted(settings: Settings, study: Study) -> list[FingerfitError]:
    """Points and lateral forces that a likelihood would leave out without a word."""
    if settings.fit.score != "likelihood":
        return []
    lateral = [name for name in (f"force_{axis}" for axis in AXES) if any(getattr(s, name) for s in study.steps)]
    noisy = study.noise.force is not None or any(step.force_noise is not None for step in study.steps)
    unweighted = {
        "points": "points are" if any(step.points for step in study.steps) and study.noise.points is None else "",
        "force": f"{lateral[0]} is" if lateral and not noisy else "",
    }
    return [
        InputError(study.path, f"noise.{name}", "nothing", f"a number or estimated, since {what} measured")
        for name, what in unweighted.items()
        if what
    ]


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
    response = study.response
    measured = [step for step in beside if study.measures(step)]
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
