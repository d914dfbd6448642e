"""What the commands do; each imports only what it needs, because the workflow starts many."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fingerfit.fit import Fit


def show_deck(args: argparse.Namespace) -> None:
    """Write a deck as it was understood."""
    from fingerfit.deck.reader import read_deck
    from fingerfit.deck.write import format_deck

    sys.stdout.write(format_deck(read_deck(args.deck)))


def simulate(args: argparse.Namespace) -> None:
    """Solve one deck."""
    from fingerfit.errors import StateError
    from fingerfit.files import read_json
    from fingerfit.solvers.registry import get_solver

    wanted = read_json(args.solver)
    solver = get_solver(wanted["name"])
    found = solver.identity()
    if {key: wanted.get(key) for key in found} != found:
        raise StateError(f"{args.solver}: asks for {wanted}; here is {found}: run the workflow again")
    outcome = solver.solve(args.deck, args.out.parent, args.threads)
    outcome.save(args.out)
    print(f"{outcome.status}: {outcome.message}", file=sys.stderr)


def prepare(args: argparse.Namespace) -> None:
    """Read and check the study, smooth and scale its pictures, make its meshes."""
    from fingerfit.files import write_text
    from fingerfit.mesh_io import format_mesh
    from fingerfit.prepare import make_mesh, prepare
    from fingerfit.settings import load_settings
    from fingerfit.settings_check import check_against_study
    from fingerfit.study_file import load_study

    settings = load_settings(args.settings)
    study = load_study(Path(settings.study))
    check_against_study(settings, study)
    mesh = make_mesh(study, settings.model.mesh)
    data = prepare(study, mesh, settings.fit.steps, settings.fit.smooth, settings.fit.crop)
    write_text(args.mesh, format_mesh(mesh))
    if args.refined:
        write_text(args.refined, format_mesh(make_mesh(study, settings.model.refined)))
    data.save(args.out)


def _fit(args: argparse.Namespace) -> Fit:
    from fingerfit.data import Data
    from fingerfit.fit import Fit
    from fingerfit.settings import load_settings

    settings = load_settings(args.settings)
    files = {"search": args.mesh} | ({"refined": args.refined} if args.refined else {})
    return Fit(settings, Data.load(args.data), files, args.sims)


def propose(args: argparse.Namespace) -> None:
    """Score the last round and ask for the next guesses."""
    from fingerfit.course import next_round
    from fingerfit.rounds import Round

    fit = _fit(args)
    current = next_round(fit, Round.load(args.last) if args.last else None, args.threads)
    current.save(args.out)
    known = sum((args.sims / asked.sim / "solution.npz").exists() for asked in current.batch)
    best = "" if current.best is None else f"best {fit.settings.fit.score} {current.best['score']:.6f}, "
    stop = f"; stop: {current.stop}" if current.stop else ""
    print(
        f"round {current.number:3d}  {current.stage:<12} {best}simulations: {known} cached,"
        f" {len(current.batch) - known} to run{stop}",
        flush=True,
    )


def estimate(args: argparse.Namespace) -> None:
    """Constants with their standard errors."""
    from fingerfit.files import write_json, write_text
    from fingerfit.report import estimate_of, table_of
    from fingerfit.rounds import Round

    fit = _fit(args)
    found = estimate_of(fit, Round.load(args.last))
    write_text(args.table, table_of(found))
    write_json(args.out, found)


def plot(args: argparse.Namespace) -> None:
    """Figures of a finished fit."""
    from fingerfit.plots import plot_fit
    from fingerfit.rounds import Round

    plot_fit(_fit(args), Round.load(args.last), args.out)


def check(args: argparse.Namespace) -> None:
    """Say what was understood of a study."""
    from fingerfit.check import check_study

    print(check_study(args.study, args.config, args.picture))


def experiment(args: argparse.Namespace) -> None:
    """Make a study by a virtual experiment."""
    from fingerfit.experiment import run_experiment

    run_experiment(args.description, args.out)


def docs(args: argparse.Namespace) -> None:
    """Write the schema and the table of the keys of config.yaml."""
    from fingerfit.files import write_json, write_text
    from fingerfit.settings import describe, schema

    write_json(args.folder / "workflow/schemas/config.schema.json", schema())
    write_text(args.folder / "docs/config.md", describe())


def ecoflex(args: argparse.Namespace) -> None:
    """Make a study of uniaxial compression tests."""
    from fingerfit.recipes.ecoflex import make_study

    make_study(args.tests, args.out)
