"""Every command that README.md, docs/*.md and `--help` show is run: here as it stands, or by the file that a table names.

What is run here are sessions of a shell in a copy of the project, in the order of the documents, with a coarse mesh and
a short search in config.yaml; only the first one of README.md, `make run`, has the settings of the project. A command that a document shows and that is neither in a session nor in the table fails.
"""

import argparse
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import one_layer
import pytest
import yaml
from seeds import seed_of

from fingerfit.cli import _parser, main

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PROGRAMS = r"fingerfit|snakemake|make|python3?|pip|source|sed|cp|mkdir"
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMAND = re.compile(rf"(?:[A-Z_]+=\S+ )*(?:{PROGRAMS}) .+")
NAME = re.compile(r"(fingerfit|snakemake) ([a-z]+)")
"""A command's name alone, as a sentence mentions it."""


def shown():
    """Commands of code blocks without a language, and those in the text between single backticks, with their places."""
    found = {}
    for path in DOCUMENTS:
        fence, lines = None, []
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("```"):
                fence = line[3:] if fence is None else None
            elif fence is None:
                lines += re.findall(r"`([^`]+)`", line)
            elif fence == "":
                lines.append(line)
        for line in lines:
            for part in re.sub(r"\s+# .*", "", line).split("; "):
                if COMMAND.fullmatch(part.strip()):
                    found.setdefault(part.strip(), path.name)
    return found | dict.fromkeys(examples().values(), "--help")


def examples():
    """The example of each command's help, by the words of the command."""
    found = {}

    def look(parser):
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for sub in action.choices.values():
                    found[sub.prog] = (sub.epilog or "").removeprefix("example:\n").strip()
                    look(sub)

    look(_parser())
    return found


def examples_of(*names):
    """Examples of commands for the workflow, which are long."""
    return [examples()[f"fingerfit {name}"] for name in names]


