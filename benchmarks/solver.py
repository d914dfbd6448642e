"""The built-in solver against CalculiX on the same decks, alternating: times, answers, memory, growth with the mesh.

    python benchmarks/solver.py

writes benchmarks/solver.md. The decks are the phantom's: 12 mm wide, three layers, glued, seven steps to 3.5 mm.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from running import ROOT, Run, difference, machine, run_solver

from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.mesh.blocks import layered_block
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.study.study import Body, Layer, Noise, Step, Study

LAYERS = (("top", 4.0), ("middle", 4.0), ("bottom", 4.0))
MU = {"mu_top": 2.11e-2, "mu_middle": 3.57e-2, "mu_bottom": 6.56e-2}
INDENTATION = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5)
HEAD = """# The built-in solver against CalculiX

Made by `make benchmark-solver`; do not edit. The phantom (CPE8, three layers, glued, seven steps to 3.5 mm) on the same
decks, the programs in turn, the median of so many runs. Times are of the processor, from deck to displacements; *first*
is the built-in solver with the loading of its libraries, once in a process. CalculiX runs twice: as it stops by itself,
at half a percent of the mean force (*default*, which the ratio is to), and as the adapter tells it, at 1e-5 (*adapter*,
what `solver: calculix` does). Differences are the largest ones of any displacement in any step over the indentation;
those of *default* are CalculiX's own error.

"""
CASES = (("force", 6, 5), ("force", 12, 3), ("force", 24, 1), ("displacement", 6, 3), ("displacement", 12, 1))
"""Control, elements along each side, repetitions."""


def phantom(control: str, values: Sequence[float]) -> Study:
    """The phantom under forces in N, or indentations in mm."""
    steps = tuple(Step(n, **{control: value}) for n, value in enumerate(values, 1))
    body = Body(tuple(Layer(*layer) for layer in LAYERS), width=12.0, thickness=70.0)
    return Study(Path("study.yaml"), "phantom", control, steps, None, Noise(), body, "held", "glued")


def write_phantom(folder: Path, control: str, values: list[float], cells: int) -> Path:
    """Write the phantom's deck in a folder of its own."""
    folder.mkdir()
    study = phantom(control, values)
    mesh = layered_block(12.0, LAYERS, cells, cells // 3)
    context = deck_context(study, mesh, "mesh.inp", MU, {"alpha": 1.4, "poisson": 0.495})
    (folder / "mesh.inp").write_text(format_mesh(mesh))
    (folder / "deck.inp").write_text(render_deck("block.inp.j2", context, [ROOT / "templates"]))
    return folder / "deck.inp"


def measure(folder: Path, control: str, cells: int, repetitions: int, threads: int) -> dict:
    """Both solvers in turn on one deck."""
    deck = write_phantom(folder / f"displacement{cells}", "displacement", list(INDENTATION), cells)
    if control == "force":
        found = BuiltinSolver().solve(deck, folder)
        deck = write_phantom(folder / f"force{cells}", "force", (-found.reaction[:, 1]).tolist(), cells)
    ours: list[Run] = []
    theirs: list[Run] = []
    for _ in range(repetitions):
        ours.append(run_solver("builtin", deck, threads))
        theirs.append(run_solver("default", deck, threads))
    exact = run_solver("calculix", deck, threads)
    mesh_nodes = ours[0].outcome.displacement.shape[1]
    return {
        "control": control,
        "cells": cells,
        "unknowns": 2 * mesh_nodes,
        "ours": statistics.median(run.busy for run in ours),
        "theirs": statistics.median(run.busy for run in theirs),
        "ratio": statistics.median(b.busy / a.busy for a, b in zip(ours, theirs, strict=True)),
        "first": statistics.median(run.cpu for run in ours),
        "adapter": exact.busy,
        "default": difference(ours[0].outcome, theirs[0].outcome) / INDENTATION[-1],
        "difference": difference(ours[0].outcome, exact.outcome) / INDENTATION[-1],
        "memory": (max(run.memory for run in ours), max(run.memory for run in theirs)),
        "iterations": sum(ours[0].outcome.iterations),
        "steps": (ours[0].outcome.steps, theirs[0].outcome.steps),
        "repetitions": repetitions,
    }


def growth(rows: list[dict], key: str) -> float:
    """Exponent of the time over the number of unknowns in force control."""
    chosen = [row for row in rows if row["control"] == "force"]
    return float(np.polyfit(np.log([r["unknowns"] for r in chosen]), np.log([r[key] for r in chosen]), 1)[0])


def table(rows: list[dict], threads: int) -> str:
    """Markdown of what was measured."""
    lines = [
        *HEAD.splitlines(),
        f"Measured on {machine()}; threads: {threads}.",
        "",
        "| control | elements | unknowns | built-in, s | first, s | default, s | ratio | adapter, s | difference |"
        " default's | iterations | memory, MB | runs |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        memory = " / ".join(f"{value:.0f}" for value in row["memory"])
        lines.append(
            f"| {row['control']} | {row['cells']} x {row['cells']} | {row['unknowns']} | {row['ours']:.2f} |"
            f" {row['first']:.2f} |"
            f" {row['theirs']:.1f} | {row['ratio']:.1f} | {row['adapter']:.1f} | {row['difference']:.1e} |"
            f" {row['default']:.1e} | {row['iterations']} |"
            f" {memory} | {row['repetitions']} |"
        )
    ours, theirs = growth(rows, "ours"), growth(rows, "theirs")
    lines += [
        "",
        f"Time grows as unknowns to the power {ours:.2f} (built-in) and {theirs:.2f} (CalculiX), in force control.",
    ]
    for row in rows:
        if row["steps"] != (7, 7):
            lines.append(
                f"{row['control']} {row['cells']}: steps reached {row['steps'][0]} and {row['steps'][1]} of 7."
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/solver.md")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    rows = []
    for control, cells, repetitions in CASES:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure(Path(folder), control, cells, repetitions, args.threads))
        print({key: value for key, value in rows[-1].items() if key != "repetitions"}, flush=True)
    args.out.write_text(table(rows, args.threads))
    print(args.out)


if __name__ == "__main__":
    main()
