"""A rigid sphere pressed into a finger-like body of tetrahedra: the built-in solver against CalculiX.

    python benchmarks/indentation.py

writes benchmarks/indentation.md. Nodes against surface, the same linear pressure over overclosure, five steps; the
sphere is the same rigid patch of bricks for both, or round for the built-in solver. CalculiX cannot begin with a force:
its first step in force control is in displacement control, to where the built-in solver gets with the first force.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from finger import RADIUS, STIFFNESS, write_finger
from running import ROOT, Run, machine, run_solver

from fingerfit.deck.reader import read_deck
from fingerfit.fem.newton import Load, State
from fingerfit.fem.path import LoadPath
from fingerfit.solvers.analysis import model_of
from fingerfit.solvers.contract import Outcome

HEAD = f"""# Indentation of a finger-like body

Made by `make benchmark-indentation`; do not edit. Skin, tissue and bone (Ogden with nu = 0.45; E = 10 000 MPa), held at
its end and at the back, a rigid sphere of {RADIUS} mm in frictionless contact, {STIFFNESS:g} MPa/mm, five steps. Both
programs in turn; times are of the processor, with the loading of libraries. *Facets* are the elements along a side of
the sphere's patch of 130 degrees, CalculiX's / the built-in solver's. Differences are the largest ones of all steps: of
the force (in force control, of the sphere's way) relative to its value, and of displacements in mm. CalculiX begins
force control with a step in displacement control, because it does not find the contact otherwise.

On facets the answer is not unique: a node may rest on either side of an edge between two. *Settled* is how far any
node moves when the built-in solver starts from CalculiX's answer to each step instead of its own. What is left:
CalculiX takes the areas of deformed faces for the contact, the built-in solver those of the reference state, which can
be enough for a node near an edge to change its facet; and
CalculiX 2.20 gives the corners of six-node faces the area of the sphere's facet
(docs/decisions/0010-meshed-rigid-surfaces.md).

"""


@dataclass(frozen=True)
class Case:
    """What is solved: element, bricks along each side (six tetrahedra each), control, depth in mm.

    `facets` are the bricks along each side of CalculiX's sphere, 0 where it is not asked, and of the built-in solver's,
    0 where that is round.
    """

    element: str
    cells: int
    control: str
    depth: float
    facets: tuple[int, int]


CASES = (
    Case("C3D4", 18, "displacement", 2.0, (36, 36)),
    Case("C3D4", 18, "force", 2.0, (36, 36)),
    Case("C3D4", 18, "displacement", 2.0, (72, 72)),
    Case("C3D4", 18, "displacement", 2.0, (36, 0)),
    Case("C3D4", 18, "force", 2.0, (36, 0)),
    Case("C3D4", 18, "displacement", 2.0, (144, 0)),
    Case("C3D4", 18, "force", 2.0, (144, 0)),
    Case("C3D4", 18, "displacement", 4.0, (0, 0)),
    Case("C3D4", 18, "force", 4.0, (0, 0)),
    Case("C3D10", 6, "displacement", 2.0, (36, 36)),
    Case("C3D10", 6, "force", 2.0, (36, 36)),
    Case("C3D10", 9, "displacement", 2.0, (0, 0)),
    Case("C3D10", 9, "displacement", 4.0, (0, 0)),
    Case("C3D10", 9, "force", 4.0, (0, 0)),
    Case("C3D4", 9, "displacement", 2.0, (36, 36)),
    Case("C3D4", 12, "displacement", 2.0, (36, 36)),
    Case("C3D4", 24, "displacement", 2.0, (36, 36)),
    Case("C3D10", 18, "displacement", 2.0, (0, 0)),
)


def measure(case: Case, known: dict[tuple, Run], threads: int) -> dict:
    """Run a case; forces are those that the same case took in displacement control."""
    depths = [case.depth * n / 5 for n in range(1, 6)]
    cells = (case.cells,) * 3
    theirs_meshed, ours_meshed = case.facets
    key = case.element, case.cells, case.depth, ours_meshed
    row: dict = {"case": case, "theirs": None}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        values, first = depths, depths
        if case.control == "force":
            values = (-known[key].outcome.reaction[:, 1]).tolist()
        deck = folder / "deck.inp"
        row["nodes"] = write_finger(deck, case.control, values, case.element, cells, ours_meshed)
        row["ours"] = ours = run_solver("builtin", deck, threads)
        if case.control == "displacement":
            known[key] = ours
        if not theirs_meshed or ours.outcome.steps < 5:
            return row
        if case.control == "force":
            first = (-ours.outcome.indenter[:1, 1]).tolist()
        mixed, driven = [*first[:1], *values[1:]], case.control == "force"
        write_finger(folder / "mesh.inp", case.control, mixed, case.element, cells, theirs_meshed, driven)
        row["theirs"] = theirs = run_solver("ccx", folder / "mesh.inp", threads)
        if theirs_meshed == ours_meshed:
            row["settled"] = settle(deck, theirs.outcome, row["nodes"])
    steps = theirs.outcome.steps
    what = "reaction" if case.control == "displacement" else "indenter"
    a, b = (getattr(run.outcome, what)[:steps, 1] for run in (ours, theirs))
    row["force"] = float(np.abs(a / b - 1).max())
    gap = ours.outcome.displacement[:steps, : row["nodes"]] - theirs.outcome.displacement[:, : row["nodes"]]
    row["gap"] = float(np.linalg.norm(gap, axis=2).max())
    return row


def settle(path: Path, outcome: Outcome, count: int) -> float:
    """How far the built-in solver moves any of the first `count` nodes from another one's answers to a deck, mm."""
    deck = read_deck(path)
    model, largest = model_of(deck, path, averaged=False), 0.0
    for step, moved, way in zip(deck.steps, outcome.displacement, outcome.indenter, strict=False):
        load = Load(np.zeros(model.size), np.zeros(model.size))
        held = np.zeros(model.size, dtype=bool)
        for values, target in ((step.displacement, load.given), (step.force, load.force)):
            for (node, axis), value in values.items():
                if model.dof(node, axis) >= 0:
                    target[model.dof(node, axis)] = value
                    held[model.dof(node, axis)] |= target is load.given
        system = model.system(held)
        loading = LoadPath(system)
        start = load.given.copy()
        start[: 3 * count] = moved[:count].ravel()
        start[3 * count : 3 * count + 3] = way
        start = system.expand(start[system.free], load.given)
        evaluation = system.evaluate(start, tangent=False)
        if evaluation is None:
            return float("nan")
        loading.state, loading.load = State(start[system.free], start, evaluation.internal), load
        with np.errstate(all="ignore"):
            arrived, _ = loading.advance(load)
        change = (loading.state.u - start)[: 3 * count].reshape(-1, 3)
        largest = max(largest, float(np.linalg.norm(change, axis=1).max()) if arrived else float("nan"))
    return largest


def growth(rows: list[dict]) -> str:
    """Exponents of the times over the number of unknowns: C3D4 and 36 facets, 2 mm in displacement control."""
    same = [
        row
        for row in rows
        if (row["case"].element, row["case"].control, row["case"].facets) == ("C3D4", "displacement", (36, 36))
    ]
    if len(same) < 3:
        return ""
    unknowns = np.log([row["nodes"] for row in same])
    ours = np.polyfit(unknowns, np.log([row["ours"].cpu for row in same]), 1)[0]
    theirs = np.polyfit(unknowns, np.log([row["theirs"].cpu for row in same]), 1)[0]
    return (
        f"Time grows as unknowns to the power {ours:.2f} (built-in) and {theirs:.2f} (CalculiX):"
        f" C3D4 in displacement control to 2 mm on 36 facets, {len(same)} meshes."
    )


def table(rows: list[dict], threads: int) -> str:
    """Markdown of what was measured."""
    lines = [*HEAD.splitlines(), f"Measured on {machine()}; threads: {threads}.", ""]
    lines += [
        "| elements | nodes | control | depth, mm | facets | built-in, s | iterations | CalculiX, s | ratio |"
        " force or way | displacement, mm | settled, mm | memory, MB |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        case, ours, theirs = row["case"], row["ours"], row["theirs"]
        reached = "" if ours.outcome.steps == 5 else f" ({ours.outcome.steps} of 5 steps)"
        facets = " / ".join(str(n) if n else end for n, end in zip(case.facets, ("-", "round"), strict=True))
        line = (
            f"| {6 * case.cells**3} {case.element} | {row['nodes']} | {case.control} | {case.depth:g}{reached} |"
            f" {facets} | {ours.cpu:.1f} | {sum(ours.outcome.iterations)} |"
        )
        if theirs is None:
            lines.append(f"{line} | | | | | {ours.memory:.0f} |")
            continue
        stopped = "" if theirs.outcome.steps == 5 else f" ({theirs.outcome.steps} of 5 steps)"
        settled = f"{row['settled']:.4f}" if "settled" in row else ""
        lines.append(
            f"{line} {theirs.cpu:.1f}{stopped} | {theirs.cpu / ours.cpu:.1f} |"
            f" {100 * row['force']:.2f} % | {row['gap']:.4f} | {settled} | {ours.memory:.0f} / {theirs.memory:.0f} |"
        )
    return "\n".join([*lines, "", growth(rows)]).strip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/indentation.md")
    parser.add_argument("--threads", type=int, default=1)
    args = parser.parse_args()
    rows: list[dict] = []
    known: dict[tuple, Run] = {}
    for case in CASES:
        rows.append(measure(case, known, args.threads))
        args.out.write_text(table(rows, args.threads))
        lines = args.out.read_text(encoding="utf-8").splitlines()
        print(next(line for line in reversed(lines) if "|" in line), flush=True)


if __name__ == "__main__":
    main()
