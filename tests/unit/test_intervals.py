"""Minimum, spread, intervals and what the data cannot tell, against closed forms."""

import numpy as np
import pytest
from differences import by_differences
from scipy.stats import norm
from scipy.stats import t as student
from seeds import generator

from fingerfit.fit.identified import identifiability
from fingerfit.fit.intervals import (
    WIDTH,
    as_json,
    curvature,
    gradient_and_hessian,
    minimise,
    repeat,
    summarise,
    widths,
)
from fingerfit.fit.objective import Objective
from fingerfit.model.parameters import Parameter

A = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 2.0]])
TWO, THREE = np.full(2, WIDTH), np.full(3, WIDTH)
LOG = tuple(Parameter(name, "MPa", 1e-3, 1.0, 0.1) for name in ("mu_a", "mu_b", "mu_c"))


def bowl(centre, matrix=A):
    return Objective(lambda d: 0.5 * (d - centre) @ matrix @ (d - centre), lambda d: matrix @ (d - centre))


def test_differences_of_a_quadratic_are_exact():
    centre = np.array([0.03, -0.02, 0.05])
    gradient, hessian = gradient_and_hessian(bowl(centre), THREE)
    assert gradient == pytest.approx(-A @ centre, abs=1e-12)
    assert hessian == pytest.approx(A, abs=1e-10)
    assert curvature(bowl(centre), THREE) == pytest.approx(A, abs=1e-10)


def test_sums_squares_and_a_part_of_the_numbers_have_the_gradients_of_their_values(rng):
    left, columns, start = rng.normal(size=5), rng.normal(size=(5, 3)), rng.normal(size=3)
    whole = Objective.total([bowl(start), Objective.squares(0.7, left, columns)])
    assert whole(start) == pytest.approx(0.7 * np.sum((left - columns @ start) ** 2))
    for one, at in ((whole, rng.normal(size=3)), (whole.along(np.array([0, 2]), start), rng.normal(size=2))):
        assert one.gradient(at) == pytest.approx(by_differences(one.value).gradient(at), rel=1e-6)


@pytest.mark.parametrize("reach", [0.01, 0.15])
def test_minimum_of_a_quadratic(reach):
    centre = np.array([0.05, -0.1, 0.02])
    found = minimise(bowl(centre), THREE, reach)
    assert found == pytest.approx(centre, abs=1e-4 if reach > 0.1 else 1e-3)


def test_minimum_of_something_else():
    found = minimise(by_differences(lambda d: float(np.cosh(3 * (d[0] - 0.2)) + np.exp(d[1]) - 1.1 * d[1])), TWO)
    assert found == pytest.approx([0.2, np.log(1.1)], abs=5e-4)


def test_a_number_that_moves_pictures_fast_has_shorter_differences():
    """A score that is skew: over 2 % its slope at 0 has the wrong sign, over half a per cent it has the right one."""
    number = Parameter("band.size", "1", -1.0, 1.0, 0.0, log=False, unity=1.0)
    skew = Objective(
        lambda d: 100 * (d[0] - 0.002) ** 2 + 1500 * (d[0] - 0.002) ** 3,
        lambda d: 200 * (d - 0.002) + 4500 * (d - 0.002) ** 2,
    )
    short = widths([LOG[0], LOG[1], number], np.array([1.0, 0.5, 4.0]))
    assert short == pytest.approx([WIDTH, WIDTH, WIDTH / 4])
    assert minimise(skew, short[2:]) == pytest.approx([0.002], abs=1500 * short[2] ** 2 / 200)
    assert widths([number, LOG[0]], np.zeros(2)) == pytest.approx([WIDTH, WIDTH])


def test_from_the_top_of_a_hill_it_goes_down():
    def hill(d):
        return float(-np.cos(4 * (d[0] - 0.1)) + d[1] ** 2)

    start = np.zeros(2)
    found = minimise(by_differences(lambda d: hill(d + np.array([0.55, 0.0]))), TWO)
    assert hill(found + np.array([0.55, 0.0])) < hill(start + np.array([0.55, 0.0])) - 0.3


