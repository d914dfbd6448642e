"""What the phantom study says: paper's mesh, two solvers, mesh of the data, where the time goes.

Each part writes its section to benchmarks/.cache; all sections that are there make benchmarks/phantom.md.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from fitting import CACHE, ROOT, Fitted, fit_study, processor_time

from fingerfit.core.files import write_text
from fingerfit.core.folders import template_folders
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.mesh.blocks import layered_block
from fingerfit.solvers.contract import Outcome
from fingerfit.solvers.registry import get_solver
from fingerfit.study.study import Body, Layer, Noise, Step, Study

PHANTOM = ROOT / "studies/phantom"
TRUTH = yaml.safe_load((PHANTOM / "sealed/truth.yaml").read_text(encoding="utf-8"))
EXPERIMENT = yaml.safe_load((PHANTOM / "experiment.yaml").read_text(encoding="utf-8"))
LAYERS = [(layer["name"], float(layer["height"])) for layer in EXPERIMENT["body"]["layers"]]
WIDTH, THICKNESS = EXPERIMENT["body"]["width"], EXPERIMENT["body"]["thickness"]
BOTH = {"element": "CPE8", "across": 10, "per_layer": 4, "grading": 10.0}


def config_of(file: str) -> dict[str, Any]:
    """A config of this repository, with the study's place made absolute."""
    config = yaml.safe_load((ROOT / file).read_text(encoding="utf-8"))
    return {**config, "study": str(ROOT / config["study"])}


def fitted(config: dict[str, Any]) -> Fitted:
    """A fit in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return fit_study(config, Path(folder))


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table."""
    return [f"| {' | '.join(cells)} |" for cells in [head, ["---"] * len(head), *rows]]


def paper_mesh() -> list[str]:
    """The paper's own mesh, without a finer one."""
    config = config_of("config.yaml")
    config["model"]["mesh"] = {"element": "CPE8", "across": 6, "per_layer": 2}
    del config["model"]["refined"]
    found = fitted(config).estimate
    rows = []
    for name, entry in found["parameters"].items():
        error = 100 * (entry["value"] / TRUTH["constants"][name] - 1)
        spread = 100 * entry["standard_error"] / entry["value"]
        rows.append(
            [name, f"{TRUTH['constants'][name]:.4f}", f"{entry['value']:.4f}", f"{error:+.1f} %", f"{spread:.2f} %"]
        )
    return [
        "## The paper's own mesh",
        "",
        "36 CPE8 of equal size (133 nodes), no finer mesh; everything else as in `config.yaml`:",
        "",
        *table(["constant", "truth, MPa", "estimate, MPa", "error", "std. error (noise only)"], rows),
    ]


def agreement() -> list[str]:
    """The whole study with CalculiX and with the built-in solver on a mesh that both know."""
    config = config_of("studies/phantom/calculix.yaml")
    fits = {name: fitted({**config, "solver": name}) for name in ("builtin", "calculix")}
    values = {name: {k: e["value"] for k, e in f.estimate["parameters"].items()} for name, f in fits.items()}
    rows = []
    for name, ours in values["builtin"].items():
        theirs = values["calculix"][name]
        rows.append([name, f"{ours:.6f}", f"{theirs:.6f}", f"{100 * (theirs / ours - 1):+.3f} %"])
    times = [
        [
            name,
            f"{f.seconds['simulate']:.0f} s",
            f"{f.estimate['simulations']['run']}",
            f"{f.seconds['simulate'] / f.estimate['simulations']['run']:.2f} s",
            f"{f.estimate['search']['diverged']}",
            f"{sum(f.seconds.values()):.0f} s",
        ]
        for name, f in fits.items()
    ]
    return [
        "## Two solvers, one study",
        "",
        "`studies/phantom/calculix.yaml` (CPE8, 10 across, 4 in each layer, grading 10, no finer mesh), once as it is",
        "and once with `solver: builtin`, each in one process with one thread; seconds of processor time:",
        "",
        *table(["constant", "builtin, MPa", "calculix, MPa", "difference"], rows),
        "",
        *table(["solver", "simulations took", "of", "each", "without solution", "whole fit"], times),
    ]


