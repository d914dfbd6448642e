"""config.yaml: what is refused and how it is told, defaults, the schema."""

import copy
from pathlib import Path

import pytest
import yaml

from fingerfit.core.errors import FingerfitError, Problems
from fingerfit.core.keys import read_yaml
from fingerfit.provenance.stages import check_model
from fingerfit.settings.config import load_settings
from fingerfit.settings.runs import Config, describe, load_runs, schema

ROOT = Path(__file__).resolve().parents[2]
CONFIG = read_yaml(ROOT / "config.yaml")


def changed(path, value):
    config = copy.deepcopy(CONFIG)
    at = config
    *parents, last = path.split(".")
    for parent in parents:
        at = at[int(parent)] if parent.isdigit() else at[parent]
    at[last] = value
    return config


def test_configs_that_are_shipped_are_right(monkeypatch):
    """All of them, by what they contain: a study's own files name no model and no fit."""
    monkeypatch.chdir(ROOT)
    files = [path for folder in ("studies", "examples") for path in Path(folder).rglob("*.yaml")]
    found = [path for path in (Path("config.yaml"), *files) if {"model", "fit"} & set(read_yaml(path))]
    assert {path.parent.name for path in found} >= {"", "ecoflex", "fingertip", "fingertip-coarse", "phantom", "skin"}
    for path in found:
        for settings in load_runs(read_yaml(path), path):
            # the other studies are made from what has to be downloaded, or take minutes to make
            if settings.study == "studies/phantom":
                check_model(settings, path)


def test_what_is_left_out_has_its_default():
    config = copy.deepcopy(CONFIG)
    for key in ("smooth", "crop", "bins", "batch"):
        config["fit"].pop(key, None)
    del config["solver"]
    settings = load_settings(config)
    assert (settings.solver, settings.fit.bins, settings.fit.crop, settings.fit.smooth) == ("builtin", 32, 0.3, 1.0)


def test_parameters_keep_the_order_of_the_file():
    names = [p.name for p in load_settings(CONFIG).parameters()]
    assert names == ["mu_top", "mu_middle", "mu_bottom"]
    turned = {name: CONFIG["model"]["parameters"][name] for name in reversed(names)}
    assert [p.name for p in load_settings(changed("model.parameters", turned)).parameters()] == names[::-1]


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        ("studdy", 1, "studdy: found an unknown key; expected study (did you mean that?)"),
        ("model.mesh.acros", 3, "model.mesh.acros: found an unknown key; expected across (did you mean that?)"),
        (
            "model.refined.gradin",
            3,
            "model.refined.gradin: found an unknown key; expected grading (did you mean that?)",
        ),
        ("fit.stages.1.tolX", 3, "fit.stages.1.tolX: found an unknown key; expected tolx (did you mean that?)"),
        ("fit.qqq", 3, "fit.qqq: found an unknown key; expected one of score, steps, smooth"),
        ("model.parameters.mu_top.strat", 1, "strat: found an unknown key; expected start (did you mean that?)"),
        ("model.parameters.mu_top.unit", "1", "model.parameters.mu_top.unit: found 1; expected MPa"),
        ("model.parameters.mu_top.start", 2.0, "found start 2; expected 0.001 to 1, the bounds"),
        ("model.parameters.mu_top.lower", 0.0, "found 0.0; expected above 0, for a search in the logarithm"),
        ("model.parameters.mu_top.prior", 0.03, "model.parameters.mu_top.prior: found 0.03; expected"),
        ("model.parameters.mu_top.prior", {"value": 0.03}, "mu_top.prior.deviation: found nothing; expected"),
        (
            "model.parameters.mu_top.prior",
            {"value": 0.03, "deviation": 0},
            "model.parameters.mu_top.prior.deviation: found 0; expected greater than 0",
        ),
        (
            "model.parameters.mu_top.prior",
            {"value": 3, "deviation": 1},
            "model.parameters.mu_top.prior.value: found 3; expected 0.001 to 1, the bounds",
        ),
        ("model.material.poisson", 0.5, "model.material.poisson: found 0.5; expected between -1 and 0.5"),
        ("model.material.alpha", 0, "model.material.alpha: found 0; expected not 0"),
        ("model.material.alpha", 1e-9, "model.material.alpha: found 1e-09; expected not 0: 0.00012 to 709"),
        ("model.material.alpha", -710.0, "model.material.alpha: found -710; expected not 0: 0.00012 to 709, or as far"),
        ("model.parameters.mu_top.upper", 1e14, "mu_top.upper: found 1e+14 MPa; expected at most 4.5e+12 MPa"),
        ("model.mesh.grading", 1e5, "model.mesh.grading: found 100000.0; expected less than or equal to 65536"),
        ("fit.stages.1.step", 40.0, "fit.stages.1.step: found 40.0; expected less than or equal to 37"),
        ("study", "x" * 256, "study: found a name of 256 bytes; expected at most 255, as files have"),
        ("model.material.nu", 0.4, "model.material.nu: found an unknown key; expected one of mu, alpha, poisson"),
        ("model.mesh.element", "CPE9", "model.mesh.element: found CPE9; expected"),
        ("fit.bins", 2, "fit.bins: found 2; expected greater than or equal to 4"),
        ("fit.bins", True, "fit.bins: found True; expected a value that is not true or false"),
        ("fit.steps", [True], "fit.steps: found [True]; expected a value that is not true or false"),
        ("model.material.mu", True, "model.material: found {"),
        ("fit.smooth", float("nan"), "fit.smooth: found nan; expected a finite number"),
        ("fit.stages.1.name", "grid", "fit.stages: found grid twice; expected a name of its own for each stage"),
        ("fit.stages.0.tied", "alpha", "fit.stages.0.tied: found alpha; expected mu or a list of mu_top, mu_middle"),
        ("fit.stages.1.tied", ["mu_top", "mu_tip"], "fit.stages.1.tied: found mu_tip; expected mu or a list of mu_top"),
        ("fit.stages.1.tied", [], "fit.stages.1.tied: found []; expected mu or a list of mu_top"),
        ("fit.stages.1.tolx_in", "MPa", "fit.stages.1.tolx_in: found MPa; expected 'share' or 'unit'"),
        ("study", "my study", "study: found 'my study'; expected letters, digits and . / _ + - only"),
        ("solver", "calculx", "did you mean calculix?"),
    ],
)
def test_a_mistake_is_one_line(path, value, says):
    with pytest.raises(Problems) as raised:
        load_settings(changed(path, value), "mine.yaml")
    assert len(raised.value.problems) == 1
    assert str(raised.value).startswith("mine.yaml: ")
    assert says in str(raised.value)


