"""Drafts of studies from files of other programs: what is in them, what is marked, what is asked for."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from programs import INSTRON, PROGRAMS, X, Y, vic3d, write

from fingerfit.check.check import check_study
from fingerfit.cli import main
from fingerfit.core.errors import InputError, Problems
from fingerfit.readers.keys import read_data
from fingerfit.start.draft import MARK
from fingerfit.start.measured import draft_from


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Frames of VIC-3D at 1, 2 and 3 s, and the record of a machine."""
    monkeypatch.chdir(tmp_path)
    Path("dic").mkdir()
    write(Path("dic"), "VIC-3D")
    Path("machine.csv").write_text(INSTRON, encoding="utf-8")
    return tmp_path


def test_frames_and_readings_are_matched_by_time(place, capsys):
    assert main(["new", "mine", "--from", "dic", "machine.csv", "--rate", "2"]) == 0
    assert "lines are marked # CHECK" in capsys.readouterr().out
    assert Path("mine/steps.csv").read_text(encoding="utf-8") == (
        "step,time,displacement,force,points\n1,0.5,0.1,2.5,points/1.csv\n2,1,0.2,5,points/2.csv\n"
    )
    text = Path("mine/study.yaml").read_text(encoding="utf-8")
    assert (
        f"{MARK}: 20 points, read as VIC-3D; steps are frames 1, 2; the last axis of the study is the measured y"
        in text
    )
    assert "the surface is taken as plane" in text
    with pytest.raises(Problems) as found:
        check_study(Path("mine"))
    assert str(found.value) == "mine/study.yaml: body.thickness: found nothing; expected a number above 0"
    Path("mine/study.yaml").write_text(text.replace("thickness:", "thickness: 5"), encoding="utf-8")
    told = check_study(Path("mine"), picture=Path("mine.png"), solve=False)
    assert re.search(r"^points: 20 at each of 2 steps; x from 0 to 4, y from 0 to 3 mm; in body 20$", told, re.M)
    assert re.search(r"^finer mesh: \d+ nodes, \d+ CPE8H$", told, re.M)
    assert yaml.safe_load(Path("mine/config.yaml").read_text(encoding="utf-8"))["fit"]["score"] == "likelihood"


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_each_program_gives_is_drafted(place, program):
    for path in Path("dic").iterdir():
        path.unlink()
    draft_from(Path("mine"), [*write(Path("dic"), program), Path("machine.csv")], PROGRAMS[program][1], 2.0)
    table = np.loadtxt("mine/points/2.csv", delimiter=",", skiprows=1)
    order = np.lexsort((table[:, 0], table[:, 1]))
    assert table[order][:, :2] == pytest.approx(np.stack([X, Y], axis=1)[np.lexsort((X, Y))], abs=1e-6)
    assert table[:, 2] == pytest.approx(0.02 * table[:, 0], abs=1e-6)
    assert table[:, 3] == pytest.approx(-0.04 * table[:, 1], abs=1e-6)


