"""Files of a study: study.yaml, steps.csv, config.yaml, pictures and meshes."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import yaml
from body import write_inp
from camera import Camera, with_noise, write
from cases import Case, coarse_body

Array = np.ndarray


def write_pictures(case: Case, camera: Camera, clean: list[Array], folder: Path, rng: np.random.Generator) -> object:
    """Write all pictures with noise; return how the noise is stated."""
    kind, level, stated = case.noise
    full = 4000.0 if case.whole else 200.0
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    first = camera.first + np.array([*case.origin, 0.0])[: len(camera.shape)]

    def save(name: str, picture: Array) -> None:
        noisy = with_noise(picture, kind, level, rng) * full
        write(folder / "pictures" / f"{name}.nrrd", noisy, camera.pixel, first, case.whole)

    for k, picture in enumerate(clean):
        save("before" if k == 0 else f"step_{k}", picture)
    if stated == "repeats":
        save("again", clean[0])
        return ["pictures/again.nrrd"]
    return level * full if stated == "number" else "estimated"


def write_steps(case: Case, folder: Path, times: list[float], displacement: Array, force: Array) -> None:
    """Write the table of the steps."""
    rows = [
        [k + 1, f"{times[k]:g}", f"{displacement[k]:.5g}", f"{force[k]:.6g}", f"pictures/step_{k + 1}.nrrd"]
        for k in range(len(case.shares))
    ]
    with (folder / "steps.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["step", "time", "displacement", "force", "picture"], *rows])


def write_study(case: Case, folder: Path, noise: object, deviation: float, shape: object) -> None:
    """Write study.yaml, with meshes where the body is no block."""
    layers = [{"name": layer[0], "height": float(layer[1])} for layer in case.layers]
    if case.space:
        body = {"brick": [*map(float, case.sides), float(case.height)], "layers": layers}
    elif case.shape:
        for name, across in (("body", 10), ("refined", 16)):
            rows = {1: 8, 2: 5, 3: 4, 4: 3}[len(case.layers)]
            mesh = coarse_body(case, across, round(rows * across / 10), shape)
            write_inp(mesh, case.names, np.array(case.origin), folder / f"{name}.inp")
        layers = [{"name": layer[0], "elements": layer[0].upper()} for layer in case.layers]
        body = {"mesh": "body.inp", "refined": "refined.inp", "layers": layers, "thickness": float(case.thickness)}
    else:
        body = {
            "width": float(case.width),
            "thickness": float(case.thickness),
            "origin": case.origin,
            "layers": layers,
        }
    pictures = {"before": "pictures/before.nrrd", "noise": noise}
    if case.blur:
        pictures["blur"] = case.blur
    study = {
        "title": case.title,
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": case.control,
        "steps": "steps.csv",
        "pictures": pictures,
        "noise": {"displacement" if case.control == "force" else "force": deviation},
        "body": body,
        "boundary": {"base": case.base, "indenter": case.plate},
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False, width=120))


def write_config(case: Case, folder: Path, out: Path, rng: np.random.Generator) -> None:
    """Write config.yaml: constants to identify, meshes, steps that are fitted."""
    parameters = {}
    for layer in case.layers:
        start = float(f"{layer[2] * 2 ** (rng.choice([-1, 1]) * rng.uniform(0.3, 1)):.2g}")
        bounds = {"lower": float(f"{start / 30:.1g}"), "upper": float(f"{start * 30:.1g}")}
        parameters[f"mu_{layer[0]}"] = {"unit": "MPa", "start": start, **bounds}
    model: dict[str, object] = {"material": {"alpha": case.alpha, "poisson": case.nu}}
    rows = {1: 8, 2: 5, 3: 4, 4: 3}[len(case.layers)]
    if case.space:
        model["mesh"] = {"element": "C3D20R", "across": 4, "per_layer": 2, "grading": 2}
        model["refined"] = {"element": "C3D20R", "across": 6, "per_layer": 3, "grading": 2}
    elif not case.shape:
        model["mesh"] = {"element": "CPE8H", "across": 10, "per_layer": rows, "grading": 4}
        model["refined"] = {"element": "CPE8H", "across": 16, "per_layer": round(1.6 * rows), "grading": 4}
    model["parameters"] = parameters
    fit: dict[str, object] = {"score": "likelihood"}
    if case.fitted:
        fit["steps"] = case.fitted
    fit["stages"] = [{"name": "search", "kind": "least_squares"}]
    config = {"study": str(folder.resolve()), "results": str(out.resolve() / "results"), "model": model, "fit": fit}
    (folder / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False, width=120))
