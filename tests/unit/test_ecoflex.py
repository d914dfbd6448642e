"""The example with other people's compression tests; the data themselves are not part of the project."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scripts import script_of

from fingerfit.core.errors import InputError
from fingerfit.study.reader import load_study

SCRIPT = script_of("ecoflex")
DATA = Path(__file__).resolve().parents[3] / "shared/real/ecoflex_compression/EF10_50T"


def test_wrong_columns_are_told(tmp_path):
    (tmp_path / "a.csv").write_text("Time (s),Load (N)\n0,1\n")
    with pytest.raises(InputError, match="Compression"):
        SCRIPT.read_test(tmp_path / "a.csv")


def test_a_study_from_the_authors_files(tmp_path):
    if not DATA.is_dir():
        pytest.skip("the measured data (shared/real/ecoflex_compression) are not here")
    SCRIPT.make_study(sorted(DATA.glob("*.csv")), tmp_path)
    study = load_study(tmp_path)
    assert len(study.steps) == 20
    assert study.steps[-1].displacement == pytest.approx(20.0, abs=0.01)
    moved = np.array([step.displacement for step in study.steps])
    force = np.array([step.force for step in study.steps])

    def uniaxial(u, mu, alpha):
        """Incompressible Ogden: nominal stress 2 mu / alpha (l^(alpha-1) - l^(-alpha/2-1)), MPa, on the area."""
        stretch = 1 - u / 30
        stress = 2 * mu / alpha * (stretch ** (alpha - 1) - stretch ** (-alpha / 2 - 1))
        return -stress * np.pi * 25**2

    noise = np.array([step.force_noise for step in study.steps])
    assert 0.001 < (noise / force).min() < (noise / force).max() < 0.03
    assert study.noise.force_gain == pytest.approx(0.034, abs=0.002)
    # the finite element fits of examples/ecoflex/README.md, with poisson 0.499: by those weights to the odd steps, and without weights
    for chosen, weights, expected in (
        (slice(0, None, 2), noise, (0.00445, 4.66)),
        (slice(None), None, (0.00403, 5.12)),
    ):
        weights = None if weights is None else weights[chosen]
        (mu, alpha), _ = curve_fit(uniaxial, moved[chosen], force[chosen], p0=(0.004, 4.0), sigma=weights)
        assert (mu, alpha) == pytest.approx(expected, rel=0.02)
