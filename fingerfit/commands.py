"""What the commands do; each imports only what it needs, because the workflow starts many."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fingerfit.fit.problem import InverseProblem
    from fingerfit.settings.config import Settings


def show_deck(args: argparse.Namespace) -> None:
    """Write a deck as it was understood, or in ABAQUS's words."""
    from fingerfit.deck.cards import read_cards
    from fingerfit.deck.dialect import to_abaqus
    from fingerfit.deck.reader import read_deck
    from fingerfit.deck.write import format_deck

    deck = read_deck(args.deck)
    if args.abaqus:
        cards = to_abaqus(read_cards(args.deck), deck)
        sys.stdout.writelines(f"{line}\n" for card in cards for line in card.lines())
    else:
        sys.stdout.write(format_deck(deck))


def simulate(args: argparse.Namespace) -> None:
    """Solve one deck."""
    from fingerfit.core.errors import StateError
    from fingerfit.core.files import read_record
    from fingerfit.fit.rounds import FIRST_ORDER, NEARBY, check_deck
    from fingerfit.solvers.registry import get_solver, solve_deck

    wanted = read_record(args.solver, "name", kept=False)
    if not isinstance(wanted["name"], str):
        raise StateError(f"{args.solver}: cannot be read: the name of the solver is no text")
    solver = get_solver(wanted["name"], args.time_limit or None)
    found = solver.identity()
    if {key: wanted.get(key) for key in found} != found:
        raise StateError(f"{args.solver}: asks for {wanted}; here is {found}: run the workflow again")
    check_deck(args.deck, wanted)
    nearby = args.deck.absolute().parent.parent / wanted[NEARBY] if NEARBY in wanted else None
    outcome = solve_deck(solver, args.deck, args.threads, nearby, FIRST_ORDER in wanted)
    outcome.save(args.out)
    print(f"{outcome.status}: {outcome.message}", file=sys.stderr)


def settings(args: argparse.Namespace) -> None:
    """Write what is fitted to what in one model, where its search starts, and what a fit reads of the study."""
    import json

    from fingerfit.core.errors import InputError
    from fingerfit.provenance.stages import warm, write_settings
    from fingerfit.settings.config import load_settings

    try:
        given = json.loads(args.given)
    except ValueError:
        raise InputError("settings", "given", args.given, "settings of a model as JSON") from None
    write_settings(warm(load_settings(given, args.config), args.config), args.out, with_study=True)


def prepare(args: argparse.Namespace) -> None:
    """Read and check the study, smooth and scale its pictures, make its meshes."""
    from fingerfit.core.errors import InputError
    from fingerfit.core.files import keep_text
    from fingerfit.deck.mesh_file import format_mesh
    from fingerfit.fit.check import check_against_study, check_data, check_effects
    from fingerfit.prepare.plausible import refuse_magnitudes
    from fingerfit.prepare.prepare import make_mesh, prepare
    from fingerfit.study.reader import load_study

    settings = _checked(args.settings)
    whole = load_study(Path(settings.study))
    check_against_study(settings, whole)
    name, names = args.test.removeprefix("-"), [test.test for test in whole.every]
    if name not in names:
        expected = f"one of {', '.join(names)}" if whole.tests else "no such option: the study has one test"
        raise InputError("prepare", "--test", name or "nothing", expected)
    study = whole.of_test(name)
    if args.refined:
        if not settings.finer(study):
            expected = f"a finer mesh, since {args.refined} is asked for"
            raise InputError(args.settings, "model.refined", "nothing", expected)
        keep_text(args.refined, format_mesh(make_mesh(study, settings.model.refined, finer=True)))
    if args.refined and not (args.out or args.mesh):
        return
    if not (args.out and args.mesh):
        raise InputError("prepare", "--out, --mesh", "one of them or none", "both, or --refined alone")
    mesh = make_mesh(study, settings.model.mesh)
    check_effects(settings, whole, make_mesh(whole, settings.model.mesh) if name else mesh)
    data = prepare(study, mesh, settings.fit.steps, settings.fit.smooth, settings.fit.crop)
    refuse_magnitudes(settings, study, mesh)
    check_data(settings, study, data)
    for remark in data.remarks.splitlines():
        print(f"{study.path}: {name}{': ' * bool(name)}remark: {remark}", flush=True)
    keep_text(args.mesh, format_mesh(mesh))
    data.save(args.out)


