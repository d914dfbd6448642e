"""A user's mistakes: one clear line each, exit code 1, no traceback, nothing half written."""

from __future__ import annotations

import gzip
import json
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from figures import check_file, corners, images, legend_of, recorded
from scipy.ndimage import gaussian_filter
from seeds import generator

from fingerfit.cli import main
from fingerfit.core.checksums import seal
from fingerfit.imaging.pictures import Picture, read_picture, write_picture
from fingerfit.solvers.builtin import BuiltinSolver

ROOT = Path(__file__).resolve().parents[2]
TEMPLATE = "*STEP\n{{ layers[0].mu }}\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A small study and its config in an empty folder."""
    monkeypatch.chdir(tmp_path)
    study = tmp_path / "study"
    rng = generator(1)
    for name in ("before", "step_1", "step_2"):
        picture = Picture(rng.uniform(0, 4000, (30, 30)), np.full(2, 0.8), np.full(2, -5.0), np.eye(2))
        write_picture(study / f"{name}.nii.gz", picture)
    (study / "steps.csv").write_text(
        "step,time,displacement,force,picture\n1,1,0.5,7,step_1.nii.gz\n2,2,1.0,14,step_2.nii.gz\n"
    )
    data = {
        "title": "t",
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": "force",
        "steps": "steps.csv",
        "pictures": {"before": "before.nii.gz", "noise": "estimated"},
        "noise": {"force": 0.1},
        "body": {
            "width": 12,
            "thickness": 70,
            "layers": [{"name": "top", "height": 6}, {"name": "bottom", "height": 6}],
        },
        "boundary": {"base": "held", "indenter": "glued"},
    }
    (study / "study.yaml").write_text(yaml.safe_dump(data))
    config = {
        "study": "study",
        "model": {
            "material": {"alpha": 1.4, "poisson": 0.49},
            "mesh": {"element": "CPE4", "across": 3, "per_layer": 2},
            "parameters": {"mu": {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}},
        },
        "fit": {"score": "nmi", "stages": [{"name": "s", "kind": "independent"}]},
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    return tmp_path


def edit(path, change):
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(yaml.safe_dump(data))


def study(change):
    return lambda place: edit(place / "study/study.yaml", change)


def config(change):
    return lambda place: edit(place / "config.yaml", change)


def text(name, old, new):
    def change(place):
        path = place / name
        assert old in path.read_text(encoding="utf-8")
        path.write_text(path.read_text(encoding="utf-8").replace(old, new))

    return change


def picture(name, **changes):
    def change(place):
        values = changes.pop("values", np.ones((30, 30)))
        frame = {"spacing": np.full(values.ndim, 0.8), "origin": np.full(values.ndim, -5.0)} | changes
        write_picture(place / "study" / name, Picture(values, direction=np.eye(values.ndim), **frame), float)

    return change


NAN = np.ones((30, 30))
NAN[3, 3] = np.nan
STEPS = "study/steps.csv"
CASES = {
    "unknown key": (study(lambda d: d.update(contrl="force")), "contrl: found an unknown key; expected control"),
    "unknown key inside": (study(lambda d: d["body"].update(widht=3)), "body.widht: found an unknown key; expected width"),
    "wrong unit": (study(lambda d: d["units"].update(force="lbf")), "units.force: found lbf; expected one of mN, N"),
    "unknown control": (study(lambda d: d.update(control="stress")), "control: found stress; expected one of force"),
    "missing steps key": (study(lambda d: d.pop("steps")), "study.yaml: steps: found nothing"),
    "missing table": (study(lambda d: d.update(steps="no.csv")), "no.csv: steps: found No such file"),
    "missing picture": (text(STEPS, "step_2.nii", "step_9.nii"), "row 3, picture: found step_9.nii.gz"),
    "missing first picture": (lambda p: (p / "study/before.nii.gz").unlink(), "pictures.before: found before.nii.gz"),
    "no first picture": (study(lambda d: d.pop("pictures")), "pictures.before: found nothing"),
    "NaN in forces": (text(STEPS, ",14,", ",nan,"), "row 3, force: found nan; expected a finite number"),
    "text in forces": (text(STEPS, ",14,", ",14N,"), "row 3, force: found 14N"),
    "negative force": (text(STEPS, ",14,", ",-14,"), "row 3, force: found -14; expected 0 or more"),
    "force missing": (text(STEPS, ",14,", ",,"), "step 2 without force"),
    "steps not rising": (text(STEPS, "\n2,2,", "\n1,2,"), "row 3, step: found 1; expected a number above 1"),
    "time not rising": (text(STEPS, "\n2,2,", "\n2,1,"), "row 3, time: found 1"),
    "ragged row": (text(STEPS, "\n2,2,", "\n2,2,2,"), "row 3: found 6 cells; expected 5"),
    "unknown column": (text(STEPS, "force", "Load"), "columns: found Load"),
    "empty table": (lambda p: (p / STEPS).write_text(""), "columns: found an empty table"),
    "table without rows": (lambda p: (p / STEPS).write_text("step,force\n"), "rows: found none"),
    "layer of no height": (study(lambda d: d["body"]["layers"][0].update(height=0)), "layers.0.height: found 0"),
    "layer twice": (study(lambda d: d["body"]["layers"][0].update(name="bottom")), "layers.1.name: found bottom"),
    "mesh file missing": (study(lambda d: (d["body"].update(mesh="m.inp"), d["body"].pop("width"))), "body.mesh: found m.inp"),
    "broken YAML": (lambda p: (p / "study/study.yaml").write_text("a: [1,\n"), "study.yaml: line 2"),
    "tab in YAML": (lambda p: (p / "study/study.yaml").write_text("a:\n\tb: 1\n"), "study.yaml: line 2"),
    "YAML that would run": (
        lambda p: (p / "study/study.yaml").write_text("title: !!python/object/apply:os.mkdir [ran]\n"),
        "could not determine a constructor",
    ),
    "a list as study": (lambda p: (p / "study/study.yaml").write_text("- 1\n"), "expected keys and values"),
    "unreadable NIfTI": (lambda p: (p / "study/step_1.nii.gz").write_bytes(gzip.compress(b"no")), "step_1.nii.gz: picture"),
    # not NIfTI: its library reads NaN as 0 without a word
    "NaN in a picture": (
        lambda p: [picture("step_1.mha", values=NAN)(p), text(STEPS, "step_1.nii.gz", "step_1.mha")(p)],
        "step_1.mha: picture: found NaN",
    ),
    "other geometry": (picture("step_2.nii.gz", spacing=np.full(2, 0.7)), "step_2.nii.gz: geometry"),
    "no overlap": (
        lambda p: [picture(f"{n}.nii.gz", origin=np.full(2, 90.0))(p) for n in ("before", "step_1", "step_2")],
        "expected a picture that overlaps the body",
    ),
    "volume for a plane mesh": (
        lambda p: [picture(f"{n}.nii.gz", values=np.ones((4, 30, 30)))(p) for n in ("before", "step_1", "step_2")],
        "found 3 dimensions; expected 2",
    ),
    "needed key misspelt": (
        study(lambda d: d["body"].update(widht=d["body"].pop("width"))),
        "body.widht: found an unknown key; expected width",
    ),
    "needed config key misspelt": (
        config(lambda d: d["fit"].update(stage=d["fit"].pop("stages"))),
        "fit.stage: found an unknown key; expected stages",
    ),
    "unknown config key": (config(lambda d: d["fit"].update(scor="nmi")), "fit.scor: found an unknown key; expected score"),
    "unknown score": (config(lambda d: d["fit"].update(score="mi")), "fit.score: found mi; expected 'nmi', 'ssd'"),
    "negative tolx": (config(lambda d: d["fit"]["stages"][0].update(tolx=-1)), "fit.stages.0.tolx: found -1"),
    "unknown solver": (config(lambda d: d.update(solver="calculx")), "did you mean calculix?"),
    "unknown layer": (
        config(lambda d: d["model"].update(parameters={"mu_skin": d["model"]["parameters"]["mu"]})),
        "model.parameters.mu_skin: found layer skin; expected a layer of the study: top, bottom",
    ),
    "start out of bounds": (
        config(lambda d: d["model"]["parameters"]["mu"].update(start=5.0)),
        "model.parameters.mu: found start 5; expected 0.01 to 1",
    ),
    "log of zero": (config(lambda d: d["model"]["parameters"]["mu"].update(lower=0.0)), "expected above 0"),
    "no mesh": (config(lambda d: d["model"].pop("mesh")), "model.mesh: found nothing"),
    "bounds swapped": (
        config(lambda d: d["model"]["parameters"]["mu"].update(lower=1.0, upper=0.01)),
        "model.parameters.mu: found lower 1, which is above upper 0.01; expected lower below upper",
    ),
    "decimal comma in a number": (
        text("config.yaml", "      start: 0.1\n", "      start: 0\n      05:\n"),  # what YAML makes of {start: 0,05}
        "model.parameters.mu: found the number 5 for a key; expected names of values; a number has a decimal point",
    ),
    "semicolons": (text(STEPS, ",", ";"), "steps.csv: columns: found semicolons between the cells; expected commas"),
    "no such step": (config(lambda d: d["fit"].update(steps=[1, 8])), "fit.steps: found step 8"),
}  # fmt: skip


def errors(capsys):
    return [line for line in capsys.readouterr().err.splitlines() if line]


@pytest.mark.parametrize("name", CASES)
def test_one_clear_line(place, name, capsys):
    change, expected = CASES[name]
    change(place)
    before = sorted(place.rglob("*"))
    assert main(["check", "study", "--picture", "mesh.png"]) == 1
    lines = errors(capsys)
    assert len(lines) == 1, lines
    assert lines[0].startswith("fingerfit: error: ")
    assert expected in lines[0]
    assert sorted(place.rglob("*")) == before


def test_the_study_itself_is_fine(place, capsys, monkeypatch):
    drawn = recorded(monkeypatch)
    assert main(["check", "study", "--picture", "mesh.png"]) == 0
    assert "identifiable: stiffness itself" in capsys.readouterr().out
    # the mesh where the body is, 12 mm wide and of two layers of 6 mm, over the picture where that is
    (axes,) = drawn["mesh"].axes
    assert corners(axes, "top") == pytest.approx(np.array([[0, 6], [12, 12]]))
    assert corners(axes, "bottom") == pytest.approx(np.array([[0, 0], [12, 6]]))
    assert {"bottom", "top"} < set(legend_of(drawn["mesh"]))
    values, borders = images(axes)
    # the part of the picture around the body, which lies where its pixels of 0.8 mm do: the first one around -5 mm
    pixels = (np.array(borders) + 5.4) / 0.8
    left, right, low, high = np.rint(pixels).astype(int)
    assert pixels == pytest.approx([left, right, low, high], abs=1e-4)
    part = read_picture(place / "study/before.nii.gz").values[low:high, left:right]
    # smoothed by one pixel, and a border is smoothed in another way than here
    smooth = gaussian_filter(part, 1.0)[3:-3, 3:-3]
    assert np.corrcoef(values[3:-3, 3:-3].ravel(), smooth.ravel())[0, 1] > 0.999
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x in mm", "y in mm")
    check_file(place / "mesh.png", drawn["mesh"])


def test_all_problems_at_once(place, capsys):
    study(lambda d: (d["units"].update(force="lbf"), d.update(control="x"), d["body"].update(width=-1)))(place)
    text(STEPS, ",14,", ",nan,")(place)
    assert main(["check", "study"]) == 1
    assert len(errors(capsys)) == 4


def prepared(place):
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 0
    return [
        "propose",
        "config.yaml",
        "--data",
        "data.npz",
        "--mesh",
        "mesh.inp",
        "--sims",
        "sims",
        "--out",
        "0.json",
    ]


TEMPLATES = {
    "misspelt name": ("*STEP\n{{ layers[0].mue }}\n", "own.inp.j2: line 2"),
    "syntax": ("*STEP\n{% for %}\n", "own.inp.j2: line 2"),
    "missing part": ("{% include 'nothing.j2' %}\n", "nothing.j2"),
    "escape": ("{{ ''.__class__.__mro__[1].__subclasses__() }}\n", "unsafe"),
}


@pytest.mark.parametrize("name", TEMPLATES)
def test_templates(place, name, capsys):
    template, expected = TEMPLATES[name]
    (place / "study/own.inp.j2").write_text(template)
    config(lambda d: d["model"].update(template="own.inp.j2"))(place)
    assert main(prepared(place)) == 1
    lines = errors(capsys)
    assert len(lines) == 1
    assert expected in lines[0]
    assert not (place / "0.json").exists()


def test_missing_template(place, capsys):
    config(lambda d: d["model"].update(template="none.inp.j2"))(place)
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 1
    assert "config.yaml: model.template: found none.inp.j2; expected a template in" in errors(capsys)[0]


def test_missing_ccx(place, capsys, monkeypatch):
    config(lambda d: d.update(solver="calculix"))(place)
    monkeypatch.setenv("FINGERFIT_CCX", "no-such-ccx")
    assert main(prepared(place)) == 1
    assert "no executable no-such-ccx; install CalculiX" in errors(capsys)[0]


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a zip"])
def test_damaged_results(place, capsys, damage):
    command = prepared(place)
    (place / "data.npz").write_bytes(damage)
    assert main(command) == 1
    lines = errors(capsys)
    assert len(lines) == 1
    assert "data.npz: cannot be read" in lines[0]


def test_pickles_are_not_opened(place, capsys):
    command = prepared(place)
    with (place / "data.npz").open("w+b") as handle:
        np.savez(handle, step=np.array([{"a": 1}], dtype=object))
        seal(handle)
    assert main(command) == 1
    assert "data.npz: cannot be read: Object arrays cannot be loaded" in errors(capsys)[0]


@pytest.mark.parametrize("command", ["prepare"])
def test_full_disk(place, command):
    """A quota of 4 kB for each file stands for the full disk."""

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    arguments = [
        sys.executable,
        "-B",  # compiled modules would be cut as well, and kept
        "-m",
        "fingerfit.cli",
        "prepare",
        "config.yaml",
        "--out",
        "data.npz",
        "--mesh",
        "mesh.inp",
    ]
    done = subprocess.run(arguments, capture_output=True, text=True, preexec_fn=limit, cwd=place)
    assert done.returncode == 1
    assert done.stderr.splitlines() == ["fingerfit: error: data.npz: cannot be written: File too large"]
    assert not (place / "data.npz").exists()
    assert not list(place.glob(".data*"))


def test_decks(place, capsys):
    (place / "solver.json").write_text(json.dumps(BuiltinSolver().identity()))
    for deck, expected in (
        ("*NODE\n1, 0., 0.\n*ELEMNT\n", "deck.inp: line 3, *ELEMNT: found an unknown keyword"),
        ("*NODE\n1, 0., x\n", "deck.inp: line 2, *NODE: found x; expected a number"),
        ("*INCLUDE, INPUT=none.inp\n", "none.inp: deck: found"),
    ):
        (place / "deck.inp").write_text(deck)
        assert main(["simulate", "deck.inp", "--solver", "solver.json", "--out", "s.npz"]) == 1
        assert expected in errors(capsys)[0]
        assert not (place / "s.npz").exists()


def test_a_result_of_another_solver_version_is_not_made(place, capsys):
    shutil.copy(ROOT / "config.yaml", place / "deck.inp")
    (place / "solver.json").write_text('{"name": "builtin", "version": "0"}')
    assert main(["simulate", "deck.inp", "--solver", "solver.json", "--out", "s.npz"]) == 1
    assert "run the workflow again" in errors(capsys)[0]