def test_a_long_step_that_bounds_cut_still_goes_down():
    """Slopes and curvature of a fit far from its minimum; cut axis by axis its Newton step of 1.6 went uphill."""
    gradient = np.array([0.249, 0.497, 0.365, 0.491])
    curvature = np.array([
        [0.305, -0.596, -0.757, -0.403],
        [-0.596, -0.512, -0.681, -0.563],
        [-0.757, -0.681, 0.398, -0.208],
        [-0.403, -0.563, -0.208, -0.222],
    ])  # fmt: skip

    def score(d):
        return float(gradient @ d + 0.5 * d @ curvature @ d)

    found = minimise(by_differences(score), np.full(4, WIDTH), low=np.full(4, -0.3), high=np.full(4, 0.3))
    assert score(found) < -0.1
    assert np.abs(found).max() <= 0.3 + 1e-12


def test_a_step_that_bounds_turn_uphill_is_taken_straight_down():
    """A narrow valley aslant: with the second axis at its bound, the Newton step along the first one goes up its wall."""

    def valley(d):
        return float(100 * (d[0] - d[1] - 0.02) ** 2 + 0.5 * (d[1] - 0.5) ** 2)

    found = minimise(by_differences(valley), TWO, low=np.full(2, -0.3), high=np.array([0.3, 0.03]))
    assert found == pytest.approx([0.05, 0.03], abs=2e-3)


def test_a_minimum_that_is_steeper_than_the_way_to_it_is_not_jumped_over_for_ever():
    """The curvature at the start is less than that near the minimum: whole steps go from one side to the other."""
    found = minimise(by_differences(lambda d: 50 * float(d.sum() ** 2) + abs(float(d[0] - d[1] - 0.025)) ** 1.5), TWO)
    assert found == pytest.approx([0.0125, -0.0125], abs=1e-3)


def test_what_the_score_does_not_see_is_not_moved():
    found = minimise(by_differences(lambda d: float((d[0] - d[1] - 0.1) ** 2)), TWO)
    assert found[0] - found[1] == pytest.approx(0.1, abs=1e-4)
    assert found.sum() == pytest.approx(0.0, abs=1e-6)


def test_repetitions_shift_as_their_noise_says():
    rng = generator(4)
    noise = rng.normal(0.0, 0.01, (4000, 3))
    drawn = iter(noise)
    shifts, hessian = repeat(lambda: bowl(next(drawn)), THREE, len(noise))
    assert shifts == pytest.approx(noise, abs=1e-9)
    assert hessian == pytest.approx(A, abs=1e-9)


def test_minima_of_repetitions_are_found_where_a_step_is_too_short():
    """Two numbers compensate each other; along that the curvature at 0.1 from the minimum is four times that at it."""
    apart = np.array([0.1, -0.1] * 5)

    def score(at):
        return by_differences(
            lambda d: float(50 * d.sum() ** 2 + 10 * (d[0] - d[1] - at) ** 2 * (1 + 50 * (d[0] - d[1] - at) ** 2))
        )

    def found(minima):
        drawn = iter(apart)
        shifts, _ = repeat(lambda: score(next(drawn)), TWO, len(apart), minima=minima)
        return shifts[:, 0] - shifts[:, 1]

    assert found(minima=True) == pytest.approx(apart, rel=0.01)
    # the curvature is 20 + 6000 x^2 and the gradient 20 x + 2000 x^3, x = 0.1
    assert found(minima=False) == pytest.approx(apart * (20 + 20) / (20 + 60), rel=0.05)


@pytest.mark.parametrize("count", [3, 20, 60, 400])
def test_intervals_without_a_mesh_are_those_of_student(count):
    shifts = generator(2).normal(0.0, [0.01, 0.02, 0.03], (count, 3))
    values = [0.02, 0.03, 0.06]
    found = summarise(shifts, A, LOG, values)
    spread = shifts.std(axis=0, ddof=1)
    assert found.relative == pytest.approx(spread, rel=1e-12)
    half = student.ppf(0.975, count - 1) * spread
    if count == 3:  # two degrees of freedom: in closed form
        half = 0.95 * np.sqrt(2 / (1 - 0.95**2)) * spread
    assert np.log(found.interval[:, 1] / values) == pytest.approx(half, rel=1e-10)
    assert np.log(values / found.interval[:, 0]) == pytest.approx(half, rel=1e-10)
    assert found.mesh == pytest.approx(np.zeros(3))


