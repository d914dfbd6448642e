import os
import sys
from pathlib import Path

from snakemake.exceptions import WorkflowError

from fingerfit import layout
from fingerfit.errors import FingerfitError
from fingerfit.rounds import Walk
from fingerfit.settings import load_settings

# the fingerfit that jobs run is the one beside this Python
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
os.environ.setdefault("OMP_NUM_THREADS", "1")

try:
    SETTINGS = load_settings(config)
    PARTS = {stage: layout.settings_of(SETTINGS, stage) for stage in layout.SOURCES}
    FIGURE_NAMES = layout.figures(SETTINGS)
except FingerfitError as error:
    raise WorkflowError(str(error))

STUDY = str(layout.study_folder(SETTINGS))  # simulations, shared by the models of a study
MODEL = str(layout.model_folder(SETTINGS))  # rounds, estimate, figures
SETTINGS_FILE = layout.write_settings(SETTINGS, Path(MODEL) / "settings.json")
WALK = Walk(Path(STUDY), Path(MODEL))
FIGURES = [f"{MODEL}/figures/{name}.png" for name in FIGURE_NAMES]
MESHES = {"mesh": f"{MODEL}/mesh.inp"}
if SETTINGS.model.refined:
    MESHES["refined"] = f"{MODEL}/refined.inp"
MESH_OPTIONS = " ".join(f"--{name} {path}" for name, path in MESHES.items())


wildcard_constraints:
    round=r"\d+",
    sim=r"[0-9a-f]{20}",


def round_file(number):
    return f"{MODEL}/rounds/{number}.json"


def solution(sim):
    return f"{STUDY}/sims/{sim}/solution.npz"


def before_round(wildcards):
    """The round before this one and the solutions of the guesses that it asked for."""
    number = int(wildcards.round)
    if number == 0:
        return []
    last = checkpoints.propose.get(round=number - 1).output[0]
    return [last, *[ancient(solution(sim)) for sim in WALK.batch(last)]]


def last_option(wildcards):
    number = int(wildcards.round)
    return f"--last {round_file(number - 1)}" if number else ""


def rounds_and_solutions(wildcards):
    """All rounds up to the one that says stop, and the solutions of every guess in them."""
    files, number = [], 0
    while True:
        last = checkpoints.propose.get(round=number).output[0]
        files += [last, *[ancient(solution(sim)) for sim in WALK.batch(last)]]
        if WALK.stopped(last):
            return files
        number += 1


def last_round(wildcards):
    """The round that says stop."""
    number = 0
    while not WALK.stopped(checkpoints.propose.get(round=number).output[0]):
        number += 1
    return round_file(number)


def deck_files(wildcards):
    """The deck of a simulation, the files it includes and the identity of its solver."""
    return [ancient(path) for path in WALK.sim_inputs(wildcards.sim)]


def show_table():
    table = Path(MODEL) / "table.txt"
    if table.exists():
        print(table.read_text())
