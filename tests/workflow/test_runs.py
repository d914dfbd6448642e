"""Several studies and models in one call of the workflow; and reading it changes nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml
from one_layer import FEW
from seeds import part_of
from test_provenance import CONFIG, DESCRIPTION, ROOT, snakemake

from fingerfit.core.files import read_json
from fingerfit.virtual.experiment import run_experiment

OPTIONS = ("-s", str(ROOT / "Snakefile"), "--workflow-profile", str(ROOT / "workflow/profiles/default"))
SHARED = {key: value for key, value in CONFIG.items() if key != "study"} | {"diagnosis": {"only": FEW}}
MODELS = ({}, {"effects": {"tilt": {}}})
RUNS = [{"study": f"studies/{study}", "model": model} for study in ("one", "two") for model in MODELS]
FOLDERS = [f"results/{study}/{model}" for study in ("one", "two") for model in ("base", "base+tilt")]


def configure(place, config):
    (place / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")


def run(place, *options, ends=0, **environment):
    said, code = snakemake(place, *OPTIONS, *options, **environment)
    assert code == ends, said[-3000:]
    return said


def snapshot(place):
    """All files with their times, but those of Snakemake itself."""
    return {
        path.relative_to(place): (path.stat().st_mtime_ns, path.read_bytes() if path.is_file() else None)
        for path in place.rglob("*")
        if path.relative_to(place).parts[0] != ".snakemake"
    }


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """Two studies with other noise and another stiffness."""
    place = tmp_path_factory.mktemp("studies")
    for number, name in enumerate(("one", "two")):
        layers = [{**DESCRIPTION["body"]["layers"][0], "mu": 0.03 + 0.01 * number}]
        description = {
            **DESCRIPTION,
            "body": {**DESCRIPTION["body"], "layers": layers},
            "seed": DESCRIPTION["seed"] + number,
        }
        (place / "experiment.yaml").write_text(yaml.safe_dump(description))
        run_experiment(place / "experiment.yaml", place / "studies" / name)
    return place


@pytest.fixture(scope="module")
def made(studies):
    """Two models of each study, fitted by one call."""
    configure(studies, {**SHARED, "runs": RUNS})
    run(studies, cores=2)
    return studies


@pytest.fixture(scope="module")
def first(studies, tmp_path_factory):
    """The first of these models alone, fitted."""
    place = tmp_path_factory.mktemp("first")
    shutil.copytree(studies / "studies", place / "studies")
    configure(place, {**SHARED, "runs": RUNS[:1]})
    run(place, cores=2)
    return place


@pytest.fixture
def place(request, tmp_path):
    """A copy of that, times kept: in slow tests with all models, in others with the first one."""
    slow = request.node.get_closest_marker("slow")
    shutil.copytree(request.getfixturevalue("made" if slow else "first"), tmp_path / "copy", symlinks=True)
    return tmp_path / "copy"


@pytest.mark.slow
def test_two_studies_and_two_models_of_each_run_side_by_side(made):
    first = {folder: (made / folder / "rounds/0.json").stat().st_mtime for folder in FOLDERS}
    last = {folder: (made / folder / "estimate.json").stat().st_mtime for folder in FOLDERS}
    # neither study waits for the other one, and a model with an effect for the one below
    assert max(first["results/one/base"], first["results/two/base"]) < min(last.values())
    for study in ("one", "two"):
        assert last[f"results/{study}/base"] < first[f"results/{study}/base+tilt"]
        below = read_json(made / f"results/{study}/base/estimate.json")["parameters"]["mu"]
        settings = read_json(made / f"results/{study}/base+tilt/settings.json")
        assert settings["model"]["parameters"]["mu"]["start"] == below["value"]
        assert settings["study"] == f"studies/{study}"
    values = [read_json(made / f"{folder}/estimate.json")["parameters"]["mu"]["value"] for folder in FOLDERS]
    assert len(set(values)) == 4
    assert values[2] > 1.1 * values[0]


@pytest.mark.slow
def test_each_model_is_that_of_a_call_of_its_own(made, tmp_path):
    """Byte for byte; and neither form runs again what the other one made."""
    shutil.copytree(made / "studies", tmp_path / "studies")
    for one in RUNS[2:]:
        configure(tmp_path, {**SHARED, "study": one["study"], "model": {**SHARED["model"], **one["model"]}})
        run(tmp_path, cores=2)
        assert "Nothing to be done" in run(tmp_path, "-n")
    names = ("settings.json", "estimate.json", "table.txt", "rounds/0.json", "figures/force.png")
    for folder in FOLDERS[2:]:
        for name in names:
            assert (tmp_path / folder / name).read_bytes() == (made / folder / name).read_bytes(), f"{folder}/{name}"
    configure(tmp_path, {**SHARED, "runs": RUNS[2:]})
    assert "Nothing to be done" in run(tmp_path, "-n")


@pytest.mark.slow
def test_one_changed_model_runs_alone(place):
    runs = [
        {**one, "model": {**one["model"], "material": {"poisson": 0.48}}} if n == 3 else one
        for n, one in enumerate(RUNS)
    ]
    before = snapshot(place)
    configure(place, {**SHARED, "runs": runs})
    run(place, cores=2)
    assert "Nothing to be done" in run(place, "-n")
    after = snapshot(place)
    estimates = [Path(folder, "estimate.json") for folder in FOLDERS]
    assert [path for path in estimates if after[path] != before[path]] == estimates[3:]


@pytest.mark.slow
def test_a_file_of_one_model_is_a_target(place):
    (place / FOLDERS[1] / "table.txt").unlink()
    (place / FOLDERS[3] / "table.txt").unlink()
    run(place, f"{FOLDERS[1]}/table.txt")
    assert (place / FOLDERS[1] / "table.txt").exists()
    assert not (place / FOLDERS[3] / "table.txt").exists()


@pytest.mark.slow
def test_the_models_of_a_study_are_one_ladder(place):
    configure(place, {**SHARED, "runs": RUNS[:2]})
    run(place, "diagnose", cores=2)
    ladder = read_json(place / "results/one/ladder.json")
    assert ([rung["model"] for rung in ladder["rungs"]], ladder["others"]) == (["base", "base+tilt"], [])
    # what the model below asked for is counted, so it has to be there
    asked, rung = (
        place / folder / name for folder, name in zip(FOLDERS, ("simulations.json", "rung.json"), strict=False)
    )
    assert asked.stat().st_mtime < rung.stat().st_mtime
    assert "Nothing to be done" in run(place, "-n", "diagnose")


SLOW = pytest.mark.slow
READS = [
    pytest.param(("-n",), id="a dry run"),
    pytest.param(("--list-rules",), id="names of the rules", marks=SLOW),
    pytest.param(("-n", "diagnose"), id="a dry run of all", marks=SLOW),
    pytest.param(("-n", "export"), id="a dry run of the export", marks=SLOW),
    pytest.param(("--summary",), id="a summary", marks=SLOW),
    pytest.param(("--dag",), id="a drawing", marks=SLOW),
    pytest.param(("-n", "discover"), id="what discover would do", marks=SLOW),
]


@pytest.mark.parametrize("options", [READS[0], *part_of(READS[1:], 2)])
def test_reading_the_workflow_changes_nothing(place, studies, tmp_path, options):
    """Neither in a folder without results, nor where some are missing, are of other settings or are damaged."""
    single = {**SHARED, "study": "studies/one"}
    fresh = tmp_path / "fresh"
    shutil.copytree(studies / "studies", fresh / "studies")
    # a dry run reads both kinds of config; for the others one is enough
    configs = [single, {**SHARED, "runs": RUNS}] if options == ("-n",) else [single]
    for config in configs:
        for folder in (fresh, place):
            configure(folder, config)
            before = snapshot(folder)
            run(folder, *options)
            assert snapshot(folder) == before
    assert {path.name for path in fresh.iterdir()} <= {"config.yaml", "studies", ".snakemake"}
    for sim in (place / "results/one/sims").iterdir():
        (sim / "deck.inp").unlink()
        (sim / "solver.json").unlink()
    (place / FOLDERS[0] / "rounds/1.json").unlink()
    configure(place, {**single, "fit": {**SHARED["fit"], "replicates": 30}})
    before = snapshot(place)
    run(place, *options)
    assert snapshot(place) == before
    (place / FOLDERS[0] / "estimate.json").write_text("{")
    before = snapshot(place)
    said, code = snakemake(place, *OPTIONS, *options)
    assert code == ("-n" in options), said
    assert snapshot(place) == before


def test_a_drawing_and_a_report_need_no_cores(place):
    """What the report shows has a caption, and stands under its study and model."""
    assert "digraph" in run(place, "--dag", cores=None)
    run(place, "--report", "report.html", cores=None)
    report = (place / "report.html").read_text(encoding="utf-8")
    for words in (
        "The mesh of model base at the steps",
        "The constants of model base with",
        "The course of the search",
    ):
        assert words in report
    assert '"results/one": {"base": ["results/one/base/' in report


def test_runs_that_would_share_results_are_refused(place):
    for runs, says in (
        (
            [RUNS[0], RUNS[0]],
            "config.yaml: runs.1: model.name: found a second model base of results/one; expected another",
        ),
        ([RUNS[0], {"study": "studies/three"}], "config.yaml: runs.1: study: found studies/three; expected the folder"),
        ([{"study": "studies/one"}, {"study": "one"}], "config.yaml: runs.1: results: found results/one for one, and"),
    ):
        if not (place / "one").exists():
            shutil.copytree(place / "studies/one", place / "one")
            shutil.rmtree(place / "results")
        configure(place, {**SHARED, "runs": runs})
        said = run(place, "-n", ends=1)
        assert says in said
        assert "Traceback" not in said


def test_a_study_that_fails_stops_no_other_one(first, tmp_path):
    """The table of the other one is shown, and its results are not made again."""
    shutil.copytree(first, tmp_path / "copy", symlinks=True)
    place = tmp_path / "copy"
    picture = sorted((place / "studies/two/pictures").iterdir())[-1]
    picture.write_bytes(picture.read_bytes()[:200])
    configure(place, {**SHARED, "runs": [RUNS[0], RUNS[2]]})
    said = run(place, ends=1, cores=2)
    assert f"{picture.name}: picture: found" in said
    assert "table: results/one/base/table.txt" in said
    assert not (place / "results/two/base/estimate.json").exists()
