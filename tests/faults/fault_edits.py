"""Inputs and code that are others between two runs: what is there must not be taken for what would come out."""

import os
import shutil

import numpy as np
from places import ROOT
from workspace import Fault

from fingerfit.imaging.pictures import Picture, read_picture, write_picture

AREA = "edited between runs"


def keeping_time(path, edit):
    """Edit a file whose time stays, as by `cp -p` or rsync from an older one."""
    kept = path.stat()
    edit(path)
    os.utime(path, ns=(kept.st_atime_ns, kept.st_mtime_ns))


def edited(file, edit, old=False):
    def happens(place):
        path = place / file
        keeping_time(path, edit) if old else edit(path)

    return happens


def replaced(before, after):
    def edit(path):
        text = path.read_text(encoding="utf-8")
        assert before in text
        path.write_text(text.replace(before, after, 1), encoding="utf-8")

    return edit


def forces_doubled(path):
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    rows = [rows[0], *([row[0], row[1], f"{float(row[2]) * 2:.4f}", *row[3:]] for row in rows[1:])]
    path.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")


def picture_shifted(path):
    found = read_picture(path)
    write_picture(path, Picture(np.roll(found.values, 1, axis=0), found.spacing, found.origin, found.direction))


def template_own(place):
    """A template of the study, first the same as ours, then another."""
    text = (ROOT / "templates/block.inp.j2").read_text(encoding="utf-8")
    (place / "study/own.inp.j2").write_text(text)
    place.configure(model__template="own.inp.j2")
    assert place.run()[0] == 0
    return text


def template_edited(place):
    text = template_own(place)
    (place / "study/own.inp.j2").write_text(
        text.replace(
            "{% for step in steps %}",
            "*ELEMENT, TYPE=SPRING1, ELSET=S\n9001, 5\n*SPRING, ELSET=S\n2\n5.\n{% for step in steps %}",
            1,
        )
    )


def template_broken(place):
    template_own(place)
    (place / "study/own.inp.j2").write_text("{% for %}")


def and_back(first):
    def happens(place):
        kept = {
            path: path.read_bytes()
            for path in [place / "config.yaml", *sorted((place / "study").rglob("*"))]
            if path.is_file()
        }
        first(place)
        place.run()
        for path, content in kept.items():
            if path.read_bytes() != content:
                path.write_bytes(content)

    return happens


def own_code(place):
    """A copy of the project, in which this workspace runs from now on."""
    project = place.path.with_name("project")
    for name in ("fingerfit", "workflow", "templates"):
        shutil.copytree(ROOT / name, project / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", project / "Snakefile")
    place.project = project
    assert place.run()[0] == 0
    return project


def code_edited(file, before, after):
    def happens(place):
        replaced(before, after)(own_code(place) / file)

    return happens


CODE = {
    "the score": ("fingerfit/forward/score.py", "\n\ndef score(", "\n\nWEIGHT = 1\n\n\ndef score("),
    "a material": ("fingerfit/material/ogden.py", '"""', '"""Edited. '),
}
FAULTS = [
    Fault("forces", edited("study/steps.csv", forces_doubled), other=True),
    Fault("forces, in a file that is as old as before", edited("study/steps.csv", forces_doubled, old=True), other=True),
    Fault("a picture", edited("study/pictures/step_1.nii.gz", picture_shifted), other=True),
    Fault("a picture that is as old as before", edited("study/pictures/step_1.nii.gz", picture_shifted, old=True), other=True),
    Fault("the body", edited("study/study.yaml", replaced("thickness: 70", "thickness: 35")), other=True),
    Fault("the body, in a file that is as old as before", edited("study/study.yaml", replaced("thickness: 70", "thickness: 35"), old=True), other=True),
    Fault("the mesh of the model", lambda place: place.configure(model__mesh__across=3), other=True),
    Fault("a fixed constant", lambda place: place.configure(model__material__alpha=2.0), other=True),
    Fault("the score", lambda place: place.configure(fit__score="ssd"), other=True),
    Fault("the template", template_edited, other=True),
    Fault("the template, broken", template_broken, says=("own.inp.j2",), mends=lambda place: (place / "study/own.inp.j2").write_text((ROOT / "templates/block.inp.j2").read_text(encoding="utf-8"))),
    Fault("the config, broken", lambda place: (place / "config.yaml").write_text("model: [\n"), says=("config.yaml",), mends=lambda place: place.configure()),
    Fault("the config, deleted", lambda place: (place / "config.yaml").unlink(), says=("config.yaml",), mends=lambda place: place.configure()),
    Fault("a picture, deleted", lambda place: (place / "study/pictures/step_1.nii.gz").rename(place / "kept"), says=("step_1.nii.gz",), mends=lambda place: (place / "kept").rename(place / "study/pictures/step_1.nii.gz")),
    Fault("a picture, emptied", lambda place: (shutil.copy(place / "study/pictures/step_1.nii.gz", place / "kept"), (place / "study/pictures/step_1.nii.gz").write_bytes(b"")), says=("step_1.nii.gz",), mends=lambda place: (place / "kept").rename(place / "study/pictures/step_1.nii.gz")),
    Fault("forces, and back", and_back(edited("study/steps.csv", forces_doubled))),
    Fault("the mesh, and back", and_back(lambda place: place.configure(model__mesh__across=3))),
    Fault("the config broken, and back", and_back(lambda place: (place / "config.yaml").write_text("model: [\n"))),
    *(Fault(f"code: {name}", code_edited(*edit), other=True) for name, edit in CODE.items()),
]  # fmt: skip