def _checked(path: Path) -> Settings:
    """Settings with all checks: from config.yaml, or the JSON that the workflow wrote of it."""
    from fingerfit.settings.config import load_settings, read_written

    return read_written(path) if path.suffix == ".json" else load_settings(path)


def _fit(args: argparse.Namespace, settings: Settings | None = None) -> InverseProblem:
    from fingerfit.core.errors import InputError
    from fingerfit.core.files import check_kept
    from fingerfit.fit.joint import problem_of
    from fingerfit.settings.choices import read_checked
    from fingerfit.study.data import Data

    if settings is None and args.settings.suffix == ".json":
        settings = read_checked(args.settings, getattr(args, "time_limit", None))  # as the workflow wrote them
    elif settings is None:
        settings = _checked(args.settings)
    tests, given = len(settings.read_study().every), (args.data, args.mesh, args.refined or args.mesh)
    if any(len(paths) != tests for paths in given):
        found = " and ".join(str(len(paths)) for paths in given[:2])
        raise InputError(args.settings, "--data, --mesh", found, f"{tests} of each, as many as the study has tests")
    files = [{"search": path} for path in args.mesh]
    for own, path in zip(files, args.refined, strict=False):
        own["refined"] = path
    for path in (*args.mesh, *args.refined):
        check_kept(path)
    return problem_of(settings, [Data.load(path) for path in args.data], files, args.sims, args.data)


def propose(args: argparse.Namespace) -> None:
    """Score the last round and ask for the next guesses."""
    from fingerfit.core.progress import say
    from fingerfit.fit.jobs import next_job
    from fingerfit.fit.rounds import Round
    from fingerfit.fit.took import Took

    last, took = Round.load(args.last) if args.last else None, Took()
    next_job(_fit(args), last, args.threads, bool(args.solve), took).save(args.out)
    if took.number:
        say(took.told(), error=True)  # into the log of the job, where `fingerfit.provenance.watch` finds it


def estimate(args: argparse.Namespace) -> None:
    """Constants with their standard errors."""
    from fingerfit.core.files import keep_json, write_text
    from fingerfit.fit.estimate import estimate_of, table_of
    from fingerfit.fit.kept import forget
    from fingerfit.fit.rounds import Round, asked_for

    problem, last = _fit(args), Round.load(args.last)
    problem.predict_all(last.batch, args.threads)
    found = estimate_of(problem, last, args.threads, asked_for(args.last))
    write_text(args.table, table_of(found))
    keep_json(args.out, found)
    forget(args.data[0])


def plot(args: argparse.Namespace) -> None:
    """Figures of a finished fit."""
    from fingerfit.fit.rounds import Round
    from fingerfit.report.plots import plot_fit

    plot_fit(_fit(args), Round.load(args.last), args.out)


def diagnose(args: argparse.Namespace) -> None:
    """Say where a fitted model fails and which effect is missing."""
    from fingerfit.core.files import keep_json, read_record
    from fingerfit.core.journal import Journal
    from fingerfit.core.progress import Progress
    from fingerfit.diagnosis.diagnose import diagnose
    from fingerfit.fit.rounds import Round, asked_for
    from fingerfit.fit.simulate import measured
    from fingerfit.report.compared import compared
    from fingerfit.report.findings import count_simulations, rung_of, write_compare, write_diagnosis

    settings = _checked(args.settings).model_copy(update={"time_limit": args.time_limit or None})
    problem, last = _fit(args, settings), Round.load(args.last)
    everything, estimate = measured(problem), read_record(args.estimate, "parameters")
    study, model = args.out.parents[1], problem.settings.model
    with Progress(ticks=False).working(f"diagnose {model.full_name}", Journal(study)):
        found = diagnose(problem, last, everything, args.threads)
    write_compare(found.comparison, args.out.parent / "compare.npz")
    counted = count_simulations(study, model.path, set(asked_for(args.last)), problem.asked)
    models = compared(study, model.path, found.comparison.weighed)
    rung = rung_of(found, write_diagnosis(found, args.out), estimate, counted, models)
    keep_json(args.out.parent / "rung.json", rung)
    known = f", {counted['reused']} of them known from the models below" if model.effects else ""
    total = counted["run"] + counted["reused"]
    print(f"{model.full_name}: {total} simulations{known}; {found.verdict.sentence}", flush=True)


