"""Which effects are candidates: those that are another model than all others."""

import pytest
import yaml
from blocks import FIT, MODEL, STUDY

from fingerfit.core.files import write_json
from fingerfit.diagnosis.candidates import candidates
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings

STEPS = "step,displacement,force\n1,0.4,10.0\n2,0.8,21.0\n3,1.2,32.0\n"
ALPHA = {"unit": "1", "start": 2.0, "lower": 1.2, "upper": 20.0}


@pytest.mark.parametrize("layers", [1, 2])
@pytest.mark.parametrize("fitted", [False, True])
def test_one_layer_that_stiffens_is_another_model_where_there_are_several(tmp_path, layers, fitted):
    names = ["top", "bottom"][:layers]
    body = {"width": 12, "thickness": 70, "layers": [{"name": name, "height": 4.0} for name in names]}
    write_json(tmp_path / "study/study.yaml", {**STUDY, "body": body})
    (tmp_path / "study/steps.csv").write_text(STEPS)
    parameters = {**MODEL["parameters"], **({"alpha": ALPHA} if fitted else {})}
    material = {key: value for key, value in MODEL["material"].items() if not (fitted and key == "alpha")}
    model = {**MODEL, "parameters": parameters, "material": material}
    config = {"study": str(tmp_path / "study"), "solver": "builtin", "model": model, "fit": FIT}
    (tmp_path / "config.yaml").write_text(yaml.safe_dump({**config, "results": str(tmp_path / "results")}))
    problem, _ = begin(load_settings(tmp_path / "config.yaml"), tmp_path / "model")
    values = {one.name: one.start for one in problem.settings.parameters()}
    found = [(one.effect.name, *one.place.values()) for one in candidates(problem, values)[0]]
    one_layer = [one for one in found if one[0] == "layer_stiffening"]
    assert one_layer == ([("layer_stiffening", 1), ("layer_stiffening", 2)] if layers == 2 else [])
    assert (("stiffening",) in found) != fitted
    assert len(found) == len(set(found))