def body(control: str, values: Sequence[float]) -> Study:
    """The phantom as a study without data."""
    steps = tuple(Step(n, **{control: value}) for n, value in enumerate(values, 1))
    layers = Body(tuple(Layer(*layer) for layer in LAYERS), width=WIDTH, thickness=THICKNESS)
    return Study(Path("study.yaml"), "phantom", control, steps, None, Noise(), layers, "held", "glued")


def solve(solver: str, control: str, values: Sequence[float], mesh: dict[str, Any]) -> tuple[Outcome, float]:
    """Answer of a solver at the true constants, and its processor time."""
    made = layered_block(WIDTH, LAYERS, mesh["across"], mesh["per_layer"], mesh["element"], mesh["grading"])
    constants = {name: value for name, value in TRUTH["constants"].items() if name.startswith("mu")}
    context = deck_context(body(control, values), made, "mesh.inp", constants, EXPERIMENT["material"])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_text(folder / "mesh.inp", format_mesh(made))
        write_text(folder / "deck.inp", render_deck("block.inp.j2", context, template_folders()))
        start = processor_time()
        outcome = get_solver(solver).solve(folder / "deck.inp", folder, 1)
        return outcome, processor_time() - start


def one_deck() -> list[str]:
    """Displacements of one deck with both solvers."""
    rows = []
    for control, values in (("displacement", EXPERIMENT["displacement"]), ("force", TRUTH["force"])):
        (ours, fast), (theirs, slow) = (solve(s, control, values, BOTH) for s in ("builtin", "calculix"))
        if ours.status != theirs.status or ours.steps != theirs.steps:
            raise SystemExit(f"{control}: {ours.message} / {theirs.message}")
        depth = np.abs(theirs.indenter).max()
        apart = np.abs(ours.displacement - theirs.displacement).max() / depth
        force = np.abs(ours.reaction[:, 1] / theirs.reaction[:, 1] - 1).max()
        rows.append([control, f"{apart:.1e}", f"{force:.1e}", f"{fast:.2f} s", f"{slow:.2f} s", f"{slow / fast:.1f}"])
    return [
        "## Two solvers, one deck",
        "",
        "The same mesh at the true constants, seven steps to 3.5 mm; largest difference over all nodes and steps, and",
        "processor time:",
        "",
        *table(
            ["control", "displacement / indentation", "reaction, relative", "builtin", "calculix", "times as long"],
            rows,
        ),
    ]


