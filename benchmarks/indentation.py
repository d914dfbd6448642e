"""A rigid sphere pressed into a finger-like body of tetrahedra: the built-in solver against CalculiX.

    python benchmarks/indentation.py

writes benchmarks/indentation.md. The sphere is an analytical surface for one and a rigid patch of bricks for the other;
nodes against surface, the same linear pressure over overclosure, five steps. CalculiX cannot begin with a force: its
first step in force control is in displacement control, to where the built-in solver gets with the first force.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from finger import RADIUS, STIFFNESS, write_finger
from running import ROOT, Run, machine, run_solver

HEAD = f"""# Indentation of a finger-like body

Made by `make benchmark-indentation`; do not edit. Skin, tissue and bone (Ogden with nu = 0.45; E = 10 000 MPa), held at
its end and at the back, a rigid sphere of {RADIUS} mm in frictionless contact, {STIFFNESS:g} MPa/mm, five steps. Both
programs in turn; times with the loading of libraries. Differences are the largest ones of all steps: of the force (in
force control, of the sphere's way) relative to its value, and of displacements in mm. CalculiX begins force control
with a step in displacement control, because it does not find the contact otherwise. *Facets* are the elements along a
side of CalculiX's sphere, a patch of 130 degrees; the built-in solver has a round one. With twice as many the force
differs by a third, displacements by four fifths as much.

"""


@dataclass(frozen=True)
class Case:
    """What is solved: element, bricks along each side (six tetrahedra each), control, depth in mm.

    `patch` are the bricks along each side of CalculiX's sphere, 0 where it is not asked.
    """

    element: str
    cells: int
    control: str
    depth: float
    patch: int


CASES = (
    Case("C3D4", 18, "displacement", 2.0, 36),
    Case("C3D4", 18, "force", 2.0, 36),
    Case("C3D4", 18, "displacement", 4.0, 0),
    Case("C3D10", 6, "displacement", 2.0, 36),
    Case("C3D10", 9, "displacement", 2.0, 0),
    Case("C3D4", 9, "displacement", 2.0, 36),
    Case("C3D4", 18, "displacement", 2.0, 72),
)


def measure(case: Case, known: dict[tuple, Run], threads: int) -> dict:
    """Run a case; forces are those that the same case took in displacement control."""
    depths = [case.depth * n / 5 for n in range(1, 6)]
    cells = (case.cells,) * 3
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        values, first = depths, depths
        if case.control == "force":
            driven = known[case.element, case.cells, "displacement", case.depth].outcome
            values = (-driven.reaction[:, 1]).tolist()
        count = write_finger(folder / "deck.inp", case.control, values, case.element, cells, meshed=0)
        ours = run_solver("builtin", folder / "deck.inp", threads)
        known[case.element, case.cells, case.control, case.depth] = ours
        row = {"case": case, "nodes": count, "ours": ours, "theirs": None}
        if not case.patch or ours.outcome.steps < 5:
            return row
        if case.control == "force":
            first = (-ours.outcome.indenter[:1, 1]).tolist()
        write_finger(
            folder / "mesh.inp", case.control, [*first[:1], *values[1:]], case.element, cells, meshed=case.patch
        )
        theirs = run_solver("ccx", folder / "mesh.inp", threads)
    row["theirs"] = theirs
    steps = theirs.outcome.steps
    what = "reaction" if case.control == "displacement" else "indenter"
    a, b = (getattr(run.outcome, what)[:steps, 1] for run in (ours, theirs))
    row["force"] = float(np.abs(a / b - 1).max())
    gap = ours.outcome.displacement[:steps, :count] - theirs.outcome.displacement[:, :count]
    row["gap"] = float(np.linalg.norm(gap, axis=2).max())
    return row


def table(rows: list[dict], threads: int) -> str:
    """Markdown of what was measured."""
    lines = [*HEAD.splitlines(), f"Measured on {machine()}; threads: {threads}.", ""]
    lines += [
        "| elements | nodes | control | depth, mm | built-in, s | iterations | facets | CalculiX, s | ratio |"
        " force or way | displacement, mm | memory, MB |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        case, ours, theirs = row["case"], row["ours"], row["theirs"]
        reached = "" if ours.outcome.steps == 5 else f" ({ours.outcome.steps} of 5 steps)"
        line = (
            f"| {6 * case.cells**3} {case.element} | {row['nodes']} | {case.control} | {case.depth:g}{reached} |"
            f" {ours.first:.1f} | {sum(ours.outcome.iterations)} |"
        )
        if theirs is None:
            lines.append(f"{line} | | | | | {ours.memory:.0f} |")
            continue
        stopped = "" if theirs.outcome.steps == 5 else f" ({theirs.outcome.steps} of 5 steps)"
        lines.append(
            f"{line} {case.patch} | {theirs.seconds:.1f}{stopped} | {theirs.seconds / ours.first:.1f} |"
            f" {100 * row['force']:.2f} % | {row['gap']:.3f} | {ours.memory:.0f} / {theirs.memory:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/indentation.md")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    rows: list[dict] = []
    known: dict[tuple, Run] = {}
    for case in CASES:
        rows.append(measure(case, known, args.threads))
        args.out.write_text(table(rows, args.threads))
        print(args.out.read_text(encoding="utf-8").splitlines()[-1], flush=True)


if __name__ == "__main__":
    main()
