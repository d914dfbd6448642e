"""Effects of a study's own folder, tried before anything runs: their formulas and parts at a small size, and absent."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems, SolverError
from fingerfit.core.files import write_text
from fingerfit.core.folders import template_folders
from fingerfit.deck.context import deck_context, place_of
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import blocks
from fingerfit.fit.check import changes_the_deck
from fingerfit.forward.decks import make_deck, refusal, template_of
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.applicable import unmet
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import Effect
from fingerfit.model.laws import LAWS, impossible
from fingerfit.model.observation import Observation
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import Settings
from fingerfit.study.several import of_test
from fingerfit.study.study import Study

_ROUNDING = 1e-9
"""Of what a formula gives, as a share of what it is given: double precision, with digits lost by differences in it."""


def own_effects(settings: Settings, study: Study, mesh: Mesh) -> list[str]:
    """A line for each effect of the study's own folder, after its formulas and its part were tried at a small size.

    Raises
    ------
    Problems
        With one line for each that cannot be read, or whose formulas or part name what is not there.
    """
    folder = Path(settings.study) / "effects"
    known, whole = effects_of(Path(settings.study)), effects_of(Path(settings.study), whole=True)
    problems: list[FingerfitError] = [
        InputError(part, "file", "no .yaml beside it", f"{name}, or no such part")
        for part in sorted(folder.glob("*.inp.j2"))
        if not (folder / (name := f"{part.name.split('.')[0]}.yaml")).exists()
    ]
    named, ours = blocks(template_folders(Path(settings.study))), catalogue()
    lines = []
    for path in sorted(folder.glob("*.yaml")):
        effect = known[path.stem]
        problems += _strange_blocks(effect, path, named)
        lacking = unmet(effect, study, mesh, settings.finer(study))
        try:
            use = f"needs {' and '.join(lacking)}: not tested here"
            if not lacking:
                use = _tried(settings, study, mesh, effect, whole[path.stem])
        except InputError as error:
            own = error.where == f"effect {effect.name}"
            problems.append(InputError(path, error.field, error.found, error.expected) if own else error)
        else:
            lines.append(f"effect {effect.name}: {effect.title}; {use}")
            if effect.name in ours:
                lines.append(f"remark: {path} replaces the effect {effect.name} that comes with fingerfit or a package")
    if problems:
        raise Problems(problems)
    return lines


def _strange_blocks(effect: Effect, path: Path, known: list[str]) -> Iterator[InputError]:
    """Blocks that an effect fills or replaces and that no template has."""
    used = [(path, "replaces", block) for block in effect.replaces]
    used += [(path.parent / Path(part).name, "file", block) for block, part in effect.fills.items()]
    for where, field, block in used:
        if block not in known:
            yield InputError(where, field, f"block {block}", "a block of the deck: " + ", ".join(known))


def _tried(settings: Settings, study: Study, mesh: Mesh, effect: Effect, whole: Effect) -> str:
    """What an effect at its trial size changes; `whole`, it has the formulas for the other control, too."""
    sizes = {effect.key(p.name): p.null + p.step for p in effect.parameters}
    values = {**of_test(settings.starts(), study.test), **effect.places()[0], **sizes}
    found = []
    if changes_the_deck(settings, study, mesh, effect):
        found.append("the deck")
        _taken(settings, study, mesh, effect, values)
        _absent_in_deck(settings, study, mesh, effect)
    place_of(effect, values, mesh)
    seen = Observation.of([whole], values, mesh.body, study.course)
    if seen is not None:
        seen.shift(1, mesh.body[:1])
        seen.first(mesh.body[:1])
        seen.intensity(np.zeros(1), 1, *mesh.body[:1].T)
        for name in ("force", "displacement"):
            seen.response(np.zeros(len(study.steps)), name)
    refuse_when_absent(study, mesh, whole)
    if effect.observes:
        found.append(", ".join(effect.observes))
    return f"changes {' and '.join(found)}" if found else "changes nothing in this study: not tested here"


def _taken(settings: Settings, study: Study, mesh: Mesh, effect: Effect, values: Mapping[str, float]) -> None:
    """Refuse constants that a material cannot have, increments that are none, and a deck that the solver does not take.

    Where the solver is not there, that is told with the start of the fit.
    """
    known = effects_of(Path(settings.study))
    where, guess = f"effect {effect.name}", {**settings.fixed(), **values}
    context = deck_context(study, mesh, "mesh", guess, settings.model.material, known, settings.model.law)
    for layer in context["layers"]:
        for quantity, constant in LAWS[settings.model.law].items():
            if wrong := impossible(where, f"changes.{quantity}", constant, layer[quantity]):
                raise wrong[0]
    increment = float(context["increment"])
    if not 0 < increment <= 1:
        raise InputError(where, "changes.increment", f"{increment:g}", "above 0 and at most 1, the whole step")
    start = {**values, **effect.null()}
    with_it, without = (make_deck(settings, study, mesh, "mesh", one, known) for one in (values, start))
    template = template_of(settings, study)
    with tempfile.TemporaryDirectory(prefix="fingerfit-") as name, contextlib.suppress(SolverError):
        file = Path(name) / "mesh.inp"
        write_text(file, format_mesh(mesh))
        refused = refusal(settings.solver, template, with_it, file, "mesh")
        if refused is None or refusal(settings.solver, template, without, file, "mesh"):
            return  # what is not the effect's is told with the start of the fit
        part = Path(settings.study) / effect.part if effect.part else None
        place = part if part and part.exists() else where
        raise InputError(place, f"in the {refused.where}, {refused.field}", refused.found, refused.expected)


def _absent_in_deck(settings: Settings, study: Study, mesh: Mesh, effect: Effect) -> None:
    """Refuse formulas that change the deck at the effect's absent values, where they are not used at all.

    So the first step away from there would be a jump. The deck with such a formula is compared with the one where it
    gives what it was given; both are made as if the effect were there.
    """
    known = effects_of(Path(settings.study))
    values = {**of_test(settings.starts(), study.test), **effect.places()[0], **effect.null()}
    for what, formula in effect.changes.items():
        ones = [replace(_as_present(effect), changes={what: text}) for text in (formula, what)]
        decks = [make_deck(settings, study, mesh, "mesh", values, {**known, effect.name: one}) for one in ones]
        if decks[0] != decks[1]:
            raise _not_absent(effect, f"changes.{what}", formula, "the deck")


def refuse_when_absent(study: Study, mesh: Mesh, effect: Effect) -> None:
    """Refuse formulas that change what is measured at the effect's absent values, where they are not used at all."""
    for places in effect.places():
        seen = Observation.of([_as_present(effect)], {**places, **effect.null()}, mesh.body, study.course)
        if seen is None:
            return
        for what, formula in effect.observes.items():
            for found, given, size in _seen(seen, what, mesh.body):
                if (np.abs(found - given) > _ROUNDING * size).any():
                    raise _not_absent(effect, f"observes.{what}", formula, "what is measured")


