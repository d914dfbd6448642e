"""The first pass on a body that is far from the fitted model: slopes there say little, refits what is hidden."""

import re
from dataclasses import replace

import numpy as np
import pytest
from seeds import generator
from small_body import SMALL, alike_to, compared, fitted, to_first_order, written

from fingerfit.core.errors import StateError
from fingerfit.diagnosis import first_pass, trials
from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.explained import SLOPES, explained
from fingerfit.diagnosis.first_pass import FALL, NEAR, FirstPass, Way, widened
from fingerfit.diagnosis.ranking import (
    FIRST_PASS,
    REFIT,
    STARTS,
    STARTS_ELSEWHERE,
    alike,
    best_places,
    elsewhere,
    other_places,
    rank_candidates,
)
from fingerfit.diagnosis.refit import Refit, explains
from fingerfit.diagnosis.trials import refit_all
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import finest
from fingerfit.settings.extend import extended

SHIFT = 4.0
"""Exponent 5.4 where the model has 1.4."""
NAMES = ("stiffening", "compressibility", "tilt", "misregistration")
MOVING = ("stiffening", "compressibility", "tilt", "base_slip", "misregistration", "split_layer")


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stiff")
    own = {"displacement": [0.75, 1.5, 2.25, 3.0], "effects": {"stiffening": {"shift": SHIFT}}}
    problem, last, _, everything = fitted(written(folder, **own), folder / "model")
    found = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in NAMES]
    comparison, _ = compared(problem, last, everything, found)
    ranking = best_places(rank_candidates(comparison, comparison.score_test, found))
    return comparison, ranking, refit_all(comparison, ranking)[0]


def test_the_hidden_effect_comes_first_and_explains_it(world):
    comparison, _, ranking = world
    best = ranking[0]
    assert best.candidate.effect.name == "stiffening"
    assert best.refitted.converged
    assert best.refitted.share > 0.9
    # what is left is noise: five of its standard deviations
    count = FirstPass(comparison).count
    assert best.refitted.misfit < count + 5 * np.sqrt(2 * count)
    assert all(one.refitted.share < best.refitted.share for one in ranking[1:])


def test_what_an_effect_is_shown_to_explain_is_what_its_refit_changes(world):
    """Subtracted from the residual it leaves the misfit of that refit; slopes at the size that was found do not."""
    comparison, _, ranking = world
    first = FirstPass(comparison)
    inside = first.rows[comparison.kept]

    def left(change):
        known = np.zeros(len(first.rows))
        known[comparison.kept] = comparison.vector - change
        return float((first.whiten(known) ** 2).sum())

    assert inside.sum() == first.count
    for one in ranking:
        shown, by = explained(comparison, one)
        assert by == FIRST_PASS
        assert left(shown[comparison.kept]) == pytest.approx(one.refitted.misfit, rel=1e-6)
    assert left(ranking[0].columns @ ranking[0].finding.size) > 2 * ranking[0].refitted.misfit


def test_the_log_says_that_it_is_the_first_pass_and_from_which_place(world, monkeypatch):
    comparison, ranking, _ = world
    (moved,) = (one for one in ranking if one.candidate.effect.name == "misregistration")
    said = []
    monkeypatch.setattr(trials, "tell", said.append)
    refit_all(comparison, [moved])
    at = ", ".join(f"{key.partition('.')[2]} {value:.3g}" for key, value in moved.candidate.place.items())
    assert said and all(
        re.fullmatch(
            rf"first pass: misregistration{f' [(]{at}[)]' if at else ''} explains \d+ %; \d+ simulations?", line
        )
        for line in said
    )


def test_without_a_refit_the_constants_follow_what_is_shown(world):
    comparison, ranking, _ = world
    score_test = comparison.score_test
    for one in ranking:
        shown, by = explained(comparison, one)
        assert by == SLOPES
        # nothing is left in it that the constants can take up, and nothing else is taken out of it
        whitened = score_test.whiten(shown[comparison.kept])
        signature = score_test.signature(one.columns @ one.finding.size)
        assert whitened == pytest.approx(signature, abs=1e-6 * np.abs(signature).max())


