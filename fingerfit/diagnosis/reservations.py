"""Reservations about a verdict: what it must not say, and what it has to add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fingerfit.core.keys import listed
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.families import ENOUGH, SURE, families, leads
from fingerfit.diagnosis.ranking import FIRST_PASS, REFIT, Ranked
from fingerfit.diagnosis.refit import EXPLAINED, Refit, error_explained, excess, explains, loud
from fingerfit.diagnosis.score_tests import ScoreTest, per_value
from fingerfit.diagnosis.verdict import MATTERS, WITHIN, Verdict, best_of
from fingerfit.diagnosis.worth import LARGEST, threshold
from fingerfit.fit.far_off import far_off
from fingerfit.model.applicable import CURE, cure_of
from fingerfit.model.effect import FAMILIES, NUMERICS, Effect

BEYOND = "the misfit beyond the noise"
"""What shares of an explanation are of, in words."""
NAMED = 3
"""Effects that a sentence names at most."""


def of_family(
    verdict: Verdict, score_test: ScoreTest, ranking: Sequence[Ranked], refits: Mapping[str, Refit]
) -> Verdict:
    """The verdict with the family of what it names; where it names nothing, that which is likeliest behind it.

    That is the family of the best refit, where one improves the fit beyond chance; else that of the best odds. Of a
    probe it also says which known effect comes nearest.

    Parameters
    ----------
    verdict : Verdict
    score_test : ScoreTest
        Of the model without any effect more.
    ranking : sequence of Ranked
    refits : mapping
        By name of the effect: those that count.
    """
    named = next((one.candidate.effect for one in ranking if one.candidate.effect.name in verdict.effects[:1]), None)
    family = named.family if named else ""
    if named and named.probe:
        verdict = replace(verdict, sentence=verdict.sentence + _nearest(score_test, ranking, refits, family))
    if verdict.kind != "unexplained" or score_test.freedom < 1:
        return replace(verdict, family=family)
    best = best_of(ranking, refits)
    if best is not None and best[1].gain(score_test.misfit) > verdict.threshold:
        behind = [best[0]]
    else:
        odds = families(score_test, ranking).items()
        behind = [one for name, (one, own) in odds if name != NUMERICS and own > SURE]
    share, by = _share(score_test, behind[0], refits) if behind else (0.0, "")
    if share <= 0.0:
        return verdict
    family = behind[0].candidate.effect.family
    text = f"{verdict.sentence}; {_percent(share)} of {BEYOND} may lie in {FAMILIES[family]} ({by})"
    return replace(verdict, family=family, sentence=text)


def _share(score_test: ScoreTest, one: Ranked, refits: Mapping[str, Refit]) -> tuple[float, str]:
    """Share of the misfit beyond the noise that an effect explains, and what says so: refit, else first pass."""
    refit = refits.get(one.candidate.effect.name)
    if refit is not None:
        return refit.explained(score_test.misfit), REFIT
    return one.finding.fall / score_test.beyond_noise, FIRST_PASS


def _nearest(score_test: ScoreTest, ranking: Sequence[Ranked], refits: Mapping[str, Refit], family: str) -> str:
    """The known effect of a family that explains most, in words; empty where none explains any."""
    members = [one for one in ranking if one.candidate.effect.family == family and not one.candidate.effect.probe]
    best = max(members, key=lambda one: _share(score_test, one, refits)[0], default=None)
    share, by = _share(score_test, best, refits) if best else (0.0, "")
    if best is None or round(100 * share) < 1:
        return ""
    return f"; of known effects {best.candidate.effect.title} comes nearest ({by}: {_percent(share)})"


def largest_part(
    verdict: Verdict,
    score_test: ScoreTest,
    ranking: Sequence[Ranked],
    refits: Mapping[str, Refit],
    error: float,
    tried: Mapping[str, Refit] | None = None,
    held_out: float | None = None,
    beside: bool = False,
) -> Verdict:
    """The verdict, but where nothing explains it all, what surely is the largest part of it: more is missing.

    Beside effects that are known to be some of it already, also what is no more than a part, as long as much is left:
    an error that is `loud`. It must lower the errors on fitted and on held-out steps by more than `MATTERS`.

    Parameters
    ----------
    verdict : Verdict
    score_test : ScoreTest
        Of the model without any effect more.
    ranking : sequence of Ranked
    refits : mapping
        By name of the effect: those that count.
    error : float
        Of the model, in units of the noise floor, on the fitted steps.
    tried : mapping, optional
        All refits, which other families are judged by.
    held_out : float, optional
        Error of the model on held-out steps, where there are some.
    beside : bool
        Whether the model has effects.
    """
    best = best_of(ranking, refits)
    if verdict.kind != "unexplained" or best is None or error <= 1.0:
        return verdict
    one, own = best
    share = error_explained(error, own.fitted)
    beyond = own.gain(score_test.misfit) > verdict.threshold
    spread = per_value(own.level, own.freedom)
    # as in `nearest`: what leaves more in every pixel, or value, is behind, whatever its patches say
    behind = {
        name: np.inf if refit.at_least > own.fitted + MATTERS else (refit.level - own.level) / 2 / spread
        for name, refit in (tried or {}).items()
    }
    falls = [error - own.fitted]
    if held_out is not None and own.held_out is not None:
        falls.append(held_out - own.held_out)
    part = beside and loud(error, score_test.freedom) and min(falls) > MATTERS
    if not (beyond and (share > LARGEST or part) and leads(score_test, ranking, one, behind)):
        return verdict
    fell = f"the error falls from {error:.2g} to {own.fitted:.2g} times the noise level"
    # of a misfit that is no more than the noise's there are no shares
    explained = _explained("it", own.explained(score_test.misfit), BEYOND)
    explained = "it does not explain all" if explains(score_test) else explained
    text = f"missing: {one.candidate.effect.title}; {explained} ({fell}), more is missing"
    return Verdict("missing", (one.candidate.effect.name,), text, verdict.threshold)


def by_settings(verdict: Verdict, score_test: ScoreTest, ranking: Sequence[Ranked], tests: int) -> Verdict:
    """The verdict, and where no effect explains the misfit but mesh or load steps would: that they do, and the cure.

    They are never refitted, so that the prediction must do.
    """
    left = score_test.beyond_noise
    for one in ranking if verdict.kind == "unexplained" else ():
        effect, fall = one.candidate.effect, one.finding.fall
        beyond = fall > threshold(score_test, ranking, tests, one.columns.shape[1])
        if effect.acts == NUMERICS and beyond and fall >= ENOUGH * left:
            text = _cured(effect, "that", fall / left, BEYOND)
            return replace(verdict, sentence=text, family=NUMERICS, numerics=effect.name)
    return verdict


def _cured(effect: Effect, what: str, share: float, of: str) -> str:
    wrong, cure = cure_of(effect)
    return f"{wrong}: {_explained(what, share, of)}{CURE}{cure}"


def _explained(what: str, share: float, of: str) -> str:
    return f"{what} explains {_percent(share)} of {of}"


def _percent(share: float) -> str:
    return f"{100 * min(share, 1.0):.0f} %"


def too_coarse(
    verdict: Verdict, score_test: ScoreTest, by: tuple[float, str], best: float, effect: Effect, error: float
) -> Verdict:
    """The verdict of a model whose mesh leaves most of what there is beyond the noise, or of what an effect would say.

    Where that is no more than the noise in all values and in every pixel, the model is adequate all the same: its
    intervals know the mesh.

    Parameters
    ----------
    verdict : Verdict
    score_test : ScoreTest
    by : (float, str)
        How far the misfit falls by the error of the mesh, and which finer mesh shows it.
    best : float
        The same by the best effect of the first pass, where the model leaves no more than the noise; else 0.
    effect : Effect
        The one that stands for it.
    error : float
        Of the fitted measurements in units of the noise floor.
    """
    beyond = max(excess(score_test), 1.0)
    of = BEYOND if beyond >= best else "what the best effect would explain"
    fall, what = by
    share = fall / max(beyond, best)
    if explains(score_test) and error <= 1.0 + MATTERS:
        return Verdict("adequate", (), f"{WITHIN}; {_explained(what, share, of)}", verdict.threshold)
    return Verdict("unexplained", (), _cured(effect, what, share, of), verdict.threshold, NUMERICS, effect.name)


def doubted(verdict: Verdict, error: float, held_out: float | None, freedom: int) -> Verdict:
    """The verdict, but no *adequate* where the pictures still differ by much more than their noise.

    Few and coarse patches can have no misfit while every pixel shows that the model is wrong. So can fitted pictures.

    Parameters
    ----------
    verdict : Verdict
    error : float
        Of the fitted measurements, in units of the noise floor.
    held_out : float or None
        The same of held-out pictures; None without any.
    freedom : int
    """
    where = "" if held_out is None or error >= held_out else " on held-out steps"
    if verdict.kind != "adequate" or not loud(most := max(error, held_out or 0.0), freedom):
        return verdict
    text = f"unexplained: the residual is {most:.2g} times the noise level{where}, but no known effect explains it"
    return Verdict("unexplained", (), text, verdict.threshold)


def loud_by_mesh(verdict: Verdict, error: float, at_least: float, effect: Effect, set_aside: bool = False) -> Verdict:
    """The verdict, and a finer mesh where what is expected of this one is why the pictures still differ by much.

    `discover` takes one, also where the model is adequate: the error of the mesh is known to be there, what is named
    only perhaps.

    Parameters
    ----------
    verdict : Verdict
    error, at_least : float
        Of the fitted measurements in units of the noise floor, and the same without what the mesh is expected to make.
    effect : Effect
        The one that stands for the mesh.
    set_aside : bool
        Whether what the verdict names gives way to the mesh: nothing of a known form, or only effects whose refits
        leave the pictures as the mesh makes them (`leave_mesh`).
    """
    if not (set_aside or verdict.kind == "adequate") or not _by_mesh(error, at_least):
        return verdict
    made = f"the pictures differ by {error:.2g} times the noise, by {at_least:.2g} without what the mesh makes of them"
    wrong, cure = cure_of(effect)
    if verdict.kind != "adequate":
        return Verdict("unexplained", (), f"{wrong}: {made}{CURE}{cure}", verdict.threshold, NUMERICS, effect.name)
    return replace(verdict, sentence=f"{verdict.sentence}; {made}{CURE}{cure}", numerics=effect.name)


def leave_mesh(named: Sequence[str], refits: Mapping[str, Refit]) -> bool:
    """Whether effects are named, and with each of them the pictures still differ by much, because of the mesh."""
    found = [refits[name] for name in named if name in refits]
    return bool(found) and all(_by_mesh(one.fitted, one.at_least) for one in found)


def _by_mesh(error: float, at_least: float) -> bool:
    return error > EXPLAINED >= at_least


def far_off_of(test: Comparison) -> str:
    """As `fingerfit.fit.far_off.far_off`, of one test."""
    start, modelled = test.residual.value.size, test.prediction.response
    control, mesh = test.slope("control")[start:], test.mesh_signal[start:]
    return far_off(test.data, modelled, control, mesh, test.problem.test)


def some_far_off(verdict: Verdict, comparison: Comparison) -> Verdict:
    """The verdict, and which force (or displacement) of each test is far off where no effect explains it."""
    if verdict.kind not in ("adequate", "unexplained"):
        return verdict
    said = "".join(f"; {text}" for text in map(far_off_of, comparison.every) if text)
    return replace(verdict, sentence=verdict.sentence + said)


def with_blur(verdict: Verdict, comparison: Comparison) -> Verdict:
    """The verdict, and how much the camera blurs the pictures of each test where that is not stated."""
    blurs = [one.blur for one in comparison.every if one.blur and one.blur.by_optics]
    said = "".join(f"; the camera blurs pictures by {blur}: state it as pictures.blur" for blur in blurs)
    return replace(verdict, sentence=verdict.sentence + said)


def not_needed(verdict: Verdict, spare: Sequence[Effect]) -> Verdict:
    """The verdict, and which effects an adequate model may not need beside its others."""
    titles = ", ".join(effect.title for effect in spare)
    return replace(verdict, sentence=f"{verdict.sentence}; perhaps not needed: {titles}") if spare else verdict


def perhaps(verdict: Verdict, titles: Sequence[str]) -> Verdict:
    """The verdict, and which effects it does not exclude, three of them by name."""
    new = [title for title in titles if title not in verdict.sentence]
    # titles have commas of their own
    named = listed(new, NAMED, " or ", " or ")
    return replace(verdict, sentence=f"{verdict.sentence}; not excluded: {named}") if new else verdict


def untried(
    verdict: Verdict, solver: str, titles: Sequence[str], left_out: int, unsolved: Sequence[str] = ()
) -> Verdict:
    """The verdict, and in its sentence what was not tried, and what does not count for lack of an answer.

    Not tried is what the solver or the deck cannot, and what was left out, of which the number is said.
    """
    why = f"; not tried, since solver {solver} or the deck lacks what they need: "
    lacking = why + ", ".join(titles) if titles else ""
    count = "1 effect was" if left_out == 1 else f"{left_out} effects were"
    chosen = f"; {count} not tried, as diagnosis in config.yaml says" if left_out else ""
    ended = f"; tried, but solver {solver} gave no answer, so that it does not count: {', '.join(unsolved)}"
    return replace(verdict, sentence=verdict.sentence + lacking + chosen + (ended if unsolved else ""))
