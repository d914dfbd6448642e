"""Small studies that are fine, each in a folder with everything that a command may read; the battery damages copies."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from seeds import generator, seed_of

from fingerfit.imaging.pictures import Picture, write_picture

ROOT = Path(__file__).resolve().parents[2]
STEPS = "step,time,displacement,force,picture\n1,1,0.5,7,step_1.mha\n2,2,1.0,14,step_2.mha\n"
STUDY: dict[str, Any] = {
    "title": "t",
    "units": {"length": "mm", "force": "N", "time": "s"},
    "control": "force",
    "steps": "steps.csv",
    "pictures": {"before": "before.mha", "noise": "estimated"},
    "noise": {"force": 0.1, "displacement": 0.01},
    "body": {"width": 12, "thickness": 70, "layers": [{"name": "top", "height": 6}, {"name": "bottom", "height": 6}]},
    "boundary": {"base": "held", "indenter": "glued"},
}
CONFIG: dict[str, Any] = {
    "study": "study",
    "solver": "builtin",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.45},
        "mesh": {"element": "CPE4", "across": 3, "per_layer": 2},
        "refined": {"element": "CPE4", "across": 4, "per_layer": 3},
        "parameters": {"mu": {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}},
    },
    "fit": {"score": "nmi", "steps": [1, 2], "stages": [{"name": "s", "kind": "independent"}]},
}
EFFECT: dict[str, Any] = {
    "title": "an effect",
    "acts": "structure",
    "words": "Something.",
    "look": "Somehow.",
    "confirm": "A test.",
    "parameters": {"size": {"unit": "1", "absent": 0, "lower": -1, "upper": 1, "step": 0.1}},
    "scan": {"place": [1, 2]},
    "refine": {"place": [0.5, 5]},
    "changes": {"field": "size * exp(-x / place)"},
    "observes": {"force": "force * (1 + size)"},
}
EXPERIMENT: dict[str, Any] = {
    "title": "t",
    "body": {
        "width": 12,
        "thickness": 70,
        "layers": [
            {"name": "top", "height": 6, "mu": 0.03, "intensity": 0.5},
            {"name": "bottom", "height": 6, "mu": 0.06, "intensity": 0.9},
        ],
    },
    "material": {"alpha": 1.4, "poisson": 0.45},
    "mesh": {"element": "CPE4", "across": 3, "per_layer": 2, "grading": 1},
    "solver": "builtin",
    "displacement": [0.3, 0.6],
    "picture": {"pixels": 24, "side": 22, "texture": 0.15, "correlation": 2.0, "noise": 0.01, "pictured": [1, 2]},
    "noise": {"force": 0.001, "displacement": 0.01},
    "seed": seed_of(3),
}
TEMPLATE = (ROOT / "templates/block.inp.j2").read_text(encoding="utf-8")
# two squares on top of each other, in the plane
MESH = """*NODE, NSET=ALL
1, 0., 0.
2, 6., 0.
3, 12., 0.
4, 0., 6.
5, 6., 6.
6, 12., 6.
7, 0., 12.
8, 6., 12.
9, 12., 12.
*ELEMENT, TYPE=CPE4, ELSET=LOWER
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*ELEMENT, TYPE=CPE4, ELSET=UPPER
3, 4, 5, 8, 7
4, 5, 6, 9, 8
*NSET, NSET=BOTTOM
1, 2, 3
*NSET, NSET=TOP
7, 8, 9
*NSET, NSET=INDENTER
8
"""
POINTS = "x,y,ux,uy\n3,3,0.01,-0.2\n9,3,0.02,-0.2\n3,9,0.01,-0.4\n9,9,0.02,-0.4\n"


def dump(path: Path, data: Any) -> None:
    """Write YAML."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")


def picture(path: Path, shape: tuple[int, ...] = (30, 30), kind: Any = np.float32, **changes: Any) -> None:
    """Write a picture of noise that holds the body."""
    dim = len(shape)
    frame = {"spacing": np.full(dim, 0.8), "origin": np.full(dim, -5.0), "direction": np.eye(dim)} | changes
    found = frame.pop("values", None)
    noise = generator(sum(path.name.encode())).uniform(0, 4000, shape)
    write_picture(path, Picture(noise if found is None else found, **frame), kind)


def plane(place: Path) -> None:
    """Two layers in the plane with two pictures, an effect of its own, and descriptions of an experiment and a finger."""
    for name in ("before", "step_1", "step_2"):
        picture(place / f"study/{name}.mha")
    (place / "study/steps.csv").write_text(STEPS)
    dump(place / "study/study.yaml", STUDY)
    dump(place / "config.yaml", CONFIG)
    dump(place / "study/effects/own.yaml", EFFECT)
    (place / "study/own.inp.j2").write_text(TEMPLATE)
    dump(place / "experiment.yaml", EXPERIMENT)
    dump(place / "anatomy.yaml", {"length": 34.0, "epidermis": 0.68})


def volume(place: Path) -> None:
    """A brick in volumes."""
    for name in ("before", "step_1", "step_2"):
        picture(place / f"study/{name}.mha", (12, 14, 16), origin=np.full(3, -2.0))
    (place / "study/steps.csv").write_text(STEPS)
    body = {"brick": [8, 7, 6], "layers": [{"name": "body"}]}
    dump(place / "study/study.yaml", {**STUDY, "body": body})
    model = {key: value for key, value in CONFIG["model"].items() if key != "refined"}
    model["mesh"] = {"element": "C3D8", "across": 2, "per_layer": 2}
    dump(place / "config.yaml", {**CONFIG, "model": model})