def test_a_refit_is_shown_by_what_it_leaves(world):
    comparison, _, ranking = world
    weighed = comparison.weighed
    known = np.isfinite(weighed.whole) & (generator(2).random(len(weighed.whole)) < 0.9)
    less = replace(weighed, whole=np.where(known, 0.4 * weighed.whole, np.nan))
    refit = Refit(1.0, 1, 1.0, None, {}, weighed=less)
    shown, by = explained(comparison, ranking[0], refit)
    assert by == REFIT
    # in held-out steps, too: they are drawn, though they choose nothing
    assert (known & ~comparison.kept).any()
    assert shown[known] == pytest.approx(0.6 * weighed.whole[known])
    assert np.isnan(shown[~known]).all() and 0 < (~known).sum() < len(known)


def test_the_refit_ends_at_the_minimum_of_what_it_fits(world):
    """From the other side, it ends at the same place, within what the last move may still be worth."""
    comparison, _, ranking = world
    wider = widened(comparison.problem, comparison.base.values, ranking[0])
    first = FirstPass(comparison)
    start = {**ranking[0].refitted.values, "stiffening.shift": 1.5 * ranking[0].refitted.values["stiffening.shift"]}
    again = first.refit(wider, start)
    assert again.converged
    assert again.misfit == pytest.approx(ranking[0].refitted.misfit, rel=2 * FALL)


def test_laws_of_the_material_are_read_near_the_model(world):
    """At a tenth of their step: Poisson's ratio alone changes the bulk modulus by half within one."""
    comparison, ranking, _ = world
    chosen = [one.candidate for one in ranking if one.candidate.effect.acts == "material"]
    exact, first, read = to_first_order(comparison, chosen)
    assert read == {"stiffening", "compressibility"}
    for name in read:
        assert alike_to(exact[name], first[name]) > 0.95
        assert np.linalg.norm(first[name]) == pytest.approx(np.linalg.norm(exact[name]), rel=0.3)


def test_where_the_first_step_has_no_solution_a_shorter_one_is_taken(world, monkeypatch):
    comparison, ranking, _ = world
    (tilt,) = (one for one in ranking if one.candidate.effect.name == "tilt")
    slope, _ = tilt.candidate.effect.parameters
    solved, known = comparison.read, FirstPass(comparison)

    def read(asked):
        return None if abs(asked.values.get("tilt.slope", 0.0)) > 0.9 * slope.step else solved(asked)

    monkeypatch.setattr(comparison, "read", read)
    wider = widened(comparison.problem, comparison.base.values, trials._just_present(tilt))
    with pytest.raises(StateError, match="no solution"):
        known.refit(wider, wider.settings.starts())
    ((found,), _) = refit_all(comparison, [tilt])
    assert found.refitted is not None


def test_one_that_does_not_end_says_so(world):
    comparison, ranking, _ = world
    stiffening = next(one for one in ranking if one.candidate.effect.name == "stiffening")
    wider = widened(comparison.problem, comparison.base.values, trials._just_present(stiffening))
    assert not FirstPass(comparison).refit(wider, wider.settings.starts(), moves=2).converged


def test_slopes_are_those_of_simulations_and_are_none(world, monkeypatch):
    """Both are differences to one side, and wrong by a few of their steps. Those by the tangent leave no trace."""
    comparison, ranking, _ = world
    for one in ranking:
        wider = widened(comparison.problem, comparison.base.values, trials._just_present(one))
        start, known = wider.settings.starts(), set(wider.sims.iterdir())
        way = Way(FirstPass(comparison), wider, start, {})
        near = way.slopes(np.zeros(len(start)))
        here = wider.ask(way.values(np.zeros(len(start)))).sim
        assert wider.asked == {here} and set(wider.sims.iterdir()) <= known | {wider.sims / here}
        assert way.run == (wider.sims / here not in known)
        with monkeypatch.context() as patch:
            patch.setattr(first_pass, "beside", lambda problem, here, guesses: [None] * len(guesses))
            patch.setattr(first_pass, "STEP", NEAR)
            whole = Way(FirstPass(comparison), wider, start, {}).slopes(np.zeros(len(start)))
        assert len(wider.asked) == 1 + sum(name not in way._linear for name in start)
        assert np.all(np.linalg.norm(near - whole, axis=0) < 10 * NEAR * np.linalg.norm(whole, axis=0))


def test_near_the_truth_only_those_are_refitted_that_slopes_speak_for(world):
    comparison, ranking, refitted = world
    sloped, run = refit_all(comparison, ranking, sloped=True)
    assert run == 0
    spoken_for = {one.candidate.effect.name for one in ranking if one.odds(1.0) > 0}
    assert {one.candidate.effect.name for one in sloped if one.refitted} == spoken_for
    assert 0 < len(spoken_for) < len(NAMES) == len([one for one in refitted if one.refitted])


