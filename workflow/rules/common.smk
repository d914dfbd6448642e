from pathlib import Path

from snakemake.exceptions import WorkflowError

from fingerfit.errors import FingerfitError
from fingerfit.rounds import Walk, package_fingerprint
from fingerfit.settings import load_settings, write_settings

try:
    SETTINGS = load_settings(config)
except FingerfitError as error:
    raise WorkflowError(str(error))

STUDY = SETTINGS.results_folder  # results/{study}: simulations, shared by the models of a study
MODEL = f"{STUDY}/{SETTINGS.model.name}"  # results/{study}/{model}: rounds, estimate, figures
SETTINGS_FILE = write_settings(SETTINGS, Path(MODEL) / "settings.json")
WALK = Walk(Path(STUDY), Path(MODEL))


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
