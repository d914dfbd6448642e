"""Slip beyond a limit of the shear, hidden in a small body: the diagnosis tells it from slip in proportion to the shear."""

import pytest
from small_body import SMALL, fitted, written

from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.fit.problem import InverseProblem

KNOWN = ("base_slip", "indenter_slip", "base_friction", "indenter_friction", "tilt")


@pytest.mark.parametrize("name", [pytest.param("base_friction", marks=pytest.mark.slow), "indenter_friction"])
def test_it_is_named_with_its_limit(tmp_path, name):
    """By the slopes at a share of 0 alone slip in proportion explains more; the moves of the first pass find the limit."""
    study = written(tmp_path, effects={name: {"share": 0.5}})
    problem, last, _, everything = fitted(study, tmp_path / "model", SMALL)
    few = InverseProblem(problem.settings, problem.data, problem.mesh_files, problem.sims)
    few.__dict__["effects"] = {known: problem.effects[known] for known in KNOWN}
    found = diagnose(few, last, everything)
    assert (found.verdict.kind, found.verdict.effects) == ("missing", (name,))
    # found 0.50 and 0.52, with noise
    assert found.refits[name].values[f"{name}.share"] == pytest.approx(0.5, abs=0.05)
