"""Evidence for effects: against numbers integrated one by one; which effects a model may do without."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from seeds import generator

from fingerfit.diagnosis.evidence import LIKELY, Information, information, interval95, log_odds, spare
from fingerfit.diagnosis.score_tests import ScoreTest
from fingerfit.model.catalogue import catalogue
from fingerfit.model.parameters import Parameter
from fingerfit.model.scales import bound

VALUES = 60
EFFECTS = bound(catalogue(), {"width": 12.0, "height": 12.0, "force": 40.0}, "force")


def test_odds_are_an_integral_over_the_number():
    """A line with noise of 1: with a slope whose prior is normal, and without one."""
    rng = generator(3)
    x, prior = np.linspace(-1, 1, VALUES), 0.7
    y = 0.4 * x + rng.normal(size=VALUES)
    slopes = np.linspace(-8, 8, 4001)
    misfit = ((y - slopes[:, None] * x) ** 2).sum(axis=1)
    density = np.exp(-0.5 * (slopes / prior) ** 2) / prior / np.sqrt(2 * np.pi)
    exact = np.log((np.exp(-0.5 * (misfit - (y @ y))) * density).sum() * (slopes[1] - slopes[0]))
    # where likelihood and prior together are largest
    best = x @ y / (x @ x + prior**-2)
    fall = y @ y - ((y - best * x) ** 2).sum()
    assert log_odds(fall, (best / prior) ** 2, np.array([[x @ x * prior**2]]), 1.0) == pytest.approx(exact, abs=1e-6)


def test_an_effect_of_which_some_numbers_are_absent_is_compared_without_them():
    """Against fits of each choice of numbers: the misfit of a linear model with independent noise of 1."""
    rng = generator(6)
    columns = 30.0 * np.linalg.qr(rng.normal(size=(VALUES, 3)))[0] @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))
    rest = rng.normal(size=VALUES)
    # two numbers of about one standard error
    left = columns @ [0.8, 0.03, -0.03] + rest - columns @ np.linalg.lstsq(columns, rest, rcond=None)[0]
    far, known = np.linalg.lstsq(columns, left, rcond=None)[0], columns.T @ columns
    for kept, rise, moved in Information(known, far, np.ones(3, dtype=bool)).without_least():
        own = np.linalg.lstsq(columns[:, kept], left, rcond=None)[0]
        assert moved == pytest.approx(own)
        after = left - columns[:, kept] @ own
        assert rise == pytest.approx(after @ after - (left - columns @ far) @ (left - columns @ far), abs=1e-9)
    assert list(np.flatnonzero(kept)) == [0]
    fall = float(left @ columns @ far)
    # one of three counts, and one of three choices of one number: less what two numbers more would have cost
    (only,) = own
    alone = log_odds(fall - rise, only**2, known[:1, :1], 1.0) - 2 * np.log(3)
    both = Information(known, far, np.ones(3, dtype=bool)).odds(fall, 1.0)
    assert log_odds(fall, float(far @ far), known, 1.0) < alone < both < alone + 0.2
    needed = Information(known, far, np.zeros(3, dtype=bool)).odds(fall, 1.0)
    assert needed == pytest.approx(log_odds(fall, float(far @ far), known, 1.0))


@pytest.mark.parametrize("spread", [1.0, 3.0])
@pytest.mark.parametrize("choices", [1, 5])
@pytest.mark.parametrize("optional", [True, False])
def test_what_numbers_are_worth_is_the_fall_at_which_the_odds_for_them_are_even(rng, spread, choices, optional):
    columns = rng.normal(size=(VALUES, 3))
    known = Information(columns.T @ columns, rng.normal(size=3), np.full(3, optional))
    assert known.odds(known.worth(spread, choices), spread) == pytest.approx(np.log(choices))


def test_numbers_that_data_do_not_see_are_worth_nothing_and_places_by_the_room_that_they_had():
    size, place = np.array([0.5, 0.0]), np.array([True, False])
    seen = Information(np.array([[99.0]]), size[:1], place[:1]).worth(1.0)
    assert seen == pytest.approx(0.25 + np.log(100.0))
    assert Information(np.diag([99.0, 0.0]), size, place).worth(1.0) == pytest.approx(seen)
    assert Information(np.diag([99.0, 1e4 - 1.0]), size, place).worth(1.0) == pytest.approx(seen + np.log(1e4))
    assert Information(np.zeros((0, 0)), np.zeros(0), np.zeros(0, dtype=bool)).worth(1.0) == 0.0


def test_a_number_that_moves_nothing_is_left_out_first():
    known = Information(np.diag([900.0, 0.0, 400.0]), np.array([0.1, 1.9, 0.2]), np.ones(3, bool))
    assert [list(np.flatnonzero(kept)) for kept, *_ in known.without_least()] == [[0, 1, 2], [0, 2], [2]]


def test_a_polynomial_loses_its_highest_degree_first_and_each_further_one_is_half_as_likely():
    """A number that is as good as absent changes nothing but the prior: 1/2 for one degree, 1/4 for two and for three."""
    plain = Information(np.diag([900.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.ones(3, bool))
    known = replace(plain, polynomial=True)
    assert [list(np.flatnonzero(kept)) for kept, *_ in known.without_least()] == [[0, 1, 2], [0, 1], [0]]
    alone = log_odds(900.0, 1.0, plain.matrix[:1, :1], 1.0)
    assert known.odds(900.0, 1.0) == pytest.approx(alone)
    line = replace(known, matrix=np.diag([900.0, 900.0, 0.0]), far=np.array([1.0, 1.0, 0.0]))
    assert line.odds(1800.0, 1.0) == pytest.approx(2.0 * alone - np.log(2.0))
    probe = replace(line, optional=np.zeros(3, bool))
    assert probe.odds(1800.0, 1.0) == pytest.approx(2.0 * alone)


@pytest.mark.parametrize(
    ("name", "optional"),
    [("yeoh", [True, True]), ("inclusion", [True, False, False]), ("loading_probe", [False] * 4)],
)
def test_sizes_of_a_member_are_optional_but_no_places_nor_those_of_a_probe(name, optional):
    effect = EFFECTS[name]
    keys = [effect.key(p.name) for p in effect.parameters] + [effect.key(place) for place in effect.refine]
    numbers = [Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0)]
    numbers += [Parameter(key, "1", -1.0, 1.0, 0.0, False, 1.0) for key in keys]
    slopes = generator(4).normal(size=(VALUES, len(numbers)))
    assert list(information(numbers, dict.fromkeys(keys, 0.3), slopes, effect).optional) == optional


def test_intervals_of_a_refit_are_as_wide_as_its_slopes_say_and_within_the_bounds():
    """One constant that the data see well, one that they do not see; a misfit of four per value doubles the width."""
    mu = Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0)
    share = Parameter("base_slip.share", "1", 0.0, 1.0, 0.3, False, 0.5)
    slopes = np.zeros((VALUES, 2))
    slopes[0, 0] = 40.0
    for spread in (1.0, 4.0):
        found = interval95((mu, share), {"mu": 0.1, "base_slip.share": 0.3}, slopes, spread)
        half = 1.96 * np.sqrt(spread) / 40.0
        assert found["mu"] == pytest.approx((0.1 * np.exp(-half), 0.1 * np.exp(half)), rel=1e-3)
        assert found["base_slip.share"] == pytest.approx((0.0, 0.3 + 1.96 / np.sqrt(12.0)), abs=1e-3)


def model(effects, slopes, values, per_test=()):
    """A fitted model with one constant: `slopes` of all numbers in units of the noise, `values` in units of scales."""
    known = {name: EFFECTS[name] for name in effects}
    numbers = [
        (f"{effect.key(p.name)}{end}", p)
        for effect in known.values()
        for p in effect.parameters
        for end in (["@wide", "@narrow"] if effect.name in per_test else [""])
    ]
    parameters = [Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0)]
    parameters += [Parameter(key, p.unit, p.lower, p.upper, p.null, False, p.scale) for key, p in numbers]
    settings = SimpleNamespace(
        parameters=lambda: tuple(parameters), model=SimpleNamespace(effects=dict.fromkeys(effects))
    )
    at = {p.name: value * p.scale for p, value in zip(parameters[1:], values, strict=True)} | {"mu": 0.1}
    # what is left after a fit has no part along its slopes
    rest = generator(5).normal(size=VALUES)
    rest -= slopes @ np.linalg.lstsq(slopes, rest, rcond=None)[0]
    score_test = ScoreTest(rest, np.eye(VALUES), slopes, np.zeros((VALUES, 0)))
    return SimpleNamespace(settings=settings, effects=known), score_test, at


@pytest.mark.parametrize(("alike", "expected"), [(0.0, []), (0.999, ["base_slip"])])
def test_what_another_effect_says_as_well_is_spare(alike, expected):
    rng = generator(4)
    one, other, mu = np.linalg.qr(rng.normal(size=(VALUES, 3)))[0].T * 40.0
    slopes = np.stack([mu, one, alike * one + np.sqrt(1 - alike**2) * other], axis=1)
    problem, score_test, at = model(["base_slip", "force_gain"], slopes, [0.2, 0.5])
    assert [effect.name for effect in spare(problem, score_test, at)] == expected


@pytest.mark.parametrize("unity", [0.1, 0.6, 1.8])
def test_numbers_that_each_test_has_for_itself_are_those_of_the_effect(unity):
    """Their likely sizes are the effect's, whatever counts as 1 in their coordinates."""
    rng, scale = generator(4), EFFECTS["force_gain"].parameters[0].scale
    slopes = np.linalg.qr(rng.normal(size=(VALUES, 3)))[0] * 40.0
    numbers = [Parameter("mu", "MPa", 0.01, 1.0, 0.1, True, 1.0)]
    numbers += [Parameter(f"force_gain.gain@{test}", "1", -0.3, 0.3, 0.0, False, unity) for test in ("wide", "narrow")]
    at = {"mu": 0.1, "force_gain.gain@wide": 0.1, "force_gain.gain@narrow": 0.05}
    known = information(numbers, at, slopes * [1.0, unity, unity], EFFECTS["force_gain"])
    assert known.matrix == pytest.approx(np.eye(2) * (LIKELY * scale * 40.0) ** 2)
    assert known.far == pytest.approx(np.array([0.1, 0.05]) / (LIKELY * scale))
    assert not known.polynomial


@pytest.mark.parametrize("small", [0.3 / 40.0, 0.5], ids=["almost absent", "there"])
def test_an_effect_of_each_test_may_be_spare(small):
    slopes = np.linalg.qr(generator(4).normal(size=(VALUES, 4)))[0] * 40.0
    problem, score_test, at = model(["base_slip", "force_gain"], slopes, [small, small, 0.5], per_test=["base_slip"])
    assert [effect.name for effect in spare(problem, score_test, at)] == (["base_slip"] if small < LIKELY else [])


def test_a_number_that_is_almost_absent_is_spare_and_the_last_effect_is_not_asked_for():
    rng = generator(4)
    slopes = np.linalg.qr(rng.normal(size=(VALUES, 3)))[0] * 40.0
    small = 0.3 / 40.0  # a third of its standard error
    problem, score_test, at = model(["base_slip", "force_gain"], slopes, [small, small])
    assert small < LIKELY
    assert [effect.name for effect in spare(problem, score_test, at)] == ["base_slip"]
    assert spare(*model(["base_slip"], slopes[:, :2], [small])) == []
