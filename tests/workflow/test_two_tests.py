"""A study of two tests through the workflow: files and figures of each, one table; nothing runs again."""

import pytest
import yaml
from one_layer import MODEL, TWO_TESTS
from test_runs import configure, run

CONFIG = {
    "study": "studies/two",
    "model": {**MODEL, "refined": {"element": "CPE4", "across": 4, "per_layer": 4}},
    "fit": {
        "score": "likelihood",
        "replicates": 20,
        "stages": [{"name": "grid", "kind": "grid", "points": 2}],
    },
}


@pytest.mark.slow
def test_two_tests_through_the_workflow(tmp_path):
    study = tmp_path / "studies/two"
    study.mkdir(parents=True)
    (study / "study.yaml").write_text(yaml.safe_dump(TWO_TESTS, sort_keys=False))
    (study / "steps.csv").write_text("step,displacement,force\n1,0.5,5\n2,1,10.5\n")
    configure(tmp_path, CONFIG)
    run(tmp_path, "--cores", "2")
    folder = tmp_path / "results/two/base"
    made = {path.name for path in folder.iterdir() if path.is_file()}
    assert made >= {
        "prepared-plate.npz", "mesh-plate.inp", "refined-greased.inp", "table.txt", "estimate.json"
    }  # fmt: skip
    assert {path.name for path in (folder / "figures").iterdir()} == {
        "force-plate.png", "force-greased.png", "search.png"
    }  # fmt: skip
    # forces of one and the same table cannot fit both: it is said, with the test
    assert "force of step 2 is" in (folder / "table.txt").read_text()
    assert "Nothing to be done" in run(tmp_path, "--cores", "2", "--dry-run")
