import os
import re
import sys
from pathlib import Path

from snakemake.logging import logger

from fingerfit.core.errors import FingerfitError
from fingerfit.core.folders import CLONE, PACKAGE
from fingerfit.core.progress import Progress, say
from fingerfit.fit.rounds import Walk
from fingerfit.provenance import runs
from fingerfit.provenance.ending import end_at_once, end_when_told
from fingerfit.provenance.failures import MARK, Failures, refused
from fingerfit.provenance.size import LONG
from fingerfit.provenance.watch import Watch, heard_by

# jobs run the Python and the fingerfit that read this, or those of a conda environment and this fingerfit
PATHS = {"PATH": Path(sys.executable).parent} | ({"PYTHONPATH": PACKAGE.parent} if CLONE else {})
os.environ.update({name: os.pathsep.join(filter(None, [str(path), os.getenv(name)])) for name, path in PATHS.items()})
os.environ.setdefault("OMP_NUM_THREADS", "1")

# the file that errors name
CONFIG = Path((workflow.configfiles or ["config.yaml"])[-1])
# targets are not known before the rules are
DISCOVERS = "discover" in sys.argv
# a job that fits a study as a whole asks about no other one, nor does the workflow in it
TARGETS = workflow.dag_settings.target_jobs or [] if workflow.dag_settings else []
WHOLE = [job.wildcards_dict["study"] for job in TARGETS if job.rulename == "study"]
ONLY = os.getenv("FINGERFIT_STUDY") or next(iter(WHOLE), None)
try:
    SEVERAL = len(runs.studies(config, CONFIG)) > 1
    RUNS = runs.planned(config, CONFIG, ONLY, workflow.is_main_process)
    DAMAGED = runs.damaged(RUNS) if workflow.is_main_process and workflow.output_settings.dryrun else []
except FingerfitError as error:
    raise refused(error)
except OSError as error:
    raise refused(f"{error.filename or CONFIG}: cannot be read: {error.strerror}")
if DISCOVERS and (workflow.config_settings.config or len(workflow.configfiles) > 1):
    raise refused(f"discover adds effects to {CONFIG}: all settings must stand there")
if DISCOVERS and len(RUNS) > 1:
    raise refused(f"discover adds effects to one model; {CONFIG} has {len(RUNS)} runs")
if DAMAGED:
    raise refused("\n".join(DAMAGED))

if workflow.is_main_process:
    end_when_told()

# what is said while it runs, and why a job failed; Snakemake's words are shown to those who did not ask for quiet
PROGRESS = Progress()
if workflow.is_main_process and workflow.modifier.is_main_snakefile():
    QUIET = {"RULES", "ALL"} & {about.name for about in workflow.output_settings.quiet or ()}
    # of a job of a cluster the log holds what is said: it is read as the logs of other jobs are
    marked = MARK if os.getenv("FINGERFIT_STUDY") else ""
    FAILURES = Failures(lambda line: say(marked + line, error=True))
    if QUIET:
        for handler in list(logger.handlers):
            handler.addFilter(FAILURES.shown)
    watch = Watch(PROGRESS, lambda: runs_now() and finished(), len(RUNS) > 1, lambda: runs_now())
    heard_by(logger, watch, lambda: QUIET and runs_now())
    logger.addHandler(FAILURES)

BY_FOLDER = {run.folder: run for run in RUNS}
STUDIES = list(dict.fromkeys(run.study for run in RUNS))
# the figures that models have; those with the same ones share a rule
FIGURES = [list(names) for names in dict.fromkeys(tuple(run.figures) for run in RUNS)]
# what a study that is sent to a cluster may be asked for beside its fit
GOALS = ("diagnose", "export")
# marks of the jobs that this call sends
SENT = set()
# locks of the results that this call works on, until it ends
HELD = {}


def pattern(study):
    """A regular expression for a study that only its own models follow: files of others are made by no rule."""
    models = "|".join(re.escape(run.model) for run in RUNS if run.study == study)
    return rf"{re.escape(study)}(?=/(?:{models}|sims)/|/[^/]+$)"


wildcard_constraints:
    study="|".join(map(pattern, STUDIES)),
    model=r"[\w+-]+",
    round=r"\d+",
    sim=r"[0-9a-f]{20}",
    # of the files of a study with several tests
    test=r"(-\w+)?",
    goals=r"fit|[\w+]+",


def runs_now():
    """Whether jobs will run: neither a dry run, nor a list or a drawing of the workflow, nor a job of another one."""
    return workflow.is_main_process and workflow.execution_settings is not None and not workflow.dryrun


