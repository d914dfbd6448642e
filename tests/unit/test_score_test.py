"""The score test: the same as a refit by generalised least squares, and as rare by chance as it says."""

import numpy as np
import pytest

from fingerfit.diagnosis.score_tests import Known, ScoreTest, likeness

VALUES, OWN = 60, 3
WIDE = np.full(2, np.inf)


@pytest.fixture
def columns(rng):
    """Own columns, columns of an effect, nuisances, covariance with correlations."""
    own, effect = rng.normal(size=(VALUES, OWN)), rng.normal(size=(VALUES, 2))
    nuisance = 0.5 * rng.normal(size=(VALUES, 4))
    root = np.tril(rng.normal(size=(VALUES, VALUES)) * 0.2) + np.diag(rng.uniform(0.5, 2.0, VALUES))
    return own, effect, nuisance, root @ root.T


def refit(residual, covariance, columns):
    """Misfit and sizes of the columns, from the normal equations."""
    weight = np.linalg.inv(covariance)
    size = np.linalg.solve(columns.T @ weight @ columns, columns.T @ weight @ residual)
    left = residual - columns @ size
    return left @ weight @ left, size


def test_it_is_a_refit(columns, rng):
    own, effect, nuisance, covariance = columns
    full = covariance + nuisance @ nuisance.T
    for _ in range(5):
        residual = rng.multivariate_normal(np.zeros(VALUES), full) + effect @ rng.normal(size=2)
        score_test = ScoreTest(residual, covariance, own, nuisance)
        finding = score_test.test(effect, -WIDE, WIDE)
        without, _ = refit(residual, full, own)
        within, size = refit(residual, full, np.concatenate([own, effect], axis=1))
        assert score_test.misfit == pytest.approx(without, rel=1e-9)
        assert score_test.freedom == VALUES - OWN
        assert finding.fall == pytest.approx(without - within, rel=1e-8)
        assert finding.size == pytest.approx(size[OWN:], rel=1e-8)


def test_the_signal_is_what_the_constants_leave_of_it(columns):
    own, effect, nuisance, covariance = columns
    full = covariance + nuisance @ nuisance.T
    finding = ScoreTest(np.zeros(VALUES), covariance, own, nuisance).test(effect, -WIDE, WIDE)
    left = [refit(column, full, own)[0] for column in effect.T]
    assert finding.signal == pytest.approx(sum(left), rel=1e-9)
    total = np.trace(effect.T @ np.linalg.inv(full) @ effect)
    assert finding.visible == pytest.approx(sum(left) / total, rel=1e-9)
    assert 0 < finding.visible < 1
    assert finding.fall == pytest.approx(0.0, abs=1e-12)


def test_the_constants_follow_as_in_a_refit(columns, rng):
    own, effect, nuisance, covariance = columns
    score_test = ScoreTest(rng.normal(size=VALUES), covariance, own, nuisance)
    for signal in effect.T:
        # the rest of a signal when the constants make up for it
        assert score_test.follow(signal) == pytest.approx(-refit(signal, covariance + nuisance @ nuisance.T, own)[1])


def test_falls_by_chance_are_chi_square(columns, rng):
    own, effect, nuisance, covariance = columns
    root, one, two = np.linalg.cholesky(covariance + nuisance @ nuisance.T), [], []
    for noise in (root @ rng.normal(size=(VALUES, 800))).T:
        score_test = ScoreTest(noise, covariance, own, nuisance)
        one.append(score_test.test(effect[:, :1], -WIDE[:1], WIDE[:1]).fall)
        two.append(score_test.test(effect, -WIDE, WIDE).fall)
    # mean k and variance 2 k of chi-square; five standard errors of 800 draws
    assert np.mean(one) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 800))
    assert np.mean(two) == pytest.approx(2.0, abs=5 * np.sqrt(4 / 800))
    assert np.mean(np.array(one) > 3.841) == pytest.approx(0.05, abs=5 * np.sqrt(0.05 * 0.95 / 800))
    assert np.mean(np.array(two) > 5.991) == pytest.approx(0.05, abs=5 * np.sqrt(0.05 * 0.95 / 800))


def test_what_the_constants_can_imitate_is_not_seen(columns, rng):
    own, effect, nuisance, covariance = columns
    inside = own @ np.array([[1.0], [-2.0], [0.5]])
    score_test = ScoreTest(5 * inside[:, 0] + rng.normal(size=VALUES), covariance, own, nuisance)
    finding = score_test.test(inside, -WIDE[:1], WIDE[:1])
    assert finding.visible < 1e-12
    assert finding.fall == 0
    assert finding.size == pytest.approx([0.0])
    # what stands at right angles to them, after whitening, is seen whole
    root = np.linalg.cholesky(covariance + nuisance @ nuisance.T)
    signature = score_test.signature(effect)
    assert score_test.test(root @ signature, -WIDE, WIDE).visible == pytest.approx(1.0, abs=1e-12)


