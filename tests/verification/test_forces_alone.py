"""Diagnosis of forces alone, on made-up tests in the format of examples/ecoflex."""

from pathlib import Path

import numpy as np
import pytest
from scripts import EXAMPLES, script_of
from searches import ends_alike_in_half
from seeds import generator

from fingerfit.diagnosis import batches
from fingerfit.diagnosis.diagnose import diagnose, errors
from fingerfit.diagnosis.ranges import excess_of
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings

SCRIPT = script_of("ecoflex")
REAL = Path(__file__).resolve().parents[3] / "shared/real/ecoflex_compression"
MU, ALPHA = 0.01, 2.0


def uniaxial(moved, alpha):
    """Force in N of an incompressible Ogden cylinder of 50 mm by 30 mm."""
    stretch = 1 - moved / 30
    return -2 * MU / alpha * (stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1)) * np.pi * 25**2


def several_tests(folder, law, seed=1):
    """Of an exponent, or of a function from displacement to force: six tests whose specimens differ by a factor of up to 3 %, and by 0.1 % in each force."""
    rng, moved = generator(seed), np.linspace(0, 15, 61)
    true, paths = law(moved) if callable(law) else uniaxial(moved, law), []
    for number, factor in enumerate(np.linspace(0.97, 1.03, 6)):
        force = factor * true * (1 + rng.normal(0, 0.001, moved.shape))
        rows = [f"{t},{d},{f}" for t, (d, f) in enumerate(zip(moved, force, strict=True))]
        paths.append(folder / f"{number}.csv")
        paths[-1].write_text("made up;\nTime (s),Compression (mm),Load (N)\n" + "\n".join(rows) + "\n")
    return paths


def settings_of(folder, config, law):
    """Settings of an example, for tests that are made up and written here."""
    SCRIPT.make_study(several_tests(folder, law), folder / "study")
    return load_settings(EXAMPLES / f"ecoflex/{config}.yaml").model_copy(update={"study": str(folder / "study")})


def diagnosed(folder, law):
    problem, everything = begin(settings_of(folder, "fixed", law), folder / "results")
    last, _ = run_fit(problem, 1)
    return diagnose(problem, last, everything)


def test_the_factor_between_specimens_is_taken_apart():
    shape = np.arange(1.0, 11.0)
    own = np.array([[0.01], [-0.01], [0.0]]) * (-1.0) ** np.arange(10)
    noise, factor = SCRIPT.spread_of(np.array([[0.95], [1.0], [1.05]]) * shape * (1 + own))
    # they are told apart to first order: what is left is of the size of their product, 0.05 x 0.01, of each
    assert factor == pytest.approx(0.05, rel=1e-3)
    assert noise / shape == pytest.approx(0.01, rel=1e-3)


def test_a_missing_exponent_is_named_from_forces_alone(tmp_path):
    found = diagnosed(tmp_path, ALPHA)
    fitted, held_out = errors(found.comparison)
    # 16 seeds: 9.1 and 7.9, with standard deviations of 1.2 and 0.8
    assert fitted > 2
    assert held_out > 2
    assert found.verdict.effects[0] == "stiffening"
    refit = found.refits["stiffening"]
    # 16 seeds: 1.998 with a standard deviation of 0.013; five of them
    assert refit.values["stiffening.shift"] + 1.4 == pytest.approx(ALPHA, abs=0.07)
    # noise is that of one test, and what is fitted is their mean: 1 / sqrt(6), 0.37 and 0.44 found, with 0.12 and 0.09
    assert refit.fitted < 1.0
    assert refit.held_out < 1.0
    # effects that only pictures or a finer mesh show are no candidates
    names = {one.candidate.effect.name for one in found.ranking}
    assert "plate_friction" in names
    assert not names & {"bias_field", "intensity_drift", "misregistration", "tilt", "coarse_mesh"}


def test_nothing_is_missing_where_nothing_is(tmp_path):
    found = diagnosed(tmp_path, 1.4)
    assert found.verdict.kind == "adequate"
    assert excess_of(found.comparison) == 0.0
    assert errors(found.comparison)[0] < 1.0  # 16 seeds: 0.41, 0.12


def test_least_squares_end_at_the_constants_of_the_simplex(tmp_path):
    settings, searches = settings_of(tmp_path, "config", ALPHA), {}
    for kind in ("independent", "least_squares"):
        stage = settings.fit.stages[-1].model_copy(update={"name": kind, "kind": kind})
        fit = settings.fit.model_copy(update={"stages": [settings.fit.stages[0], stage]})
        searches[kind] = settings.model_copy(update={"fit": fit})
    # from where they end, slopes lead to the same minimum of one score. Measured: within 1e-5
    ends_alike_in_half(searches["independent"], searches["least_squares"], tmp_path)


def test_what_is_missing_beside_another_effect_is_looked_for(tmp_path, monkeypatch):
    """Slopes that were answered to first order, and never simulated, are asked for again beside another anchor."""
    calls = []

    def looked_for(*given):
        calls.append(partner(*given))
        return calls[-1]

    partner = batches.partner_of
    monkeypatch.setattr(batches, "partner_of", looked_for)
    # two exponents: the coefficients of Yeoh's law explain part of it
    diagnosed(tmp_path, lambda moved: uniaxial(moved, 2.0) + 0.3 * uniaxial(moved, 12.0))
    ((found, _),) = calls
    assert found is not None


def test_refits_that_miss_their_minimum_take_nothing_from_others(tmp_path):
    """Fibres of this silicone end far from a minimum; a prediction by slopes from there has them absent at once."""
    files = sorted((REAL / "EF30_25T").glob("*.csv"))
    if not files:
        pytest.skip("the measured data (shared/real/ecoflex_compression) are not here")
    SCRIPT.make_study(files, tmp_path / "study")
    settings = load_settings(EXAMPLES / "ecoflex/fixed.yaml").model_copy(update={"study": str(tmp_path / "study")})
    problem, everything = begin(settings, tmp_path / "results")
    last, _ = run_fit(problem, 1)
    found = diagnose(problem, last, everything)
    assert found.verdict.effects[0] == "yeoh"
    assert found.refits["yeoh"].explained(found.score_test.misfit) > 0.75  # 0.91, examples/ecoflex/README.md