def test_the_error_of_the_mesh_widens_the_interval_but_not_the_standard_error():
    shifts = generator(2).normal(0.0, 0.01, (60, 3))
    mesh = np.array([0.0, 0.01, 0.5])
    without, found = (summarise(shifts, A, LOG, [0.02, 0.03, 0.06], m) for m in (None, mesh))
    assert np.array_equal(found.relative, without.relative)
    half, plain = (np.log(u.interval[:, 1] / u.interval[:, 0]) / 2 for u in (found, without))
    assert half == pytest.approx(np.hypot(plain, norm.ppf(0.975) * mesh), rel=1e-10)
    entry = as_json(found, LOG, [0.02, 0.03, 0.06])["mu_c"]
    assert entry["mesh_error"] == pytest.approx(0.5 * 0.06)
    assert entry["standard_error"] == pytest.approx(found.relative[2] * 0.06)


def test_without_a_logarithm_the_interval_is_symmetric_in_the_value():
    parameters = (Parameter("poisson", "1", 0.3, 0.5, 0.4, log=False),)
    shifts = generator(3).normal(0.0, 0.05, (60, 1))
    found = summarise(shifts, np.eye(1), parameters, [0.45])
    low, high = found.interval[0]
    assert (low + high) / 2 == pytest.approx(0.45)
    expected = student.ppf(0.975, 59) * shifts.std(ddof=1) * 0.2
    assert (high - low) / 2 == pytest.approx(expected, rel=1e-10)
    assert as_json(found, parameters, [0.45])["poisson"]["standard_error"] == pytest.approx(shifts.std(ddof=1) * 0.2)


@pytest.mark.parametrize(("name", "low"), [("base_slip.share", 0.0), ("mu", -0.0196)])
def test_an_interval_ends_at_the_bounds_of_an_effect_and_not_at_those_of_a_constant(rng, name, low):
    shifts = rng.normal(size=(4000, 1)) * 0.01
    found = summarise(shifts, np.eye(1), [Parameter(name, "1", 0.0, 1.0, 0.5, log=False)], [0.0])
    assert found.interval[0] == pytest.approx([low, 0.0196], abs=0.001)


def test_a_constant_that_the_data_do_not_see_may_be_anywhere_in_its_bounds():
    hessian = np.diag([1.0, 0.0, 2.0])
    shifts = generator(4).normal(0.0, 0.01, (60, 3)) * [1.0, 0.0, 1.0]
    found = summarise(shifts, hessian, LOG, [0.02, 0.03, 0.06])
    assert found.remarks == ("mu_b is not identifiable from these data",)
    assert tuple(found.interval[1]) == (LOG[1].lower, LOG[1].upper)
    assert found.relative[1] == pytest.approx(np.log(LOG[1].upper / LOG[1].lower) / np.sqrt(12.0))
    others = summarise(shifts[:, [0, 2]], hessian[np.ix_([0, 2], [0, 2])], [LOG[0], LOG[2]], [0.02, 0.06])
    assert found.interval[[0, 2]] == pytest.approx(others.interval)


def test_constants_of_which_only_ratios_are_seen_may_be_anywhere_in_their_bounds():
    """Together: the largest one ends at its upper bound, the smallest one at its lower bound."""
    shifts = generator(4).normal(0.0, 1e-9, (60, 3)) * [1.0, 1.0, 1e7]
    values = np.array([0.6, 0.2, 0.06])
    found = summarise(shifts, plane([1, 1, 0]), LOG, values)
    assert found.remarks[0].startswith("only ratios of mu_a, mu_b are identifiable")
    low, high = LOG[1].lower / 0.2, LOG[0].upper / 0.6
    assert found.interval[:2] == pytest.approx(np.outer(values[:2], [low, high]), rel=1e-6)
    assert found.relative[:2] == pytest.approx(np.log(high / low) / np.sqrt(12.0), rel=1e-6)
    alone = summarise(shifts[:, 2:], np.eye(1), LOG[2:], values[2:])
    assert found.interval[2] == pytest.approx(alone.interval[0])
    assert found.relative[2] == pytest.approx(alone.relative[0])


