"""Slopes to first order against whole simulations, by every number of the catalogue that changes a deck in the plane.

    python benchmarks/slopes.py

writes benchmarks/slopes.md. The body is the phantom's: 12 mm wide, three layers, glued, pressed by 13 % in two steps.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from running import ROOT, machine

from fingerfit.core.errors import FingerfitError
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.forward.bodies import deck_of_body
from fingerfit.mesh.blocks import layered_block
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import NUMERICS, Effect
from fingerfit.model.scales import bound, scales
from fingerfit.solvers.builtin import BuiltinSolver
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.study import Body, Layer, Noise, Step, Study

LAYERS = (("top", 4.0), ("middle", 4.0), ("bottom", 4.0))
BASE = {"mu_top": 2.11e-2, "mu_middle": 3.57e-2, "mu_bottom": 6.56e-2, "alpha": 1.4, "poisson": 0.49}
CONTROLS = {"force": (20.0, 40.0), "displacement": (0.8, 1.6)}
STEP, PRESENT = 0.003, 3.0
"""Step of a slope, as a share of a number's scale: that of the first pass. And how much there is of each size, in steps
of the catalogue, within its bounds."""
HEAD = """# Slopes to first order

Made by `python benchmarks/slopes.py`; do not edit. Every number of an effect of the catalogue that changes a deck in
the plane, on the phantom (three layers, 6 x 6 CPE8H that shrink towards the edges, pressed by 13 % in two steps). There
is three times as much of each size as a step of the catalogue, at the first of its places. Each number is moved by
0.003 of its scale to one side, as the first pass of the diagnosis does; the answer to first order is compared with a
simulation. *Off* is what it leaves out of displacements and reactions, over what they change by (norms). A dash: in a
diagnosis this guess is simulated. *Still*: it changes nothing here.

"""


def study_of(control: str) -> Study:
    """The phantom under forces in N, or indentations in mm."""
    steps = tuple(Step(n, **{control: value, "time": 10.0 * n}) for n, value in enumerate(CONTROLS[control], 1))
    body = Body(tuple(Layer(*layer) for layer in LAYERS), width=12.0, thickness=70.0)
    return Study(Path("study.yaml"), "phantom", control, steps, None, Noise(), body, "held", "glued")


def deck_text(study: Study, mesh: Mesh, effects: Mapping[str, Effect], values: Mapping[str, float]) -> str:
    """The deck of a guess; one whose nodes are moved has its mesh in it."""

    def deck_of(body: Mesh) -> str:
        context = deck_context(study, body, "mesh.inp", values, {}, effects)
        return render_deck("block.inp.j2", context, [ROOT / "templates"])

    return deck_of_body(study, mesh, "mesh.inp", effects, values, deck_of)


def flat(outcome: Outcome) -> np.ndarray:
    """Displacements in mm and, in units that make them as large, reactions."""
    return np.concatenate([outcome.displacement.ravel(), outcome.reaction.ravel() / 20.0])


def off(folder: Path, study: Study, mesh: Mesh, effects: dict[str, Effect], effect: Effect, name: str) -> str:
    """By one number of an effect: what an answer leaves out, in words."""
    solver = BuiltinSolver()
    if effect.shares_of:
        return "not measured here"
    sizes = {p.name: min(PRESENT * p.step, 0.9 * (p.upper - p.null)) + p.null for p in effect.parameters}
    own = {effect.key(key): value for key, value in sizes.items()} | effect.places()[0]
    low, high = effect.bounds()[name]
    scale = next((p.scale for p in effect.parameters if p.name == name), high - low)
    key, step = effect.key(name), STEP * scale
    there = own | {key: own[key] + (step if own[key] + step <= high else -step)}
    try:
        known, moved = (deck_text(study, mesh, effects, BASE | values) for values in (own, there))
        if known == moved:
            return "still"
        found = []
        for text in (known, moved):
            (folder / "deck.inp").write_text(text)
            found.append(solver.solve(folder / "deck.inp", folder))
    except FingerfitError:
        return "no deck"
    if any(one.status != CONVERGED for one in found):
        return "no solution"
    (answer,) = solver.first_order(folder, known, found[0], [moved])
    change = flat(found[1]) - flat(found[0])
    if answer is None:
        return "-"
    if not np.linalg.norm(change) > 1e-6 * np.linalg.norm(flat(found[0])):
        return "still"
    return f"{np.linalg.norm(flat(answer) - flat(found[1])) / np.linalg.norm(change):.1g}"


def main() -> None:
    mesh = layered_block(12.0, LAYERS, 6, 2, "CPE8H", 4.0)
    rows = list[tuple[str, ...]]()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "mesh.inp").write_text(format_mesh(mesh))
        for name, effect in catalogue().items():
            if effect.acts == NUMERICS or not effect.simulated or effect.series or name.endswith("_in_space"):
                continue
            for number in (*(p.name for p in effect.parameters), *effect.refine):
                row = [f"`{name}.{number}`"]
                for control in CONTROLS:
                    study = study_of(control)
                    effects = bound(catalogue(), scales(study, np.ptp(mesh.body, axis=0)), control)
                    row.append(off(folder, study, mesh, effects, effects[name], number))
                if any(cell[:1].isdigit() or cell == "-" for cell in row[1:]):
                    rows.append(tuple(row))
                print(*row)
    table = ["| number | off, under a force | off, under displacements |", "|---|---|---|"]
    table += [f"| {' | '.join(row)} |" for row in rows]
    text = HEAD + f"{machine()}\n\n" + "\n".join(table) + "\n"
    (ROOT / "benchmarks/slopes.md").write_text(text)


if __name__ == "__main__":
    main()
