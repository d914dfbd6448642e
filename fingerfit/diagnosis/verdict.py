"""From tests and refits to one of four answers: missing, indistinguishable, adequate, unexplained."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from fingerfit.diagnosis.families import ENOUGH
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import LEVEL, Refit, explains
from fingerfit.diagnosis.score_tests import ScoreTest, per_value
from fingerfit.diagnosis.worth import FEW, threshold, to_refit, unseen

RIVAL = 12.0
"""Difference of misfit below which two refits cannot be told apart: odds of 400 to 1."""
NEAR = 0.03
"""The same for two refits that are both adequate, per degree of freedom: what an error of the mesh may decide."""
WORSE, WORSE_OF_FEW = 0.02, 0.2
"""Rise of the error on held-out or on fitted steps, in noise floors, from which a refit does not count; of few
values."""
PART = 1 / 3
"""Share of the misfit from which a member may be one of two effects that a probe imitates: the larger of two explains
half of what both do, and less where its fit lies between them. A choice (decision 7)."""
MATTERS = 0.05
"""Fall of the error, in noise floors, by which an effect matters that moves no constant."""
BUT_FORM = 0.9
"""Share of what the best member of a family explains from which another one that no pixel tells from it may be as
right: their forms are idealised; and of what the best effect explains in the first pass, from which one of another
family is refitted. A choice (decisions 49 and 50)."""
WITHIN = "the model explains the measurements to within their noise"
"""Of an adequate model, in words."""


@dataclass(frozen=True)
class Verdict:
    """The answer.

    Parameters
    ----------
    kind : str
        ``missing``, ``indistinguishable``, ``adequate`` or ``unexplained``.
    effects : tuple of str
        Effects that are named, the best first.
    sentence : str
        For a person.
    threshold : float
        Fall of the misfit that an effect of one parameter needs.
    family : str
        One of `FAMILIES`: of what is named, or of *unexplained* the likeliest; empty where there is none.
    numerics : str
        Effect of mesh or load steps that the sentence blames; empty where there is none.
    """

    kind: str
    effects: tuple[str, ...]
    sentence: str
    threshold: float
    family: str = ""
    numerics: str = ""


def best_of(ranking: Sequence[Ranked], refits: Mapping[str, Refit]) -> tuple[Ranked, Refit] | None:
    """The candidate whose refit leaves least, by one likelihood, and that refit; None without any."""
    found = [(one, refits[name]) for one in ranking if (name := one.candidate.effect.name) in refits]
    return min(found, key=lambda pair: pair[1].level, default=None)


def half_explained(
    score_test: ScoreTest, ranking: Sequence[Ranked], refits: Mapping[str, Refit], tests: int
) -> Ranked | None:
    """The best refitted effect where it is one beyond chance, but does not explain enough alone."""
    found = best_of(ranking, refits)
    if found is None or score_test.freedom < 1:
        return None
    best, refit = found
    beyond = refit.gain(score_test.misfit) >= threshold(score_test, ranking, tests)
    return best if beyond and not explains(refit) and refit.explained(score_test.misfit) < ENOUGH else None


def beside_probe(
    ranking: Sequence[Ranked], nearest: Mapping[str, Refit], refits: Mapping[str, Refit], before: float
) -> Ranked | None:
    """The best member where a probe comes nearest, and does not explain the data: with another effect it may.

    What a probe's many numbers gain there may be what they imitate of the other effect. A member of the probe's family
    comes first, if it explains enough alone; else that of any family, if it explains a part.

    Parameters
    ----------
    ranking : sequence of Ranked
    nearest, refits : mapping
        Those that no other one is nearer than, and all that count, by name of the effect.
    before : float
        Misfit of the model without any of them.
    """
    best = best_of(ranking, nearest)
    if best is None or not best[0].candidate.effect.probe or explains(best[1]):
        return None
    shares = {name: own.explained(before) for name, own in refits.items()}
    members = [one for one in ranking if not one.candidate.effect.probe]
    kin = [one for one in members if one.candidate.effect.family == best[0].candidate.effect.family]
    for those, least in ((kin, ENOUGH), (members, PART)):
        enough = {name: own for name, own in refits.items() if shares[name] >= least}
        if member := best_of(those, enough):
            return member[0]
    return None


def both_explain(score_test: ScoreTest, partner: tuple[Ranked, Refit] | None, held_out: float | None) -> bool:
    """Whether the refit of an effect with its partner explains the data, held-out steps included."""
    return partner is not None and explains(partner[1]) and _generalises(score_test, partner[1], held_out)


def decide(
    score_test: ScoreTest,
    ranking: Sequence[Ranked],
    refits: Mapping[str, Refit],
    tests: int,
    partner: tuple[Ranked, Refit] | None = None,
    held_out: float | None = None,
    missed: Collection[str] = (),
) -> Verdict:
    """The verdict on a model.

    A refit that is worse on held-out steps than the model without its effect does not count: the effect is a mere
    freedom to fit.

    Parameters
    ----------
    score_test : ScoreTest
        Of the model without any of them.
    ranking : sequence of Ranked
        Tested effects, the best first.
    refits : mapping
        Refits of the best ones, by name of the effect.
    tests : int
        Number of tests that were made.
    partner : (Ranked, Refit), optional
        Where the best effect does not explain enough, or less than a probe does: the one that explains most of what it
        leaves, and the refit of both.
    held_out : float, optional
        Error of the model on held-out steps, where there are some, without what its mesh makes of it.
    missed : collection of str
        Effects whose refit ended worse than the model without them: it has missed its minimum, and says nothing.
    """
    if score_test.freedom < 1:
        text = "there are as many constants as measured values: missing effects cannot be tested"
        return Verdict("unexplained", (), text, 0.0)
    limit = threshold(score_test, ranking, tests)
    # where no effect explains it, what is left must be as sure as each of these effects would have to be
    adequate = explains(score_test, LEVEL / max(tests, 1))
    by_name = {one.candidate.effect.name: one for one in ranking}
    refitted, refits = refits, generalising(score_test, refits, held_out)
    tried = [name for name in by_name if name in refits]
    if refitted and not tried:
        names = ", ".join(_title(by_name[name]) for name in refitted)
        text = f"no known effect improves the fit on held-out steps; only on the fitted ones does: {names}"
        return _nothing_named(adequate, text, limit)
    if not tried:
        chosen = {one.candidate.effect.name for one in to_refit(score_test, ranking, tests)}
        if chosen - set(missed) or not adequate:
            text = "unexplained: no known effect explains the misfit beyond the noise"
            return Verdict("unexplained", (), text, limit)
        text = WITHIN
        if missed:
            text += (
                f"; no minimum was found with {', '.join(_title(by_name[name]) for name in by_name if name in missed)}"
            )
        hidden = ", ".join(_title(one) for one in unseen(score_test, ranking))
        return Verdict("adequate", (), f"{text}; these data would not show: {hidden}" if hidden else text, limit)
    best = min(tried, key=lambda name: refits[name].level)
    fell = refits[best].gain(score_test.misfit) >= limit
    # or by the likelihood of the model without it, whose mesh may be wrong by another amount
    if not fell and not (explains(refits[best]) and refits[best].earned >= limit):
        return _nothing_named(adequate, "no known effect improves the fit beyond chance", limit)

    def percent(name: str) -> str:
        share = refits[name].explained(score_test.misfit) if fell else refits[name].earned / score_test.beyond_noise
        return f"{100 * min(share, 1.0):.0f} %"

    if partner is not None and both_explain(score_test, partner, held_out):
        text = f"missing: {_title(by_name[best])}; with {_title(partner[0])} it explains"
        return Verdict("missing", (best,), f"{text} the misfit beyond the noise, alone {percent(best)} of it", limit)
    if half_explained(score_test, ranking, refits, tests) is not None:
        nearest = f"{_title(by_name[best])} comes nearest but explains only {percent(best)} of the misfit"
        return Verdict("unexplained", (), f"unexplained: {nearest} beyond the noise", limit)
    plainer = [name for name in tried if _plainer(refits[name], refits[best], _worse(score_test))]
    family = by_name[best].candidate.effect.family

    def tied(name: str) -> bool:
        kin = by_name[name].candidate.effect.family == family
        return _rival(refits[name], refits[best]) or (kin and _but_form(refits[name], refits[best], score_test.misfit))

    rivals = [name for name in tried if tied(name) and name not in plainer]
    rivals = [*sorted(plainer, key=lambda name: refits[name].level), best, *(name for name in rivals if name != best)]
    rivals = _without_series(rivals, by_name, refits)
    if len(rivals) > 1:
        names = " or ".join(_title(by_name[name]) for name in rivals)
        return Verdict(
            "indistinguishable", tuple(rivals), f"missing: {names}; these data cannot tell them apart", limit
        )
    (named,) = rivals
    text = f"missing: {_title(by_name[named])}; it explains {percent(named)} of the misfit beyond the noise"
    return Verdict("missing", (named,), text, limit)


def _nothing_named(adequate: bool, why: str, limit: float) -> Verdict:
    return Verdict("adequate", (), f"{WITHIN}; {why}", limit) if adequate else Verdict("unexplained", (), why, limit)


def misses(score_test: ScoreTest, refit: Refit, at_least: float) -> bool:
    """Whether a refit is worse than the model on the steps that both have fitted, where its error was `at_least`.

    A model with an effect more has that model in it: one that ends worse has missed its minimum, whatever its own
    covariance says of its misfit. What the mesh of each makes is taken off: one may end on the coarser mesh, where the
    finer one has no answer.
    """
    return refit.at_least > at_least + _worse(score_test)


def nearest(refits: Mapping[str, Refit], bright: Collection[str] = ()) -> dict[str, Refit]:
    """Refits that no other one is nearer than, by `MATTERS` of what it leaves: fitted steps tell, others can veto.

    The misfit knows patches that could be registered, the error every pixel. What the mesh of a refit makes of it does
    not count against it: patches have that in their covariance. One with a number for each step comes near on those
    that were fitted, and says nothing of the others.

    Those on the brightness alone, `bright` by name, and those that move places are no rivals: both may be there, and
    how near the one comes says nothing of the other. Each kind is looked at by itself.
    """

    def is_nearer(one: Refit, other: Refit) -> bool:
        matters = MATTERS * max(1.0, one.fitted)
        return other.at_least > one.fitted + matters and not max(_behind(one, other)) > matters

    def alike(name: str) -> list[Refit]:
        return [one for other, one in refits.items() if (other in bright) == (name in bright)]

    return {name: refit for name, refit in refits.items() if not any(is_nearer(one, refit) for one in alike(name))}


def generalising(score_test: ScoreTest, refits: Mapping[str, Refit], held_out: float | None) -> dict[str, Refit]:
    """Refits that are no worse than the model on the steps that no fit has seen, whose error with it was `held_out`.

    What the mesh of each makes of them is taken off.
    """
    return {name: refit for name, refit in refits.items() if _generalises(score_test, refit, held_out)}


def _generalises(score_test: ScoreTest, refit: Refit, held_out: float | None) -> bool:
    return held_out is None or refit.held_at_least is None or refit.held_at_least <= held_out + _worse(score_test)


def _worse(score_test: ScoreTest) -> float:
    return WORSE if score_test.freedom > FEW else WORSE_OF_FEW


def _rival(one: Refit, best: Refit) -> bool:
    """Whether a refit cannot be told from the best one: by odds, or because both explain the data well enough.

    What the best one leaves beyond its noise is an error of models; a difference as small may be one as well.
    """
    behind = one.level - best.level
    if behind < RIVAL * per_value(best.misfit, best.freedom):
        return True
    return explains(one) and explains(best) and behind < max(NEAR * one.freedom, best.misfit - best.freedom)


def _but_form(one: Refit, best: Refit, before: float) -> bool:
    """Whether two refits of one family are the same but for the forms of their effects, as far as pictures can tell.

    A border may be sharp or blurred, a slip by springs or by a limit: thousands of patches tell such forms apart at
    odds that say nothing of what is in the body. Values that all of a step have in common, as the response, know no
    such forms. `before` is the misfit without an effect.
    """
    # where something else is missing as well, what the best one leaves of these values is no measure of its form
    left = 0.0 if explains(best) else best.common_misfit - best.common_freedom
    common = one.common_misfit - best.common_misfit < max(RIVAL, (1.0 - BUT_FORM) * left)
    same = max(_behind(one, best)) <= MATTERS * max(1.0, best.fitted) and common
    alike = same and one.gain(before) >= BUT_FORM * best.gain(before)
    return alike and (explains(one) or not explains(best))


def _plainer(one: Refit, best: Refit, clearly: float) -> bool:
    """Whether a refit with fewer numbers explains the data and is clearly nearer in the pictures than the best one.

    Patches say the one and pixels the other, in steps that were fitted and in those that were not: a sharp edge has an
    error of the mesh that smooth shapes with more numbers can make up for.
    """
    return one.numbers < best.numbers and explains(one) and nearer(one, best, clearly)


def nearer(one: Refit, other: Refit, clearly: float = WORSE) -> bool:
    """Whether a refit is clearly nearer in the pictures than another one, in fitted and in held-out steps."""
    return all(behind < -clearly for behind in _behind(one, other))


def _behind(one: Refit, other: Refit) -> list[float]:
    """How far the error of a refit is above another one's: on fitted steps, and on others where both have some."""
    found = [one.fitted - other.fitted]
    if one.held_out is not None and other.held_out is not None:
        found.append(one.held_out - other.held_out)
    return found


def _without_series(rivals: Sequence[str], ranking: Mapping[str, Ranked], refits: Mapping[str, Refit]) -> list[str]:
    """Rivals but for a series of numbers, one for each step, beside a member of its family that says it with fewer."""

    def said(name: str) -> bool:
        effect, numbers = ranking[name].candidate.effect, refits[name].numbers
        alike = [one for one in rivals if ranking[one].candidate.effect.family == effect.family]
        series = bool(effect.series) and not effect.probe
        return series and any(refits[one].numbers < numbers for one in alike)

    return [name for name in rivals if not said(name)]


def _title(one: Ranked) -> str:
    return one.candidate.effect.title
