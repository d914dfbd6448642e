"""What is missing beside another effect: by known slopes, and where a probe imitates both."""

from dataclasses import replace

import pytest
from small_body import DESCRIPTION, MESHES, SMALL, compared, config_of, fitted, written

from fingerfit.diagnosis.candidates import candidates, makes_sense
from fingerfit.diagnosis.comparison import anchor_of
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.joint import comparison_of
from fingerfit.diagnosis.ranking import best_places, rank_candidates
from fingerfit.diagnosis.second_pass import ended_of
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import finest
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.settings.config import load_settings

HIDDEN = {"base_slip": {"share": 0.81}, "tilt": {"slope": 0.04}}
TRIED = {*HIDDEN, "compressibility", "gradient", "sideways", "misregistration"}


@pytest.mark.slow
def test_the_partner_of_a_slip_is_found_by_known_slopes(tmp_path):
    problem, last, _, everything = fitted(written(tmp_path, effects=HIDDEN), tmp_path / "model", SMALL)
    tested = [one for one in candidates(problem, finest(problem, last).values)[0] if one.effect.name in TRIED]
    before, _ = compared(problem, last, everything, tested)
    slip = next(
        one for one in rank_candidates(before, before.score_test, tested) if one.candidate.effect.name == "base_slip"
    )
    ended = ended_of(before, replace(slip, refitted=None), 1)

    wider, last = ended.comparison.problem, ended.comparison.last
    left = [one for one in tested if makes_sense(one.effect, wider)]
    assert {one.effect.name for one in left} == TRIED - {"base_slip"}
    after = comparison_of(wider, last, everything)
    asked = set(wider.asked)
    known = best_places(rank_candidates(after, after.score_test, left, before.anchor))
    assert wider.asked == asked
    assert known[0].candidate.effect.name == "tilt"

    own = [one for one in candidates(wider, finest(wider, last).values)[0] if one.effect.name == "tilt"]
    solve_missing(wider, [anchor_of(wider, last), *(a for one in own for a in one.asked)], 1)
    (again,) = best_places(rank_candidates(after, after.score_test, own))
    # slopes of another model rank, the refit decides: only the order of size has to be right
    assert 0.5 < known[0].finding.fall / again.finding.fall < 2.0
    assert known[0].finding.size[0] * again.finding.size[0] > 0


@pytest.mark.slow
def test_of_two_lumps_one_is_named_and_no_field(tmp_path):
    """A field of stiffness comes nearer than one lump does; both lumps have fewer numbers than it."""
    lumps = {
        "inclusion": {"contrast": 1.5, "across": 0.3, "along": 0.7},
        "ellipse": {"contrast": 1.0, "across": 0.75, "along": 0.25, "radius": 1.3, "flat": 0.0, "slant": 0.0},
    }
    picture = {**DESCRIPTION["picture"], "pixels": 128, "noise": 0.01}
    config = config_of(written(tmp_path, effects=lumps, picture=picture), MESHES)
    tried = {"only": [*lumps, "stiffness_field", "gradient", "base_slip"]}
    problem, everything = begin(load_settings({**config, "diagnosis": tried}), tmp_path / "model")
    last, _ = run_fit(problem, 1)
    found = diagnose(problem, last, everything)
    assert found.ranking[0].candidate.effect.name == "stiffness_field"
    assert found.verdict.kind == "missing"
    (named,) = found.verdict.effects
    assert named in lumps
    assert "it explains the misfit beyond the noise, alone" in found.verdict.sentence
