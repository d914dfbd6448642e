"""The lines of docs/python.md, run on a small body with something hidden in it."""

import re
from pathlib import Path

import pytest
import yaml
from one_layer import FEW
from small_body import SMALL, config_of, written

import fingerfit
from fingerfit.core.errors import InputError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """What the documented lines leave behind."""
    folder = tmp_path_factory.mktemp("notebook")
    study = written(folder, effects={"tilt": {"slope": 0.04}}).rename(folder / "tilt")
    config = {**config_of(study, SMALL), "diagnosis": {"only": [*FEW, "indenter_probe"]}}
    (study / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False))
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(), re.DOTALL)
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(lines, found)
        found["again"] = fingerfit.fit("tilt/config.yaml")
    return found


def test_what_is_hidden_is_found_and_added(names):
    assert names["study"].layer_names == ["top", "bottom"]
    assert names["found"].effects == ("tilt",)
    tilt = names["found"].candidates.loc["tilt"]
    assert (tilt.family, tilt.refitted) == ("indenter", True)
    assert tilt.explained > 0.75
    assert names["better"].run == 0
    slope = names["better"].constants.loc["tilt.slope"]
    assert abs(slope.value - 0.04) < 4 * slope.standard_error + 2 * slope.mesh_error


def test_tables_are_those_of_the_estimate(names):
    result = names["result"]
    assert list(result.constants.index) == ["mu_top", "mu_bottom"]
    assert (result.constants.low95 < result.constants.value).all()
    assert (result.constants.value < result.constants.high95).all()
    assert result.correlation.loc["mu_top", "mu_top"] == 1.0
    assert result.search.score.min() == result.last.best["score"]
    assert names["again"].run == 0
    assert names["again"].constants.equals(result.constants)


def test_there_are_ten_lines_of_one_package(names):
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text(), re.DOTALL)
    assert sum(bool(line.strip()) for line in lines.splitlines()) <= 10
    steps = names["result"].steps
    assert steps.model_displacement.to_numpy() == pytest.approx(steps.displacement.to_numpy(), abs=0.05)
    assert callable(fingerfit.fit) and fingerfit.fit.__name__ == "fingerfit.fit"  # the room and the verb
    assert {"add", "diagnose", "fit", "load_result", "load_study"} <= set(dir(fingerfit))
    with pytest.raises(AttributeError, match="module 'fingerfit' has no attribute 'fitt'"):
        _ = fingerfit.fitt


def test_figures_have_names(names):
    assert (names["result"].figure("force").get_axes()[0].get_ylabel()) == "force in N"
    with pytest.raises(InputError, match="one of force, search"):
        names["result"].figure("forces")
