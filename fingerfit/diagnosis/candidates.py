"""Effects that make sense in a study and are not in its model, each with the simulations that show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fingerfit.core.errors import InputError
from fingerfit.deck.context import check_layer, check_layers
from fingerfit.diagnosis.budget import starts
from fingerfit.fit.problem import REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked
from fingerfit.forward.bodies import MESH_LINE
from fingerfit.forward.decks import with_effect
from fingerfit.model.applicable import not_measured
from fingerfit.model.effect import CONSTANTS, OUTLINE, Effect
from fingerfit.model.laws import foreign
from fingerfit.model.regions import PREFIX

ONE_OF_TWO = "only one of two effects that replace the same block of the deck"


@dataclass(frozen=True)
class Candidate:
    """An effect at one place, with the simulations that show it.

    Parameters
    ----------
    effect : Effect
    place : dict
        Its scanned numbers.
    asked : tuple of Asked
        One for each parameter; none for effects on the observation.
    choices : int
        How many of the effect's places are tried that differ in what no fit can move, as layers or borders.
    """

    effect: Effect
    place: dict[str, float]
    asked: tuple[Asked, ...] = ()
    choices: int = 1

    def is_that_of(self, other: Candidate) -> bool:
        """Whether it is the same model under another name: the same changes by the same decks, and no other ones."""
        if not self.asked or self.effect.observes or other.effect.observes:
            return False
        sims, theirs = [one.sim for one in self.asked], [one.sim for one in other.asked]
        return sims == theirs and self.effect.changes.keys() == other.effect.changes.keys()


def candidates(problem: InverseProblem, values: Mapping[str, float]) -> tuple[list[Candidate], dict[str, InputError]]:
    """Effects that are to be tried in this study and are not in the model, with their simulations at small sizes.

    Returns
    -------
    list of Candidate
    dict
        What the solver, or the deck, lacks for others, by their titles: they are not tried.
    """
    found: list[Candidate] = []
    lacking: dict[str, InputError] = {}
    without = problem.ask(values).sim
    for effect in sorted(problem.effects.values(), key=lambda effect: bool(effect.scan)):
        if not makes_sense(effect, problem):
            continue
        if effect.series and problem.meshes[SEARCH].dim == 3 and starts(problem) < len(effect.parameters):
            continue  # a simulation for each of tens of numbers may take hours in space: a person adds it
        for place in effect.places():
            if not may_be(effect, place, problem):
                continue
            try:
                asked = _asked(effect, place, problem, values)
            except InputError as error:
                if error.field != MESH_LINE:
                    raise
                lacking[effect.title] = error  # a template with nodes of its own: none can lie elsewhere
                continue
            if asked and all(one.sim == without for one in asked):
                continue  # no part of this study's deck: friction where nothing is in contact
            candidate = Candidate(effect, place, tuple(asked))
            if any(map(candidate.is_that_of, found)):
                continue  # one layer that stiffens, where there is one: an effect without a place comes first
            if asked and not any(one.effect.name == effect.name for one in found):
                # its first place only: the others have the same keywords
                refused = next(filter(None, map(problem.refusal, asked)), None)
                if refused is not None:
                    lacking[effect.title] = refused
                    break
            found.append(candidate)
    tried = {one.effect.title for one in found}
    found = [replace(one, choices=_choices(one.effect, found)) for one in found]
    return found, {title: error for title, error in lacking.items() if title not in tried}


def _choices(effect: Effect, found: Sequence[Candidate]) -> int:
    keys = effect.unmoved()
    return len({tuple(one.place[key] for key in keys) for one in found if one.effect is effect})


def _asked(
    effect: Effect, place: Mapping[str, float], problem: InverseProblem, values: Mapping[str, float]
) -> list[Asked]:
    """A simulation for each number of an effect at a place, at a small size of it."""
    asked = []
    for parameter in effect.parameters if effect.simulated else ():
        trial = with_effect(effect, place, parameter.name)
        role = f"{effect.name}.{parameter.name}"
        asked.append(problem.ask({**values, **trial}, role, nearby=values, first_order=False))
    return asked


def makes_sense(effect: Effect, problem: InverseProblem) -> bool:
    """Whether a model may have an effect more: to be tried, not in it by this or another name, and testable."""
    settings = problem.settings
    if not settings.tries(effect.name):
        return False
    if effect.name in (OUTLINE, *settings.model.effects) or foreign(effect, settings.model.law):
        return False
    if all(test.lacks(effect) for test in problem.every):  # one test that can have it is enough
        return False
    if effect.moves_first and not any(test.data.outline for test in problem.every):
        return False  # the first picture shows the sides where they are stated
    if any(one.series and one.probe and one.family == effect.family for one in settings.effects()):
        return False  # beside a field as fine as the data tell, no other form of the same
    return not (_is_fitted(effect, problem) or _replacing_the_same(effect, problem))


def may_be(effect: Effect, place: Mapping[str, float], problem: InverseProblem) -> bool:
    """Whether an effect may be at a place: a test has its layer, and none refuses it beside those of the model."""
    settings, counts = problem.settings, [len(test.study.layer_names) for test in problem.every]
    present = (*settings.effects(known=problem.effects), effect)
    values = {**settings.fixed(known=problem.effects), **place}
    try:
        check_layer(effect, values, max(counts))
        for count in counts:
            check_layers(present, values, count)
    except InputError:
        return False
    return True


def untestable(problem: InverseProblem) -> dict[str, InputError]:
    """Effects that may be in this body but cannot be tested on what was measured, by title, and what is lacking.

    Those on the observation are not among them: a brightness that drifts is none where there are no pictures. Nor are
    probes, which stand for others.
    """
    study, found = problem.study, dict[str, InputError]()
    for effect in problem.effects.values():
        if effect.name in (OUTLINE, *problem.settings.model.effects) or effect.observes_alone or effect.probe:
            continue
        if not problem.settings.tries(effect.name):
            continue
        if others := _replacing_the_same(effect, problem):
            found[effect.title] = InputError(study.path, "effects", f"a model without {others[0]}", ONE_OF_TWO)
            continue
        told = [
            not_measured(effect, test.study, test.meshes[SEARCH], REFINED in test.mesh_files) for test in problem.every
        ]
        lacking = next(filter(None, told), [])
        if lacking and all(test.lacks(effect) for test in problem.every):
            expected = "it in the study, or for a mesh in the settings: then the effect is tested"
            found[effect.title] = InputError(study.path, "effects", " and ".join(lacking), expected)
    return found


def left_out(problem: InverseProblem) -> list[str]:
    """Titles of the effects that config.yaml says not to try."""
    settings, every = problem.settings, problem.effects.values()
    return [e.title for e in every if not settings.tries(e.name) and e.name not in settings.model.effects]


def _replacing_the_same(effect: Effect, problem: InverseProblem) -> list[str]:
    """Effects of the model that replace the same block of the deck: beside them it cannot be there."""
    chosen = [problem.effects[name] for name in problem.settings.model.effects]
    return [other.name for other in chosen if set(other.replaces) & set(effect.replaces)]


def _is_fitted(effect: Effect, problem: InverseProblem) -> bool:
    """Whether all that an effect changes are constants that the model fits in every layer, or gives a region."""
    model = problem.settings.model.parameters
    own = f"mu_{effect.name.removeprefix(PREFIX)}"
    if effect.name.startswith(PREFIX) and own in {**model, **problem.settings.model.material}:
        return True
    names = {name for test in problem.every for name in test.study.layer_names}
    shared = "layer" not in effect.scan
    return (
        set(effect.changes) <= set(CONSTANTS)
        and bool(effect.changes)
        and not (effect.part or effect.fills or effect.replaces)
        and all(
            (quantity in model and (shared or len(names) == 1)) or all(f"{quantity}_{name}" in model for name in names)
            for quantity in effect.changes
        )
    )