def export(args: argparse.Namespace) -> None:
    """Write the results of a model for other programs."""
    from fingerfit.report.export import export

    out = args.out or args.model / "export"
    print(f"{len(export(args.model, out))} files in {out}")


def add(args: argparse.Namespace) -> None:
    """Add an effect to config.yaml."""
    from fingerfit.diagnosis.ladder import add, run_again

    print(f"{add(args.config, args.effect)}; now: {run_again(args.config)}")


def drop(args: argparse.Namespace) -> None:
    """Take an effect out of config.yaml."""
    from fingerfit.diagnosis.ladder import drop, run_again

    print(f"{drop(args.config, args.effect)}; now: {run_again(args.config)}")


def profile(args: argparse.Namespace) -> None:
    """How far the misfit rises when a constant is held elsewhere."""
    from fingerfit.report.profiles import profile_of

    print(profile_of(args.config, args.constant, args.cores))


def discover(args: argparse.Namespace) -> None:
    """Fit, diagnose and add effects until the model is adequate."""
    from fingerfit.core.journal import Journal
    from fingerfit.core.progress import say_in
    from fingerfit.diagnosis.climb import discover
    from fingerfit.provenance.results import study_folder
    from fingerfit.settings.config import load_settings

    settings = load_settings(args.config)  # what is wrong with it is said here in one line, not by the workflow
    journal = Journal(study_folder(settings))
    discover(args.config, args.cores, say_in(journal))
    journal.now("nothing more: it has ended")


def effects(args: argparse.Namespace) -> None:
    """List the known effects."""
    from fingerfit.core.errors import InputError
    from fingerfit.model.catalogue import as_lines, catalogue
    from fingerfit.settings.bound import effects_of
    from fingerfit.study.reader import study_path

    if args.study and not (study_path(args.study).is_file() and study_path(args.study).name == "study.yaml"):
        raise InputError(args.study, "study", "no study.yaml", "the folder of a study")
    known = effects_of(study_path(args.study).parent) if args.study else catalogue()
    print("\n\n".join(as_lines(effect) for effect in known.values()))


def ladder(args: argparse.Namespace) -> None:
    """Put the rungs of a study together, and write the page."""
    from fingerfit.core.files import keep_json
    from fingerfit.report.page import write_page
    from fingerfit.report.rungs import ladder

    study = args.out.parent
    found = ladder(study, args.settings)
    for other in found["others"]:
        print(f"{other['model']}: not on the ladder: {other['why']}", file=sys.stderr)
    keep_json(args.out, found)
    write_page(study, args.page)


def check(args: argparse.Namespace) -> None:
    """Say what was understood of a study."""
    from fingerfit.check.check import check_study
    from fingerfit.core.errors import InputError

    if args.picture is not None and args.picture.suffix.lower() != ".png":
        raise InputError("--picture", "name", args.picture, "one that ends in .png")
    print(check_study(args.study, args.config, args.picture, args.solve))


def run(args: argparse.Namespace) -> None:
    """Fit a study by the workflow; this process becomes Snakemake's, so that signals and exit code are its own."""
    import os

    from fingerfit.core.errors import InputError
    from fingerfit.core.keys import read_yaml
    from fingerfit.provenance.call import command

    config = args.config or Path("config.yaml")
    if args.study is not None:
        from fingerfit.settings.runs import settings_for

        settings, config, source = settings_for(args.study, args.config)
        if settings is None:
            raise InputError(args.study, "settings", source, f"{args.study / 'config.yaml'}, or --config FILE")
    read_yaml(config)  # a file that is not there is told in one line
    goals = [name for name in ("diagnose", "export") if getattr(args, name)]
    line = command(goals, config, args.cores, args.more, args.profile)
    sys.stdout.flush()
    os.execv(line[0], line)


