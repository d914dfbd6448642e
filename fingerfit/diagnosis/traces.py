"""What is named, but is a trace: it does not matter, is not likely, or is a small part of what is left."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fingerfit.diagnosis.effect_form import NO_FORM, Form
from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import Refit, chance, error_explained, explains, loud
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.diagnosis.verdict import MATTERS, WITHIN, Verdict
from fingerfit.diagnosis.worth import LARGEST, LIKELY_ENOUGH, odds_of_any


def traced(
    verdict: Verdict,
    score_test: ScoreTest,
    ranking: Sequence[Ranked],
    refits: Mapping[str, Refit],
    base: Refit,
    tolerance: float,
    tests: int,
    form: Form = NO_FORM,
) -> Verdict:
    """The verdict, but *adequate* where the model explains the data and what is named does not matter or is not likely.

    With many values everything is beyond chance. An effect matters when it moves a constant by more than the tolerance,
    or lowers the error on held-out steps (on fitted ones, where there are no others) by more than `MATTERS`. What is
    named, matters, and explains enough (below) is likely when the odds that one of it is there, against the model that
    explains the data without it, are more than `LIKELY_ENOUGH`; before it was seen, each of those that were tested had
    an equal share of what speaks for any of them. What speaks for it is only what the form of the effects that the
    model has does not explain (`Form`), and a model explains the data also where it leaves no more than that form and
    noise. Beside effects of the model that leaves more, what acts on the body or on pictures is a trace as well where
    nothing of it both matters and is likely. Where pictures differ by much (`loud`), nothing is.

    Where a model explains the data, but leaves more than chance does, there is an error of unknown form: what explains
    less than half of that may be another part of the same error, and is a trace.

    Parameters
    ----------
    verdict : Verdict
    score_test : ScoreTest
        Of the model without the effects.
    ranking : sequence of Ranked
    refits : mapping
        By name of the effect.
    base : Refit
        The model without the effects: its constants and errors.
    tolerance : float
        Share of a constant.
    tests : int
        How many effects, and places of them, were tested.
    form : Form
        Of the model's own effects.
    """
    if verdict.kind == "adequate" or loud(base.at_least, score_test.freedom):
        return verdict
    explained = explains(score_test)
    if verdict.kind == "unexplained" and (explained or not form.explains):
        return verdict
    named = [one for one in ranking if one.candidate.effect.name in verdict.effects]
    matter = [one for one in named if _matters(refits[one.candidate.effect.name], base, tolerance)]
    large = [one for one in matter if not explained or _half(refits[one.candidate.effect.name], score_test)]
    names = _titles(named)
    far = f"by more than {100 * tolerance:g} %"
    odds = odds_of_any(large, score_test, ranking, tests, form.limited(refits))
    before = odds_of_any(large, score_test, ranking, tests, refits)
    of_form = "what the form of its own effects may be off by"
    if not explained and not form.explains:
        if odds >= LIKELY_ENOUGH or not form.beside or not all(_is_quiet(one, refits, base) for one in named):
            return verdict
        text = "the model leaves little beside its effects: a trace that hardly lowers the error, and moves no constant"
        text += f" {far}{' with the odds for it' if matter else ''}: {names}"
    else:
        text = WITHIN if explained else f"the model leaves no more than {of_form}"
        if named and not matter:
            text += f"; beyond chance, but a trace that moves no constant {far}: {names}"
        elif named and not large:
            text += f"; a trace, less than half of what is left beyond chance: {names}"
        elif named and odds >= LIKELY_ENOUGH:
            return verdict
        elif before >= LIKELY_ENOUGH:
            text += f"; a trace, hardly more than {of_form}: {names}"
        elif named:
            text += f"; a trace, with odds of only {np.exp(odds):.2g} to 1 for it after {tests} tests: {_titles(large)}"
            if len(matter) < len(named):
                rest = [one for one in named if one not in matter]
                text += f"; beyond chance, but a trace that moves no constant {far}: {_titles(rest)}"
    return Verdict("adequate", (), text, verdict.threshold)


def small_part(
    verdict: Verdict,
    score_test: ScoreTest,
    ranking: Sequence[Ranked],
    refits: Mapping[str, Refit],
    at_least: float,
) -> Verdict:
    """The verdict, but *unexplained* where pictures differ by much, and what is named explains a small part of that.

    Few and coarse patches may nearly all be explained while every pixel shows that something is missing (`loud`). An
    effect that explains less of the patches than an answer must is then asked for half of the squared error beyond the
    noise; one on the loading, which few values show, for half of what the patches leave beyond chance.

    Parameters
    ----------
    verdict, score_test, ranking, refits
        As for `traced`.
    at_least : float
        Error of the model on the fitted steps, without what the mesh is expected to make of it.
    """
    if not verdict.effects or not loud(at_least, score_test.freedom):
        return verdict
    shares = dict[str, float]()
    for one in ranking:
        if (name := one.candidate.effect.name) in verdict.effects:
            refit = refits[name]
            shares[one.candidate.effect.title] = share = error_explained(at_least, refit.at_least)
            enough = share >= LARGEST or refit.explained(score_test.misfit) >= ENOUGH
            if enough or (one.candidate.effect.on_loading and _half(refit, score_test)):
                return verdict
    best = max(shares, key=shares.__getitem__)
    text = f"unexplained: the pictures differ by {at_least:.2g} times the noise; {best} comes nearest"
    text += f" but explains only {100 * max(shares[best], 0.0):.0f} % of their squared error beyond it"
    return Verdict("unexplained", (), text, verdict.threshold)


def _titles(those: Sequence[Ranked]) -> str:
    return " or ".join(one.candidate.effect.title for one in those)


def _matters(refit: Refit, base: Refit, tolerance: float) -> bool:
    moved = (abs(refit.values[name] - value) > tolerance * abs(value) for name, value in base.values.items())
    return any(moved) or _lowers(refit, base) > MATTERS


def _lowers(refit: Refit, base: Refit) -> float:
    """By how much an effect lowers the error on held-out steps, or on fitted ones where there are no others."""
    known = base.held_at_least is not None and refit.held_at_least is not None
    before, after = (base.held_at_least, refit.held_at_least) if known else (base.at_least, refit.at_least)
    return float(before or 0.0) - float(after or 0.0)


def _is_quiet(one: Ranked, refits: Mapping[str, Refit], base: Refit) -> bool:
    """Whether an effect is one of the body, or of pictures, and hardly lowers their error."""
    effect = one.candidate.effect
    return not effect.on_loading and _lowers(refits[effect.name], base) <= MATTERS


def _half(refit: Refit, score_test: ScoreTest) -> bool:
    """Whether an effect explains half of what a model leaves beyond chance, of all values or of those of whole steps.

    Nothing is asked for where that is no more than chance.
    """
    if score_test.misfit <= chance(score_test.freedom):
        return True
    of_steps = bool(score_test.common_freedom) and score_test.common_misfit > chance(score_test.common_freedom)
    common = score_test.common_misfit - score_test.common_freedom
    fell = score_test.common_misfit - refit.common_misfit
    return refit.explained(score_test.misfit) >= LARGEST or (of_steps and fell >= LARGEST * common)