def meshed(place: Path) -> None:
    """A mesh in a file, with pictures."""
    plane(place)
    (place / "study/mesh.inp").write_text(MESH)
    layers = [{"name": "top", "elements": "UPPER"}, {"name": "bottom", "elements": "LOWER"}]
    dump(place / "study/study.yaml", {**STUDY, "body": {"mesh": "mesh.inp", "thickness": 70, "layers": layers}})
    model = {key: value for key, value in CONFIG["model"].items() if key not in ("mesh", "refined")}
    dump(place / "config.yaml", {**CONFIG, "model": model})
    shutil.rmtree(place / "study/effects")


def points(place: Path) -> None:
    """Points and forces without pictures, by displacement."""
    plane(place)
    for name in ("before", "step_1", "step_2"):
        (place / f"study/{name}.mha").unlink()
    (place / "study/points.csv").write_text(POINTS)
    (place / "study/steps.csv").write_text(
        "step,displacement,force,force_noise,points\n1,0.5,7,0.1,\n2,1.0,14,0.1,points.csv\n"
    )
    data = {key: value for key, value in STUDY.items() if key != "pictures"}
    data |= {"control": "displacement", "noise": {"force": 0.1, "points": 0.02}}
    dump(place / "study/study.yaml", data)
    dump(place / "config.yaml", {**CONFIG, "fit": {**CONFIG["fit"], "score": "likelihood"}})


PLACES: dict[str, Callable[[Path], None]] = {"plane": plane, "volume": volume, "meshed": meshed, "points": points}

CCX = """#!/bin/sh
# stands in for CalculiX: gives the results that lie ready
if [ "$1" = -v ]; then echo "This is Version 2.20"; exit 0; fi
cat "{0}/said.txt"
[ -e "{0}/ready.dat" ] && cp "{0}/ready.dat" deck.dat
exit 0
"""
ABAQUS = """#!/bin/sh
# stands in for ABAQUS: gives the results that lie ready
if [ "$1" = information=release ]; then echo "Abaqus 2024"; exit 0; fi
cat "{0}/said.txt"
[ -e "{0}/ready.fil" ] && cp "{0}/ready.fil" deck.fil
exit 0
"""


def deck(place: Path) -> None:
    """A deck of the body in the plane, and what solvers that stand in for CalculiX and ABAQUS answer to it."""
    from fingerfit.core.files import write_json
    from fingerfit.deck.mesh_file import format_mesh
    from fingerfit.deck.reader import read_deck
    from fingerfit.forward.decks import make_deck
    from fingerfit.model.catalogue import catalogue
    from fingerfit.prepare.prepare import make_mesh
    from fingerfit.settings.config import load_settings
    from fingerfit.solvers.analysis import run_steps
    from fingerfit.solvers.builtin import BuiltinSolver
    from fingerfit.study.reader import load_study

    plane(place)
    settings = load_settings(place / "config.yaml").model_copy(update={"study": str(place / "study")})
    study = load_study(place / "study")
    mesh = make_mesh(study, settings.model.mesh)
    text = make_deck(settings, study, mesh, "mesh", {"mu": 0.1}, catalogue())
    (place / "mesh.inp").write_text(format_mesh(mesh))
    (place / "deck.inp").write_text(text.replace("../../meshes/", ""))
    for name, program in (("ccx", CCX), ("abaqus", ABAQUS)):
        (place / name).write_text(program)
        (place / name).chmod(0o755)
    (place / "said.txt").write_text(" Job finished\n")
    write_json(place / "builtin.json", BuiltinSolver().identity())
    read = read_deck(place / "deck.inp")
    tables, records, time = [], [_record(1921, "6.23-1", "stand-in", "", "", 0, 0, 1.0)], 0.0
    records += [_record(1901, label, *point) for label, point in enumerate(read.mesh.points.tolist(), 1)]
    for number, step in enumerate(run_steps(read, place / "deck.inp"), 1):
        time += read.steps[number - 1].period
        top = read.mesh.node_sets["TOP"]
        for name, nodes, values in (("displacements (vx,vy,vz) for set ALL", range(len(step.displacement)), step.displacement),
                                    ("forces (fx,fy,fz) for set TOP", top, step.internal),
                                    ("forces (fx,fy,fz) for set ALL", range(len(step.internal)), step.internal)):  # fmt: skip
            rows = "".join(f"{n + 1:10d}  {values[n][0]: .6E} {values[n][1]: .6E} {0.0: .6E}\n" for n in nodes)
            tables.append(f"\n {name} and time {time: .7E}\n\n{rows}")
        records.append(_record(2000, time, read.steps[number - 1].period, 0.0, 0.0, 1, number, 1, 0))
        for key, values in ((101, step.displacement), (104, step.internal)):
            records += [_record(key, label, *row) for label, row in enumerate(values.tolist(), 1)]
        records.append(_record(2001))
    (place / "ready.dat").write_text("".join(tables))
    stream = "".join(records)
    (place / "ready.fil").write_text("".join(stream[n : n + 80].ljust(80) + "\n" for n in range(0, len(stream), 80)))


def _item(value: int | float | str) -> str:
    if isinstance(value, int):
        return f"I{len(str(value)):2d}{value}"
    if isinstance(value, float):
        mantissa, exponent = f"{value:.15E}".split("E")
        return f"D{mantissa:>18}D{int(exponent):+03d}"
    return f"A{value:<8}"


def _record(key: int, *values: int | float | str) -> str:
    return "*" + _item(2 + len(values)) + _item(key) + "".join(map(_item, values))


PLACES["deck"] = deck
