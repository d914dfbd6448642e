"""Profiles against closed forms and against a search by simulations."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from test_identification import MU, TRUTH, compared

from fingerfit.core.errors import InputError, StateError
from fingerfit.diagnosis.first_pass import FirstPass
from fingerfit.diagnosis.profiles import BOUND, RISEN, profile
from fingerfit.fit.jobs import solve_missing
from fingerfit.report.profiles import profile_of


@pytest.fixture(scope="module")
def layers(tmp_path_factory):
    return compared(tmp_path_factory.mktemp("layers"), [0.4, 0.8])


def test_forces_are_proportional_to_a_single_modulus(tmp_path):
    """So the misfit is a parabola of it, not of its logarithm; the noise is a quarter of the forces."""
    comparison = compared(tmp_path, [0.4, 0.8], truth={"mu": 0.03}, noise=5.0)
    found = profile(comparison, "mu")
    share = 1.96 * 5.0 / np.linalg.norm(comparison.data.force)
    assert share > 0.3
    # between points the root of the misfit is taken for a line of the logarithm: 1 % found
    assert found.interval == pytest.approx((0.03 * (1 - share), 0.03 * (1 + share)), rel=0.03)
    mu = np.array([one["mu"] for one in found.guesses])
    assert found.rise == pytest.approx(((mu / 0.03 - 1) / share * 1.96) ** 2, abs=0.01)
    assert found.ends == (RISEN, RISEN)


def test_all_others_follow(layers):
    found, first = profile(layers, "mu_top"), FirstPass(layers)

    def misfit(log_mu, top):
        asked = layers.problem.ask({"mu_top": top, "mu_bottom": float(np.exp(log_mu))})
        solve_missing(layers.problem, [asked], 1)
        return float(np.sum(first.left(first.change(layers.read(asked))) ** 2))

    for n in (2, 5):
        top, bottom = found.guesses[n]["mu_top"], np.log(found.guesses[n]["mu_bottom"])
        best = minimize_scalar(misfit, bounds=(bottom - 0.1, bottom + 0.1), args=(top,), method="bounded")
        assert found.rise[n] == pytest.approx(best.fun, abs=0.02)
        assert bottom == pytest.approx(best.x, abs=2e-3)


def test_it_finds_the_other_minimum(layers):
    """Two glued layers of one height may change places: what one can be the other can, which no slope at 0.02 tells."""
    intervals = [profile(layers, name).interval for name in TRUTH]
    assert intervals[0] == pytest.approx(intervals[1], rel=0.03)
    assert intervals[1][1] > TRUTH["mu_top"]


def test_where_the_misfit_does_not_rise_it_is_not_identified(tmp_path):
    narrow = {**MU, "lower": 0.03, "upper": 0.12}
    found = profile(compared(tmp_path, [0.4, 0.8], bounds={"mu_top": narrow}), "mu_top")
    assert found.interval == (None, None)
    assert found.ends == (BOUND, BOUND)
    assert [found.guesses[n]["mu_top"] for n in (0, -1)] == pytest.approx([0.03, 0.12])
    assert found.sentence == (
        "mu_top is not identified below: up to 0.03 the misfit does not rise by 3.84 (bound);"
        " above: up to 0.12 the misfit does not rise by 3.84 (bound)"
    )


def test_what_cannot_be_profiled_is_one_line(monkeypatch, tmp_path):
    from fingerfit.start.draft import example

    monkeypatch.chdir(tmp_path)
    example(tmp_path / "mine", "phantom")
    config = tmp_path / "mine/config.yaml"
    with pytest.raises(
        InputError, match=r"config.yaml: constant: found mu_tip; expected one of mu_top, mu_middle, mu_b"
    ):
        profile_of(config, "mu_tip")
    with pytest.raises(StateError, match="no estimate; make it: fingerfit run --config"):
        profile_of(config, "mu_top")
