"""Priors: one more datum, in the fit, in the interval and in the diagnosis, against closed forms."""

import copy
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY
from one_layer import TWO_TESTS
from scipy.ndimage import gaussian_filter, shift
from seeds import generator

from fingerfit.core.errors import InputError
from fingerfit.diagnosis.first_pass import FirstPass
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.score_tests import Known, ScoreTest
from fingerfit.fit.check import check_data
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.priors import Priors, weigh
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.imaging.similarity import nmi, nmi_noise
from fingerfit.model.parameters import Parameter
from fingerfit.settings.config import load_settings

MU = MODEL["parameters"]["mu"]
TWO = (
    Parameter("mu_a", "MPa", 1e-3, 1.0, 0.1, prior=(0.2, 0.02)),
    Parameter("poisson", "1", 0.3, 0.5, 0.4, log=False, prior=(0.45, 0.02)),
    Parameter("mu_b", "MPa", 1e-3, 1.0, 0.1),
)
DESCENT = {"stages": [{"name": "descent", "kind": "least_squares"}]}


def fitted(folder, parameters, material=None, study=STUDY, **how):
    """Fit of a block of two layers to two forces, or of another study."""
    (folder / "study").mkdir(exist_ok=True)
    (folder / "study/study.yaml").write_text(yaml.safe_dump(study))
    (folder / "study/steps.csv").write_text(STEPS)
    model = {**copy.deepcopy(MODEL), "parameters": parameters}
    model["material"] |= material or {}
    settings = {"study": str(folder / "study"), "model": model, "fit": {**FIT, "replicates": 40, **how}}
    problem, everything = begin(load_settings(settings), folder / "m")
    return problem, run_fit(problem, 1)[0], everything


def estimate(folder, *parts, **how):
    return estimate_of(*fitted(folder, *parts, **how)[:2])


def test_a_deviation_is_a_share_of_the_value_in_the_logarithm_and_else_of_the_scale():
    priors = Priors.of(TWO)
    away = {"mu_a": 0.2 * np.exp(0.2), "poisson": 0.41, "mu_b": 0.5}
    assert priors.left(away) == pytest.approx([-2.0, 2.0])
    assert not Priors.of(TWO[2:])


def test_weighed_as_by_the_normal_equations():
    """Of the third constant there is no prior; a fourth direction that nobody sees stays where it is."""
    rng, priors = generator(3), Priors.of(TWO)
    shifts = rng.normal(size=(200, 3)) @ (rng.normal(size=(3, 3)) * 0.05)
    data, move, left = np.cov(shifts, rowvar=False), np.array([0.01, -0.02, 0.03]), np.array([0.5, -1.0])
    found = weigh(priors, left, move, shifts, None, np.eye(3))
    before = np.diag([0.1, 0.1, np.inf])
    information = np.linalg.inv(data) + np.diag(np.diag(before) ** -2.0)
    at = np.array([0.05, -0.1, 0.0])  # of the priors, from the base
    expected = np.linalg.solve(information, np.linalg.solve(data, move) + np.diag(before) ** -2.0 * at)
    assert found.shift == pytest.approx(expected, rel=1e-6)
    whole = found.gain @ data @ found.gain.T + found.known
    assert whole == pytest.approx(np.linalg.inv(information), rel=1e-6)
    blind = weigh(Priors.of(TWO[1:]), left[1:], move[1:], shifts[:, 1:] * [1, 0], None, np.eye(2)[:, :1])
    assert blind.shift[1] == pytest.approx(0.0, abs=1e-12)


def test_the_search_knows_it(tmp_path):
    priors = {"mu": {**MU, "prior": {"value": 0.2, "deviation": 0.02}}}
    problem, last, _ = fitted(tmp_path, priors, **DESCENT)
    first = last.history[0]
    off = np.log(0.2 / first["values"]["mu"]) / 0.1
    assert first["match"]["left"][-1] == pytest.approx(off)
    assert len({len(first["match"][name]) for name in ("read", "left", "noise")}) == 1
    asked = problem.ask(first["values"])
    assert first["score"] - problem.fit_to_data(problem.prediction(asked)) == pytest.approx(off**2 / 2)


@pytest.mark.parametrize("study", [STUDY, TWO_TESTS], ids=["one test", "two tests"])
def test_a_prior_as_good_as_the_data_meets_them_half_way(tmp_path, study):
    alone = estimate(tmp_path, {"mu": MU}, study=study)["parameters"]["mu"]
    share = alone["standard_error"] / alone["value"]
    centre = alone["value"] * np.exp(2 * share)
    prior = {"value": centre, "deviation": share * centre}
    for how in ({}, DESCENT):
        found = estimate(tmp_path, {"mu": {**MU, "prior": prior}}, study=study, **how)["parameters"]["mu"]
        # a move by slopes errs by about half its square: of 0.5 %, 0.4 % of the standard error; 1 % found at most
        assert np.log(found["value"] / alone["value"]) / share == pytest.approx(1.0, abs=0.03)
        assert found["standard_error"] / found["value"] == pytest.approx(share / np.sqrt(2), rel=0.01)
        assert found["prior"] == [centre, share * centre]