def test_where_brightness_alone_is_off_only_those_are_refitted_that_slopes_speak_for(tmp_path):
    """Slopes count what the first pass looks at: brightness makes whatever moves the body promise something.

    Of 396 displacements and forces the model leaves some 350, and 462 are within chance: four standard deviations more.
    """
    own = {"displacement": [0.75, 1.5, 2.25, 3.0], "effects": {"contrast_drift": {"power": -0.03}}}
    problem, last, _, everything = fitted(written(tmp_path, **own), tmp_path / "model", SMALL)
    found = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in MOVING]
    comparison, _ = compared(problem, last, everything, found)
    assert not explains(comparison.score_test)
    ranking = best_places(rank_candidates(comparison, comparison.score_test, found))
    ranked, _ = refit_all(comparison, ranking)
    first = FirstPass(comparison)
    promised = {one.candidate.effect.name: first.promised(one) for one in ranking}
    spoken_for = {name for name, one in promised.items() if one.odds(1.0) > 0}
    assert {one.candidate.effect.name for one in ranked if one.refitted} == spoken_for
    assert len(spoken_for) < len(ranking) == len(MOVING)
    left = {one.candidate.effect.name: one.finding.fall for one in ranked if not one.refitted}
    assert left == {name: promised[name].finding.fall for name in left}
    whole = {one.candidate.effect.name: one.finding.fall for one in ranking}
    assert all(whole[name] != fall for name, fall in left.items() if fall)


def test_two_processes_find_what_one_does(world):
    comparison, ranking, one = world
    two, _ = refit_all(comparison, ranking, threads=2)
    assert [found.candidate.effect.name for found in two] == [found.candidate.effect.name for found in one]
    assert [found.refitted and found.refitted.values for found in two] == [
        found.refitted and found.refitted.values for found in one
    ]
    assert all(found.columns is own.columns for found, own in zip(two, one, strict=True))


@pytest.mark.parametrize("threads", [1, 2])
def test_of_two_layers_the_better_is_kept_with_its_columns(world, threads):
    """Slopes point to the wrong one; what a process of its own has found is known by its place."""
    comparison, ranking, _ = world
    problem = comparison.problem
    found = [one for one in candidates(problem, comparison.base.values)[0] if one.effect.name == "layer_stiffening"]
    solve_missing(problem, [asked for one in found for asked in one.asked], 1)
    everywhere = rank_candidates(comparison, comparison.score_test, found)
    alone = [refit_all(comparison, [one])[0][0].refitted.misfit for one in everywhere]
    wrong, right = everywhere[int(np.argmax(alone))], everywhere[int(np.argmin(alone))]
    tilt = next(one for one in ranking if one.candidate.effect.name == "tilt")
    both, _ = refit_all(comparison, [tilt, wrong], threads, everywhere=[wrong, right])
    best = next(one for one in both if one.candidate.effect.name == "layer_stiffening")
    assert best.candidate.place == right.candidate.place != wrong.candidate.place
    assert best.columns is right.columns


def test_of_several_starts_the_better_half_goes_on(world, monkeypatch):
    """A few moves do not tell whose minimum is the lowest: a stiff lump was named as a soft one elsewhere."""
    comparison, _, refitted = world
    base = next(one for one in refitted if one.refitted)
    found = [one for one in candidates(comparison.problem, comparison.base.values)[0] if one.effect.name == "inclusion"]
    enough = trials.chance(base.refitted.count)
    starts = [replace(base, candidate=found[n], columns=np.zeros((2, 1))) for n in range(4)]
    first, then = (enough + np.array(left) for left in ([3.0, 1.0, 2.0, 4.0], [-9.0, 1.0, -5.0, -9.0]))
    asked = []

    def refit(_, one, share, __=None):
        n = found.index(one.candidate)
        asked.append(n)
        left = (then if asked.count(n) > 1 else first)[n]
        there = replace(base.refitted, misfit=left, converged=len(asked) > 4)
        return trials._Tried(replace(one, refitted=there, columns=np.zeros((0, 0)), also=()), frozenset(), share)

    monkeypatch.setattr(trials._Trial, "_refit", refit)
    monkeypatch.setattr(trials._Trial, "_falls_short", lambda *_: False)
    monkeypatch.setattr(trials, "other_places", lambda *_: starts[1:])
    ((best,), _) = refit_all(comparison, starts[:1])
    assert best.candidate is found[2]
    assert best.refitted.misfit == enough - 5.0
    assert best.columns is starts[2].columns
    assert sorted(asked) == [0, 1, 1, 2, 2, 3]
    # where the first moves leave what chance leaves, there is nothing lower to look for
    asked.clear()
    first -= 5.0
    ((best,), _) = refit_all(comparison, starts[:1])
    assert best.candidate is found[1]
    assert sorted(asked) == [0, 1, 1, 2, 3]


