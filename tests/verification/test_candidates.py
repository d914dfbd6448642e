"""Which effects are candidates: those that are another model than all others."""

import pytest
import yaml
from blocks import FIT, MODEL, STUDY

from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import write_json
from fingerfit.diagnosis.candidates import candidates, left_out, untestable
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings

STEPS = "step,displacement,force\n1,0.4,10.0\n2,0.8,21.0\n3,1.2,32.0\n"
ALPHA = {"unit": "1", "start": 2.0, "lower": 1.2, "upper": 20.0}


def problem_of(folder, layers=1, **keys):
    """A fit of forces alone of so many layers, with other keys of config.yaml; nothing is solved."""
    names = ["top", "bottom"][:layers]
    body = {"width": 12, "thickness": 70, "layers": [{"name": name, "height": 4.0} for name in names]}
    write_json(folder / "study/study.yaml", {**STUDY, "body": body})
    (folder / "study/steps.csv").write_text(STEPS)
    config = {"study": str(folder / "study"), "solver": "builtin", "model": MODEL, "fit": FIT}
    (folder / "config.yaml").write_text(yaml.safe_dump({**config, "results": str(folder / "results"), **keys}))
    return begin(load_settings(folder / "config.yaml"), folder / "model")[0]


def named(problem):
    values = {one.name: one.start for one in problem.settings.parameters()}
    return [(one.effect.name, *one.place.values()) for one in candidates(problem, values)[0]]


@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("fitted", [False, True])
def test_one_layer_that_stiffens_is_another_model_where_there_are_several(tmp_path, layers, fitted):
    parameters = {**MODEL["parameters"], **({"alpha": ALPHA} if fitted else {})}
    material = {key: value for key, value in MODEL["material"].items() if not (fitted and key == "alpha")}
    model = {**MODEL, "parameters": parameters, "material": material}
    found = named(problem_of(tmp_path, layers, model=model))
    one_layer = [one for one in found if one[0] == "layer_stiffening"]
    assert one_layer == ([("layer_stiffening", 1), ("layer_stiffening", 2)] if layers == 2 else [])
    assert (("stiffening",) in found) != fitted
    assert len(found) == len(set(found))


@pytest.mark.parametrize(("layers", "stiffening_of", "softening_of"), [(1, None, 1), (2, 2, 3)])
def test_places_that_no_fit_can_move_are_counted(tmp_path, layers, stiffening_of, softening_of):
    """A law of one layer may be that of either layer; softening of all, too. Its rate is fitted, and counts as that."""
    problem = problem_of(tmp_path, layers)
    values = {one.name: one.start for one in problem.settings.parameters()}
    found = candidates(problem, values)[0]
    choices = {one.effect.name: one.choices for one in found}
    assert choices.get("layer_stiffening") == stiffening_of
    assert choices["softening"] == softening_of < len([one for one in found if one.effect.name == "softening"])
    assert choices["compressibility"] == 1


@pytest.mark.parametrize("layers", [1, 2])
def test_no_layer_is_tried_that_the_body_does_not_have(tmp_path, layers):
    """Fibres there left a comment in the deck, and relaxation other steps: two candidates that are none."""
    problem = problem_of(tmp_path, layers)
    values = {one.name: one.start for one in problem.settings.parameters()}
    places = [one.place.get(one.effect.key("layer")) for one in candidates(problem, values)[0]]
    assert max(number for number in places if number is not None) == layers


def test_what_config_yaml_leaves_out_is_not_tried(tmp_path):
    every = {name for name, *_ in named(problem_of(tmp_path))}
    assert {"compressibility", "base_slip"} < every
    without = problem_of(tmp_path, diagnosis={"without": ["base_slip"]})
    assert {name for name, *_ in named(without)} == every - {"base_slip"}
    assert left_out(without) == [without.effects["base_slip"].title]
    # a tilt needs pictures or points
    only = problem_of(tmp_path, diagnosis={"only": ["compressibility", "tilt"]})
    assert {name for name, *_ in named(only)} == {"compressibility"}
    assert len(left_out(only)) == len(only.effects) - 2
    assert list(untestable(only)) == [only.effects["tilt"].title]


@pytest.mark.parametrize("key", ["only", "without"])
def test_the_names_are_those_of_effects(tmp_path, key):
    with pytest.raises(
        FingerfitError, match=rf"config.yaml: diagnosis.{key}.tlit: found an unknown key; expected tilt"
    ):
        problem_of(tmp_path, diagnosis={key: ["tlit"]})
