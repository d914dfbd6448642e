"""The laws that a config names: equal where one is a case of another, alike at small strain, and checked."""

import re
from itertools import pairwise

import pytest
import yaml
from small_body import config_of, written

from fingerfit.core.errors import FingerfitError
from fingerfit.diagnosis.candidates import candidates
from fingerfit.fit.check import check_against_study, check_effects
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin
from fingerfit.model.laws import LAWS
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.config import load_settings

MESH = {"mesh": {"element": "CPE4", "across": 2, "per_layer": 1}, "refined": None}
POISSON = {"poisson": 0.45}
CONSTANTS = {
    "ogden": {"alpha": 5.0},
    "ogden2": {"alpha": 5.0, "share": 0.4, "alpha2": -3.0},
    "neo_hooke": {},
    "mooney_rivlin": {"share": 0.3},
    "yeoh": {"c2": 0.5, "c3": 0.2},
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return written(tmp_path_factory.mktemp("study"), displacement=[0.001, 3.0], time=[1, 2], effects={},
                   picture={"pixels": 32, "side": 19, "texture": 0.15, "correlation": 0.6, "noise": 0.02, "pictured": [2]},
                   noise={"force": 1e-6, "displacement": 1e-6})  # fmt: skip


def config(study, law, **material):
    found = config_of(study, MESH)
    found["model"] |= {"law": law, "material": {**POISSON, **material}}
    del found["model"]["refined"], found["fit"]["steps"]
    return found


def moved(study, folder, law, **material):
    """How far the indenter goes under both forces, mm."""
    problem, _ = begin(load_settings(config(study, law, **material)), folder)
    asked = problem.ask({"mu_top": 0.03, "mu_bottom": 0.06})
    solve_missing(problem, [asked], 1)
    return problem.prediction(asked).response


def test_every_law_has_the_modulus_and_poisson_ratio_it_was_given(study, tmp_path):
    """Under a ten-thousandth of strain laws differ by about as much; at a quarter by far more."""
    found = {law: moved(study, tmp_path / law, law, **CONSTANTS[law]) for law in LAWS}
    assert found.keys() == CONSTANTS.keys()
    small = [response[0] for response in found.values()]
    assert small == pytest.approx([small[0]] * len(small), rel=1e-3)
    large = sorted(response[1] for response in found.values())
    assert all(more > 1.005 * less for less, more in pairwise(large))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("ogden", {"alpha": 2.0}), ("neo_hooke", {})),
        (("mooney_rivlin", {"share": 0.0}), ("neo_hooke", {})),
        (("yeoh", {"c2": 0.0, "c3": 0.0}), ("neo_hooke", {})),
        (("ogden2", {"alpha": 2.0, "share": 0.3, "alpha2": -2.0}), ("mooney_rivlin", {"share": 0.3})),
        (("ogden2", {"alpha": 5.0, "share": 0.0, "alpha2": -2.0}), ("ogden", {"alpha": 5.0})),
    ],
)
def test_cases_of_each_other_give_the_same(study, tmp_path, one, other):
    first, second = (moved(study, tmp_path / str(n), law, **material) for n, (law, material) in enumerate((one, other)))
    assert second == pytest.approx(first, rel=1e-6)


@pytest.mark.parametrize(
    ("law", "material", "words"),
    [
        ("yeoh", {"c2": 0.5, "c3": 0.2, "alpha": 1.4}, r"model.material.alpha: found .*; expected .*poisson"),
        ("mooney_rivlin", {"share": 1.0}, r"model.material.share: found 1; expected from 0 to below 1"),
        ("ogden2", {"alpha": 5.0, "share": 0.4, "alpha2": 0.0}, r"model.material.alpha2: found 0; expected not 0"),
        ("mooney", {}, r"model.law: found mooney; expected .*mooney_rivlin"),
    ],
)
def test_what_a_law_does_not_have_is_one_line(study, law, material, words):
    with pytest.raises(FingerfitError, match=words):
        load_settings(config(study, law, **material))


def test_a_constant_that_is_left_out_is_asked_for(study):
    settings = load_settings(config(study, "yeoh", c2=0.5))
    with pytest.raises(
        FingerfitError, match=r"model.material.c3: found nothing; expected a value of c3 for the layers"
    ):
        check_against_study(settings, settings.read_study())


def test_constants_of_a_law_are_fitted_like_any_other(study):
    found = config(study, "yeoh", c3=0.0)
    found["model"]["parameters"]["c2"] = {"unit": "1", "start": 0.3, "lower": 0.0, "upper": 2.0, "log": False}
    settings = load_settings(found)
    check_against_study(settings, settings.read_study())
    assert [p.name for p in settings.parameters()] == ["mu_top", "mu_bottom", "c2"]
    found["model"]["parameters"]["c2"]["unit"] = "MPa"
    with pytest.raises(FingerfitError, match=re.escape("model.parameters.c2.unit: found MPa; expected 1")):
        load_settings(found)


def test_effects_on_ogden_s_law_are_not_tested_with_another_one(study, tmp_path):
    problem, _ = begin(load_settings(config(study, "yeoh", c2=0.1, c3=0.0)), tmp_path)
    tested = {one.effect.name for one in candidates(problem, {"mu_top": 0.03, "mu_bottom": 0.06})[0]}
    assert tested >= {"tilt", "compressibility", "fibres"}
    assert not tested & {"stiffening", "second_term", "material_probe"}
    wrong = yaml.safe_load(yaml.safe_dump(config(study, "yeoh", c2=0.1, c3=0.0)))
    wrong["model"]["effects"] = {"stiffening": {}}
    settings = load_settings(wrong)
    words = r"model.effects.stiffening: found stiffening, which changes what law yeoh does not have; expected"
    with pytest.raises(FingerfitError, match=words):
        check_effects(settings, problem.study, problem.meshes["search"])


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"swollen": {"volume": 0.02, "layer": 7}}, "swollen.layer: found 7; expected 1 to 2, or 0 for all layers"),
        ({"fibres": {"stiffness": 1.0, "layer": 3}}, "fibres.layer: found 3; expected 1 to 2, or 0 for all layers"),
        (
            {"swelling": {"volume": 0.01}, "swollen": {"volume": 0.02, "layer": 2}},
            "swollen.layer: found 2; expected 0, all layers, beside effect swelling",
        ),
    ],
    ids=["no such layer", "no such layer for a law", "beside another one that swells"],
)
def test_a_layer_that_an_effect_cannot_be_in_is_one_line(study, effects, message):
    wrong = yaml.safe_load(yaml.safe_dump(config(study, "ogden")))
    wrong["model"]["effects"] = effects
    settings = load_settings(wrong)
    whole = settings.read_study()
    with pytest.raises(FingerfitError) as found:
        check_effects(settings, whole, make_mesh(whole, settings.model.mesh), "mine.yaml")
    assert str(found.value) == f"mine.yaml: model.effects.{message}"
