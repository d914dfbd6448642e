"""The files of a study: pictures, steps.csv, study.yaml, and a config.yaml that fits the base model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk
import yaml
from camera import Picture
from simulation import grid_of
from study_table import Study

LARGEST = 65535
"""Largest intensity in the files."""
CORNER = 12
"""Rows at the lower end of the first picture that its noise is read from."""
MESHES = {"mesh": 12, "refined": 24}
"""Elements along the side of a square as large as the body, in the meshes of the model."""


@dataclass
class Written:
    """What is told about the pictures.

    Parameters
    ----------
    noise : float
        Standard deviation beside the body, in the first picture.
    saturated : int
        Pixels that are brighter than the files can tell.
    """

    noise: float
    saturated: int


def picture_file(step: int) -> str:
    """Place of the picture of a step, or of that before compression (0), in the study."""
    return f"pictures/step_{step}.nii.gz" if step else "pictures/before.nii.gz"


def write_pictures(folder: Path, study: Study, clean: list[Picture], rng: np.random.Generator) -> Written:
    """Write pictures with noise."""
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    grid = grid_of(study)
    sigma = study.noise.picture * study.look.mean
    noise, saturated = 0.0, 0
    for step, picture in enumerate(clean):
        shape = picture.values.shape
        values = picture.values + sigma * rng.standard_normal(shape)
        if study.noise.magnitude:
            values = np.hypot(values, sigma * rng.standard_normal(shape))
        values = np.rint(values)
        if step == 0:
            noise = float(values[:CORNER, : CORNER * (shape[1] // CORNER)].std())
        saturated += int((values > LARGEST).sum())
        image = sitk.GetImageFromArray(np.clip(values, 0, LARGEST).astype(np.uint16))
        image.SetSpacing([grid.pixel, grid.pixel])
        corner = (grid.x + study.origin[0], grid.y + study.origin[1])
        image.SetOrigin([float(np.float32(place)) for place in corner])
        sitk.WriteImage(image, str(folder / picture_file(step)), True)
    return Written(noise, saturated)


def write_steps(folder: Path, times: np.ndarray, displacement: np.ndarray, force: np.ndarray) -> None:
    """Write steps.csv: times in s, indentations in mm, forces in N."""
    lines = ["step,time,displacement,force,picture"]
    for step, (t, d, f) in enumerate(zip(times, displacement, force, strict=True), start=1):
        lines.append(f"{step},{t:.0f},{d:.5g},{f:.6g},{picture_file(step)}")
    (folder / "steps.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_study(
    folder: Path, study: Study, heights: list[float], force: float, displacement: float, picture: float
) -> None:
    """Write study.yaml, with the heights of the layers in the first picture (from the base on) and the noise.

    Magnitude noise is left to be estimated.
    """
    layers = [{"name": layer.name, "height": height} for layer, height in zip(study.layers, heights, strict=True)]
    _dump(
        folder / "study.yaml",
        {
            "title": study.title,
            "units": {"length": "mm", "force": "N", "time": "s"},
            "control": study.control,
            "steps": "steps.csv",
            "pictures": {
                "before": picture_file(0),
                "noise": "estimated" if study.noise.magnitude else float(f"{picture:.3g}"),
            },
            "noise": {"force": force, "displacement": displacement},
            "body": {
                "width": study.width,
                "thickness": study.thickness,
                "origin": list(study.origin),
                "layers": layers[::-1],
            },
            "boundary": {"base": "held", "indenter": "glued"},
        },
    )


def write_config(folder: Path, study: Study) -> None:
    """Write config.yaml: all moduli are fitted, with exponent and Poisson ratio given; two steps are held out.

    Each modulus starts at 0.4 to 0.57 or 1.7 to 2.5 times the true one.
    """
    rng = np.random.default_rng(9000 + study.number)
    parameters = {}
    for layer in study.layers[::-1]:
        power = rng.choice([-1, 1]) * (0.8 + 0.5 * rng.random())
        start = float(f"{layer.modulus * 2**power:.3g}")
        parameters[f"mu_{layer.name}"] = {"unit": "MPa", "start": start, "lower": 0.001, "upper": 1.0}
    held_out = [2, study.steps - 1]
    _dump(
        folder / "config.yaml",
        {
            "study": str(folder.resolve()),
            "results": "results",
            "solver": "builtin",
            "model": {
                "name": "base",
                "template": "block.inp.j2",
                "law": "ogden",
                "material": {"alpha": study.alpha, "poisson": study.poisson},
                **{name: _mesh(study, elements) for name, elements in MESHES.items()},
                "parameters": parameters,
            },
            "fit": {
                "score": "likelihood" if study.control == "displacement" else "nmi",
                "steps": [step for step in range(1, study.steps + 1) if step not in held_out],
                "smooth": 1.0,
                "crop": 0.3,
                "stages": [
                    {"name": "alike", "kind": "grid", "points": 6},
                    {"name": "all", "kind": "least_squares", "tolx": 0.002},
                ],
            },
        },
    )


def _mesh(study: Study, elements: int) -> dict[str, Any]:
    """Mesh of about square elements, at least two rows for each layer, four where there is one layer only."""
    across = max(8, round(elements * np.sqrt(study.width / study.height)))
    up = elements * np.sqrt(study.height / study.width)
    count = len(study.layers)
    per_layer = max(2, round(up / count)) if count > 1 else max(4, round(up))
    return {"element": "CPE4H", "across": across, "per_layer": per_layer, "grading": 2.0}


def _dump(file: Path, content: dict[str, Any]) -> None:
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
