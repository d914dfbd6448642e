"""The shipped phantom study at its default settings: the accuracy that the README states."""

import re
import sys
from pathlib import Path

import pytest
import yaml

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    sys.path.insert(0, str(ROOT / "benchmarks"))
    try:
        from fitting import fit_study
    finally:
        sys.path.pop(0)
    config = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
    return fit_study({**config, "study": str(ROOT / config["study"])}, tmp_path_factory.mktemp("fit")).estimate


def test_every_constant_is_within_two_per_cent(found):
    truth = yaml.safe_load((ROOT / "studies/phantom/sealed/truth.yaml").read_text(encoding="utf-8"))["constants"]
    assert found["sim_mesh"] == "refined"
    assert found["remarks"] == []
    assert set(found["parameters"]) == {"mu_top", "mu_middle", "mu_bottom"}
    for name, entry in found["parameters"].items():
        assert entry["value"] == pytest.approx(truth[name], rel=0.02)
        low, high = entry["interval95"]
        assert low < truth[name] < high


def test_the_readme_states_what_comes_out(found):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    truth = yaml.safe_load((ROOT / "studies/phantom/sealed/truth.yaml").read_text(encoding="utf-8"))["constants"]
    for name, entry in found["parameters"].items():
        (printed,) = re.findall(rf"^{name} +MPa +([\d.]+)", readme, re.MULTILINE)
        (row,) = re.findall(rf"^\| {name} \|(.*)\|$", readme, re.MULTILINE)
        cells = [cell.strip() for cell in row.split("|")]
        assert float(printed) == pytest.approx(entry["value"], rel=3e-3)
        assert float(cells[2]) == truth[name]
        assert float(cells[3]) == pytest.approx(entry["value"], rel=5e-3)
        assert float(cells[4].removesuffix(" %")) == pytest.approx(100 * (entry["value"] / truth[name] - 1), abs=0.3)