def run_of(wildcards):
    """The model that a job works on; its results are made ready when Snakemake asks for the first of them.

    That is after the Snakefile was read and before Snakemake looks at the results: `onstart` would be too late, and does
    not come where there seems to be nothing to do.
    """
    run = BY_FOLDER[f"{wildcards.study}/{wildcards.model}"]
    for one in (BY_FOLDER.get(run.below), run):
        if one and one.folder not in HELD and runs_now():
            HELD[one.folder], lines = one.begin()
            say(*lines, error=True)
        elif one and one.folder not in HELD and workflow.is_main_process and workflow.dryrun:
            HELD[one.folder] = one.in_order()
    return run


def runs_of(study):
    """The models of a study."""
    return [run for run in RUNS if run.study == study]


def memory(simulations=1, pictures=True, diagnosed=False):
    """A resource: MB of a job, more with each attempt; see `fingerfit.provenance.size.Size.memory`."""

    def needed(wildcards, attempt):
        return attempt * max(run.size.memory(simulations, pictures, diagnosed) for run in runs_of(wildcards.study))

    return needed


def minutes(stage):
    """A resource: time after which a cluster may end a job, longer with each attempt."""

    def needed(wildcards, attempt):
        models = runs_of(wildcards.study) if stage == "study" else runs_of(wildcards.study)[:1]
        return attempt * sum(run.size.minutes(stage) for run in models)

    return needed


def is_short(study):
    """Whether all models of a study have simulations that are worth no jobs of their own."""
    return all(run.size.short for run in runs_of(study))


