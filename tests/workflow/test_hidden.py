"""A small study with a hidden tilt: the diagnosis names it, and the model that has it fits what was held out."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from seeds import seed_of

from fingerfit.core.files import read_json
from fingerfit.provenance import stages
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import run_experiment

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
SLOPE = 0.04
DESCRIPTION = {
    "title": "an indenter that does not stay level",
    "body": {
        "width": 12,
        "thickness": 70,
        "layers": [
            {"name": "top", "height": 6, "mu": 0.03, "intensity": 0.5},
            {"name": "bottom", "height": 6, "mu": 0.06, "intensity": 0.9},
        ],
    },
    "material": {"alpha": 1.4, "poisson": 0.49},
    "mesh": {"element": "CPE8", "across": 12, "per_layer": 6, "grading": 2},
    "solver": "builtin",
    "displacement": [0.5, 1.0, 1.5, 2.0],
    "picture": {
        "pixels": 96,
        "side": 19,
        "texture": 0.15,
        "correlation": 0.6,
        "noise": 0.02,
        "pictured": [1, 2, 3, 4],
    },
    "noise": {"force": 0.003, "displacement": 0.01},
    "seed": seed_of(5),
    "effects": {"tilt": {"slope": SLOPE}},
}
CONFIG = {
    "study": "study",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.49},
        "mesh": {"element": "CPE8", "across": 5, "per_layer": 3, "grading": 2},
        "refined": {"element": "CPE8", "across": 8, "per_layer": 4, "grading": 2},
        "parameters": {
            f"mu_{n}": {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.2} for n in ("top", "bottom")
        },
    },
    "fit": {
        "score": "nmi",
        "bins": 16,
        "replicates": 20,
        "seed": seed_of(1),
        "steps": [2, 4],
        "stages": [
            {"name": "grid", "kind": "grid", "points": 3},
            {"name": "independent", "kind": "independent", "tolx": 0.2, "tolf": 2e-2},
        ],
    },
}


SNAKEMAKE = [str(Path(sys.executable).parent / "snakemake"), "-s", str(ROOT / "Snakefile"), "--cores", "2"]


def run(place, *arguments):
    done = subprocess.run(
        arguments, cwd=place, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout + done.stderr


def snakemake(place, target):
    return run(place, *SNAKEMAKE, "--workflow-profile", str(ROOT / "workflow/profiles/default"), target)


def diagnose(place):
    return snakemake(place, "diagnose")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The study, its first rung, and then those that `snakemake discover` adds."""
    place = tmp_path_factory.mktemp("hidden")
    (place / "experiment.yaml").write_text(yaml.safe_dump(DESCRIPTION))
    run_experiment(place / "experiment.yaml", place / "study")
    (place / "config.yaml").write_text(yaml.safe_dump(CONFIG, sort_keys=False))
    diagnose(place)
    (place / "first.txt").write_text("\n".join(f"{sim} {when}" for sim, when in simulations(place).items()))
    (place / "said.txt").write_text(snakemake(place, "discover"))
    return place


def simulations(place):
    return {path.parent.name: path.stat().st_mtime_ns for path in (place / "results/study/sims").glob("*/solution.npz")}


def rung(place, model):
    return read_json(place / f"results/study/{model}/rung.json")


def test_the_first_rung_misses_the_tilt(place):
    found = read_json(place / "results/study/base/diagnosis.json")
    assert found["verdict"] == "missing"
    assert found["effects"] == ["tilt"]
    assert found["sentence"].startswith("missing: tilt of the indenter; it explains ")
    assert rung(place, "base")["family_sentence"].startswith("The effect lies in the indenter and other boundaries")
    assert rung(place, "base")["family_sentence"] in (place / "said.txt").read_text()
    first, *others = found["ranking"]
    assert first["effect"] == "tilt"
    # the probe of its family has the tilt among its numbers, and falls as deep or a little deeper
    second = next(entry for entry in others if entry["effect"] != "indenter_probe")
    # five standard errors, the size over the root of the fall; 9 seeds: low by 1.3 of them, with 0.8 as their spread
    size = first["size"]["slope"]
    assert size == pytest.approx(SLOPE, abs=5 * size / first["predicted_fall"] ** 0.5)
    # 9 seeds: 2.5 times as much, with a standard deviation of 18 %
    assert first["predicted_fall"] > second["predicted_fall"]


