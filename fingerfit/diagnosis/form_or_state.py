"""Sides that lie elsewhere: another form of the body, or a state before the first picture that moved them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.progress import counted, tell
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.ranking import REFIT, Ranked, said_by
from fingerfit.diagnosis.refit import Refit, explains, per_number
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.second_pass import refit_of, with_outline
from fingerfit.diagnosis.sides import Sides, begun
from fingerfit.diagnosis.tested import Tested
from fingerfit.diagnosis.verdict import Verdict, nearer
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
    off, or where another form explains nothing, to bring them nearer; then the criterion of Schwarz (1978) decides. It
    knows the sides as data, which another form has as numbers, and between states that do as well. Beside one that
    counts, another that leaves more of the sides is named where it is as likely by that criterion; so it is where the
    effect that the verdict names is surely likelier than another form. A state whose pictures are clearly nearer than
    those of another form is not excluded by it.

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
    near = near_enough(sides, form)

    # what is left beyond what chance would: each has its own values, and some that another has not
    def left(refit: Refit) -> float:
        return refit.misfit - refit.freedom + refit.sides.misfit + refit.worth

    def counts(refit: Refit) -> bool:
        if not explains(refit) or refit.sides.misfit >= sides.misfit:
            return False
        if stated is None:
            return True
        surely = verdict.threshold + _chance(stated, refit)
        return left(refit) + surely < stated.misfit - stated.freedom + sides.misfit

    possible = [(one, refit) for one, refit in states if counts(refit)]
    able = [each for each in possible if each[1].sides.off <= near]
    shaped = form.misfit - form.freedom + sides.numbers * per_number(form.freedom)
    if own is not None and explains(own):
        rivals = [shaped, *(left(refit) for _, refit in able)]
        if left(own) + verdict.threshold + _chance(form, own) < min(rivals):
            falls = [(left(refit), one, refit) for one, refit in possible]
            return _or_state(verdict, sides, (left(own), own), falls, titles or {})
    if not able:
        return another
    one, refit = min(able, key=lambda each: left(each[1]))
    effect = one.candidate.effect
    gain, tell = shaped - left(refit), verdict.threshold + _chance(form, refit)
    if gain <= -tell:
        able = [each for each in able if nearer(each[1], form)]
        if not able:
            return another
        one, refit = min(able, key=lambda each: left(each[1]))
        effect = one.candidate.effect
    # patches say the one and pixels another: these data cannot tell them apart
    named = [*(each.candidate.effect for each, its in able if nearer(its, refit)), effect]
    # one that leaves a side farther off than that, but is as likely with what it leaves of the sides, is not excluded
    for each, its in possible:
        alike = left(its) - left(refit) < verdict.threshold + _chance(its, refit)
        if alike and each.candidate.effect not in named:
            named.append(each.candidate.effect)
    both = [(each.name, each.title) for each in named]
    if gain < tell:  # twelve numbers that happen to be those of a state would be a coincidence: the states come first
        both.append((OUTLINE, ANOTHER))
    return _by_sides(verdict, sides, both, effect.family, refit)


def _or_state(
    verdict: Verdict,
    sides: Sides,
    own: tuple[float, Refit],
    states: Sequence[tuple[float, Ranked, Refit]],
    titles: Mapping[str, str],
) -> Verdict:
    """The verdict on an effect that surely is likelier than another form: beside it, or in its place, likely states.

    Parameters
    ----------
    verdict : Verdict
        That names the effect.
    sides : Sides
    own : (float, Refit)
        What the effect leaves, sides included, and its refit.
    states : sequence of (float, Ranked, Refit)
        The same of each state that explains the data.
    titles : mapping
        Of the effects that the verdict names.
    """

    def margin(refit: Refit) -> float:
        return verdict.threshold + _chance(refit, own[1])

    alike = sorted((each for each in states if each[0] < own[0] + margin(each[2])), key=lambda each: each[0])
    if not alike:
        return replace(verdict, sentence=f"{verdict.sentence}; {shown(sides)}")
    least, first, best = alike[0]
    surely = least + margin(best) < own[0]
    named = [one.candidate.effect for less, one, refit in alike if not surely or less < least + margin(refit)]
    both = [(effect.name, effect.title) for effect in named]
    if not surely:
        others = [(name, titles[name]) for name in verdict.effects]
        both = list(dict.fromkeys([*both, *others] if least < own[0] else [*others, *both]))
    family = first.candidate.effect.family if surely or least < own[0] else verdict.family
    return _by_sides(verdict, sides, both, family, best)


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


def _chance(one: ScoreTest | Refit, other: Refit) -> float:
    """What chance makes of the values that only one of two models has."""
    return SURELY * float(np.sqrt(2.0 * abs(one.freedom - other.freedom)))


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
