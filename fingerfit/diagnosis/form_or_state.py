"""Sides that lie elsewhere: another form of the body, or a state before the first picture that moved them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.progress import counted, tell
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.ranking import REFIT, Ranked, said_by
from fingerfit.diagnosis.refit import Refit, explains
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.second_pass import refit_of, with_outline
from fingerfit.diagnosis.sides import Sides, begun
from fingerfit.diagnosis.tested import Tested
from fingerfit.diagnosis.verdict import Verdict, nearer
from fingerfit.diagnosis.worth import LARGEST
from fingerfit.fit.jobs import solved, solved_since
from fingerfit.model.effect import OUTLINE, STATE

SURELY = 3.0
"""Standard deviations of chance."""
ANOTHER = "sides of the body elsewhere"
"""Another form of the body, in words."""
ROUGHLY = 2.0
"""How many times as far off as a state may leave a side to count slopes may leave it: they are rough. A choice."""


def form_or_state(
    verdict: Verdict, found: Tested, refits: Mapping[str, Refit], threads: int
) -> tuple[Verdict, list[tuple[Ranked, Refit]], Refit | None, int]:
    """The verdict on a model whose sides lie elsewhere in the picture before compression.

    Another form, which has no number, is tried first: where it explains the data, only those states are refitted that
    can bring the sides near enough (docs/decisions/0034-form-or-state.md).

    Parameters
    ----------
    verdict : Verdict
        Without regard to the sides.
    found : Tested
    refits : mapping
        Those so far, by name of the effect.
    threads : int

    Returns
    -------
    Verdict
    list of (Ranked, Refit)
        States that were refitted.
    Refit or None
        Of the model with the sides that the picture shows.
    int
        Simulations that were not known before.
    """
    form, run = with_outline(found.comparison.problem, found.comparison.last, threads)
    most = ROUGHLY * near_enough(found.outline, form) if form is not None else np.inf
    chosen = begun(found.comparison, found.everywhere, most)
    states, more = _refitted(found, chosen, threads)
    run += more
    if form is not None:
        # a state is judged by where it brings the sides, also where it was named without regard to them
        first = found.comparison.problem.effects[verdict.effects[0]] if verdict.effects else None
        named = refits.get(first.name) if first and first.family != STATE else None
        titles = {one.candidate.effect.name: one.candidate.effect.title for one in found.ranking}
        verdict = elsewhere(verdict, found.outline, form, states, named, found.score_test, titles)
    if form is not None and verdict.effects == (OUTLINE,) and refuted(form, found.score_test):
        probes = [one for one in found.ranking if one.candidate.effect.probe and one.candidate.effect.family == STATE]
        unknown, more = _refitted(found, probes, threads)
        states, run = [*states, *unknown], run + more
        verdict = strained(verdict, found.outline, next(iter(unknown), None))
    return verdict, states, form, run


def refuted(form: Refit, stated: ScoreTest) -> bool:
    """Whether a body at rest in the shape that the picture shows explains less of the data than one as stated."""
    return not explains(form) and form.misfit * stated.freedom > stated.misfit * form.freedom


def strained(verdict: Verdict, sides: Sides, probe: tuple[Ranked, Refit] | None) -> Verdict:
    """The verdict on a body that was not at rest in the shape that the picture shows, but that no known state explains.

    Parameters
    ----------
    verdict : Verdict
    sides : Sides
        Against the model without any effect more.
    probe : (Ranked, Refit) or None
        That of states before the first picture, refitted.
    """
    text = f"{shown(sides)}, but a body that is at rest in that shape would not deform like this one"
    if probe is None or not explains(probe[1]):
        return Verdict("unexplained", (), f"unexplained: {text}", verdict.threshold, STATE)
    effect = probe[0].candidate.effect
    return Verdict("missing", (effect.name,), f"missing: {effect.title}; {text}", verdict.threshold, effect.family)


def near_enough(sides: Sides, form: Refit) -> float:
    """How far off a state may leave a side to count, mm.

    Parameters
    ----------
    sides : Sides
        Against the model without any effect more.
    form : Refit
        Of the model whose body has the sides that the picture shows.
    """
    return (1.0 - ENOUGH) * sides.off if explains(form) else sides.off


def elsewhere(
    verdict: Verdict,
    sides: Sides,
    form: Refit,
    states: Sequence[tuple[Ranked, Refit]] = (),
    own: Refit | None = None,
    stated: ScoreTest | None = None,
    titles: Mapping[str, str] | None = None,
) -> Verdict:
    """The verdict, but on the outline where the picture before compression shows another body than the study states.

    That is seen without any model, and whatever is fitted to a body of another shape imitates it. It has another form,
    or was pressed or swelled before that picture. A state has to explain the data, and most of how far the sides are
    off, or where another form explains nothing, to bring them nearer; then the misfit decides, and what the numbers are
    worth. Sides are data of a state, and numbers of another form. Where data cannot tell these two apart, the likelier
    one comes first, or a state whose pictures are clearly nearer. Beside a state that counts, another that leaves more
    of the sides is named where it is as likely; so it is where the effect that the verdict names is surely likelier
    than another form. A state whose pictures are clearly nearer than those of another form is not excluded by it.
    Where neither explains the data, a state that surely is likelier than another form is the largest part.

    Parameters
    ----------
    verdict : Verdict
    sides : Sides
        Against the model without any effect more.
    form : Refit
        Of the model whose body has the sides that the picture shows.
    states : sequence of (Ranked, Refit)
        Effects on the state in that picture, refitted.
    own : Refit, optional
        Of the effect that the verdict names. Where it surely explains more than any of these, it comes first.
    stated : ScoreTest, optional
        Of the model as it is: a state that explains no more than that, sides included, is none.
    titles : mapping, optional
        Of the effects that the verdict names, by name.
    """
    text = f"missing: {ANOTHER}; {shown(sides, 'one')}"
    another = Verdict("missing", (OUTLINE,), text, verdict.threshold, "geometry")
    possible = [(one, refit) for one, refit in states if _counts(verdict, sides, refit, stated)]
    near = near_enough(sides, form)
    able = sorted((each for each in possible if each[1].sides.off <= near), key=lambda each: _left(each[1]))
    shaped = form.misfit - form.freedom + sides.worth
    if own is not None and explains(own):
        rivals = [shaped, *(_left(refit) for _, refit in able)]
        if _left(own) + _margin(verdict, form, own) < min(rivals):
            return _or_state(verdict, sides, own, possible, titles or {})
    if able and _ahead(able[0][1], form, sides) <= -verdict.threshold:
        able = [each for each in able if _nearer_form(each[1], form)]
    if not able:
        part = _largest_part(states, sides, form, stated) if stated is not None else None
        if part is None or _ahead(part[1], form, sides) < verdict.threshold:
            return another
        effect = part[0].candidate.effect
        found = _by_sides(verdict, sides, [(effect.name, effect.title)], effect.family, part[1])
        return replace(found, sentence=f"{found.sentence}; more is missing")
    first, best = able[0]
    # patches say the one and pixels another: these data cannot tell them apart
    named = [*(one.candidate.effect for one, refit in able if nearer(refit, best)), first.candidate.effect]
    # one that leaves a side farther off than that, but is as likely with what it leaves of the sides, is not excluded
    for one, refit in possible:
        alike = _left(refit) - _left(best) < _margin(verdict, refit, best)
        if alike and one.candidate.effect not in named:
            named.append(one.candidate.effect)
    both, family = [(effect.name, effect.title) for effect in named], first.candidate.effect.family
    if (ahead := _ahead(best, form, sides)) < verdict.threshold:
        if ahead < 0.0 and not _nearer_form(best, form):
            both, family = [(OUTLINE, ANOTHER), *both], another.family
        else:
            both.append((OUTLINE, ANOTHER))
    return _by_sides(verdict, sides, both, family, best)


def _or_state(
    verdict: Verdict,
    sides: Sides,
    own: Refit,
    states: Sequence[tuple[Ranked, Refit]],
    titles: Mapping[str, str],
) -> Verdict:
    """The verdict on an effect that surely is likelier than another form: beside it, or in its place, likely states.

    Parameters
    ----------
    verdict : Verdict
        That names the effect.
    sides : Sides
    own : Refit
        Of the effect.
    states : sequence of (Ranked, Refit)
        Those that explain the data.
    titles : mapping
        Of the effects that the verdict names.
    """
    alike = [each for each in states if _left(each[1]) < _left(own) + _margin(verdict, each[1], own)]
    alike.sort(key=lambda each: _left(each[1]))
    if not alike:
        return replace(verdict, sentence=f"{verdict.sentence}; {shown(sides)}")
    first, best = alike[0]
    surely = _left(best) + _margin(verdict, best, own) < _left(own)
    named = [
        one.candidate.effect
        for one, refit in alike
        if not surely or _left(refit) < _left(best) + _margin(verdict, refit, own)
    ]
    both = [(effect.name, effect.title) for effect in named]
    likelier = _left(best) < _left(own)
    if not surely:
        others = [(name, titles[name]) for name in verdict.effects]
        both = list(dict.fromkeys([*both, *others] if likelier else [*others, *both]))
    return _by_sides(verdict, sides, both, first.candidate.effect.family if likelier else verdict.family, best)


def _by_sides(verdict: Verdict, sides: Sides, named: Sequence[tuple[str, str]], family: str, refit: Refit) -> Verdict:
    """The verdict that names effects, by names and titles, with what the sides say; `refit` is that of the first."""
    names, titles = zip(*named, strict=True)
    if len(names) > 1:
        text = f"missing: {' or '.join(titles)}; these data cannot tell them apart; {shown(sides)}"
        return Verdict("indistinguishable", names, text, verdict.threshold, family)
    text = f"missing: {titles[0]}; with it {shown(sides)}"
    if refit.sides.off:
        text += f", and {refit.sides.off:.2g} mm from where this model has it"
    return Verdict("missing", names, text, verdict.threshold, family)


def shown(sides: Sides, which: str = "a side") -> str:
    """Where the picture has the sides, in words."""
    return f"the picture before compression shows {which} {sides.off:.2g} mm from where body in study.yaml has it"


def _counts(verdict: Verdict, sides: Sides, refit: Refit, stated: ScoreTest | None) -> bool:
    """Whether a state explains the data, brings the sides nearer, and is surely likelier than the model without it."""
    if not explains(refit) or refit.sides.misfit >= sides.misfit:
        return False
    if stated is None:
        return True
    return _left(refit) + _margin(verdict, stated, refit) < stated.misfit - stated.freedom + sides.misfit


def _left(refit: Refit) -> float:
    """What a refit leaves beyond what chance would, sides and its numbers included.

    Each refit has its own values, and some that another one has not.
    """
    return refit.misfit - refit.freedom + refit.sides.misfit + refit.worth


def _largest_part(
    states: Sequence[tuple[Ranked, Refit]], sides: Sides, form: Refit, stated: ScoreTest
) -> tuple[Ranked, Refit] | None:
    """Where another form does not explain the data: the state that does not either, but explains most of them.

    It must bring the sides nearer, and the pictures nearer than that form does.
    """
    part = [
        (one, refit)
        for one, refit in states
        if refit.sides.misfit < sides.misfit and _nearer_form(refit, form) and refit.explained(stated.misfit) >= LARGEST
    ]
    return None if explains(form) else min(part, key=lambda each: _left(each[1]), default=None)


def _nearer_form(state: Refit, form: Refit) -> bool:
    """Whether a state is clearly nearer in the pictures than another form of the body, fitted and held out.

    What the mesh of each makes of them is taken off: bodies of other shapes have other meshes.
    """
    own, other = (replace(one, fitted=one.at_least, held_out=one.held_at_least) for one in (state, form))
    return nearer(own, other)


def _margin(verdict: Verdict, one: ScoreTest | Refit, other: Refit) -> float:
    """By how much one of two models must leave less than the other to be surely the likelier one.

    Beside the threshold of the verdict it is what chance makes of the values that only one of them has.
    """
    return verdict.threshold + _by_chance(one, other)


def _by_chance(one: ScoreTest | Refit, other: Refit) -> float:
    """Difference of their misfits that chance makes of the values that only one of two models has."""
    return SURELY * float(np.sqrt(2.0 * abs(one.freedom - other.freedom)))


def _ahead(state: Refit, form: Refit, sides: Sides) -> float:
    """By how much a state leaves less than another form, with what sides say of the one and cost the other.

    What chance makes of the patches that only one of them has tells nothing.
    """
    patches = form.misfit - form.freedom - (state.misfit - state.freedom)
    beyond = float(np.copysign(max(0.0, abs(patches) - _by_chance(form, state)), patches))
    return beyond + sides.worth - state.sides.misfit - state.worth


def _refitted(found: Tested, chosen: Sequence[Ranked], threads: int) -> tuple[list[tuple[Ranked, Refit]], int]:
    """Effects on the state in the picture before compression, refitted from where they bring the sides nearest."""
    problem, states, first = found.comparison.problem, list[tuple[Ranked, Refit]](), solved(found.comparison.problem)
    for one in chosen:
        known, before = set(problem.asked), solved(problem)
        try:
            refit = refit_of(found.comparison, one, threads)
        except StateError:
            found.ended(one, problem.lost.why(sorted(problem.asked - known)))
            continue
        effect = one.candidate.effect
        away = f"a side is {refit.sides.off:.2g} mm off" if refit.sides.off else "sides are where the picture has them"
        by, ran = said_by(REFIT, problem.settings.model.effects), counted(solved_since(problem, before), "simulation")
        tell(f"{by}: {effect.name} ({effect.title}): {away}; {ran} run")
        states.append((one, refit))
    return states, solved_since(problem, first)