def test_the_second_rung_explains_what_was_held_out(place):
    before, after = rung(place, "base"), rung(place, "base+tilt")
    # 9 seeds: 1.82 on average, with a standard deviation of 0.08
    assert before["error"]["fitted"] > 1.44
    # noise alone leaves 1; what is beyond it falls by more than half
    assert after["error"]["held_out"] - 1 < 0.5 * (before["error"]["held_out"] - 1)
    assert after["error"]["held_out"] < 1.16  # 9 seeds: 1.05, 0.023
    assert after["verdict"] == "adequate"
    found = read_json(place / "results/study/base+tilt/estimate.json")["parameters"]
    # 9 seeds: too small by 2.0 % on average with a standard deviation of 1.9 %; five of them
    assert found["tilt.slope"]["value"] == pytest.approx(SLOPE, rel=0.12)
    # top 1.7 % too small, 0.3 %; bottom 3.2 %, 0.3 %, by the mesh
    for name, truth in (("mu_top", 0.03), ("mu_bottom", 0.06)):
        assert found[name]["value"] == pytest.approx(truth, rel=0.05)


def test_constants_of_a_model_in_doubt_range_as_far_as_the_refit(place):
    before, after = rung(place, "base"), rung(place, "base+tilt")
    assert set(before["ranges"]) == {"mu_top", "mu_bottom"}
    for name, (low, high) in before["ranges"].items():
        known = before["parameters"][name]["interval95"]
        assert low < known[0] < known[1] < high
        assert low < after["parameters"][name]["value"] < high
    assert after["ranges"] == {}


def test_nothing_of_the_first_rung_ran_again(place):
    first = {
        name: int(when) for name, when in map(str.split, (place / "first.txt").read_text(encoding="utf-8").splitlines())
    }
    second = simulations(place)
    assert len(first) > 20
    assert {name: second[name] for name in first} == first
    assert len(second) > len(first)


def test_the_second_rung_is_the_refit_of_the_first(place):
    """All simulations of its fit were those of the diagnosis of the first rung."""
    refit = read_json(place / "results/study/base/diagnosis.json")["ranking"][0]["refit"]
    counted = rung(place, "base+tilt")["simulations"]
    assert counted["run"] == 0
    assert 5 < counted["reused"] <= refit["simulations"]
    assert rung(place, "base")["simulations"]["reused"] == 0


