"""What is hidden in a fingertip, found or not: a model of one tissue, fixed phalanxes, friction, a dermis.

    python benchmarks/fingertip_hidden.py [--only NAME ...] [--threads N] [--keep FOLDER]

writes benchmarks/fingertip_hidden.md. Data: the reference finger on a finer mesh, small
volumes of two steps, of which the second one is fitted. Finished cases are kept in benchmarks/.cache.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from hidden_effects import rungs_of
from running import ROOT, machine

from fingerfit.anatomy.finger import PULP, finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import write_json, write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings
from fingerfit.virtual.experiment import solve, write_study
from fingerfit.virtual.file import read_truth

CACHE = ROOT / "benchmarks/.cache/fingertip_hidden"
EPIDERMIS, TISSUE, DERMIS = 0.138, 0.00798, 0.04
"""MPa; the first two of Tada, Nagai and Maeno (2006)."""
MESHES = {"true": (2.0, PULP), "model": (5.0, (0.2, 2.0)), "refined": (3.0, PULP)}
"""Size and pulp of the C3D10H, as `finger_mesh` takes them: the model's cost a quarter of a fit's."""
HELD = {"base": "held", "indenter": "slides"}
MU = {"unit": "MPa", "lower": 0.001, "upper": 1.0, "log": True}


@dataclass(frozen=True)
class Case:
    """What is hidden, and the model that does not know of it.

    `anatomy` is that of both where it is not the reference's; `constants` are fitted, from these starts; `depth` of
    the indenter at both steps in mm.
    """

    effect: str
    hidden: dict[str, Any] = field(default_factory=dict)
    template: str = "fingertip.inp.j2"
    anatomy: dict[str, float] = field(default_factory=dict)
    constants: tuple[tuple[str, float], ...] = (("mu_epidermis", 0.2), ("mu_subcutaneous", 0.012))
    depth: tuple[float, float] = (1.2, 2.4)


CASES = {
    "a model of one tissue": Case("layers", constants=(("mu", 0.02),)),
    "phalanxes wrongly fixed": Case("bone_mobility", template="fingertip_fixed.inp.j2"),
    "friction under the indenter": Case("friction", {"friction": {"coefficient": 0.5}}),
    "friction, deeper": Case("friction", {"friction": {"coefficient": 0.5}}, depth=(1.8, 3.6)),
    "a stiff dermis": Case(
        "dermis", anatomy={"dermis": 0.8, "bone_height": 3.2}, constants=(("mu_epidermis", 0.2), ("mu", 0.012))
    ),
}
HEAD = """# Hidden in a fingertip

Made by `python benchmarks/fingertip_hidden.py`; do not edit. Measured on {machine}. The reference finger on
C3D10H of size {true}, volumes of 96 x 64 x 56 voxels of 0.35 mm at 1.2 and 2.4 mm (*deeper*: 1.8 and 3.6 mm),
noise of 3 % (volumes) and 0.5 % (forces); the second step is fitted, on C3D10H of size {model} and {refined} of
the same finger. Errors are those of the volumes in multiples of what noise alone leaves, fitted / held-out step; mu
errors are those of the constants; *refits* are the misfits per degree of freedom without and with what was tried;
min is on one core.

| hidden | verdict | named | refits | error before | after | mu before | after | numbers | at last | min |
|---|---|---|---|---|---|---|---|---|---|---|
"""


def describe(case: Case, folder: Path) -> Path:
    """The description of a case's experiment, with its meshes."""
    anatomy = replace(Anatomy(), **case.anatomy)
    for name, (size, pulp) in MESHES.items():
        mesh = add_fixtures(finger_mesh(anatomy, size, "C3D10H", pulp=pulp), (anatomy.pulp_centre, 0.0))
        write_text(folder / f"{name}.inp", format_mesh(mesh))
    tissues = [("epidermis", EPIDERMIS, 0.45), ("dermis", DERMIS, 0.6), ("subcutaneous", TISSUE, 0.9)]
    layers = [
        {"name": name, "elements": name.upper(), "mu": mu, "intensity": intensity}
        for name, mu, intensity in tissues
        if name != "dermis" or anatomy.dermis
    ]
    write_json(
        folder / "experiment.yaml",
        {
            "title": "a fingertip",
            "body": {"mesh": "true.inp", "layers": layers, "tissues": {"BONE": 0.6, "NAIL": 0.12}},
            "template": "fingertip.inp.j2",
            "boundary": HELD,
            "material": {"alpha": 1.4, "poisson": 0.48},
            "solver": "builtin",
            "displacement": list(case.depth),
            "picture": {
                "pixels": [96, 64, 56], "spacing": [0.35] * 3, "texture": 0.15, "correlation": 1.0, "noise": 0.03,
                "pictured": [1, 2],
            },
            "noise": {"force": 0.005, "displacement": 0.01},
            "effects": case.hidden,
            "seed": 23,
            "study": {
                "control": "displacement",
                "body": {
                    "mesh": "model.inp",
                    "refined": "refined.inp",
                    "layers": [{"name": one["name"], "elements": one["elements"]} for one in layers],
                },
                "boundary": HELD,
                "pictures": {"gaussian": 0.8},
            },
        },
    )  # fmt: skip
    return folder / "experiment.yaml"


