"""A model that fails by its mesh alone, and one with an effect missing: half the element size tells them apart."""

import pytest
from scipy.special import chdtri
from small_body import DESCRIPTION, MESHES, compared, fitted, written

from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.mesh_errors import by_finer_mesh
from fingerfit.diagnosis.refit import explains
from fingerfit.diagnosis.worth import LARGEST
from fingerfit.settings.finer import HALVED, ONE_MORE

COARSE = {
    "mesh": {"element": "CPE8", "across": 2, "per_layer": 1, "grading": 1},
    "refined": {"element": "CPE8", "across": 3, "per_layer": 1, "grading": 1},
}
LINEAR = {"element": "CPE4H", "grading": 1}
FINE = {"element": "CPE8H", "across": 16, "per_layer": 8, "grading": 3}


@pytest.fixture(scope="module")
def nothing_hidden(tmp_path_factory):
    return written(tmp_path_factory.mktemp("nothing"), effects={}, mesh=FINE)


def fall_of(study, folder, meshes):
    problem, last, _, everything = fitted(study, folder, meshes)
    comparison, _ = compared(problem, last, everything, [])
    score_test = comparison.score_test
    return score_test, *by_finer_mesh(comparison, score_test)


def test_half_the_element_size_explains_what_a_coarse_mesh_leaves(nothing_hidden, tmp_path):
    score_test, fall, what, run = fall_of(nothing_hidden, tmp_path, COARSE)
    assert (what, run) == (HALVED, 1)
    assert not explains(score_test)
    assert fall > LARGEST * (score_test.misfit - score_test.freedom)


def test_linear_elements_are_held_against_quadratic_ones(nothing_hidden, tmp_path):
    coarse = {"mesh": {**LINEAR, "across": 2, "per_layer": 1}, "refined": {**LINEAR, "across": 4, "per_layer": 2}}
    _, fall, what, _ = fall_of(nothing_hidden, tmp_path, coarse)
    assert what == ONE_MORE
    assert fall > chdtri(1, 1e-6)  # beyond chance; 128, 156 and 152 with three seeds


def test_an_effect_is_not_taken_for_a_coarse_mesh(tmp_path):
    stiff = {"inclusion": {**DESCRIPTION["effects"]["inclusion"], "contrast": 2.0}}
    score_test, fall, *_ = fall_of(written(tmp_path, mesh=FINE, effects=stiff), tmp_path / "model", MESHES)
    assert not explains(score_test)
    assert fall < 0.5 * LARGEST * (score_test.misfit - score_test.freedom)


def test_the_verdict_tells_the_cure(nothing_hidden, tmp_path):
    problem, last, _, everything = fitted(nothing_hidden, tmp_path, COARSE)
    verdict = diagnose(problem, last, everything).verdict
    assert verdict.sentence.startswith("the mesh is too coarse: half the element size explains ")
    assert (verdict.kind, verdict.effects, verdict.family) == ("unexplained", (), "numerics")