PLACES = {
    "/some/existing/folder": "$PWD/shared",
    "DESCRIPTION.yaml": "small.yaml",
    "DECK": "$(ls results/mine/sims/*/deck.inp | head -1)",
    "results/STUDY/MODEL": "results/phantom/base",
    "sims/NAME": "sims/$(ls results/phantom/sims | head -1)",
    "rounds/LAST": "rounds/$(($(ls results/phantom/base/rounds | wc -l) - 1))",
    "STUDY/": "studies/mine/",
    "STUDY": "studies/mine",
    "--size 9 --out breast/body.inp": "--size 14 --out breast/body.inp",
    "--size 6 --out breast/refined.inp": "--size 11 --out breast/refined.inp",
    "--size 5 --out breast/truth.inp": "--size 10 --out breast/truth.inp",
}
"""What a command names that a user has elsewhere, and coarser meshes."""
SESSIONS = {
    "look": [
        "source .venv/bin/activate", "make help", "make setup", "fingerfit effects", "fingerfit docs .", "fingerfit add tilt",
        "fingerfit drop tilt", "fingerfit effects studies/phantom", "fingerfit check studies/phantom", "fingerfit doctor",
    ],
    "new": [
        "> cp -r studies/phantom/pictures scans; cut -d, -f2,3 studies/phantom/steps.csv > forces.csv",
        "fingerfit new mine --pictures scans --forces forces.csv",
        "> sed -i 's/thickness:/thickness: 70/' mine/study.yaml",
        "fingerfit check mine --picture mesh.png",
        "> rm -r mine; mkdir dic; python -c \"import sys; sys.path.append('tests'); import programs, pathlib as p;"
        " programs.write(p.Path('dic'), 'VIC-3D'); p.Path('machine.csv').write_text(programs.INSTRON)\"",
        "fingerfit new mine --from dic machine.csv --rate 5",
        "> sed -i 's/thickness:/thickness: 70/' mine/study.yaml; fingerfit check mine --picture mesh.png --no-solve",
        "> mkdir data; printf 'machine: {file: ../machine.csv}\\n' > data/data.yaml; rm -r mine",
        "fingerfit new mine --from data/data.yaml",
    ],
    "tests": ["make test", "make test-all"],
    "fast": ["make fast"],
    "cluster": ["make cluster"],
    "run": ["make run"],
    "study": [
        "source .venv/bin/activate",
        "mkdir -p studies/mine/pictures",
        "cp studies/phantom/pictures/*.nii.gz studies/mine/pictures/",
        "cp config.yaml mine.yaml",
        "> sed -i s,studies/phantom,studies/mine, mine.yaml; cp mine.yaml studies/mine/config.yaml",
        "fingerfit check studies/mine --config mine.yaml --picture mesh.png",
        "fingerfit check studies/mine",
        "fingerfit check STUDY --config STUDY/config.yaml --picture mesh.png",
        "fingerfit effects studies/mine",
        "fingerfit run studies/mine --config mine.yaml",
        "snakemake --configfile mine.yaml",
        "fingerfit deck show DECK",
    ],
    "shared": [
        "> cp studies/phantom/pictures/*.nii.gz studies/mine/; sed -i s,pictures/,, studies/mine/study.yaml studies/mine/steps.csv",
        "> sed s,studies/phantom,studies/mine, config.yaml > mine.yaml; mkdir shared",
        "SNAKEMAKE_OUTPUT_CACHE=/some/existing/folder snakemake --cores 2 --cache --configfile mine.yaml",
        "> ls shared/*",
    ],
    "fingertip": [
        "make fingertip-data",
        "make fingertip-coarse",
        "fingerfit finger --out reference.inp",
        "> cp studies/fingertip/pictures/before.nii.gz .",
        "fingerfit morph reference.inp before.nii.gz --at 25.49 0 --out subject.inp",
    ],
    "breast": [
        "mkdir -p breast",
        "cp examples/breast/experiment.yaml breast/experiment.yaml",
        "python examples/breast/make_labels.py breast/labels.nii.gz",
        "fingerfit mesh breast/labels.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --holes 4=TOP --size 9 --out breast/body.inp",
        "fingerfit mesh breast/labels.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --holes 4=TOP --size 6 --out breast/refined.inp",
        "fingerfit mesh breast/labels.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --holes 4=TOP --size 5 --out breast/truth.inp",
        "fingerfit experiment breast/experiment.yaml --out studies/breast",
        "cp examples/breast/config.yaml studies/breast/config.yaml",
        "fingerfit check studies/breast --picture mesh.png",
        "fingerfit run studies/breast",
        "python examples/breast/make_labels.py breast/other.nii.gz other",
        "fingerfit morph breast/refined.inp breast/other.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --out breast/other.inp",
        "> cp breast/refined.inp reference.inp; cp studies/breast/pictures/before.nii.gz .; cp before.nii.gz other.nii.gz",
        "fingerfit morph reference.inp other.nii.gz --own before.nii.gz --out other.inp",
        "> cp breast/labels.nii.gz .",
        "fingerfit mesh labels.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --holes 4=TOP --size 8 --out body.inp",
    ],
    "case": ["python benchmarks/hidden_effects.py --only relaxation --write studies/hidden"],
    "experiment": [
        "> rm studies/mine/study.yaml",
        "fingerfit experiment DESCRIPTION.yaml --out STUDY",
        "fingerfit experiment studies/phantom/experiment.yaml --out studies/virtual",
    ],
    "calculix": ["snakemake --cores 2 --configfile studies/phantom/calculix.yaml"],
    "diagnose": [
        "fingerfit run studies/phantom --diagnose", "fingerfit run studies/phantom --export", "snakemake --cores 2 export",
        "fingerfit export results/STUDY/MODEL",
        "fingerfit export results/phantom/base", "fingerfit open studies/phantom", "fingerfit profile mu_top", *examples_of("simulate", "prepare", "propose"),
        *examples_of("estimate", "plot", "diagnose", "ladder"),
        "> python -c 'import json, yaml; print(json.dumps(yaml.safe_load(open(\"config.yaml\"))))' > settings.json",
        *examples_of("settings"),
    ],
    "tilt": [
        "fingerfit new tilt --example hidden-tilt",
        "> sed s,studies/phantom,tilt, config.yaml > tilt/config.yaml",
        "fingerfit run tilt -- --dry-run", "fingerfit run tilt", "fingerfit run tilt --diagnose", "fingerfit open tilt",
        "fingerfit add tilt --config tilt/config.yaml", "fingerfit drop tilt --config tilt/config.yaml",
        "fingerfit add tilt --config tilt/config.yaml",
    ],
}  # fmt: skip
"""What is run here; lines that begin with ``>`` are what the documents say in words."""
LEFT = {
    "run": {"results/phantom/base/estimate.json": ["mu"], "results/phantom/base/figures/force.png": []},
    "study": {"mesh.png": [], "results/mine/base/table.txt": ["mu"]},
    "experiment": {"studies/mine/steps.csv": ["step"], "studies/virtual/study.yaml": ["layers"]},
    "diagnose": {
        "results/phantom/report.html": ["<html", "Profile of mu_top"],
        "results/phantom/base/export/error_by_step.csv": ["step"],
    },
    "calculix": {"results/phantom/calculix/table.txt": ["solver calculix"]},
    "tilt": {"tilt/config.yaml": ["tilt: {power:"], "results/tilt/base/diagnosis.json": ["verdict"]},
    "new": {"mesh.png": [], "mine/config.yaml": ["# CHECK"]},
    "fingertip": {"subject.inp": ["C3D10H"], "studies/fingertip-coarse/subject.inp": ["C3D4"]},
    "breast": {
        "mesh.png": [],
        "results/breast/base/table.txt": ["mu_lump"],
        "body.inp": ["C3D10"],
        "breast/other.inp": ["LUMP"],
        "other.inp": ["LUMP"],
    },
    "case": {"studies/hidden/relaxation/study.yaml": ["layers"]},
}
"""What a session leaves, and texts in it."""
AS_SHIPPED = {"run": 60}
"""Sessions with the settings of the project, which fit the phantom as users do, and the lines that they may print: what
fits on a screen or two."""
DIAGNOSED = ("diagnose", "tilt")
"""Sessions that fit each layer, as a diagnosis needs it; in the others one constant is enough."""
SLOW = ("tests", "run", "study", "shared", "calculix", "diagnose", "tilt", "fingertip", "case", "breast")
INSTALLED = "tests/workflow/test_installed.py"
FINGERTIP, FOREIGN = "benchmarks/fingertip.py", "benchmarks/foreign/run.py"
GOAL = ('"snakemake", goal, "--cores", str(cores), "--configfile"', 'choices=("diagnose", "discover")')
CONFIGFILE = '"snakemake", "--cores", "2", "--configfile", str(folder / "config.yaml")'
ELSEWHERE = {
    "fingerfit discover --config tilt/config.yaml": (FOREIGN, GOAL),
    "fingerfit run studies/mine --config mine.yaml --diagnose": (FOREIGN, GOAL),
    "fingerfit discover --config config.yaml": ("tests/workflow/test_hidden.py", ('snakemake(place, "discover")',)),
    "fingerfit run mine": (INSTALLED, ('"run", "mine"',)),
    "python3 -m venv env": (INSTALLED, ('"-m", "venv"',)),
    "source env/bin/activate": (INSTALLED, ('programs / "fingerfit"',)),
    "pip install .": (INSTALLED, ('"-m", "pip", "wheel"', '"install", *OFFLINE')),
    "pip install ./fingerfit": (INSTALLED, ('"-m", "pip", "wheel"', '"install", *OFFLINE')),
    "snakemake --cores 2 results/subject2/coarse/table.txt": (
        "tests/workflow/test_runs.py", ('run(place, f"{FOLDERS[1]}/table.txt")',)
    ),
    "fingerfit run --profile slurm": ("tests/cluster/test_cluster.py", ('"--profile", "slurm"',)),
    "snakemake --workflow-profile workflow/profiles/slurm": (
        "tests/cluster/test_cluster.py", ('"--workflow-profile", str(ROOT / "workflow/profiles/slurm")',)
    ),
    "make fingertip": (FINGERTIP, (CONFIGFILE,)),
    "make benchmark": ("benchmarks/phantom.md", ("Made by `benchmarks/phantom.py` (`make benchmark`)",)),
    "make benchmark-solver": ("benchmarks/solver.md", ("Made by `make benchmark-solver`",)),
    "make benchmark-indentation": ("benchmarks/indentation.md", ("Made by `make benchmark-indentation`",)),
    **dict.fromkeys(
        ("fingerfit mesh study.yaml --size 1 --out body.inp", "fingerfit mesh outlines.yaml --size 1 --out body.inp"),
        ("tests/unit/test_outlines.py", ('main(["mesh", str(tmp_path / f"{name}.yaml"), "--size"', '("outlines", {', '("study", {')),
    ),
    "pip install ./examples/solver-package": (
        "tests/conformance/test_example_package.py", ('"-m", "pip", "install"', 'PACKAGE = ROOT / "examples/solver-package"')
    ),
}  # fmt: skip
"""What takes long or a network: the file that runs it, and what stands there."""