@pytest.mark.parametrize("how", [{}, DESCENT])
def test_a_prior_tells_what_the_data_do_not(tmp_path, how):
    """Forces on two layers in a row say nothing of one of them."""
    both = {"mu_top": {**MU, "prior": {"value": 0.03, "deviation": 0.003}}, "mu_bottom": MU}
    found = estimate(tmp_path, both, **how)
    top, bottom = found["parameters"]["mu_top"], found["parameters"]["mu_bottom"]
    assert top["value"] == pytest.approx(0.03, rel=2e-3)
    assert top["standard_error"] == pytest.approx(0.003, rel=0.02)
    given = estimate(tmp_path, {"mu_bottom": MU}, {"mu_top": top["value"]}, **how)["parameters"]["mu_bottom"]
    # by slopes where the fit ended, up to 12 % from here; 0.02 % and 0.9 % found
    assert bottom["value"] == pytest.approx(given["value"], rel=0.02)
    assert found["correlation"]["matrix"][0][1] < -0.9
    # as far as another top layer moves the bottom one
    softer = estimate(tmp_path, {"mu_bottom": MU}, {"mu_top": top["value"] * 0.9}, **how)["parameters"]["mu_bottom"]
    expected = np.log(softer["value"] / given["value"]) / np.log(1 / 0.9) * 0.1
    assert bottom["standard_error"] / bottom["value"] == pytest.approx(expected, rel=0.3)
    assert any(line.startswith("mu_top is known from its prior") for line in found["remarks"])


def test_a_prior_that_the_data_contradict_is_told_by_the_estimate_and_by_the_misfit(tmp_path):
    problem, last, everything = fitted(tmp_path, {"mu": {**MU, "prior": {"value": 0.2, "deviation": 0.01}}})
    remarks = estimate_of(problem, last)["remarks"]
    assert any("standard deviations off its prior: the data contradict it" in line for line in remarks)
    comparison = comparison_of(problem, last, everything)
    alone = ScoreTest(comparison.vector, comparison.covariance, comparison.own(), comparison.nuisance())
    assert comparison.score_test.misfit > alone.misfit + 100
    assert comparison.score_test.freedom == alone.freedom + 1
    # the first pass, which fits the constants again, finds the same minimum
    again = FirstPass(comparison).refit(problem, comparison.base.values)
    assert again.misfit == pytest.approx(comparison.score_test.misfit, rel=0.01)
    assert again.values["mu"] == pytest.approx(estimate_of(problem, last)["parameters"]["mu"]["value"], rel=0.01)


def test_priors_are_values_like_others():
    rng = generator(5)
    own, effect, residual, nuisance = (rng.normal(size=shape) for shape in ((30, 3), (30, 2), 30, (30, 2)))
    priors = Priors.of(TWO)
    left = np.array([0.7, -1.2])
    found = ScoreTest(residual, np.eye(30), own, nuisance, known=Known(left, priors.rows, np.zeros(3, dtype=bool)))
    # the same as two values more, whose noise is 1 and which no effect moves
    blind = np.zeros((2, 2))
    whole = np.concatenate
    other = ScoreTest(whole([residual, left]), np.eye(32), whole([own, priors.rows]), whole([nuisance, blind]))
    assert found.misfit == pytest.approx(other.misfit)
    assert found.freedom == other.freedom == 29
    ends = np.full(2, -np.inf), np.full(2, np.inf)
    tested = found.test(effect, *ends), other.test(whole([effect, blind]), *ends)
    assert tested[0].fall == pytest.approx(tested[1].fall)
    assert tested[0].size == pytest.approx(tested[1].size)


def test_the_unit_of_a_mutual_information_is_of_the_size_of_its_noise():
    """A shift of a picture: variance of the score's slope over its curvature, both pictures noisy and smoothed."""
    rng, step = generator(8), 0.2
    texture = gaussian_filter(rng.normal(size=(96, 96)), 3.0)
    texture = 0.5 + 0.15 * texture / texture.std()
    slopes, curvatures = [], []
    for _ in range(40):
        a, b = (gaussian_filter(texture + rng.normal(0, 0.03, texture.shape), 1.0) for _ in range(2))
        moved = (shift(b, (0, d), order=3, mode="nearest") for d in (-step, 0.0, step))
        low, middle, high = (-nmi(a, one, 32, limits=(0.0, 1.0)) for one in moved)
        slopes.append((high - low) / (2 * step))
        curvatures.append((high - 2 * middle + low) / step**2)
    measured = np.var(slopes) / np.mean(curvatures)
    # measured: 4.6 times here, 0.5 to 3 times in the directions of the phantom; of another size it would be 100 times
    assert 1.0 < nmi_noise(a[None], 1.0, 32) / measured < 15.0


def test_a_prior_beside_a_squared_difference_needs_the_noise_of_the_pictures():
    fit, model = SimpleNamespace(score="ssd"), SimpleNamespace(parameters={"mu": SimpleNamespace(prior=(0.1, 0.01))})
    pictures = SimpleNamespace(measured=np.ones((1, 2, 2)), picture_noise=0.0)
    with pytest.raises(
        InputError, match=r"study.yaml: pictures.noise: found 0, as estimated; expected a number above 0"
    ):
        check_data(SimpleNamespace(fit=fit, model=model), SimpleNamespace(path="study.yaml"), pictures)
    model.parameters["mu"].prior = None
    check_data(SimpleNamespace(fit=fit, model=model), SimpleNamespace(path="study.yaml"), pictures)