def share_of_machine(wildcards):
    """Processors of a round: two, but of a short study among others no more than its share of this machine."""
    here = workflow.local_exec and is_short(wildcards.study)
    return max(1, min(2, workflow.cores // len(STUDIES))) if here else 2


def beside_figures(wildcards):
    """Processors of an estimate: two, but of a short study one is left to the figures on this machine."""
    here = workflow.local_exec and is_short(wildcards.study)
    return max(1, min(2, workflow.cores - 1)) if here else 2


def side_by_side(wildcards):
    """Processors of a job that fits a whole study: two, but one of a short study among others, which run beside it."""
    return 1 if SEVERAL and is_short(wildcards.study) else 2


def memory_of_study(wildcards, attempt):
    """A resource: MB of a job that fits a whole study, more with each attempt."""
    processors, diagnosed = side_by_side(wildcards), "diagnose" in wildcards.goals.split("+")
    return attempt * max(run.size.memory_of_study(processors, diagnosed) for run in runs_of(wildcards.study))


def sent(study):
    """Whether one job of a cluster fits a study as a whole: its simulations are too short for jobs of their own."""
    return not workflow.local_exec and max(run.size.simulation for run in runs_of(study)) < LONG


def job_by_job(study, files):
    """Files of a goal, as an input: none of a study that is sent as a whole. A module has them all."""
    return (lambda wildcards: [] if sent(study) else files) if workflow.modifier.is_main_snakefile() else files


def studies_sent(wildcards):
    """The jobs that fit whole studies; they are asked for all goals of this call at once."""
    goals = "+".join(goal for goal in GOALS if goal in workflow.dag_settings.targets) or "fit"
    marks = [f"{study}/{goals}.sent" for study in STUDIES if sent(study)]
    for mark in marks:
        if mark not in SENT and runs_now():
            SENT.add(mark)
            Path(mark).unlink(missing_ok=True)  # of a call before: the job finds out what is left to do
    return marks


def options_given(wildcards):
    """What of this call's settings the workflow of a job must be told beside the last settings file."""
    files, settings = workflow.configfiles[:-1], workflow.config_settings.config_args
    return [*(["--configfile", *files, CONFIG] if files else []), *(["--config", *settings] if settings else [])]


def part(stage, which):
    """A param: what a stage of a model depends on, see `fingerfit.provenance.runs.Run.part`."""
    return lambda wildcards: run_of(wildcards).part(stage, which)


def given(wildcards):
    """The settings of a model, as a param."""
    return run_of(wildcards).given()


def settings_text(wildcards):
    """Hash of what will be in settings.json, as a param."""
    return run_of(wildcards).text()


def below(name):
    """A result of the model with one effect less, where it is there or this call makes it."""

    def files(wildcards):
        run = run_of(wildcards)
        path = Path(run.below, name)
        return [str(path)] if run.below and (run.waits or path.exists()) else []

    return files


def study_files(wildcards):
    """What a fit reads of a study."""
    return ancient(run_of(wildcards).study_files)


def meshes(wildcards):
    """The meshes of a model."""
    return [path for paths in mesh_files(wildcards).values() for path in paths]


def mesh_files(wildcards):
    """The same by option of the commands, of each test one."""
    run = run_of(wildcards)
    names = ["mesh", *["refined"] * run.refined]
    return {name: [f"{run.folder}/{name}{test}.inp" for test in run.tests] for name in names}


def mesh_options(wildcards):
    """The meshes of a model as options of the commands."""
    return " ".join(f"--{name} {' '.join(paths)}" for name, paths in mesh_files(wildcards).items())


def data(wildcards):
    """The measurements of a model, of each test one file."""
    run = run_of(wildcards)
    return [f"{run.folder}/prepared{test}.npz" for test in run.tests]


def sims(wildcards):
    """Simulations, shared by the models of a study."""
    return f"{wildcards.study}/sims"


def time_limit(wildcards):
    """Time for one simulation of a model, s, or of any that asks for it; 0 for the solver's own."""
    return runs.time_limit(RUNS, wildcards.study, getattr(wildcards, "model", ""))


def solves_inside(wildcards):
    """Whether jobs of rounds solve short simulations: not on a cluster's login node, nor those of a shared cache."""
    return int(workflow.local_exec and not workflow.output_file_cache)


def solution(study, sim):
    return f"{study}/sims/{sim}/solution.npz"


def walk(wildcards):
    """The rounds of a model that are there."""
    run = run_of(wildcards)
    return Walk(Path(run.study), Path(run.folder))


def proposed(wildcards, number):
    """The file of a round, once it is there."""
    return checkpoints.propose.get(study=wildcards.study, model=wildcards.model, round=number).output[0]


def solutions(wildcards, last):
    """Solutions of the guesses that a round asks for."""
    return [ancient(solution(wildcards.study, sim)) for sim in walk(wildcards).batch(last, runs_now())]


def before_round(wildcards):
    """The round before this one and the solutions of the guesses that it asked for."""
    number = int(wildcards.round)
    if number == 0:
        return []
    last = proposed(wildcards, number - 1)
    return [last, *solutions(wildcards, last)]


def last_option(wildcards):
    """The round before this one as an option of the command."""
    number = int(wildcards.round)
    return f"--last {wildcards.study}/{wildcards.model}/rounds/{number - 1}.json" if number else ""


def rounds_and_solutions(wildcards):
    """All rounds up to the one that says stop, and the solutions of every guess in them."""
    files, number, rounds = [], 0, walk(wildcards)
    while True:
        last = proposed(wildcards, number)
        files += [last, *solutions(wildcards, last)]
        if rounds.stopped(last):
            return files
        number += 1


def last_round(wildcards):
    """The round that says stop."""
    number, rounds = 0, walk(wildcards)
    while not rounds.stopped(proposed(wildcards, number)):
        number += 1
    return proposed(wildcards, number)


def of_simulation(number):
    """An input of a simulation: 0 is its deck, 1 the identity of its solver; what follows is what the deck includes."""

    def files(wildcards):
        found = Walk(Path(wildcards.study), Path()).sim_inputs(wildcards.sim)
        return [ancient(path) for path in (found[number:] if number > 1 else found[number : number + 1])]

    return files


def fitted(run):
    """What a fit of a model leaves."""
    names = ["estimate.json", "table.txt", *[f"figures/{name}.png" for name in run.figures]]
    return [f"{run.folder}/{name}" for name in names]


def drawn(figures):
    """The models that have these figures, as a regular expression for their study."""
    return "|".join(rf"{re.escape(run.study)}(?=/{re.escape(run.model)}/)" for run in RUNS if run.figures == figures)


def walked(run):
    """All rounds of a model and their solutions, as an input of its own: models do not wait for each other."""
    return lambda wildcards: [] if sent(run.study) else rounds_and_solutions(run)


def top(study):
    """The model whose ladder is that of a study: the last one that config.yaml names."""
    return [run for run in RUNS if run.study == study][-1]


def settings_of_top(wildcards):
    """Settings of the model whose ladder is that of a study."""
    return f"{top(wildcards.study).folder}/settings.json"


def part_of_top(stage, which):
    """A param: what a stage depends on of the model whose ladder is that of a study."""
    return lambda wildcards: run_of(top(wildcards.study)).part(stage, which)


def rungs(wildcards):
    """The rungs of a study that this call makes."""
    return [f"{run.folder}/rung.json" for run in RUNS if run.study == wildcards.study]


def finished():
    """The tables of all models, and what to open."""
    PROGRESS.stop()
    if not DISCOVERS:  # whose last model has shown its own
        say(*runs.shown(RUNS))
    end_at_once()