def run_case(case: Case, threads: int, keep: Path | None) -> dict[str, Any]:
    """Hide, fit, diagnose, add, and again."""
    with tempfile.TemporaryDirectory() as name:
        folder = keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        truth = read_truth(describe(case, folder))
        if not (folder / "study/study.yaml").exists():
            (folder / "body").mkdir(exist_ok=True)
            write_study(truth, solve(truth, folder / "body", threads), folder / "study")
            shutil.copytree(ROOT / "studies/fingertip/effects", folder / "study/effects")
        began = time.perf_counter()
        settings = {
            "study": str(folder / "study"),
            "model": {
                "template": case.template,
                "material": truth.material,
                "parameters": {constant: {**MU, "start": start} for constant, start in case.constants},
            },
            "fit": {
                "score": "likelihood",
                "steps": [2],
                "replicates": 20,
                "stages": [{"name": "independent", "kind": "independent", "step": 0.4, "tolx": 0.3, "tolf": 50.0}],
            },
        }
        problem, everything = begin(load_settings(settings), folder / "model")
        rungs = rungs_of(problem, everything, truth, threads, 2)
        return {"rungs": rungs, "minutes": (time.perf_counter() - began) / 60}


def row(name: str, found: dict[str, Any]) -> str:
    """A line of the table."""
    first, last = found["rungs"][0], found["rungs"][-1]
    added = len(found["rungs"]) > 1

    def error(rung: dict[str, Any]) -> str:
        return f"{rung['fitted']:.2f} / {rung['held_out']:.2f}"

    def constants(rung: dict[str, Any]) -> str:
        return ", ".join(f"{n} {100 * e:+.1f} %" for n, e in rung["errors"].items()) or "-"

    refits = ", ".join(f"{n} {misfit:.2f}" for n, (misfit, _, _) in first["refits"].items())
    numbers = ", ".join(f"{n} {v:.3g}" for n, v in last["values"].items() if "." in n) or "-"
    return (
        f"| {name} | {first['verdict']} | {' or '.join(first['named']) or '-'} | {first['misfit']:.2f} -> {refits} |"
        f" {error(first)} | {error(last) if added else '-'} | {constants(first)} |"
        f" {constants(last) if added else '-'} | {numbers} | {last['verdict']} | {found['minutes']:.0f} |"
    )


def main() -> None:
    """Run what is not kept yet and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=CASES, help="names of cases")
    parser.add_argument("--keep", type=Path, help="folder that keeps simulations for another run")
    args = parser.parse_args()
    meshes = {name: f"{size:g}" for name, (size, _) in MESHES.items()}
    text = HEAD.format(machine=machine(), **meshes)
    for name, case in CASES.items():
        slug = name.replace(" ", "_").replace(",", "")
        path = CACHE / f"{slug}.json"
        if not path.exists() and (args.only is None or name in args.only):
            try:
                write_json(path, run_case(case, args.threads, args.keep and args.keep / slug))
            except FingerfitError as error:
                print(name, error, flush=True)
        if path.exists():
            text += row(name, json.loads(path.read_text(encoding="utf-8"))) + "\n"
            print(text.splitlines()[-1], flush=True)
            write_text(ROOT / "benchmarks/fingertip_hidden.md", text)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
