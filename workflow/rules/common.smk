import os
import sys
from functools import partial
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from fingerfit.provenance import results, stages
from fingerfit.core.errors import FingerfitError
from fingerfit.provenance.failures import Failures
from fingerfit.fit.rounds import Walk
from fingerfit.settings.config import load_settings

# jobs run the Python and the fingerfit that read this, or those of a conda environment and this fingerfit
PATHS = {"PATH": Path(sys.executable).parent, "PYTHONPATH": stages.PACKAGE.parent}
os.environ.update({name: os.pathsep.join(filter(None, [str(path), os.getenv(name)])) for name, path in PATHS.items()})
os.environ.setdefault("OMP_NUM_THREADS", "1")

# why a job failed, in a line of its own; Snakemake's words on it are shown to those who did not ask for quiet
if workflow.is_main_process:
    FAILURES = Failures(partial(print, file=sys.stderr, flush=True))
    if {"RULES", "ALL"} & {about.name for about in workflow.output_settings.quiet}:
        for handler in list(logger.handlers):
            handler.addFilter(FAILURES.shown)
    logger.addHandler(FAILURES)

# the file that errors name
CONFIG = Path((workflow.configfiles or ["config.yaml"])[-1])
# targets are not known before the rules are
DISCOVERS = "discover" in sys.argv
if DISCOVERS and (workflow.config_settings.config or len(workflow.configfiles) > 1):
    raise WorkflowError(f"discover adds effects to {CONFIG}: all settings must stand there")
REMOVES = not workflow.output_settings.dryrun
try:
    SETTINGS = load_settings(config, CONFIG)
    stages.check_model(SETTINGS, CONFIG)
    CONTENTS = results.claim(SETTINGS)
    SETTINGS = stages.warm(SETTINGS, CONFIG)
    # another run may be at work; `discover` calls runs of its own
    if workflow.is_main_process and REMOVES and not DISCOVERS:
        HELD = results.hold(SETTINGS)
    # a job of a cluster reads this while others write
    DAMAGED = results.mend(SETTINGS, CONTENTS, REMOVES) if workflow.is_main_process else []
    if workflow.is_main_process:
        results.in_order(SETTINGS)
    PARTS = {stage: stages.settings_of(SETTINGS, stage) for stage in stages.STAGES}
    CODE = stages.fingerprints(CONTENTS)
    MADE_FROM = stages.made_from(SETTINGS, CONTENTS)
    STUDY_FILES = stages.study_files(Path(SETTINGS.study))
    FIGURE_NAMES = stages.figures(SETTINGS)
    CONTENTS.save()
    SETTINGS_FILE = stages.write_settings(SETTINGS, results.model_folder(SETTINGS) / "settings.json", True)
except FingerfitError as error:
    raise WorkflowError(str(error))
except OSError as error:
    raise WorkflowError(f"{error.filename or SETTINGS.results}: cannot be read or written: {error.strerror}")
if DAMAGED and not REMOVES:
    raise WorkflowError("\n".join(DAMAGED))
for line in DAMAGED:
    print(line, file=sys.stderr)

# simulations, shared by the models of a study
STUDY = str(results.study_folder(SETTINGS))
# rounds, estimate, figures
MODEL = str(results.model_folder(SETTINGS))
SIMS = f"{STUDY}/sims"
WALK = Walk(Path(STUDY), Path(MODEL))
FIGURES = [f"{MODEL}/figures/{name}.png" for name in FIGURE_NAMES]
MESHES = {"mesh": f"{MODEL}/mesh.inp"}
if stages.has_refined(SETTINGS):
    MESHES["refined"] = f"{MODEL}/refined.inp"
MESH_OPTIONS = " ".join(f"--{name} {path}" for name, path in MESHES.items())


wildcard_constraints:
    round=r"\d+",
    sim=r"[0-9a-f]{20}",


def round_file(number):
    return f"{MODEL}/rounds/{number}.json"


def solution(sim):
    return f"{SIMS}/{sim}/solution.npz"


def before_round(wildcards):
    """The round before this one and the solutions of the guesses that it asked for."""
    number = int(wildcards.round)
    if number == 0:
        return []
    last = checkpoints.propose.get(round=number - 1).output[0]
    return [last, *[ancient(solution(sim)) for sim in WALK.batch(last)]]


def last_option(wildcards):
    """The round before this one as an option of the command."""
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


def deck(wildcards):
    """The deck of a simulation."""
    return ancient(WALK.sim_inputs(wildcards.sim)[0])


def solver(wildcards):
    """The identity of the solver of a simulation."""
    return ancient(WALK.sim_inputs(wildcards.sim)[1])


def included(wildcards):
    """The files that the deck of a simulation includes."""
    return [ancient(path) for path in WALK.sim_inputs(wildcards.sim)[2:]]


def show_table():
    table = Path(MODEL) / "table.txt"
    if table.exists():
        print(table.read_text())