@pytest.mark.parametrize("name", ["fibres", "inclusion"])
def test_where_the_place_is_fitted_it_begins_at_places_that_look_otherwise(world, name):
    """From one of them only, oblique fibres and soft lumps ended in a local minimum."""
    comparison, _, _ = world
    problem, score_test = comparison.problem, comparison.score_test
    found = [one for one in candidates(problem, comparison.base.values)[0] if one.effect.name == name]
    # of two families of fibres all angles look alike
    found = [one for one in found if one.place.get("fibres.families", 1) == 1]
    solve_missing(problem, [asked for one in found for asked in one.asked], 1)
    everywhere = rank_candidates(comparison, score_test, found)
    (best,) = best_places(everywhere)
    starts = [best, *other_places(score_test, everywhere, best)]
    here = [one for one in starts if not elsewhere(one, best)]
    assert 1 < len(here) <= STARTS
    for n, a in enumerate(starts):
        assert sum(not elsewhere(one, a) for one in starts) <= (STARTS_ELSEWHERE if elsewhere(a, best) else STARTS)
        for b in starts[:n]:
            # those of another layer, to which no fit can move it, are more
            assert elsewhere(a, b) or alike(score_test, a, b) < 0.5 or a.finding.size[0] * b.finding.size[0] < 0


def test_one_and_two_families_of_fibres_are_begun_and_all_layers(world):
    """All else that no fit can move is the same: slopes of fibres that are not there tell neither for sure."""
    comparison, _, _ = world
    problem, score_test = comparison.problem, comparison.score_test
    found = [one for one in candidates(problem, comparison.base.values)[0] if one.effect.name == "fibres"]
    solve_missing(problem, [asked for one in found for asked in one.asked], 1)
    everywhere = rank_candidates(comparison, score_test, found)
    (best,) = best_places(everywhere)
    fixed = ("fibres.layer", "fibres.families")
    starts = [
        tuple(one.candidate.place[key] for key in fixed) for one in (best, *other_places(score_test, everywhere, best))
    ]
    layer, families = starts[0]
    assert (layer, 3 - families) in starts
    layers = {one.place["fibres.layer"] for one in found}
    assert len(layers) > 2
    assert {one[0] for one in starts if one[1] == families} == layers


def test_few_digits_of_a_place_stay_within_its_bounds(world):
    """A time of relaxation of 642.857 s, its bound, was rounded to 642.9, and the diagnosis ended."""
    comparison, _, _ = world
    settings = comparison.problem.settings
    relaxation = settings.known_effects()["relaxation"]
    _, upper = relaxation.refine["time"]
    wider = extended(settings, relaxation, {"relaxation.time": upper * 1.0001}, {}, comparison.base.values)
    assert wider.model.effects["relaxation"]["time"] == upper


def test_a_number_at_its_bound_is_said_so(world):
    comparison, _, ranking = world
    wider = widened(comparison.problem, comparison.base.values, ranking[0])
    for parameter in (parameters := list(wider.settings.parameters())):
        if parameter.name == "stiffening.shift":
            near = replace(parameter, lower=0.0, upper=0.5, start=0.3, unity=parameter.scale)
            parameters[parameters.index(parameter)] = near
            break
    object.__setattr__(wider.settings, "parameters", lambda: tuple(parameters))
    found = FirstPass(comparison).refit(wider, {**wider.settings.starts(), "stiffening.shift": 0.3})
    assert found.at_bound == ("stiffening.shift",)


def test_no_start_no_refit(world, monkeypatch):
    comparison, _, ranking = world
    wider, first = widened(comparison.problem, comparison.base.values, ranking[0]), FirstPass(comparison)
    monkeypatch.setattr(comparison, "read", lambda asked: None)
    with pytest.raises(StateError, match="no solution"):
        first.refit(wider, wider.settings.starts())