def _seen(seen: Observation, what: str, at: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """What is measured at each step, of something, what that is made from, and its size."""
    every = range(len(seen.course) + 1)  # the first picture is one before compression
    if what == "intensity":
        picture = np.linspace(0.0, 1.0, len(at))
        yield from ((seen.intensity(picture, k, *at.T), picture, 1.0) for k in every)
    elif what.startswith(("shift_", "first_")):
        size = float(np.ptp(at, axis=0).max())
        shifts = [seen.first(at)] if what.startswith("first_") else [seen.shift(k, at) for k in every]
        yield from ((found, np.zeros(len(at)), size) for shift in shifts for found in _along(shift, what))
    else:
        response = np.arange(1.0, len(every))
        yield seen.response(response, what), response, float(len(response))


def _along(shift: np.ndarray, what: str) -> list[np.ndarray]:
    """The axis that ``shift_x`` and so on is along; none of a body in the plane for the third one."""
    return [part for axis, part in zip("xyz", shift.T, strict=False) if what[-1] == axis]


def _as_present(effect: Effect) -> Effect:
    """The effect as one that is there whatever its numbers are."""
    return replace(effect, parameters=tuple(replace(p, null=math.nan) for p in effect.parameters))


def _not_absent(effect: Effect, field: str, formula: str, what: str) -> InputError:
    absent = ", ".join(f"{p.name} {p.null:g}" for p in effect.parameters)
    found = f"{formula!r}, which changes {what} at the absent values {absent}"
    return InputError(f"effect {effect.name}", field, found, "a formula that changes nothing there")