def test_a_record_alone_is_a_study_of_forces(place):
    draft_from(Path("mine"), [Path("machine.csv")])
    rows = Path("mine/steps.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "step,time,displacement,force"
    assert rows[-1] == "10,1.9,0.38,9.5"
    assert len(rows) == 11


def test_the_last_of_several_loadings_is_taken(place):
    once = np.concatenate([np.linspace(0, 2, 40), np.linspace(2, 0, 40)[1:-1]])
    moved = np.tile(once, 3)
    rows = "\n".join(f"{n},{d:.4f},{0.7 * d:.4f}" for n, d in enumerate(moved))
    Path("machine.csv").write_text(f"time (s),travel (mm),force (N)\n{rows}\n", encoding="utf-8")
    draft_from(Path("mine"), [Path("machine.csv")])
    assert "machine.csv has 3 loadings: the last one is taken" in Path("mine/study.yaml").read_text(encoding="utf-8")
    last = Path("mine/steps.csv").read_text(encoding="utf-8").splitlines()[-1].split(",")
    assert [float(cell) for cell in last[1:]] == pytest.approx([2 * 78 + 39, 2, 1.4])


@pytest.mark.parametrize("readings", [2, 3])
def test_a_first_file_that_has_displacements_is_not_before_compression(place, readings):
    Path("dic/frame_0.csv").unlink()
    rows = "".join(f"{0.1 * n},{2 * n}\n" for n in range(3 - readings, 3))
    Path("machine.csv").write_text(f"travel (mm),force (N)\n{rows}", encoding="utf-8")
    draft_from(Path("mine"), [Path("dic"), Path("machine.csv")])
    text = Path("mine/study.yaml").read_text(encoding="utf-8")
    assert "frame_1.csv has displacements already: it is frame 1" in text
    assert ("before the first one force and displacement are taken as 0" in text) == (readings == 2)
    assert Path("mine/steps.csv").read_text(encoding="utf-8") == (
        "step,displacement,force,points\n1,0.1,2,points/1.csv\n2,0.2,4,points/2.csv\n"
    )


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("frames", [10, [1, 3]])
def test_a_reading_without_a_number_keeps_its_place(place, before, frames):
    """A reading for each of four frames; the third has no force."""
    for path in Path("dic").iterdir():
        path.unlink()
    for n in range(not before, 4):
        (Path("dic") / f"f_{n}.csv").write_text(vic3d(n), encoding="utf-8")
    Path("machine.csv").write_text("travel (mm),force (N)\n0,0\n0.1,1\n0.2,\n0.3,3\n", encoding="utf-8")
    content = {"points": {"files": "dic/*.csv"}, "machine": {"file": "machine.csv"}, "frames": frames}
    Path("data.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    draft_from(Path("mine"), [Path("data.yaml")])
    assert "1 rows of machine.csv lack a number: left out" in Path("mine/study.yaml").read_text(encoding="utf-8")
    assert Path("mine/steps.csv").read_text(encoding="utf-8") == (
        "step,displacement,force,points\n1,0.1,1,points/1.csv\n2,0.3,3,points/2.csv\n"
    )
    for step, frame in ((1, 1), (2, 3)):  # 0.01 of x for each frame
        table = np.loadtxt(f"mine/points/{step}.csv", delimiter=",", skiprows=1)
        assert table[:, 2] == pytest.approx(0.01 * frame * table[:, 0], abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        ("0,\n0.1,1\n0.2,2\n", "machine.csv: rows: found no number in the first; expected a reading of frame 0"),
        ("0,0\n0.1,1\n0.2,2\n0.3,\n", "machine: found 4 readings for 3 frames, 1 without a number; expected"),
    ],
)
def test_readings_that_cannot_be_counted_are_one_line(place, rows, says):
    Path("machine.csv").write_text(f"travel (mm),force (N)\n{rows}", encoding="utf-8")
    with pytest.raises(InputError, match=says):
        draft_from(Path("mine"), [Path("dic"), Path("machine.csv")])


@pytest.mark.parametrize("lost", [False, True])
def test_readings_that_are_named_are_those_of_the_whole_record(place, lost):
    """A loading before; a reading without a number counts, too."""
    rows = [f"{d},{10 * d}" for d in (0, 1, 2, 1, 0, 1, 2, 3)]
    rows[2] = "2," if lost else rows[2]
    Path("machine.csv").write_text("travel (mm),force (N)\n" + "\n".join(rows) + "\n", encoding="utf-8")
    content = {"machine": {"file": "machine.csv"}, "frames": [5, 6, 7]}
    Path("data.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    draft_from(Path("mine"), [Path("data.yaml")])
    assert Path("mine/steps.csv").read_text(encoding="utf-8") == "step,displacement,force\n1,1,10\n2,2,20\n3,3,30\n"
    assert "readings of the record, counted from 0" in Path("mine/study.yaml").read_text(encoding="utf-8")


def test_settings_that_are_there_are_kept(place):
    Path("mine").mkdir()
    Path("mine/config.yaml").write_text("study: mine\n", encoding="utf-8")
    told = draft_from(Path("mine"), [Path("machine.csv")])
    assert "mine/config.yaml: is there already and is kept" in told
    assert Path("mine/config.yaml").read_text(encoding="utf-8") == "study: mine\n"


DATA = {"points": {"files": "dic/*.csv"}, "machine": {"file": "machine.csv"}, "rate": 2}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"rate": None},
            "machine: found 20 readings for 3 frames; expected frames in a second",
        ),
        ({"rate": 0}, "rate: found 0; expected a number above 0"),
        ({"rat": 2}, "rat: found an unknown key; expected"),
        ({"points": {"files": "dic/*.txt"}}, r"points.files: found dic/\*.txt; expected a pattern of files that exist"),
        ({"points": {"files": "dic/*.csv", "scale": 0.1}}, "scale: found 0.1, and coordinates in no unit"),
        ({"points": {"files": "dic/*.csv", "up": "up"}}, "points.up: found up; expected one of x, y"),
        ({"points": {"files": "dic/*.csv", "up": "z"}}, "axis: found z; expected an axis of the plane"),
        (
            {"points": {"files": "dic/*.csv", "columns": ["u", "v"]}},
            "points.columns: found u, v; expected x and y among them",
        ),
        ({"points": {"files": "dic/*.csv", "columns": ["x", "y"]}}, "columns: found 8 columns; expected 2"),
        ({"machine": None}, "machine: found points alone; expected forces or displacements of the indenter"),
        ({"machine": {"displacement": "machine.csv"}}, "machine: found both or none of file and force; expected one"),
        ({"machine": None, "points": None}, "file: found neither points nor machine; expected one of them at least"),
        (
            {"points": None, "indenter": {"file": "i.csv", "columns": ["x", "y"]}},
            "indenter: found positions, and no points",
        ),
        ({"frames": [1, 7]}, "frames: found 7; expected frames with a reading, 0 to 2"),
        ({"frames": [2, 1]}, r"frames: found \[2, 1\]; expected rising numbers"),
        ({"frames": "all"}, "frames: found all; expected how many"),
        ({"start": 100}, r"data.yaml: start: found 100 s; expected a time within the record, 0 to 1.9 s"),
        ({"start": 100, "frames": [1]}, "start: found 100 s; expected a time within the record"),
        ({"rate": 0.1, "frames": [1, 2]}, "frames: found 1; expected frames with a reading, 0 to 0"),
        ({"study": {"steps": "s.csv"}}, "study.steps: found an unknown key"),
        (
            {"indenter": {"file": "machine.csv", "columns": ["x", "y", "f"]}},
            "rows: found 20; expected 3, one for each frame",
        ),
    ],
)
def test_what_data_yaml_gets_wrong_is_one_line(place, change, says):
    content = {name: value for name, value in (DATA | change).items() if value is not None}
    Path("data.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises((InputError, Problems), match=says) as found:
        draft_from(Path("mine"), [Path("data.yaml")])
    assert "\n" not in str(found.value)
    assert not Path("mine").exists()


@pytest.mark.parametrize(("first", "found"), [(0.0, None), (0.0005, None), (-0.1, None), (0.01, "0.01"), (5.0, "5")])
def test_a_record_of_the_indenter_begins_where_it_is_at_frame_0(place, first, found):
    """Its way is 0.2 mm, 3 N/mm; the record may begin later by 1 % of it."""
    Path("pad.csv").write_text("0,3\n0,2.9\n0,2.8\n", encoding="utf-8")
    rows = "".join(f"{d:.6f},{3 * d:.6f}\n" for d in np.linspace(first, first + 0.4, 50))
    Path("machine.csv").write_text(f"travel (mm),force (N)\n{rows}", encoding="utf-8")
    content = {"points": {"files": "dic/*.csv", "unit": "mm"}, "indenter": {"file": "pad.csv", "columns": ["x", "y"]}}
    Path("data.yaml").write_text(yaml.safe_dump({**content, "machine": {"file": "machine.csv"}}), encoding="utf-8")
    if found is not None:
        says = (
            f"machine.csv: displacement: found {found} mm where the last loading begins; expected 0 mm, as the indenter"
        )
        with pytest.raises(InputError, match=says):
            draft_from(Path("mine"), [Path("data.yaml")])
        return
    draft_from(Path("mine"), [Path("data.yaml")])
    assert np.loadtxt("mine/steps.csv", delimiter=",", skiprows=1, usecols=(1, 2)) == pytest.approx(
        np.array([[0.1, 0.3], [0.2, 0.6]]), abs=1e-5
    )


@pytest.mark.parametrize(("head", "points"), [("[um]", {}), ("[Pixel]", {"scale": 0.001})])
def test_the_indenter_is_measured_in_the_unit_that_the_files_of_points_say(place, head, points):
    for path in Path("dic").iterdir():
        text = path.read_text(encoding="utf-8")
        names, rest = text.split("\n", 1)
        path.write_text(
            re.sub(r"([XYZUVW])(?=\W|$)(?: \[\w+\])?", rf"\1 {head}", names) + "\n" + rest, encoding="utf-8"
        )
    Path("pad.csv").write_text("0,3000\n0,2900\n0,2800\n", encoding="utf-8")
    Path("machine.csv").write_text("travel (mm),force (N)\n0,0\n0.1,1\n0.2,2\n", encoding="utf-8")
    content = {"points": {"files": "dic/*.csv", **points}, "indenter": {"file": "pad.csv", "columns": ["x", "y"]}}
    Path("data.yaml").write_text(yaml.safe_dump({**content, "machine": {"file": "machine.csv"}}), encoding="utf-8")
    draft_from(Path("mine"), [Path("data.yaml")])
    assert np.loadtxt("mine/steps.csv", delimiter=",", skiprows=1, usecols=1) == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize("rows", ["1,0\n1,1\n1,2\n", "1,1\n1,1\n"])
def test_a_record_without_loading_is_one_line(place, rows):
    Path("machine.csv").write_text(f"travel (mm),force (N)\n{rows}", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"machine.csv: displacement: found no loading in it; expected values that rise"
    ):
        draft_from(Path("mine"), [Path("machine.csv")])


def test_frames_without_loading_are_one_line(place):
    Path("machine.csv").write_text("travel (mm),force (N)\n1,0\n1,1\n1,2\n", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"--from: frames: found a displacement that does not rise; expected one loading"
    ):
        draft_from(Path("mine"), [Path("dic"), Path("machine.csv")])


def test_the_keys_of_the_documents_are_read(place):
    Path("data.yaml").write_text(yaml.safe_dump(DATA), encoding="utf-8")
    assert read_data(Path("data.yaml")).rate == 2