def test_both_rungs_are_on_the_ladder(place):
    rungs = read_json(place / "results/study/ladder.json")["rungs"]
    assert [entry["effects"] for entry in rungs] == [[], ["tilt"]]
    page = (place / "results/study/report.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1])
    shown = [
        f"{kind}|{entry['model']}|{n}"
        for kind in ("measured", "synthesized", "map")
        for entry in rungs
        for n in range(4)
    ]
    assert set(shown) <= set(data["panels"])
    rows = re.findall(r"<tr><td>.*?</tr>", re.search(r'<table class="rungs">.*?</table>', page, re.S)[0], re.S)
    for row, entry in zip(rows, rungs, strict=True):
        told = [float(x) for x in re.findall(r'data-label="Error, [a-z ]+">([\d.]+)&nbsp;×', row)]
        # three digits
        assert told == pytest.approx([entry["error"]["fitted"], entry["error"]["held_out"]], rel=5e-3)
        assert f"{entry['simulations']['run']} run" in row
    assert all(entry["sentence"][0].upper() + entry["sentence"][1:] in page for entry in rungs)


def test_discover_tells_each_rung(place):
    lines = (place / "said.txt").read_text(encoding="utf-8").splitlines()
    base, tilted = rung(place, "base"), rung(place, "base+tilt")
    wanted = [
        f"base: error {base['error']['fitted']:.3g} times the noise level, {base['error']['held_out']:.3g} on held-out steps;"
        f" {base['simulations']['run']} simulations run, 0 reused from models below; {base['sentence']}",
        "config.yaml: added tilt (tilt of the indenter), starting at power ",
        f"base+tilt: error {tilted['error']['fitted']:.3g} times the noise level,"
        f" {tilted['error']['held_out']:.3g} on held-out steps; 0 simulations run,",
        "ladder: results/study/ladder.json; page: results/study/report.html",
    ]
    found = [next((n for n, line in enumerate(lines) if line.startswith(start)), None) for start in wanted]
    assert None not in found, lines
    assert found == sorted(found)


def test_a_dropped_effect_leaves_the_ladder(place, tmp_path):
    """Its results stay, and nothing is simulated."""
    copy = tmp_path / "copy"
    shutil.copytree(place, copy, symlinks=True)
    known = simulations(copy)
    assert "dropped tilt" in run(copy, sys.executable, "-m", "fingerfit", "drop", "tilt")
    diagnose(copy)
    ladder = read_json(copy / "results/study/ladder.json")
    assert [entry["model"] for entry in ladder["rungs"]] == ["base"]
    assert ladder["others"] == [{"model": "base+tilt", "why": "not on the way to this model"}]
    assert (copy / "results/study/base+tilt/rung.json").exists()
    assert simulations(copy) == known


SEALED = """
import sys

def hook(event, arguments):
    if event in ("open", "os.listdir", "os.scandir") and "sealed" in str(arguments[0]):
        print("opened", arguments[0], flush=True)
        raise SystemExit(3)

sys.addaudithook(hook)
from fingerfit.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_the_diagnosis_opens_nothing_that_is_sealed(place, tmp_path):
    """Diagnosed once more, every simulation known; processes that are forked have the hook, too."""
    copy = tmp_path / "copy"
    shutil.copytree(place, copy, symlinks=True)
    model = copy / "results/study/base"
    before = read_json(model / "diagnosis.json")
    (model / "diagnosis.json").unlink()
    last = max(model.glob("rounds/*.json"), key=lambda path: int(path.stem))
    options = ["--data", "prepared.npz", "--mesh", "mesh.inp", "--refined", "refined.inp", "--last", last,
               "--estimate", "estimate.json", "--out", "diagnosis.json", "--sims", "../sims", "--threads", "2"]  # fmt: skip
    paths = [
        model / value if isinstance(value, str) and value[0] != "-" and value != "2" else value for value in options
    ]
    command = [sys.executable, "-c", SEALED, "diagnose", model / "settings.json", *paths]
    run(copy, *map(str, command))
    again = read_json(model / "diagnosis.json")
    assert again["simulations"] == 0
    same_diagnosis(again, before)
    # what would open it, or look what is there, is stopped
    for looks in (
        ["deck", "show", "study/sealed/truth.yaml"],
        ["new", "x", "--pictures", "study/sealed", "--forces", "f.csv"],
    ):
        stopped = subprocess.run([sys.executable, "-c", SEALED, *looks], cwd=copy, capture_output=True, text=True)
        assert stopped.returncode == 3, looks
        assert "opened" in stopped.stdout
    # and without it the diagnosis is the same
    shutil.rmtree(copy / "study/sealed")
    run(copy, *map(str, command))
    same_diagnosis(read_json(model / "diagnosis.json"), again)


def same_diagnosis(one, other):
    """All words and the order of the ranking; numbers to the last digits that sums in another order leave."""
    words = ("model", "verdict", "sentence", "effects", "freedom", "not_tried", "add")
    assert {key: one[key] for key in words} == {key: other[key] for key in words}
    assert [entry["effect"] for entry in one["ranking"]] == [entry["effect"] for entry in other["ranking"]]
    assert one["misfit"] == pytest.approx(other["misfit"], rel=1e-9)
    for mine, yours in zip(one["ranking"], other["ranking"], strict=True):
        assert mine["size"] == pytest.approx(yours["size"], rel=1e-6, abs=1e-9)
        assert (mine["refit"] or {}).get("start") == (yours["refit"] or {}).get("start")


def test_no_rule_reads_what_is_sealed(place, monkeypatch):
    """The workflow's own record of its inputs, and the list that its rules take them from."""
    monkeypatch.chdir(place)
    assert (place / "study/sealed/truth.yaml").exists()
    files = stages.study_files(Path(load_settings(Path("config.yaml")).study))
    assert "study/study.yaml" in files
    assert not [path for path in files if "sealed" in path]
    records = [
        path.read_text(encoding="utf-8") for path in (place / ".snakemake/metadata").rglob("*") if path.is_file()
    ]
    assert any("study/study.yaml" in text for text in records)
    assert not [text for text in records if "sealed" in text]


def test_discover_takes_no_settings_beside_the_file(place):
    """They would be lost: effects are added to the file, and the next rung reads it."""
    command = [*SNAKEMAKE, "discover", "--config", "solver=calculix"]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True)
    assert done.returncode != 0
    assert "discover adds effects to config.yaml: all settings must stand there" in done.stderr