def of_layers(top, bottom, **stage):
    """Settings with two constants, one stage."""
    config = copy.deepcopy(CONFIG)
    config["model"]["parameters"] = {"mu_top": top, "mu_bottom": bottom}
    config["model"]["material"]["mu_middle"] = 0.03
    config["fit"]["stages"] = [{"name": "s", **stage}]
    return config


MU = {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}


@pytest.mark.parametrize("kind", ["grid", "equal"])
@pytest.mark.parametrize(
    ("other", "says"),
    [
        ({"lower": 2.0, "upper": 5.0, "start": 3.0}, "found mu_top, mu_bottom with bounds that do not overlap"),
        ({"lower": 1.0, "upper": 5.0, "start": 3.0}, "found mu_top, mu_bottom with bounds that do not overlap"),
        ({"log": False}, "found mu_top, mu_bottom with several; expected one unit and one log for all of them"),
    ],
)
def test_parameters_that_cannot_be_alike_are_refused(kind, other, says):
    config = of_layers(MU, {**MU, **other}, kind=kind)
    with pytest.raises(Problems) as raised:
        load_settings(config)
    assert len(raised.value.problems) == 1
    assert f"fit.stages.0.tied: {says}" in str(raised.value)
    load_settings(of_layers(MU, {**MU, **other}, kind=kind, tied=["mu_top"]))
    load_settings(of_layers(MU, {**MU, **other}, kind="independent"))


def test_bounds_that_no_guess_can_tell_apart_are_refused():
    with pytest.raises(Problems, match=r"model.parameters.mu_top: found start 0.1; expected 0.1 to 0.1, the bounds"):
        load_settings(of_layers({**MU, "lower": 0.1, "upper": 0.1 + 1e-13}, MU, kind="independent"))


def test_mu_is_tied_whatever_the_order_of_the_parameters():
    alpha = {"unit": "1", "start": 3.0, "lower": 0.5, "upper": 12.0}
    config = of_layers(alpha, MU, kind="grid")
    config["model"]["parameters"] = {"alpha": alpha, "mu_top": MU, "mu_bottom": MU}
    del config["model"]["material"]["alpha"]
    assert load_settings(config).plan().stages[0].tied == ("mu_top", "mu_bottom")
    config["model"]["parameters"] = {"alpha": alpha}
    config["model"]["material"] = {"mu": 0.1, "poisson": 0.45}
    assert load_settings(config).plan().stages[0].tied == ("alpha",)


def test_a_tolerance_in_units_needs_one_unit():
    alpha = {"unit": "1", "start": 3.0, "lower": 0.5, "upper": 12.0}
    config = of_layers(MU, MU, kind="independent", tolx_in="unit")
    assert load_settings(config).plan().stages[0].tolx_in == "unit"
    config["model"]["parameters"]["alpha"] = alpha
    del config["model"]["material"]["alpha"]
    with pytest.raises(Problems, match=r"fit.stages.0.tolx_in: found unit, for 1, MPa; expected share"):
        load_settings(config)