def new(args: argparse.Namespace) -> None:
    """Draft a study, or copy an example."""
    from fingerfit.core.errors import InputError
    from fingerfit.start.draft import draft, example
    from fingerfit.start.measured import draft_from

    check = f"fingerfit check {args.study} --picture mesh.png"
    pictures = bool(args.pictures or args.forces)
    files = any(one is not None for one in (args.sources, args.scale, args.rate))
    if args.example and not (pictures or files):
        lines, then = example(args.study, args.example), f"fingerfit run {args.study}"
    elif args.pictures and args.forces and not (args.example or files):
        lines, then = draft(args.study, args.pictures, args.forces), check
    elif args.sources and not (args.example or pictures):
        lines, then = draft_from(args.study, args.sources, args.scale, args.rate), check
    else:
        raise InputError("new", "options", "no data, or too many", "--pictures and --forces, or --from, or --example")
    print(*lines, f"then: {then}", sep="\n")


def doctor(args: argparse.Namespace) -> None:
    """Say what of this machine a fit finds, and let each solver solve something."""
    from fingerfit.core.errors import FingerfitError
    from fingerfit.start.machine import look

    wrong: list[str] = []
    for line in look(wrong):
        print(line, flush=True)
    if wrong:
        raise FingerfitError("\n".join(wrong))


def open(args: argparse.Namespace) -> None:
    """Show the page of a study, or say where it is."""
    from fingerfit.start.results import page, show

    path = page(args.study, args.config)
    print(path)
    show(path)


def experiment(args: argparse.Namespace) -> None:
    """Make a study by a virtual experiment."""
    from fingerfit.core.errors import InputError
    from fingerfit.core.progress import Progress
    from fingerfit.virtual.experiment import run_experiment

    if (args.out / "study.yaml").exists() and not args.force:
        raise InputError(args.out / "study.yaml", "file", "a study", "none yet, or --force to replace it")
    with Progress(ticks=False).working("experiment"):
        run_experiment(args.description, args.out)


def finger(args: argparse.Namespace) -> None:
    """Mesh a finger."""
    from fingerfit.anatomy.description import write_finger

    at = tuple(args.at) if args.at else None
    print(write_finger(args.out, args.anatomy, args.size, args.element.upper(), args.across, at))


def mesh(args: argparse.Namespace) -> None:
    """Mesh a segmentation."""
    from fingerfit.anatomy.description import tissues_of
    from fingerfit.segment.file import write_mesh

    labels = tissues_of(args.labels) if args.labels else None
    holes = tissues_of(args.holes, "--holes") if args.holes else None
    given = (labels, holes, args.base, args.indenter, args.element, args.grading)
    print(write_mesh(args.segmentation, args.out, args.size, *given))


def morph(args: argparse.Namespace) -> None:
    """Bring a mesh to a subject."""
    from fingerfit.anatomy.description import tissues_of
    from fingerfit.morph.file import write_morphed

    labels = tissues_of(args.labels) if args.labels else None
    print(write_morphed(args.reference, args.volume, args.out, args.at, args.own, labels))


def docs(args: argparse.Namespace) -> None:
    """Write the schemas of config.yaml and study.yaml, and the tables of the keys of all files that people write."""
    from fingerfit.core.errors import InputError
    from fingerfit.core.files import write_json, write_text
    from fingerfit.model import keys as effect_keys
    from fingerfit.readers import keys as data_keys
    from fingerfit.settings import runs
    from fingerfit.study import keys as study_keys
    from fingerfit.virtual import keys as truth_keys

    if not (args.folder / "workflow/schemas").is_dir():
        raise InputError(args.folder, "folder", "no workflow/schemas", "the folder of the project")
    for name, source in (("config", runs), ("study", study_keys)):
        write_json(args.folder / f"workflow/schemas/{name}.schema.json", source.schema())
    write_text(args.folder / "docs/config.md", runs.describe())
    tables = {"study": study_keys, "effect": effect_keys, "experiment": truth_keys, "data": data_keys}
    for name, described in tables.items():
        write_text(args.folder / f"docs/{name}-keys.md", described.describe())