def data_mesh() -> list[str]:
    """What halving the elements of the data's mesh changes, and how stiff the meshes of the fit are."""
    settings = config_of("config.yaml")["model"]
    data = TRUTH["mesh"]
    finer = {**data, "across": data["across"] * 3 // 2, "per_layer": data["per_layer"] * 3 // 2}
    meshes = {
        "data, CalculiX (sealed file)": None,
        "data": data,
        "data, 1.5 times as fine": finer,
        "search": settings["mesh"],
        "last steps": settings["refined"],
        "paper's": {"element": "CPE8", "across": 6, "per_layer": 2, "grading": 1.0},
    }
    at = [EXPERIMENT["displacement"].index(d) for d in (2.0, 3.5)]
    forces, times = {}, {}
    for name, mesh in meshes.items():
        if mesh is None:
            forces[name], times[name] = np.array(TRUTH["force"])[at] / THICKNESS, None
            continue
        outcome, times[name] = solve("builtin", "displacement", EXPERIMENT["displacement"], mesh)
        forces[name] = -outcome.reaction[at, 1] / THICKNESS
    rows = []
    for name, mesh in meshes.items():
        kind = mesh or data
        change = [
            f"{100 * (f / reference - 1):+.2f} %" for f, reference in zip(forces[name], forces["data"], strict=True)
        ]
        rows.append(
            [
                name,
                f"{kind['element']} {kind['across']}x{3 * kind['per_layer']}, grading {kind['grading']:g}",
                *[f"{f:.4f} ({c})" for f, c in zip(forces[name], change, strict=True)],
                "-" if times[name] is None else f"{times[name]:.2f} s",
            ]
        )
    return [
        "## How fine the meshes are",
        "",
        "Reaction at the true constants in N per mm of thickness, and its difference from that of the data's mesh,",
        "by the built-in solver unless it says otherwise, and its processor time:",
        "",
        *table(["mesh", "elements", "at 2 mm", "at 3.5 mm", "time"], rows),
    ]


def profile() -> list[str]:
    """Where the time of a cold run goes, from Snakemake's own records of its jobs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "config.yaml").write_text(yaml.safe_dump(config_of("config.yaml"), sort_keys=False))
        command = [str(Path(sys.executable).parent / "snakemake"), "-s", str(ROOT / "Snakefile"), "--cores", "2"]
        command += ["--workflow-profile", str(ROOT / "workflow/profiles/default")]
        start = time.time()
        subprocess.run(command, cwd=folder, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
        wall = time.time() - start
        jobs: dict[str, list[tuple[float, float]]] = {}
        for path in (folder / ".snakemake/metadata").rglob("*"):
            if path.is_file():
                job = json.loads(path.read_text(encoding="utf-8"))
                jobs.setdefault(job["rule"], []).append((job["starttime"] - start, job["endtime"] - start))
        rounds = len(list(folder.glob("results/*/*/rounds/*.json")))
        count = len(list(folder.glob("results/*/sims/*/solution.npz")))
    plain = fitted(config_of("config.yaml"))
    busy = {rule: union(spans) for rule, spans in jobs.items()}
    everything = union([span for spans in jobs.values() for span in spans])
    first, last = (pick(t for spans in jobs.values() for span in spans for t in span) for pick in (min, max))
    gaps = last - first - everything
    alone = plain.seconds
    rows = [
        ["start of Snakemake, to the first job", f"{first:.1f} s", ""],
        ["prepare", f"{busy['prepare']:.1f} s", ""],
        ["propose", f"{busy['propose']:.1f} s", f"{alone['propose']:.1f} s"],
        ["simulate", f"{busy['simulate']:.1f} s", f"{alone['simulate']:.1f} s"],
        ["between jobs: Snakemake walks the rounds", f"{gaps:.1f} s", ""],
        [
            "estimate and plot, side by side",
            f"{union(jobs['estimate'] + jobs['plot']):.1f} s",
            f"{alone['estimate']:.1f} s",
        ],
        ["end", f"{wall - last:.1f} s", ""],
        ["**all**", f"**{wall:.1f} s**", f"**{sum(alone.values()):.1f} s**"],
    ]
    spans, solved = sum(b - a for a, b in jobs["simulate"]), len(jobs["simulate"])
    return [
        "## Where the time goes",
        "",
        f"`snakemake --cores 2` from nothing: {rounds} rounds, {count} simulations. Beside it, the same fit in one",
        "process without Snakemake, one simulation after the other, in processor time (`benchmarks/fitting.py`):",
        "",
        *table(["part", "workflow, 2 cores", "one process, 1 core"], rows),
        "",
        f"A round costs {gaps / rounds:.2f} s between jobs and {busy['propose'] / rounds:.2f} s of `propose`. A job of",
        f"`simulate` takes {spans / solved:.2f} s; a solve on its own {alone['simulate'] / count:.2f} s.",
        f"There are {solved} such jobs: `propose` solves the other simulations itself.",
    ]


def union(spans: Sequence[tuple[float, float]]) -> float:
    """Length of time that any of the spans covers."""
    total, end = 0.0, -np.inf
    for first, last in sorted(spans):
        total += max(0.0, last - max(first, end))
        end = max(end, last)
    return total


PARTS = {"paper": paper_mesh, "study": agreement, "deck": one_deck, "mesh": data_mesh, "time": profile}


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=f"of {', '.join(PARTS)}; all when left out")
    CACHE.mkdir(exist_ok=True)
    for part in parser.parse_args().parts:
        load = os.getloadavg()[0]
        section = "\n".join([*PARTS[part](), "", f"Load of the machine when this began: {load:.1f}."]) + "\n"
        write_text(CACHE / f"phantom_{part}.md", section)
        print(section, flush=True)
    head = "# The phantom study in figures\n\nMade by `benchmarks/phantom.py` (`make benchmark`) on two cores.\n"
    made = [CACHE / f"phantom_{part}.md" for part in PARTS]
    sections = [path.read_text(encoding="utf-8") for path in made if path.exists()]
    (ROOT / "benchmarks/phantom.md").write_text("\n".join([head, *sections]))


if __name__ == "__main__":
    main()
