"""A model that was refitted in the diagnosis of the one below it asks for no simulation that is not known."""

import pytest
import yaml
from blocks import STUDY
from conftest import all_rounds
from seeds import seed_of

from fingerfit.core.files import keep_json, read_json
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.ladder import add
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import asked_for
from fingerfit.fit.simulate import begin
from fingerfit.provenance import stages
from fingerfit.report.findings import count_simulations, write_diagnosis
from fingerfit.settings.config import load_settings

NOISE = {"force": 0.02, "displacement": 0.0001}
MOVED = [0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6]
CONFIG = """\
study: study
model:
  material: {alpha: ALPHA, poisson: 0.45}
  mesh: {element: CPE8, across: 2, per_layer: 2}
  parameters:
    mu: {unit: MPa, start: 0.05, lower: 0.005, upper: 0.5}
fit:
  score: likelihood
  replicates: 20
  stages:
    - {name: grid, kind: grid, points: 3}
diagnosis:
  only: [second_term, stiffening, exponential, yeoh, material_probe, force_offset, loading_probe, base_slip, base_probe]
""".replace("replicates: 20", f"replicates: 20\n  seed: {seed_of(1)}")


def write_steps(folder, forces):
    rows = [f"{n},{d},{f}" for n, (d, f) in enumerate(zip(MOVED, forces, strict=True), 1)]
    (folder / "study/steps.csv").write_text("\n".join(["step,displacement,force", *rows]) + "\n")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Forces of a body that stiffens more than the model says."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study").mkdir()
    (tmp_path / "study/study.yaml").write_text(yaml.safe_dump({**STUDY, "noise": NOISE}))
    write_steps(tmp_path, [1.0] * len(MOVED))
    (tmp_path / "config.yaml").write_text(CONFIG.replace("ALPHA", "6.0"))
    truth, _ = begin(load_settings(tmp_path / "config.yaml"), tmp_path / "truth")
    asked = truth.ask({"mu": 0.05})
    solve_missing(truth, [asked], 1)
    write_steps(tmp_path, truth.prediction(asked).response)
    (tmp_path / "config.yaml").write_text(CONFIG.replace("ALPHA", "1.4"))
    return tmp_path


def diagnosed(folder):
    """Fit and diagnosis of a model; how many simulations the fit ran, and as the rung counts them."""
    settings = stages.warm(load_settings(folder / "config.yaml"))
    model = stages.model_folder(settings)
    problem, everything = begin(settings, folder / "results/study")
    last, run = all_rounds(problem, model / "rounds")
    own = set(asked_for(model / f"rounds/{last.number}.json"))
    assert own == problem.asked
    problem = InverseProblem(settings, problem.data, problem.mesh_files, problem.sims)  # as another job makes it
    found = diagnose(problem, last, everything)
    keep_json(model / "estimate.json", estimate_of(problem, last))
    write_diagnosis(found, model / "diagnosis.json")
    return run, count_simulations(folder / "results/study", settings.model.path, own, problem.asked), found


@pytest.mark.slow
def test_adding_what_was_refitted_runs_nothing(folder):
    run, counted, found = diagnosed(folder)
    assert counted == {"run": run, "reused": 0}
    name = found.verdict.effects[0]
    said = add(folder / "config.yaml", name)
    assert f"; {found.refits[name].simulations} simulations of its refit are reused" in said
    run, counted, _ = diagnosed(folder)
    assert run == 0
    assert counted["run"] == 0
    assert 5 < counted["reused"] <= found.refits[name].simulations
    # by the names that were asked for, not by times: it counts the same when it is called again
    names = read_json(folder / f"results/study/base+{name}/simulations.json")
    models, asked = ["base", f"base+{name}"], (set(names["fit"]), set(names["diagnosis"]))
    assert count_simulations(folder / "results/study", models, *asked) == counted
