"""Commands that a user starts with: a draft of a study, this machine, the page; and what pipes and shells want."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
import yaml
from one_layer import DESCRIPTION

from fingerfit.check.check import check_study
from fingerfit.cli import main
from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.imaging.pictures import read_picture
from fingerfit.start import machine, results
from fingerfit.start.draft import MARK, draft, example, examples
from fingerfit.start.forces import MOST, read_forces

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "studies/phantom/pictures"
TABLE = "Extension (mm);Load [N]\n0;0\n" + "".join(
    f"{line.split(',')[1]};{line.split(',')[2]}\n".replace(".", ",")
    for line in (ROOT / "studies/phantom/steps.csv").read_text(encoding="utf-8").splitlines()[1:]
)


@pytest.mark.parametrize(
    ("text", "force", "displacement", "units"),
    [
        ("force,displacement\n1,0.1\n2,0.2\n", [1, 2], [0.1, 0.2], {}),
        ("Load (kN);Travel [um]\n1,5;-3\n2,5;-4\n", [1.5, 2.5], [3, 4], {"force": "kN", "length": "um"}),
        ("Frame\tF_mN\tDisplacement/mm\n1\t-2\t1\n", [2], [1], {"force": "mN", "length": "mm"}),
        ("displacement,Force N,time s\n0,0.1,0\n1,3,5\n", [3], [1], {"force": "N", "time": "s"}),
        ("force\n7\n", [7], None, {}),
        ("FORCE [N],TRAVEL [MM],TIME [MS]\n7,1,3\n", [7], [1], {"force": "N", "length": "mm", "time": "ms"}),
        ("force [mn],travel [M],time [S]\n7,1,3\n", [7], [1], {"force": "mN", "length": "m", "time": "s"}),
        ("force [n],travel [MM],time [Min]\n7,1,3\n", [7], [1], {"force": "N", "length": "mm", "time": "min"}),
        ("force [KN]\n7\n", [7], None, {"force": "kN"}),
    ],
)
def test_tables_of_machines_are_understood(tmp_path, text, force, displacement, units):
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    found = read_forces(tmp_path / "t.csv")
    assert found.columns["force"] == force
    assert found.columns.get("displacement") == displacement
    assert found.units == units


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "columns: found an empty table; expected a head with a column force"),
        ("1,2\n3,4\n", "columns: found 1, 2; expected a head with a column force"),
        ("force\n", "rows: found 0"),
        ("force\n" + "1\n" * (MOST + 1), f"rows: found {MOST + 1}; expected 1 to {MOST}, one for each step: copy "),
        ("force\n1\nmuch\n", "row 3, force: found much; expected a number"),
        ("force (lbf)\n1\n", "force (lbf): found the unit lbf; expected one of mN, N, kN, gf, kgf"),
        ("force [MN]\n1\n", "force [MN]: found the unit MN; expected one of mN, N, kN, gf, kgf"),
        ("force [Mn]\n1\n", "force [Mn]: found the unit Mn; expected one of mN, N, kN, gf, kgf"),
        ("Kraft/MN\n1\n", "Kraft/MN: found the unit MN; expected one of mN, N, kN, gf, kgf"),
        ("F_MN\n1\n", "F_MN: found the unit MN; expected one of mN, N, kN, gf, kgf"),
        ("force,displacement (Mm)\n1,1\n", "displacement (Mm): found the unit Mm; expected one of um, mm, cm, m"),
        ("force,time Ms\n1,1\n", "time Ms: found the unit Ms; expected one of ms, s, min"),
        ("force\n" + "1" * 140_000, "table: found field larger than field limit (131072); expected a readable table"),
    ],
)
def test_tables_that_cannot_be_understood_are_one_line(tmp_path, text, says):
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(says)):
        read_forces(tmp_path / "t.csv")


@pytest.fixture
def scans(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scans").symlink_to(PICTURES)
    (tmp_path / "forces.csv").write_text(TABLE, encoding="utf-8")
    return Path("scans"), Path("forces.csv")


def test_a_draft_lacks_what_no_picture_tells_and_nothing_else(scans):
    *files, marks = draft(Path("mine"), *scans)
    assert files == ["mine/study.yaml", "mine/steps.csv", "mine/config.yaml"]
    texts = {name: Path(name).read_text(encoding="utf-8") for name in files}
    assert marks.startswith(f"{sum(text.count(MARK) for text in texts.values())} lines are marked {MARK}")
    with pytest.raises(Problems) as found:
        check_study(Path("mine"))
    assert str(found.value) == "mine/study.yaml: body.thickness: found nothing; expected a number above 0"
    study = texts["mine/study.yaml"]
    Path("mine/study.yaml").write_text(study.replace("thickness:", "thickness: 70"), encoding="utf-8")
    told = check_study(Path("mine"), solve=False)
    assert "accepted" in told and "step_7.nii.gz" in told
    # the block of 12 x 12 mm at the origin, to two pixels of 0.1 mm
    found = re.search(r"width: ([-.\d]+).*origin: \[([-.\d]+), ([-.\d]+)\].*height: ([-.\d]+)", study, re.DOTALL)
    width, left, low, height = map(float, found.groups())
    assert (width, height) == pytest.approx((12, 12), abs=0.2)
    assert (left, low) == pytest.approx((0, 0), abs=0.2)
    with pytest.raises(FingerfitError, match=r"mine/study.yaml: is there already"):
        draft(Path("mine"), *scans)


def test_pictures_that_fit_no_steps_are_left_to_the_user(scans):
    pictures, forces = scans
    forces.write_text("force\n1\n2\n", encoding="utf-8")
    draft(Path("mine"), pictures, forces)
    assert "4 pictures (step_1.nii.gz, " in Path("mine/study.yaml").read_text(encoding="utf-8")
    assert Path("mine/steps.csv").read_text(encoding="utf-8") == "step,force,picture\n1,1,\n2,2,\n"


@pytest.mark.parametrize(
    ("origin", "body"), [((0.25, 0.25, 0.25), "brick: ["), ((9.0, 9.0, 9.0), "mesh:   # CHECK")]
)  # fmt: skip
def test_a_body_in_space_is_a_brick_where_it_stands_at_the_origin(tmp_path, monkeypatch, origin, body):
    import numpy as np

    from fingerfit.imaging.pictures import Picture, write_picture

    monkeypatch.chdir(tmp_path)
    values = np.zeros((12, 12, 12))
    values[:8, :8, :8] = 100
    for name in ("before", "during"):
        picture = Picture(values, np.full(3, 0.5), np.array(origin), np.eye(3))
        write_picture(tmp_path / "scans" / f"{name}.nii.gz", picture)
    Path("forces.csv").write_text("displacement um,force mN\n100,3\n", encoding="utf-8")
    draft(Path("mine"), Path("scans"), Path("forces.csv"))
    text = Path("mine/study.yaml").read_text(encoding="utf-8")
    assert body in text
    assert "units: {length: um, force: mN, time: s}\n" in text
    assert ("4e+03" in text or "4000" in text) == body.startswith("brick")


def scan(folder, number, time, text=""):
    """A DICOM series of three slices with a bright block, in a file for each slice."""
    folder.mkdir(parents=True, exist_ok=True)
    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for n in range(3):
        values = np.zeros((1, 8, 8), dtype=np.uint16)
        values[:, 2:6, 2:6] = 100
        image = sitk.GetImageFromArray(values)
        tags = {"0008|0060": "MR", "0020|000e": f"1.2.3.{number}", "0020|000d": "1.2.3", "0020|0013": str(n),
                "0020|0032": f"0\\0\\{2 * n}", "0020|0037": "1\\0\\0\\0\\1\\0", "0020|0011": str(number),
                "0008|0022": "20260101", "0008|0032": time, "0008|103e": text}  # fmt: skip
        for tag, value in tags.items():
            image.SetMetaData(tag, value)
        writer.SetFileName(str(folder / f"{number}_{n}.dcm"))
        writer.Execute(image)


@pytest.mark.parametrize("places", [("all",) * 3, ("c", "a", "b")])
def test_dicom_is_ordered_by_the_time_of_acquisition(tmp_path, monkeypatch, places):
    """Three series in one folder, or in one each; the last in number is the first in time."""
    monkeypatch.chdir(tmp_path)
    for place, number, time in zip(places, (7, 2, 5), ("101500", "102000", "103000.5"), strict=True):
        scan(Path("scans/study") / place, number, time, "T1 vibe")
    Path("forces.csv").write_text("force N\n1\n2\n", encoding="utf-8")
    draft(Path("mine"), Path("scans"), Path("forces.csv"))
    text = Path("mine/study.yaml").read_text(encoding="utf-8")
    rows = Path("mine/steps.csv").read_text(encoding="utf-8")
    if places[0] == "all":
        assert '"pictures/T1_vibe_0"' in text
        assert rows == "step,force,picture\n1,1,pictures/T1_vibe_1\n2,2,pictures/T1_vibe_2\n"
        assert sorted(path.name for path in Path("mine/pictures/T1_vibe_1").iterdir()) == [
            f"2_{n}.dcm" for n in range(3)
        ]
        assert read_picture(Path("mine/pictures/T1_vibe_2")).values.shape == (3, 8, 8)
    else:
        assert "in the order in which they were acquired" in text
        assert '"../scans/study/c"' in text
        assert rows == "step,force,picture\n1,1,../scans/study/a\n2,2,../scans/study/b\n"


def test_a_folder_without_series_is_one_line(tmp_path):
    (tmp_path / "scans/empty").mkdir(parents=True)
    (tmp_path / "scans/empty/notes.txt").write_text("none", encoding="utf-8")
    with pytest.raises(InputError, match=r"scans: pictures: found 1 pictures; expected one before compression"):
        draft(tmp_path / "mine", tmp_path / "scans", tmp_path / "forces.csv")
    scan(tmp_path / "one", 1, "101500")
    with pytest.raises(InputError, match=r"one: pictures: found 1 pictures; expected one before compression"):
        draft(tmp_path / "mine", tmp_path / "one", tmp_path / "forces.csv")
    assert not (tmp_path / "mine").exists()


def test_an_example_is_ready(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert {"phantom", "hidden-tilt"} <= set(examples())
    example(Path("own/tilt"), "hidden-tilt")
    assert "study: own/tilt\n" in Path("own/tilt/config.yaml").read_text(encoding="utf-8")
    assert not Path("own/tilt/sealed").exists()
    assert "own/tilt/config.yaml" in check_study(Path("own/tilt"), solve=False)
    with pytest.raises(InputError, match=r"--example: name: found other; expected one of hidden-inclusion"):
        example(Path("other"), "other")


def test_the_machine_solves_what_is_known():
    wrong = []
    lines = list(machine.look(wrong))
    assert wrong == []
    assert any(re.match(r"solver builtin \S+: self test passed", line) for line in lines)
    assert any(line.startswith("PARDISO: ") for line in lines)


def test_a_solver_that_answers_wrong_is_told(monkeypatch):
    monkeypatch.setattr(machine, "solver_names", lambda: ["builtin"])
    monkeypatch.setattr(machine, "homogeneous_force", lambda stretch, dim: (-1.0, 1.0))
    wrong = []
    assert list(machine.look(wrong))[-1].endswith("found, but its self test failed")
    assert wrong == ["solver builtin: found a reaction of 0.2788 N; expected 1 N, the closed form"]


def test_the_page_is_named_and_shown_where_there_is_a_screen(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example(Path("tilt"), "hidden-tilt")
    assert main(["open", "tilt"]) == 1
    assert (
        "results/tilt/report.html: is not there yet; make it: fingerfit run tilt --diagnose" in capsys.readouterr().err
    )
    page = tmp_path / "results/tilt/report.html"
    page.parent.mkdir(parents=True)
    page.write_text("<html></html>")
    shown = []
    monkeypatch.setattr(results.webbrowser, "open", shown.append)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    assert main(["open", "tilt"]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert shown == ([page.as_uri()] if sys.platform == "darwin" else [])
    monkeypatch.setenv("BROWSER", "something")
    assert main(["open", "--config", "tilt/config.yaml"]) == 0
    assert shown[-1] == page.as_uri()
    settings = yaml.safe_load(Path("tilt/config.yaml").read_text(encoding="utf-8"))
    Path("two.yaml").write_text(yaml.safe_dump({**settings, "runs": [{}, {"study": "other"}]}), encoding="utf-8")
    assert main(["open", "--config", "two.yaml"]) == 1
    assert "two.yaml: runs: found several studies; expected fingerfit open STUDY" in capsys.readouterr().err
    assert main(["open", "tilt", "--config", "two.yaml"]) == 0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["run"], "config.yaml: file: found No such file or directory"),
        (["run", "--config", "no.yaml"], "no.yaml: file: found No such file or directory"),
        (["run", "tilt"], "tilt: settings: found none: config.yaml is for studies/phantom"),
        (["discover", "--config", "no.yaml"], "no.yaml: file: found No such file or directory"),
        (
            ["new", "other"],
            "new: options: found no data, or too many; expected --pictures and --forces, or --from, or --exam",
        ),
        (["new", "other", "--pictures", "no", "--forces", "no.csv"], "--pictures: folder: found no; expected a folder"),
        (
            ["experiment", "x.yaml", "--out", "tilt"],
            "tilt/study.yaml: file: found a study; expected none yet, or --force",
        ),
    ],
)
def test_mistakes_are_one_line(tmp_path, monkeypatch, capsys, words, says):
    monkeypatch.chdir(tmp_path)
    example(Path("tilt"), "hidden-tilt")
    Path("tilt/config.yaml").unlink()
    if words == ["run", "tilt"]:
        Path("config.yaml").write_bytes((ROOT / "config.yaml").read_bytes())
    assert main(words) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"fingerfit: error: {says}")


def test_an_experiment_tells_what_it_does_and_replaces_only_when_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("e.yaml").write_text(yaml.safe_dump(DESCRIPTION), encoding="utf-8")
    words = ["experiment", "e.yaml", "--out", "one"]
    for more, code in (([], 0), ([], 1), (["--force"], 0)):
        assert main([*words, *more]) == code
        said = [line[line.index(" s  ") + 4 :] for line in capsys.readouterr().out.splitlines()]
        told = ["builtin: 1 steps on 16 nodes", "picture 1 of 2", "picture 2 of 2", "one: written"]
        assert said == [f"experiment: {one}" for one in told if code == 0]


def test_docs_are_written_only_where_it_is_told(capsys):
    with pytest.raises(SystemExit):
        main(["docs"])
    assert "the following arguments are required: folder" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough_is_no_error():
    """`fingerfit effects | head -1`; the pipe is closed before anything is written."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "fingerfit", "effects"], stdout=write, stderr=subprocess.PIPE, cwd=ROOT
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_shell_completes_commands_and_options(tmp_path):
    pytest.importorskip("argcomplete", reason="it is in requirements.lock")
    for line, expected in (("fingerfit ru", "run"), ("fingerfit run --exp", "--export")):
        asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": " ", "COMP_LINE": line, "COMP_POINT": str(len(line))}
        asked["_ARGCOMPLETE_STDOUT_FILENAME"] = str(tmp_path / "words")
        subprocess.run([sys.executable, "-m", "fingerfit"], env={**os.environ, **asked}, cwd=ROOT, check=True)
        assert (tmp_path / "words").read_text(encoding="utf-8").strip() == expected