def test_constants_of_two_combinations_that_are_not_seen_have_what_both_leave_open():
    found = summarise(np.zeros((60, 3)), plane([1, 1, 1], [1, -1, 0]), LOG, [0.1, 0.1, 0.01])
    # the data see mu_a mu_b / mu_c^2 alone
    assert found.interval[:2] == pytest.approx(np.tile([1e-3, 1.0], (2, 1)), rel=1e-6)
    assert found.interval[2] == pytest.approx([1e-3, 0.1], rel=1e-6)


def test_a_prior_on_the_common_scale_keeps_its_interval():
    known = 0.2**2 * np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    found = summarise(np.zeros((60, 3)), plane([1, 1, 0]), LOG, [0.02, 0.03, 0.06], known=known)
    assert np.log(found.interval[0] / 0.02) == pytest.approx(norm.ppf(0.975) * 0.2 * np.array([-1.0, 1.0]))


def test_a_constant_that_a_prior_alone_knows_has_the_interval_of_the_prior():
    hessian, known = np.diag([1.0, 0.0, 2.0]), np.diag([0.0, 0.2**2, 0.0])
    shifts = generator(4).normal(0.0, 0.01, (60, 3)) * [1.0, 0.0, 1.0]
    found = summarise(shifts, hessian, LOG, [0.02, 0.03, 0.06], known=known)
    assert np.log(found.interval[1] / 0.03) == pytest.approx(norm.ppf(0.975) * 0.2 * np.array([-1.0, 1.0]))
    assert found.relative[1] == pytest.approx(0.2)


def test_correlation_of_two_constants():
    common, own = generator(5).normal(0.0, 1.0, (2, 4000))
    shifts = np.stack([common, -common + 0.1 * own], axis=1)
    found = summarise(shifts, np.eye(2), LOG[:2], [0.1, 0.1])
    # 5 standard errors (1 - r^2) / sqrt(n)
    assert found.correlation[0, 1] == pytest.approx(-1 / np.sqrt(1.01), abs=5 * (1 - 1 / 1.01) / np.sqrt(4000))
    assert np.diag(found.correlation) == pytest.approx([1.0, 1.0])


MODULI = [Parameter(name, "MPa", 0.01, 1.0, 0.1) for name in ("mu_a", "mu_b", "mu_c")]


def plane(*directions):
    """Curvature that is 0 along these directions and 1 across them."""
    blind = np.linalg.qr(np.array(directions, dtype=float).T)[0]
    return np.eye(len(directions[0])) - blind @ blind.T


def test_everything_seen_is_no_remark():
    assert identifiability(A, MODULI) == ()
    assert identifiability(np.diag([1.0, 1.0, 1e-3]), MODULI) == ()


def test_only_ratios():
    (remark,) = identifiability(plane([1, 1, 1]), MODULI)
    assert remark == "only ratios of mu_a, mu_b, mu_c are identifiable: these data do not see their common scale"


def test_numbers_without_a_logarithm_have_no_ratio():
    """Of such numbers a direction is a difference, each by its own scale: as of an offset and an angle."""
    offset, angle = (
        Parameter(name, "1", 0.0, high, 0.0, False) for name, high in (("x.offset", 2.0), ("y.angle", 0.1))
    )
    (remark,) = identifiability(plane([1, 1]), [offset, angle])
    assert remark == "the combination +0.354 x.offset +7.07 y.angle is not identifiable from these data"


def test_one_constant_not_seen():
    assert identifiability(np.diag([1.0, 1e-6, 1.0]), MODULI) == ("mu_b is not identifiable from these data",)


def test_one_constant_at_a_maximum_is_told_by_its_name():
    """A score that curves down along a constant has no minimum there: it is no combination of several."""
    assert identifiability(np.diag([1.0, -1.0, 1.0]), MODULI) == ("mu_b is not identifiable from these data",)


def test_a_combination_not_seen():
    (remark,) = identifiability(plane([1, -2, 0]), MODULI)
    assert remark.startswith("the combination ")
    assert "mu_c" not in remark
    assert "0.45 log mu_a" in remark
    assert "0.89 log mu_b" in remark


def test_a_flat_score_sees_nothing():
    assert identifiability(np.zeros((2, 2)), MODULI[:2]) == ("mu_a, mu_b are not identifiable from these data",)
