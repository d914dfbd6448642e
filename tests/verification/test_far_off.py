"""A force that is far off is said in the table, in the verdict and on the page by one measure and in one sentence."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from blocks import FIT, STUDY

from fingerfit.diagnosis.reservations import some_far_off
from fingerfit.diagnosis.verdict import Verdict
from fingerfit.fit.far_off import FAR_OFF, far_off, response_by_mesh, response_spread
from fingerfit.fit.minimum import minimum
from fingerfit.notebook import diagnose, fit
from fingerfit.report.findings import write_compare
from fingerfit.report.page.inputs import read_compare
from fingerfit.settings.config import load_settings

MESH = {"element": "CPE8R", "across": 3, "per_layer": 2, "grading": 1}
FINER = {**MESH, "across": 5, "per_layer": 4}
MU, FORCE_NOISE = 0.05, 0.05
ROWS = [(0.8, 0.0, 33.0, 0.0), (0.8, 1.6, 33.0, 12.0), (1.2, -1.6, 52.0, 40.0)]
"""Displacements down and along x, mm, and forces, N; the last force along x has the wrong sign."""


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("far_off")
    noise = {"force": FORCE_NOISE, "force_gain": 0.01, "displacement": 0.01}
    body = {"width": 12.0, "thickness": 70.0, "layers": [{"name": "gel", "height": 8.0}]}
    (folder / "study").mkdir()
    (folder / "study/study.yaml").write_text(yaml.safe_dump({**STUDY, "body": body, "noise": noise}))
    lines = [",".join(map(str, (n, *row))) for n, row in enumerate(ROWS, 1)]
    (folder / "study/steps.csv").write_text("\n".join(["step,displacement,displacement_x,force,force_x", *lines]))
    model = {
        "law": "neo_hooke", "material": {"poisson": 0.45}, "mesh": MESH, "refined": FINER,
        "parameters": {"mu": {"unit": "MPa", "start": MU, "lower": 0.01, "upper": 0.2}},
    }  # fmt: skip
    return fit(load_settings({"study": str(folder / "study"), "model": model, "fit": FIT}), folder / "results")


@pytest.fixture(scope="module")
def comparison(result):
    return diagnose(result).diagnosis.comparison


def test_the_measure_is_that_of_the_residual(result, comparison):
    """Noise, a common factor, the noise of what is prescribed, and the error of the mesh: none of them is nothing."""
    data, start = comparison.data, comparison.residual.value.size
    control, mesh = comparison.slope("control")[start:], comparison.mesh_signal[start:]
    spread = response_spread(data, control, mesh)
    assert spread == pytest.approx(comparison.score_test.spread, rel=1e-9)
    for without in (
        response_spread(replace(data, force_noise=0.0), control, mesh),
        response_spread(replace(data, force_gain=0.0), control, mesh),
        response_spread(data, 0 * control, mesh),
        response_spread(data, control, 0 * mesh),
    ):
        assert (without < 0.99 * spread).any()
    (own,) = response_by_mesh(result.problem, result.last, minimum(result.problem, result.last).base)
    assert own == pytest.approx(mesh, rel=1e-9)


def test_table_verdict_and_page_say_the_same(result, comparison, tmp_path):
    (told,) = (line for line in result.estimate["remarks"] if "standard deviations off" in line)
    assert told.startswith("force_x of step 3 is ")
    verdict = some_far_off(Verdict("unexplained", (), "unexplained", 0.0), comparison)
    assert told.partition("; ")[0] == verdict.sentence.removeprefix("unexplained; ")
    write_compare(comparison, tmp_path / "compare.npz")
    found = read_compare(tmp_path / "compare.npz")
    assert str(found.far_off) == told
    # the base is held, and the face of the indenter comes down as a whole
    base, face = (found.edge_moved[found.edge_moved[:, 0] == side, 1:] for side in (0, 1))
    assert np.all(np.diff(base[:, 0]) > 0) and np.array_equal(base[:, 0], face[:, 0])
    assert not base[:, 1:].any()
    assert face[:, 1:] == pytest.approx(np.broadcast_to(face[0, 1:], (len(face), 2)), rel=1e-9)
    assert face[0, 2] < -0.1


def test_it_is_said_from_ten_standard_deviations_on(comparison):
    data = comparison.data
    nothing = np.zeros(len(data.response[0]))
    spread = response_spread(data, nothing, nothing)
    for times, said in ((0.999 * FAR_OFF, False), (FAR_OFF * (1 + 1e-9), True)):
        assert bool(far_off(data, data.response[0] + times * spread, nothing, nothing)) == said
