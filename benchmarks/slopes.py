"""Slopes to first order against whole simulations, by every number of the catalogue that changes a deck in the plane.

    python benchmarks/slopes.py

writes benchmarks/slopes.md. The body is the phantom's: 12 mm wide, three layers, glued, pressed by 13 % in two steps.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from running import ROOT, machine
from solver import LAYERS, MU, phantom

from fingerfit.core.errors import FingerfitError
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.diagnosis.first_pass import NEAR
from fingerfit.forward.bodies import deck_of_body
from fingerfit.mesh.blocks import layered_block
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import NUMERICS, Effect
from fingerfit.model.scales import bound, scales
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.study import Study

BASE = MU | {"alpha": 1.4, "poisson": 0.49}
CONTROLS = {"force": (20.0, 40.0), "displacement": (0.8, 1.6)}
PRESENT = 3.0
"""How much there is of each size, in steps of the catalogue, within its bounds: as much as a refit may have on its way.
A choice."""
HEAD = f"""# Slopes to first order

Made by `python benchmarks/slopes.py`; do not edit. Every number of an effect of the catalogue that changes a deck in
the plane, on the phantom (three layers, 6 x 6 CPE8H that shrink towards the edges, pressed by 13 % in two steps). There
is three times as much of each size as a step of the catalogue, at the first of its places. Each number is moved by
{NEAR:g} of its scale to one side, as the first pass of the diagnosis does; the answer to first order is compared with a
simulation. *Off* is what it leaves out of displacements and reactions, over what they change by (norms). A dash: in a
diagnosis this guess is simulated. *Still*: it changes nothing here. *Not measured here*: a share of a force, where none
was measured.

"""


def deck_text(study: Study, mesh: Mesh, effects: Mapping[str, Effect], values: Mapping[str, float]) -> str:
    """The deck of a guess; one whose nodes are moved has its mesh in it."""

    def deck_of(body: Mesh) -> str:
        context = deck_context(study, body, "mesh.inp", values, {}, effects)
        return render_deck("block.inp.j2", context, [ROOT / "templates"])

    return deck_of_body(study, mesh, "mesh.inp", effects, values, deck_of)


def flat(outcome: Outcome) -> np.ndarray:
    """Displacements in mm and, in units that make them as large, reactions."""
    return np.concatenate([outcome.displacement.ravel(), outcome.reaction.ravel() / 20.0])


def off(folder: Path, study: Study, mesh: Mesh, effects: dict[str, Effect], effect: Effect) -> dict[str, str]:
    """What answers leave out, in words, by the numbers of an effect."""
    numbers = [*(p.name for p in effect.parameters), *effect.refine]
    if effect.shares_of:
        return dict.fromkeys(numbers, "not measured here")
    sizes = {p.name: min(PRESENT * p.step, 0.9 * (p.upper - p.null)) + p.null for p in effect.parameters}
    own = {effect.key(name): size for name, size in sizes.items()} | effect.places()[0]
    solver, bounds, scale = BuiltinSolver(), effect.bounds(), {p.name: p.scale for p in effect.parameters}

    def solved(text: str) -> Outcome:
        (folder / "deck.inp").write_text(text)
        return solver.solve(folder / "deck.inp", folder)

    def by_one(name: str) -> str:
        low, high = bounds[name]
        key, step = effect.key(name), NEAR * scale.get(name, high - low)
        there = own[key] + (step if own[key] + step <= high else -step)
        moved = deck_text(study, mesh, effects, BASE | own | {key: there})
        if moved == known:
            return "still"
        found = solved(moved)
        if not found.status == here.status == CONVERGED:
            return "no solution"
        (answer,) = solver.first_order(folder, known, here, [moved])
        change = flat(found) - flat(here)
        if answer is None:
            return "-"
        if not np.linalg.norm(change) > 1e-6 * np.linalg.norm(flat(here)):
            return "still"
        return f"{np.linalg.norm(flat(answer) - flat(found)) / np.linalg.norm(change):.1g}"

    try:
        known = deck_text(study, mesh, effects, BASE | own)
        here = solved(known)
        return {name: by_one(name) for name in numbers}
    except FingerfitError:
        return dict.fromkeys(numbers, "no deck")


def main() -> None:
    mesh = layered_block(12.0, LAYERS, 6, 2, "CPE8H", 4.0)
    rows = dict[str, list[str]]()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "mesh.inp").write_text(format_mesh(mesh))
        for control, values in CONTROLS.items():
            study = phantom(control, values)
            study = replace(study, steps=tuple(replace(step, time=10.0 * step.number) for step in study.steps))
            effects = bound(catalogue(), scales(study, np.ptp(mesh.body, axis=0)), control)
            for name, effect in catalogue().items():
                if effect.acts == NUMERICS or not effect.simulated or effect.series or name.endswith("_in_space"):
                    continue
                for number, words in off(folder, study, mesh, effects, effects[name]).items():
                    rows.setdefault(f"`{name}.{number}`", []).append(words)
    table = ["| number | off, under a force | off, under displacements |", "|---|---|---|"]
    for number, cells in rows.items():
        if any(cell[:1].isdigit() or cell == "-" for cell in cells):
            table.append(f"| {number} | {' | '.join(cells)} |")
    (ROOT / "benchmarks/slopes.md").write_text(HEAD + f"{machine()}\n\n" + "\n".join(table) + "\n")


if __name__ == "__main__":
    main()
