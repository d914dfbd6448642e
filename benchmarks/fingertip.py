"""The fingertip: what elements cost and how stiff they are, and both models fitted to the virtual MR test.

    python benchmarks/fingertip.py [--part elements|fits|solvers]

writes benchmarks/fingertip.md from what its parts left in benchmarks/.cache/fingertip. `fits` wants the study that
`make fingertip-data` makes, and runs Snakemake from a cold cache; `solvers` wants that of `make fingertip-coarse`,
and ccx.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml
from fitting import processor_time
from running import ROOT, machine

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.core.files import write_text
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import minimum
from fingerfit.fit.refine import around_best
from fingerfit.fit.simulate import begin
from fingerfit.provenance.results import model_folder
from fingerfit.settings.config import load_settings
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.study.study import Body, Layer, Noise, Step, Study

STUDY = ROOT / "studies/fingertip"
CACHE = ROOT / "benchmarks/.cache/fingertip"
DEPTHS = (0.8, 1.6, 2.4, 3.2, 4.0)
"""mm."""
VALUES = {"mu_epidermis": 0.138, "mu_subcutaneous": 0.00798}
"""MPa (Tada, Nagai and Maeno 2006)."""
FIXED = {"alpha": 1.4, "poisson": 0.48}
MESHES = (("C3D4", 1.0), ("C3D4H", 1.5), ("C3D10", 1.7), ("C3D10H", 3.0), ("C3D10H", 1.7))
CONFIGS = ("homogeneous", "config")
HEAD = """# The fingertip

Made by `python benchmarks/fingertip.py`; do not edit. Measured on {machine}.

"""
ELEMENTS = """## Elements

The reference finger with the paper's constants and nu = 0.48, the hemisphere pressed in to 4 mm in five steps
(displacement control, processor time of one thread). *Stiffer* is the force at 4 mm relative to the finest mesh's.

| elements | nodes | s | Newton iterations | force at 0.8 to 4 mm, N | stiffer |
|---|---|---|---|---|---|
"""
FITS = """## Fits

The virtual MR test of `studies/fingertip` from a cold cache by `snakemake --cores 2`, after the data were made. Truth
in MPa: {truth}.

| model | constant | start | estimate | standard error | error | score (SSD) | rounds | simulations | s |
|---|---|---|---|---|---|---|---|---|---|
"""


SOLVERS = """## Two solvers

The mesh of `studies/fingertip-coarse` (4 843 linear tetrahedra, tools of flat facets), solved by both with the paper's
constants under the measured forces; then the built-in solver fitted, from 10 % and 5 % off, to the volumes that
CalculiX's displacements make of the first one.