def test_all_mistakes_are_told_at_once(tmp_path):
    config = changed("fit.scor", "nmi")
    config["model"]["mesh"]["across"] = 0
    del config["fit"]["score"]
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(config))
    with pytest.raises(Problems) as raised:
        load_settings(tmp_path / "c.yaml")
    assert {str(p).split(": ")[1] for p in raised.value.problems} == {"fit.scor", "model.mesh.across"}


def test_the_schema_says_what_the_settings_do():
    made = schema()
    assert made["additionalProperties"] is False
    assert [set(one["required"]) for one in made["anyOf"]] == [{"study", "model", "fit"}, {"runs"}]
    for name, definition in made["$defs"].items():
        assert definition["additionalProperties"] is False, name
        for key, value in definition["properties"].items():
            assert value.get("description"), f"{name}.{key}"


def test_every_key_is_described():
    text = describe()

    def walk(data, prefix):
        for key, value in data.items():
            assert f"| `{prefix}{key}" in text, f"{prefix}{key}"
            if isinstance(value, dict) and key not in ("material", "parameters"):
                walk(value, f"{prefix}{key}.")

    walk(CONFIG, "")
    assert all(field.description for field in Config.model_fields.values())


def test_runs_go_over_what_they_share():
    """Mappings are merged, everything else is replaced; without runs there is one model."""
    (one,) = load_runs(CONFIG)
    assert one == load_settings(CONFIG)
    shared = {key: value for key, value in CONFIG.items() if key != "study"}
    runs = [
        {"study": "studies/phantom", "model": {"name": "soft", "refined": None, "material": {"alpha": 2.0}}},
        {"study": "studies/other", "fit": {"steps": [1]}},
    ]
    first, second = load_runs({**shared, "runs": runs})
    wanted = copy.deepcopy(CONFIG)
    wanted["model"] |= {"name": "soft", "refined": None}
    wanted["model"]["material"]["alpha"] = 2.0
    assert first == load_settings(wanted)
    assert second == load_settings({**CONFIG, "study": "studies/other", "fit": {**CONFIG["fit"], "steps": [1]}})


@pytest.mark.parametrize(
    ("runs", "says"),
    [
        ([], "config.yaml: runs: found []; expected a list"),
        ({"a": {}}, "config.yaml: runs: found {'a': {}}; expected a list"),
        ([{}, "phantom"], "config.yaml: runs.1: found phantom; expected the keys that differ"),
        ([{}, {"fit": {"scor": "nmi"}}], "config.yaml: runs.1: fit.scor: found an unknown key; expected score"),
        ([{}, {"model": {"mesh": 3}}], "config.yaml: runs.1: model.mesh: found 3; expected "),
    ],
)
def test_wrong_runs_are_one_line(runs, says):
    with pytest.raises(FingerfitError) as caught:
        load_runs({**CONFIG, "runs": runs})
    assert str(caught.value).startswith(says)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["studies", "study"])
@pytest.mark.parametrize("others", [{}, {"study": "studies/phantom"}, {"runs": [{}]}])
def test_who_lists_studies_looks_for_runs(key, others):
    shared = {name: value for name, value in CONFIG.items() if name != "study"}
    with pytest.raises(FingerfitError) as caught:
        load_runs({**shared, **others, key: ["studies/phantom", "studies/hidden-tilt"]})
    place = "config.yaml: runs.0: " if "runs" in others else "config.yaml: "
    found = "an unknown key" if key == "studies" else "a list"
    expected = "runs: [{study: FIRST}, {study: SECOND}], in which several studies are listed"
    assert str(caught.value) == f"{place}{key}: found {found}; expected {expected}"
    # one study under a misspelt key is no list
    with pytest.raises(FingerfitError, match=r"studies: found an unknown key; expected study \(did you mean that\?\)"):
        load_runs({**shared, "studies": "studies/phantom"})


def test_a_command_for_one_model_refuses_several():
    with pytest.raises(FingerfitError, match=r"config.yaml: runs: found several models; expected one"):
        load_settings({**CONFIG, "runs": [{}]})


@pytest.mark.parametrize(("c2", "scale"), [(0.0, 1.5), (0.4, 1.5), (-0.1, 1.5), (13.5, 13.5)])
def test_a_large_number_of_an_effect_counts_by_shares_of_itself(c2, scale):
    """As a modulus does, whose coordinate is its logarithm; a small one in thirty trial sizes."""
    found = load_settings(changed("model.effects", {"yeoh": {"c2": c2}})).parameters()
    assert {p.name: p.scale for p in found}["yeoh.c2"] == pytest.approx(scale)