def names():
    """Commands that are mentioned by their name alone, and are not run as they stand."""
    run = {line for lines in SESSIONS.values() for line in lines}
    return {line: where for line, where in shown().items() if NAME.fullmatch(line) and line not in run}


def test_every_command_is_run_somewhere():
    known = {line for lines in SESSIONS.values() for line in lines if not line.startswith(">")} | ELSEWHERE.keys()
    missing = {line: where for line, where in shown().items() if line not in known | names().keys()}
    assert missing == {}, "run them in a session, or name the file that runs them"
    assert known <= shown().keys(), f"no document shows {known - shown().keys()}"


def test_the_files_named_run_the_command():
    for line, (file, texts) in ELSEWHERE.items():
        written = (ROOT / file).read_text(encoding="utf-8")
        assert texts and all(text in written for text in texts), (line, file)


def test_names_of_commands_are_known(capsys):
    run = {line for lines in SESSIONS.values() for line in lines} | ELSEWHERE.keys()
    for line, where in names().items():
        program, name = line.split()
        if program == "fingerfit":
            with pytest.raises(SystemExit) as ended:
                main([name, "--help"])
            assert ended.value.code == 0, (line, where)
        else:
            assert any(other.startswith(program) and name in other.split() for other in run), (line, where)


DOCUMENTED_STUDY = {
    "steps.csv": r"`studies/mine/steps.csv`.*?^```\n(.*?)^```",
    "study.yaml": r"`studies/mine/study.yaml`:\s+```yaml\n(.*?)^```",
}
"""Where docs/study.md has the files of its example."""
COARSE = {
    "Makefile": (("--size 1.7", "--size 5"),),
    "studies/fingertip/experiment.yaml": (
        ("[0.8, 1.6, 2.4, 3.2, 4.0]", "[0.4]"), ("[1, 2, 3, 4, 5]", "[1]"), ("[192, 128, 128]", "[96, 64, 64]"),
        ("[0.234, 0.234, 0.234]", "[0.468, 0.468, 0.468]"),
    ),
    "studies/phantom/experiment.yaml": (("across: 36, per_layer: 12", "across: 4, per_layer: 2"),),
    "examples/breast/experiment.yaml": (("[2, 4, 6]", "[2, 4]"), ("pictured: [1, 2, 3]", "pictured: [1, 2]")),
}  # fmt: skip
STAGES = [{"name": "one", "kind": "independent", "step": 0.1, "tolx": 0.5, "tolf": 1.0}]
SMALL = {
    **one_layer.DESCRIPTION,
    "title": "small",
    "mesh": {"element": "CPE8", "across": 3, "per_layer": 3, "grading": 1},
    "displacement": [1.0],
    "picture": {**one_layer.DESCRIPTION["picture"], "pixels": 48},
    "seed": seed_of(1),
}