| solver | way of the indenter, mm | s |
|---|---|---|
"""


def elements() -> list[str]:
    """A row for each mesh."""
    found = []
    for element, size in MESHES:
        mesh = add_fixtures(finger_mesh(size=size, element=element), (Anatomy().pulp_centre, 0.0))
        steps = tuple(Step(n, displacement=depth) for n, depth in enumerate(DEPTHS, 1))
        body = Body((Layer("epidermis"), Layer("subcutaneous")))
        study = Study(ROOT, "finger", "displacement", steps, None, Noise(), body, "held", "slides")
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_text(folder / "mesh.inp", format_mesh(mesh))
            context = deck_context(study, mesh, "mesh.inp", VALUES, FIXED)
            write_text(folder / "deck.inp", render_deck("fingertip.inp.j2", context, [ROOT / "templates"]))
            start = time.process_time()
            outcome = BuiltinSolver().solve(folder / "deck.inp", folder)
            seconds = time.process_time() - start
        force = [-float(f) for f in outcome.reaction[:, 2]]
        count = sum(len(block.nodes) for block in mesh.blocks)
        found.append((f"{count} {element}", len(mesh.points), seconds, sum(outcome.iterations), force))
        print(found[-1], flush=True)
    last = found[-1][-1][-1]
    return [
        f"| {name} | {nodes} | {seconds:.1f} | {iterations} | {', '.join(f'{f:.3f}' for f in force)} |"
        f" {100 * (force[-1] / last - 1):+.1f} % |"
        for name, nodes, seconds, iterations, force in found
    ]


def problem(settings: dict[str, Any], folder: Path) -> tuple[dict[str, Any], float]:
    """Estimate of a fit from a cold cache, and its seconds on the clock."""
    write_text(folder / "config.yaml", yaml.safe_dump(settings, sort_keys=False))
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("SNAKEMAKE_OUTPUT_CACHE", None)
    start = time.monotonic()
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "--configfile", str(folder / "config.yaml")]
    with (folder / "log").open("w", encoding="utf-8") as log:
        subprocess.run(command, cwd=ROOT, env=environment, check=True, stdout=log, stderr=log)
    seconds = time.monotonic() - start
    path = model_folder(load_settings(settings)) / "estimate.json"
    return json.loads(path.read_text(encoding="utf-8")), seconds


def solvers() -> list[str]:
    """The built-in solver fitted to the volumes that CalculiX's solution of the same mesh synthesizes."""
    settings = yaml.safe_load((ROOT / "studies/fingertip-coarse/config.yaml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as name:
        fits, outcomes, seconds = {}, {}, {}
        for solver in ("calculix", "builtin"):
            fits[solver], _ = begin(load_settings({**settings, "solver": solver}), Path(name) / solver)
            asked = fits[solver].ask(VALUES)
            start = processor_time()
            solve_missing(fits[solver], [asked], 1)
            seconds[solver] = processor_time() - start
            outcomes[solver] = fits[solver].outcome(asked)
        seen = fits["calculix"].prediction(fits["calculix"].ask(VALUES)).pictures
        problem = replace(fits["builtin"], data=replace(fits["builtin"].data, measured=seen))
        values = {key: value * share for (key, value), share in zip(VALUES.items(), (1.1, 0.95), strict=True)}
        for _ in range(3):
            base = {
                "number": 1,
                "solver": problem.solver,
                "meshes": problem.mesh_names,
                "history": [],
                "best": {"values": values},
            }
            asked_for = around_best(problem, base, values, "")
            solve_missing(problem, asked_for.batch, 1)
            found = minimum(problem, asked_for)
            values = found.values
            if found.move < 0.01:
                break
    ways = {solver: ", ".join(f"{-u:.3f}" for u in outcome.indenter[:, 2]) for solver, outcome in outcomes.items()}
    rows = [f"| {solver} | {ways[solver]} | {seconds[solver]:.0f} |" for solver in ways]
    errors = ", ".join(f"{key} {100 * (values[key] / true - 1):+.2f} %" for key, true in VALUES.items())
    return [*rows, "", f"Constants that come out, relative to those that went in: {errors}."]


def constants() -> dict[str, float]:
    """The sealed truth."""
    truth: dict[str, float] = yaml.safe_load((STUDY / "sealed/truth.yaml").read_text(encoding="utf-8"))["constants"]
    return truth


def fits() -> list[str]:
    """Rows of both models."""
    truth, rows = constants(), []
    for name in CONFIGS:
        settings = yaml.safe_load((STUDY / f"{name}.yaml").read_text(encoding="utf-8"))
        with tempfile.TemporaryDirectory() as folder:
            settings["results"] = f"{folder}/results"
            found, seconds = problem(settings, Path(folder))
            keep = CACHE / settings["model"]["name"]
            shutil.rmtree(keep, ignore_errors=True)
            chosen = load_settings(settings)
            shutil.copytree(model_folder(chosen), keep)
        starts, rounds = chosen.starts(), found["search"]["rounds"]
        for key, entry in found["parameters"].items():
            error = f"{100 * (entry['value'] / truth[key] - 1):+.1f} %" if key in truth else ""
            rows.append(
                f"| {chosen.model.full_name} | {key} | {starts[key]:g} | {entry['value']:.4g} |"
                f" {entry['standard_error']:.1g} | {error} | {found['score']['final']:.4g} | {rounds} |"
                f" {found['simulations']['run']} | {seconds:.0f} |"
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--part", choices=("elements", "fits", "solvers", "none"), action="append", help="none: only the tables"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/fingertip.md")
    args = parser.parse_args()
    CACHE.mkdir(parents=True, exist_ok=True)
    text = HEAD.format(machine=machine())
    for part, run in (("elements", elements), ("fits", fits), ("solvers", solvers)):
        kept = CACHE / f"{part}.json"
        if part in (args.part or ("elements", "fits", "solvers")):
            kept.write_text(json.dumps(run()), encoding="utf-8")
        if kept.exists():
            head = {"elements": ELEMENTS, "fits": FITS, "solvers": SOLVERS}[part]
            if part == "fits":
                head = head.format(truth=", ".join(f"{k} {v:g}" for k, v in constants().items() if k.startswith("mu")))
            text += head + "\n".join(json.loads(kept.read_text(encoding="utf-8"))) + "\n\n"
    args.out.write_text(text.rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