def test_own_columns_may_depend_on_each_other(columns, rng):
    own, effect, nuisance, covariance = columns
    residual = rng.normal(size=VALUES)
    twice = np.concatenate([own, own[:, :1] + own[:, 1:2], np.zeros((VALUES, 1))], axis=1)
    a, b = ScoreTest(residual, covariance, own, nuisance), ScoreTest(residual, covariance, twice, nuisance)
    assert b.freedom == a.freedom == VALUES - OWN
    assert b.misfit == pytest.approx(a.misfit, rel=1e-9)
    assert b.test(effect, -WIDE, WIDE).fall == pytest.approx(a.test(effect, -WIDE, WIDE).fall, rel=1e-8)


def test_sizes_stay_within_bounds(columns, rng):
    own, effect, nuisance, covariance = columns
    residual = effect @ np.array([8.0, -3.0]) + rng.normal(size=VALUES)
    score_test = ScoreTest(residual, covariance, own, nuisance)
    free = score_test.test(effect, -WIDE, WIDE)
    low, high = np.array([-1.0, -np.inf]), np.array([1.0, np.inf])
    bound = score_test.test(effect, low, high)
    full = covariance + nuisance @ nuisance.T
    assert free.size == pytest.approx(refit(residual, full, np.concatenate([own, effect], axis=1))[1][OWN:], rel=1e-8)
    assert free.size[0] > high[0]
    assert bound.size[0] == 1.0
    # the other one follows: it is the best for the first at its bound
    columns = np.concatenate([own, effect[:, 1:]], axis=1)
    misfit, size = refit(residual - effect[:, 0], full, columns)
    assert bound.size[1] == pytest.approx(size[-1], rel=1e-8)
    assert bound.fall == pytest.approx(score_test.misfit - misfit, rel=1e-8)
    assert 0 < bound.fall < free.fall
    # the wrong sign only: nothing is better than the bound at zero
    assert score_test.test(effect[:, :1], np.array([-5.0]), np.array([0.0])).fall == 0


def test_common_modes_are_chi_square(columns, rng):
    """What noise leaves in them has as many degrees of freedom as modes that the constants cannot imitate."""
    own, modes, nuisance, covariance = columns
    root = np.linalg.cholesky(covariance + nuisance @ nuisance.T)
    # one of the modes twice, and one that is a constant's own
    common = np.concatenate([modes, 3 * modes[:, :1], own[:, :1]], axis=1)
    tests = [ScoreTest(noise, covariance, own, nuisance, common) for noise in (root @ rng.normal(size=(VALUES, 800))).T]
    assert {score_test.common_freedom for score_test in tests} == {2}
    found = np.array([score_test.common_misfit for score_test in tests])
    assert found.mean() == pytest.approx(2.0, abs=5 * np.sqrt(4 / 800))
    assert np.mean(found > 5.991) == pytest.approx(0.05, abs=5 * np.sqrt(0.05 * 0.95 / 800))
    # they are part of the whole, and a test of the very modes finds the same
    score_test = ScoreTest(modes @ np.array([3.0, -2.0]), covariance, own, nuisance, common)
    assert score_test.common_misfit == pytest.approx(score_test.misfit, rel=1e-9)
    score_test = ScoreTest(rng.normal(size=VALUES), covariance, own, nuisance, common)
    assert score_test.common_misfit == pytest.approx(score_test.test(modes, -WIDE, WIDE).fall, rel=1e-8)


def test_a_number_that_has_ended_at_a_bound_takes_nothing_up(columns, rng):
    """What it would explain beyond the bound counts as left, and it counts as fitted all the same."""
    own, effect, nuisance, covariance = columns
    residual, held = 5 * own[:, 1] + rng.normal(size=VALUES), np.array([False, True, False])
    known = Known(np.zeros(0), np.zeros((0, OWN)), held)
    found, free = (ScoreTest(residual, covariance, own, nuisance, known=one) for one in (known, None))
    without = ScoreTest(residual, covariance, own[:, ~held], nuisance)
    assert found.misfit == pytest.approx(without.misfit, rel=1e-9)
    assert found.misfit > free.misfit + 10
    assert found.freedom == free.freedom == without.freedom - 1
    assert found.signature(effect) == pytest.approx(without.signature(effect))
    assert found.follow(effect[:, 0])[held] == pytest.approx(0.0, abs=1e-12)
    assert found.of_another(residual, own, known).misfit == pytest.approx(found.misfit)


def test_likeness(rng):
    basis = np.linalg.qr(rng.normal(size=(VALUES, 4)))[0]
    a, b, c = basis[:, :1], basis[:, 1:2], basis[:, 2:]
    assert likeness(a, a) == pytest.approx(1.0)
    assert likeness(a, -3 * a) == pytest.approx(1.0)
    assert likeness(a, b) == pytest.approx(0.0, abs=1e-12)
    assert likeness(a, c) == pytest.approx(0.0, abs=1e-12)
    # of two at 30 degrees cos^2, and 1 for what lies in the span of several
    slanted = np.cos(np.pi / 6) * a + np.sin(np.pi / 6) * b
    assert likeness(a, slanted) == pytest.approx(0.75)
    assert likeness(slanted, np.concatenate([a, b], axis=1)) == pytest.approx(1.0)
