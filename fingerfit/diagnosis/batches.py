"""Refits in batches: pairs, the best effects, the next best, and partners, until something explains the data."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from fingerfit.diagnosis.partners import pair_of, partner_of
from fingerfit.diagnosis.ranking import Ranked
from fingerfit.diagnosis.refit import Refit
from fingerfit.diagnosis.reservations import doubted
from fingerfit.diagnosis.second_queue import by_one_likelihood, refit_best
from fingerfit.diagnosis.tested import Tested
from fingerfit.diagnosis.traces import small_part
from fingerfit.diagnosis.verdict import (
    Verdict,
    beside_probe,
    both_explain,
    decide,
    generalising,
    half_explained,
    nearest,
)

BATCHES = 2
"""How often the next best effects are refitted, as long as none explains the residual."""


@dataclass
class Answer:
    """What refits say of a model.

    Parameters
    ----------
    verdict : Verdict
    refits : dict
        All that have a solution, by name of the effect, with misfits by one likelihood.
    nearest : dict
        Those of them that the verdict is about: no other one is nearer.
    run : int
        Simulations that were not known before.
    """

    verdict: Verdict
    refits: dict[str, Refit] = field(default_factory=dict)
    nearest: dict[str, Refit] = field(default_factory=dict)
    run: int = 0


def before_refits(found: Tested) -> Answer:
    """What the tests of a model say without any refit."""
    return Answer(decide(found.score_test, found.ranking, {}, found.tests, held_out=found.but_mesh[1]))


def refitted(found: Tested, threads: int) -> Answer:
    """Refit effects until one of them, or two, explain what a model leaves.

    Parameters
    ----------
    found : Tested
    threads : int
        Simulations beside each other.
    """
    held, score_test, ranking, tests = found.but_mesh[1], found.score_test, found.ranking, found.tests
    # beside a probe that the model has: it says by itself that there is something of no known form, and has no partner
    probed = any(effect.probe for effect in found.comparison.problem.settings.effects())
    # a probe is likelier than its members, but two of these may be what it imitates
    pair, partner, run = (dict[str, Refit](), None, 0) if probed else pair_of(found, held, threads)
    if partner is not None:
        verdict = decide(score_test, ranking, pair, tests, partner, held)
        if verdict.kind == "missing":
            return Answer(verdict, pair, pair, run)
    answer, with_partner = replace(before_refits(found), run=run), set(pair)
    for _ in range(BATCHES):
        answer.run += refit_best(found, answer.refits, threads)
        answer.refits = by_one_likelihood({**pair, **answer.refits}, found.comparison.weighed)
        _judge(answer, found)
        half, beside = (None, False) if probed else _half(answer, found)
        if half is not None and half.candidate.effect.name not in with_partner:
            with_partner.add(half.candidate.effect.name)
            partner, run = partner_of(half, found, threads)
            answer.run += run
            if not (partner and beside and partner[0].candidate.effect.probe):  # no more than the one that came nearest
                _both(answer, half, partner, found)
        if answer.verdict.kind != "unexplained":
            break
    return answer


def _judge(answer: Answer, found: Tested) -> None:
    """The verdict on the refits, and which of them it is about."""
    at_least, held = found.but_mesh
    score_test, ranking = found.score_test, found.ranking
    well, bright = _well(answer), {one.candidate.effect.name for one in ranking if one.candidate.effect.on_brightness}
    answer.nearest, missed = nearest(well, bright), answer.refits.keys() - well.keys()
    verdict = decide(score_test, ranking, answer.nearest, found.tests, None, held, missed)
    pictured = all(len(test.data.picture_step) for test in found.comparison.every)
    verdict = doubted(verdict, at_least, held if pictured else None, score_test.freedom)
    answer.verdict = small_part(verdict, score_test, ranking, answer.nearest, at_least)


def _well(answer: Answer) -> dict[str, Refit]:
    return {name: refit for name, refit in answer.refits.items() if not refit.missed}


def _half(answer: Answer, found: Tested) -> tuple[Ranked | None, bool]:
    """The effect that explains a part of what is left, for which a partner is worth looking for; None without one.

    And whether it is a member where a probe comes nearest: that has as many numbers as several effects, and gets none.
    """
    held, score_test, ranking = found.but_mesh[1], found.score_test, found.ranking
    half = half_explained(score_test, ranking, generalising(score_test, answer.nearest, held), found.tests)
    if half is not None and not half.candidate.effect.probe:
        return half, False
    others = generalising(score_test, _well(answer), held)
    return beside_probe(ranking, answer.nearest, others, score_test.misfit), True


def _both(answer: Answer, half: Ranked, partner: tuple[Ranked, Refit] | None, found: Tested) -> None:
    """The verdict on an effect and its partner, where both explain the data."""
    held, score_test, name = found.but_mesh[1], found.score_test, half.candidate.effect.name
    if both_explain(score_test, partner, held):
        answer.nearest = {name: answer.refits[name]}
        answer.verdict = decide(score_test, found.ranking, answer.nearest, found.tests, partner, held)
