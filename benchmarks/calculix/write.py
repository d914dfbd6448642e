"""The files of a study: pictures, steps.csv, study.yaml, and a config.yaml that fits the base model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import SimpleITK as sitk
import yaml
from pictures import Pixels
from study_table import Study

FINEST = 0.002
"""Noise of the displacement, mm, at least."""
PART = 0.02
"""Noise of the displacement, pixels."""
ACROSS = 14
"""Elements over the width, in the mesh of the model."""
ACROSS_MANY = 12
"""The same for a body of four layers."""


class _Dumper(yaml.SafeDumper):
    """YAML with what is short in one line."""


class _Line(dict):  # type: ignore[type-arg]
    """A dict in one line."""


class _Row(list):  # type: ignore[type-arg]
    """A list in one line."""


_Dumper.add_representer(_Line, lambda to, one: to.represent_mapping("tag:yaml.org,2002:map", one, flow_style=True))
_Dumper.add_representer(_Row, lambda to, one: to.represent_sequence("tag:yaml.org,2002:seq", one, flow_style=True))


def write(
    folder: Path,
    study: Study,
    pixels: Pixels,
    pictures: dict[int, np.ndarray],
    displacement: np.ndarray,
    force: np.ndarray,
) -> None:
    """Write all files of a study.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    study : Study
        What it is.
    pixels : Pixels
        Of the pictures.
    pictures : dict of ndarray (rows, columns)
        With noise, by step; 0 is the one before compression.
    displacement, force : ndarray (steps,)
        Without noise, mm and N.
    """
    _write_pictures(folder, study, pixels, pictures)
    rng = study.generator("readings")
    force_noise = float(f"{study.force_noise * force.max():.2g}")
    displacement_noise = float(f"{max(FINEST, PART * pixels.side):.1g}")
    noisy_force = force + rng.normal(0, force_noise, study.steps)
    noisy_displacement = displacement + rng.normal(0, displacement_noise, study.steps)
    _write_steps(folder, study, noisy_displacement, noisy_force)
    _write_study(folder, study, pixels, force_noise, displacement_noise)
    _write_config(folder, study, rng)


def picture_file(step: int) -> str:
    """File of the picture of a step; 0 is the one before compression."""
    return f"pictures/step_{step}.nii.gz" if step else "pictures/before.nii.gz"


def _write_pictures(folder: Path, study: Study, pixels: Pixels, pictures: dict[int, np.ndarray]) -> None:
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    for step, picture in pictures.items():
        image = sitk.GetImageFromArray(picture)
        image.SetSpacing([pixels.side] * 2)
        image.SetOrigin([pixels.x + study.origin[0], pixels.y + study.origin[1]])
        sitk.WriteImage(image, str(folder / picture_file(step)))


def _write_steps(folder: Path, study: Study, displacement: np.ndarray, force: np.ndarray) -> None:
    """Write steps.csv."""
    times = study.times
    lines = ["step," + ("" if times is None else "time,") + "displacement,force,picture"]
    for index, (d, f) in enumerate(zip(displacement, force, strict=True)):
        step = index + 1
        time = "" if times is None else f"{times[index]:g},"
        lines.append(f"{step},{time}{d:.4f},{f:.4f},{picture_file(step) if step in study.pictured else ''}")
    (folder / "steps.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_study(folder: Path, study: Study, pixels: Pixels, force: float, displacement: float) -> None:
    """Write study.yaml, with the noise of force (N) and displacement (mm)."""
    pictures = _Line(before=picture_file(0), noise=float(study.look.sigma))
    if study.look.blur:
        pictures["blur"] = float(f"{study.look.blur * pixels.side:.4g}")
    _dump(
        folder / "study.yaml",
        {
            "title": study.title,
            "units": _Line(length="mm", force="N", time="s"),
            "control": study.control,
            "steps": "steps.csv",
            "pictures": pictures,
            "noise": _Line(force=force, displacement=displacement),
            "body": {
                "width": study.width,
                "thickness": study.thickness,
                "origin": _Row(study.origin),
                "layers": [_Line(name=layer.name, height=layer.height) for layer in study.layers],
            },
            "boundary": _Line(base=study.base, indenter=study.indenter),
        },
    )


def _write_config(folder: Path, study: Study, rng: np.random.Generator) -> None:
    """Write config.yaml: all moduli are fitted, each from 0.5 to 2 times the true one on."""
    parameters = {}
    for layer in study.layers:
        start = float(f"{layer.modulus * 2 ** rng.uniform(-1, 1):.2g}")
        lower, upper = float(f"{start / 10:.2g}"), float(f"{start * 10:.2g}")
        parameters[f"mu_{layer.name}"] = _Line(unit="MPa", start=start, lower=lower, upper=upper, log=True)
    across = ACROSS if len(study.layers) < 4 else ACROSS_MANY
    mean = np.mean([layer.height for layer in study.layers])
    per_layer = int(np.clip(round(across * mean / study.width), 2, 12))
    _dump(
        folder / "config.yaml",
        {
            "study": str(folder.resolve()),
            "results": "results",
            "solver": "builtin",
            "model": {
                "name": "base",
                "template": "block.inp.j2",
                "material": _Line(alpha=study.alpha, poisson=study.poisson),
                "mesh": _Line(element="CPE8H", across=across, per_layer=per_layer, grading=4),
                "refined": _Line(element="CPE8H", across=2 * across, per_layer=2 * per_layer, grading=4),
                "parameters": parameters,
            },
            "fit": {
                "score": "likelihood",
                "steps": _Row(study.fitted),
                "smooth": 1.0,
                "crop": 0.2,
                "bins": 32,
                "batch": 1,
                "stages": [
                    _Line(name="grid", kind="grid", points=6),
                    _Line(name="equal", kind="equal", tolx=0.02, tolf=0.001),
                    _Line(name="independent", kind="independent", step=0.6, tolx=0.1, tolf=0.01),
                ],
            },
        },
    )


def _dump(file: Path, content: dict[str, Any]) -> None:
    file.write_text(yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True), encoding="utf-8")