@pytest.fixture
def project(tmp_path, request):
    """A copy of the project with coarse meshes, a few constants that start near their ends, and a file of tests."""
    for name in ("Snakefile", "Makefile", "config.yaml", "pyproject.toml", *(p.name for p in ROOT.glob("*.lock"))):
        shutil.copy2(ROOT / name, tmp_path / name)
    for name in ("workflow", "templates", "benchmarks", "docs"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", ".cache"))
    (tmp_path / "profiles").symlink_to("workflow/profiles")
    for name in ("phantom", "hidden-tilt", "fingertip", "fingertip-coarse"):
        made = shutil.ignore_patterns("*.inp", *(["pictures", "sealed", "st*"] if name == "fingertip" else []))
        shutil.copytree(ROOT / "studies" / name, tmp_path / "studies" / name, ignore=made)
    for name in (
        "tests/conftest.py",
        "tests/seeds.py",
        "tests/programs.py",
        "tests/faults/table.py",
        "tests/unit/test_ogden.py",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / "examples/breast", tmp_path / "examples/breast")
    for name, pairs in COARSE.items():
        text = (tmp_path / name).read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in text, (name, old)
            text = text.replace(old, new)
        (tmp_path / name).write_text(text, encoding="utf-8")
    for path in (tmp_path / "config.yaml", tmp_path / "studies/phantom/calculix.yaml"):
        if request.node.callspec.params["name"] in AS_SHIPPED:
            continue
        config = yaml.safe_load(path.read_text(encoding="utf-8"))
        config["model"]["mesh"] |= {"across": 4, "per_layer": 1}
        config["model"].pop("refined", None)
        if request.node.callspec.params["name"] in DIAGNOSED:
            for entry in config["model"]["parameters"].values():
                entry["start"] = 0.035
        else:
            config["model"]["parameters"] = {"mu": {"unit": "MPa", "start": 0.035, "lower": 0.01, "upper": 0.1}}
        config["fit"] |= {"stages": STAGES, "replicates": 20, "steps": [3, 7]}
        config["diagnosis"] = {"only": one_layer.FEW}
        path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(SMALL, sort_keys=False), encoding="utf-8")
    text = (ROOT / "docs/study.md").read_text(encoding="utf-8")
    path = tmp_path / "examples/breast/config.yaml"
    config = yaml.safe_load(path.read_text(encoding="utf-8"))
    # near the true constants, so that two sets of slopes are enough
    for name, value in {"mu_fat": 0.0021, "mu_gland": 0.0052, "mu_lump": 0.0155}.items():
        config["model"]["parameters"][name]["start"] = value
    config["fit"]["replicates"] = 20
    path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    (tmp_path / "studies/mine").mkdir()
    for name, pattern in DOCUMENTED_STUDY.items():
        (found,) = re.findall(pattern, text, re.MULTILINE | re.DOTALL)
        (tmp_path / "studies/mine" / name).write_text(found, encoding="utf-8")
    (tmp_path / ".venv").mkdir()
    for path in Path(sys.prefix).iterdir():
        if path.name != "ready":
            (tmp_path / ".venv" / path.name).symlink_to(path)
    (tmp_path / ".venv/ready").touch()
    return tmp_path


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in SESSIONS])
def test_a_session_of_commands(project, name):
    """All in one shell, which ends at the first that fails; programs are those of this environment."""
    if "source .venv/bin/activate" in SESSIONS[name] and not (project / ".venv/bin/activate").exists():
        pytest.skip("this Python is not in a virtual environment, as `make setup` makes it")
    if name in ("experiment", "calculix") and shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx) is not installed: .ci/run installs it")
    package = {"fast": "pypardiso", "cluster": "snakemake_executor_plugin_slurm"}.get(name)
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package}, which it installs, is not here, and this test uses no network")
    lines = ["set -euo pipefail"]
    for line in SESSIONS[name]:
        for place, own in PLACES.items():
            line = line.replace(place, own)
        lines.append(line.removeprefix("> "))
    # Snakemake in Snakemake, and pytest in pytest, would take the settings of the outer one
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST_", "MAKE", "MFLAGS"))}
    kept |= {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": "1",
        "PIP_NO_INDEX": "1",
    }
    done = subprocess.run(["bash", "-xc", "\n".join(lines)], cwd=project, env=kept, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-1500:] + done.stderr[-3000:]
    for file, texts in LEFT.get(name, {}).items():
        path = project / file
        assert path.stat().st_size > 0
        assert all(text in path.read_text(encoding="utf-8") for text in texts), file
    if name in AS_SHIPPED:
        # the shell's own lines are what was typed
        printed = [line for line in (done.stdout + done.stderr).splitlines() if not line.startswith("+ ")]
        assert len(printed) <= AS_SHIPPED[name], "\n".join(printed)
        assert any(re.match(r"round +0  .*: \d+ run \([\d.]+ s each\)", line) for line in printed)
        # README.md ends with the same lines but for digits, which another machine may round otherwise
        (table,) = re.findall(r"^```\n(studies/phantom, model base.*?)^```", README, re.MULTILINE | re.DOTALL)
        words = [
            [re.sub(r"\d[\d.]*(e-\d+)?", "0", line).split() for line in lines]
            for lines in (table.splitlines(), printed)
        ]
        assert [line for line in words[0] if line not in words[1]] == []
