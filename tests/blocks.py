"""What several tests press: a block of two layers with forces alone, as a study; corners of simple bodies, as a deck."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

STUDY: dict[str, Any] = {
    "title": "block",
    "units": {"length": "mm", "force": "N", "time": "s"},
    "control": "displacement",
    "steps": "steps.csv",
    "noise": {"force": 0.05, "displacement": 0.001},
    "body": {"width": 12, "thickness": 70, "layers": [{"name": "top", "height": 4}, {"name": "bottom", "height": 4}]},
    "boundary": {"base": "held", "indenter": "glued"},
}
STEPS = "step,displacement,force\n1,0.4,10.0\n2,0.8,21.0\n"
MESH = {"element": "CPE8", "across": 2, "per_layer": 2}
MODEL: dict[str, Any] = {
    "material": {"alpha": 1.4, "poisson": 0.45},
    "parameters": {"mu": {"unit": "MPa", "start": 0.05, "lower": 0.005, "upper": 0.5}},
    "mesh": MESH,
}
FIT: dict[str, Any] = {"score": "likelihood", "stages": [{"name": "grid", "kind": "grid", "points": 3}]}
RECTANGLE = """*NODE
1, 0., 0.
2, 2., 0.
3, 2., 1.
4, 0., 1.
"""
CUBE = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
"""


def study_with_pictures(folder: Path) -> None:
    """The same block with pictures and times, as far as effects of a model look at it: the pictures are empty files."""
    folder.mkdir()
    rows = [f"{row},{name}" for row, name in zip(STEPS.split(), ("time,picture", "1,1.nii", "2,2.nii"), strict=True)]
    files = {"steps.csv": "\n".join(rows), "study.yaml": yaml.safe_dump({**STUDY, "pictures": {"before": "0.nii"}})}
    for name, text in {**files, **{f"{n}.nii": "" for n in range(3)}}.items():
        (folder / name).write_text(text, encoding="utf-8")
