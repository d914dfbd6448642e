"""Mistakes with volumes: one clear line each from `fingerfit check`, and nothing written."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from seeds import generator

from fingerfit.cli import main
from fingerfit.imaging.pictures import Picture, write_picture

SHAPE = (12, 14, 16)
LEFT = np.diag([1.0, 1.0, -1.0])
SKEW = np.array([[1.0, 0.3, 0.0], [0.0, 0.954, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A small study of a brick in volumes, and its config."""
    monkeypatch.chdir(tmp_path)
    for name in NAMES:
        write(tmp_path, name)
    (tmp_path / "study/steps.csv").write_text(
        "step,displacement,force,picture\n1,0.5,7,step_1.mha\n2,1.0,14,step_2.mha\n"
    )
    study = {
        "title": "t",
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": "force",
        "steps": "steps.csv",
        "pictures": {"before": "before.mha", "noise": "estimated", "resize": [16, 14, 12], "gaussian": 0.8},
        "noise": {"displacement": 0.01},
        "body": {"brick": [8, 7, 6], "layers": [{"name": "body"}]},
        "boundary": {"base": "held", "indenter": "glued"},
    }
    (tmp_path / "study/study.yaml").write_text(yaml.safe_dump(study))
    config = {
        "study": "study",
        "model": {
            "material": {"alpha": 1.4, "poisson": 0.45},
            "mesh": {"element": "C3D8", "across": 2, "per_layer": 2},
            "parameters": {"mu": {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}},
        },
        "fit": {"score": "ssd", "steps": [1, 2], "stages": [{"name": "s", "kind": "independent"}]},
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    return tmp_path


NAMES = ("before", "step_1", "step_2")


def write(place, name, shape=SHAPE, **changes):
    frame = {"spacing": np.full(3, 0.8), "origin": np.full(3, -2.0), "direction": np.eye(3)} | changes
    values = generator(sum(name.encode())).uniform(0, 4000, shape)
    write_picture(place / "study" / f"{name}.mha", Picture(values, **frame), np.float32)


def all_of_them(**changes):
    return lambda place: [write(place, name, **changes) for name in NAMES]


def edit(name, change):
    def apply(place):
        path = place / name
        data = yaml.safe_load(path.read_text())
        change(data)
        path.write_text(yaml.safe_dump(data))

    return apply


def text(old, new):
    def apply(place):
        path = place / "study/steps.csv"
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return apply


def series(place, name, heights, series="1.2.3.4"):
    """A folder with a DICOM series of slices at these heights."""
    import SimpleITK as sitk

    (place / "study" / name).mkdir(exist_ok=True)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for n, height in enumerate(heights):
        image = sitk.GetImageFromArray(np.full((1, 14, 16), n, dtype=np.uint16))
        image.SetSpacing((0.8, 0.8, 1.0))
        for tag, value in (
            ("0008|0060", "MR"),
            ("0020|000e", series),
            ("0020|000d", "1.2.3"),
            ("0020|0013", str(n)),
            ("0020|0032", f"-2\\-2\\{height}"),
            ("0020|0037", "1\\0\\0\\0\\1\\0"),
        ):
            image.SetMetaData(tag, value)
        writer.SetFileName(str(place / "study" / name / f"{series}_{n}.dcm"))
        writer.Execute(image)


def as_series(heights, *others):
    def apply(place):
        series(place, "before", heights)
        for number, other in enumerate(others):
            series(place, "before", other, f"1.2.3.5{number}")
        edit("study/study.yaml", lambda d: d["pictures"].update(before="before"))(place)

    return apply


def repeats(*names):
    return edit("study/study.yaml", lambda d: d["pictures"].update(noise=list(names)))


def other_repeat(place):
    write(place, "again", (12, 14, 15))
    repeats("again.mha")(place)


EVEN = np.round(-2 + 0.8 * np.arange(12), 3)
CASES = {
    "another number of voxels": (lambda p: write(p, "step_2", (12, 14, 15)), "step_2.mha: geometry: found 15x14x12 pixels; expected that of before.mha"),
    "another spacing": (lambda p: write(p, "step_2", spacing=np.array([0.8, 0.8, 0.9])), "step_2.mha: geometry: found spacing [0.8, 0.8, 0.9]"),
    "another origin": (lambda p: write(p, "step_1", origin=np.array([-2.0, -2.0, -1.0])), "step_1.mha: geometry: found origin [-2.0, -2.0, -1.0]"),
    "turned": (
        lambda p: write(p, "step_1", direction=np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])),
        "step_1.mha: geometry: found direction [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]; expected that of before.mha",
    ),
    "left-handed": (lambda p: write(p, "step_2", direction=LEFT), "step_2.mha: direction: found a left-handed direction matrix (determinant -1); expected a right-handed one"),
    "skew": (lambda p: write(p, "before", direction=SKEW), "before.mha: direction: found axes that are not perpendicular"),
    "mesh beside the volume": (all_of_them(origin=np.full(3, 40.0)), "before.mha: picture: found 0 % of the mesh in it (mesh 0 to 8, 0 to 7, 0 to 6 mm; picture 39.6 to 52.4"),
    "mesh in metres": (edit("study/study.yaml", lambda d: d["units"].update(length="m")), "of the mesh in it (mesh 0 to 8000, 0 to 7000, 0 to 6000 mm"),
    "mesh mostly outside": (all_of_them(origin=np.array([5.0, -2.0, -2.0])), "expected a picture that overlaps the body"),
    "pull for push": (text(",14,", ",-14,"), "row 3, force: found -14; expected 0 or more: compression is positive"),
    "a step without its volume": (text("step_2.mha", ""), "fit.steps: found step 2; expected steps with a picture: [1]"),
    "a step that is not there": (edit("config.yaml", lambda d: d["fit"].update(steps=[1, 2, 3])), "fit.steps: found step 3; expected steps with a picture: [1, 2]"),
    "a volume that is lost": (lambda p: (p / "study/step_2.mha").unlink(), "row 3, picture: found step_2.mha; expected a file that exists"),
    "a slice for a volume": (all_of_them(shape=(1, 14, 16)), "before.mha: picture: found 2 dimensions; expected 3, as the mesh"),
    "sizes of a plane": (edit("study/study.yaml", lambda d: d["pictures"].update(resize=[16, 14])), "pictures.resize: found 2 numbers; expected 3, as the pictures"),
    "no repeat picture": (repeats(), "pictures.noise: found []; expected a number above 0, estimated, or a list of further pictures"),
    "a lost repeat picture": (repeats("again.mha"), "pictures.noise.0: found again.mha; expected a further picture before compression, a file that exists"),
    "a repeat picture of another place": (other_repeat, "again.mha: geometry: found 15x14x12 pixels; expected that of before.mha"),
    "a lost slice": (as_series(np.delete(EVEN, 5)), "before: slices: found 1.6 mm between 1.2.3.4_4.dcm and 1.2.3.4_5.dcm; expected 0.8 mm, as between the others"),
    "two series": (as_series(EVEN, EVEN), "before: picture: found 2 DICOM series; expected one DICOM series"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_one_clear_line(place, name, capsys):
    change, expected = CASES[name]
    change(place)
    before = sorted(place.rglob("*"))
    assert main(["check", "study", "--picture", "mesh.png"]) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line]
    # a wrong first picture is wrong beside each of the others, which is not said again
    assert len(lines) == 1, lines
    assert lines[0].startswith("fingerfit: error: ")
    assert expected in lines[0]
    assert sorted(place.rglob("*")) == before


def test_the_study_itself_is_fine_and_its_preparation_is_told(place, capsys):
    assert main(["check", "study"]) == 0
    said = capsys.readouterr().out
    assert "pictures: 16 x 14 x 12 pixels of 0.8 x 0.8 x 0.8 mm, noise" in said
    assert "prepared, in this order:" in said
    assert "  resize: to 16 x 14 x 12 pixels of" in said
    assert "  Gaussian: standard deviation of 0.8 pixels" in said


def test_a_whole_series_is_taken(place, capsys):
    as_series(EVEN)(place)
    for name in ("step_1", "step_2"):
        write(place, name)
    assert main(["check", "study"]) == 0, capsys.readouterr().err


def test_a_turned_grid_is_told(place, capsys):
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    all_of_them(direction=turned, origin=np.array([9.0, -2.0, -2.0]))(place)
    assert main(["check", "study"]) == 0, capsys.readouterr().err
    assert "along (0, 1, 0), (-1, 0, 0), (0, 0, 1)" in capsys.readouterr().out
