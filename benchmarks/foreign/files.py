"""The files of a study: pictures or points, steps.csv, study.yaml, and a config.yaml that fits the base model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from body import Solved
from observing import Observation
from pictures import FULL, Camera, Texture, noisy, write_nifti
from shapes import MESHES, write_mesh

STAGES = [
    {"name": "grid", "kind": "grid", "points": 6},
    {"name": "equal", "kind": "equal", "tolx": 0.02, "tolf": 1.0e-3},
    {"name": "independent", "kind": "independent", "step": 0.6, "tolx": 0.1, "tolf": 1.0e-2},
]
"""Those of the project's config.yaml."""


def write_study(
    folder: Path, name: str, setting: Mapping[str, Any], solved: Solved, seen: Observation, seed: int
) -> dict[str, Any]:
    """Write a study with noise; returns what stands in the truth about it: noise, and forces without it."""
    looks, noise = np.random.default_rng(seed), np.random.default_rng(seed + 1)
    d, f = seen.response(setting["times"][: solved.reached], solved.depth.copy(), solved.force.copy())
    sigma_d, sigma_f = setting["noise"]["displacement"], setting["noise"]["force_share"] * float(f.max())
    rows = []
    for k in range(solved.reached):
        row = {"step": k + 1, "time": f"{setting['times'][k]:g}"}
        row["displacement"] = f"{max(d[k] + sigma_d * noise.standard_normal(), 0.0):.4f}"
        row["force"] = f"{max(f[k] + sigma_f * noise.standard_normal(), 0.0):.4f}"
        rows.append(row)
    folder.mkdir(parents=True, exist_ok=True)
    if setting["seen"] == "pictures":
        _pictures(folder, setting, solved, seen, rows, looks, noise)
    elif setting["seen"] == "points":
        _points(folder, setting, solved, rows, noise)
    columns = ["step", "time", "displacement", "force"]
    columns += [{"pictures": "picture", "points": "points"}[setting["seen"]]] if setting["seen"] != "forces" else []
    lines = [",".join(columns), *(",".join(str(row.get(column, "")) for column in columns) for row in rows)]
    (folder / "steps.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if "shape" in setting:
        for mesh, (count, ratio) in MESHES.items():
            write_mesh(folder / f"{mesh}.inp", setting, count, ratio)
    _dump(folder / "study.yaml", _study(name, setting, sigma_f))
    _dump(folder / "config.yaml", config(folder.as_posix(), setting, solved.reached))
    return {"force": sigma_f, "displacement": sigma_d, "picture": setting["noise"]["picture"] * FULL}


def _pictures(
    folder: Path,
    setting: Mapping[str, Any],
    solved: Solved,
    seen: Observation,
    rows: list[dict[str, Any]],
    looks: np.random.Generator,
    noise: np.random.Generator,
) -> None:
    camera, texture = Camera(setting, looks), Texture(setting, looks)
    (folder / "pictures").mkdir(exist_ok=True)
    for step in (0, *_pictured(setting, solved.reached)):
        file = f"pictures/{'before' if step == 0 else f's{step}'}.nii.gz"
        clean = camera.clean(texture, solved, step, seen)
        values = noisy(clean, setting["noise"]["picture"], noise)
        write_nifti(folder / file, values, camera.pixel, camera.origin)
        if step:
            rows[step - 1]["picture"] = file


def _pictured(setting: Mapping[str, Any], reached: int) -> list[int]:
    """Steps with pictures; where the last ones were not reached, the last that was."""
    return [k for k in setting["pictured"] if k <= reached] or [reached]


def _points(
    folder: Path, setting: Mapping[str, Any], solved: Solved, rows: list[dict[str, Any]], noise: np.random.Generator
) -> None:
    """Displacements of about three hundred places inside the body."""
    (folder / "points").mkdir(exist_ok=True)
    near = tuple(slice(max(2, n // 40), -max(2, n // 40), max(1, n // 18)) for n in solved.places.shape[1:])
    first = (solved.places + solved.before)[(slice(None), *near)]
    for step in range(1, solved.reached + 1):
        moved = (solved.moved[step - 1] - solved.before)[(slice(None), *near)]
        told = moved + setting["noise"]["points"] * noise.standard_normal(moved.shape)
        table = np.concatenate([first.reshape(len(first), -1), told.reshape(len(told), -1)]).T
        file = f"points/s{step}.csv"
        lines = ["x,y,ux,uy", *(",".join(f"{value:.5f}" for value in row) for row in table)]
        (folder / file).write_text("\n".join(lines) + "\n", encoding="utf-8")
        rows[step - 1]["points"] = file


def _study(name: str, setting: Mapping[str, Any], sigma_f: float) -> dict[str, Any]:
    layers = [{"name": n, "height": h} for n, h in zip(setting["names"], setting["heights"], strict=True)]
    height = round(float(sum(setting["heights"])), 6)
    body: dict[str, Any] = {"layers": layers}
    if "shape" in setting:
        body = {mesh: f"{mesh}.inp" for mesh in MESHES} | {"thickness": setting["thickness"]}
        body["layers"] = [{"name": n, "elements": n.upper()} for n in setting["names"]]
    elif setting["dimension"] == 3:
        body["brick"] = [setting["width"], setting["breadth"], height]
    else:
        body |= {"width": setting["width"], "thickness": setting["thickness"], "origin": [0, 0]}
    noise = {"force": float(f"{sigma_f:.4g}"), "displacement": setting["noise"]["displacement"]}
    found: dict[str, Any] = {
        "title": name,
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": setting["control"],
        "steps": "steps.csv",
    }
    if setting["seen"] == "pictures":
        found["pictures"] = {"before": "pictures/before.nii.gz", "noise": "estimated", "scale": "range"}
    if setting["seen"] == "points":
        noise["points"] = setting["noise"]["points"]
    return {**found, "noise": noise, "body": body, "boundary": {"base": "held", "indenter": "glued"}}


def config(study: str, setting: Mapping[str, Any], reached: int) -> dict[str, Any]:
    """Settings that fit the base model: all moduli, with exponent and Poisson ratio given."""
    bounds = {"unit": "MPa", "start": 0.1, "lower": 0.001, "upper": 1.0, "log": True}
    coarse, fine = _meshes(setting)
    meshes = {} if "shape" in setting else {"mesh": coarse, "refined": fine}
    steps = sorted(
        {*(k for k in setting["fitted"] if k <= reached), *([reached] if len(setting["fitted"]) == 1 else [])}
    )
    pictured = setting["seen"] == "pictures"
    likelihood = setting["control"] == "displacement" or not pictured
    return {
        "study": study,
        "solver": "builtin",
        "model": {
            "name": "base",
            "template": "block.inp.j2",
            "material": {"alpha": setting["alpha"], "poisson": setting["poisson"]},
            **meshes,
            "parameters": {f"mu_{name}": dict(bounds) for name in setting["names"]},
        },
        "fit": {
            "score": "likelihood" if likelihood else "nmi",
            "steps": steps,
            **({"smooth": 1.0, "crop": 0.3, "bins": 32} if pictured else {}),
            "batch": 2,
            "stages": [dict(stage) for stage in STAGES],
        },
    }


def _meshes(setting: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Meshes of the search and of its last steps."""

    def mesh(element: str, across: int, per_layer: int, grading: float) -> dict[str, Any]:
        return {"element": element, "across": across, "per_layer": per_layer, "grading": grading}

    if setting["model_mesh"] == "of the paper":
        return mesh("CPE8", 4, 1, 1), mesh("CPE8", 6, 2, 1)
    if setting["model_mesh"] == "linear":
        return mesh("CPE4", 5, 2, 1), mesh("CPE4", 8, 3, 1)
    layers = len(setting["heights"])
    if setting["dimension"] == 3:
        return mesh("C3D20H", 3, 2, 1), mesh("C3D20H", 4, 3, 1)
    wide = min(2.5, max(1.0, setting["width"] / float(sum(setting["heights"]))))
    return (
        mesh("CPE8H", round(8 * wide), max(2, round(9 / layers)), 4),
        mesh("CPE8H", round(14 * wide), max(3, round(15 / layers)), 4),
    )


def _dump(path: Path, data: Mapping[str, Any]) -> None:
    path.write_text(yaml.safe_dump(dict(data), sort_keys=False, default_flow_style=None, width=140), encoding="utf-8")
