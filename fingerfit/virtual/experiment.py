"""Virtual experiments: measured data of a body that is described exactly, with noise; the truth sealed apart."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, LimitError, SolverError
from fingerfit.core.files import digest, write_text
from fingerfit.core.folders import template_folders
from fingerfit.core.progress import tell
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.deck.render import render_deck
from fingerfit.fit.rounds import simulation_name
from fingerfit.forward import bodies
from fingerfit.forward.predict import since_first_picture
from fingerfit.imaging.noise import add_rician
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import Effect
from fingerfit.model.formulas import evaluate
from fingerfit.model.observation import Observation, by_step
from fingerfit.prepare.plausible import refuse_depth
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.parts import MeshSettings
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.solvers.registry import get_solver
from fingerfit.study.several import TESTS
from fingerfit.study.study import Noise, Step, Study
from fingerfit.virtual.file import read_truths
from fingerfit.virtual.scan import check_memory, take_pictures
from fingerfit.virtual.truth import BRIGHTEST, Truth

FULL_SCALE = 4000.0
"""Stored intensity of 1."""
LOADING = ("force", "displacement")
"""What instruments show of the loading."""


@dataclass(frozen=True)
class Solved:
    """A solved experiment without noise.

    Parameters
    ----------
    force : ndarray, shape (steps,)
        N, positive in compression.
    pictures : ndarray, shape (1 + steps, ny, nx) or (1 + steps, nz, ny, nx)
        Intensities 0..1; the first is before compression.
    frame : Picture
        Pixel grid.
    displacement : ndarray, shape (steps,)
        mm, positive in compression, as it is measured.
    """

    force: np.ndarray
    pictures: np.ndarray
    frame: Picture
    displacement: np.ndarray


def solve(truth: Truth, folder: Path, threads: int = 1) -> Solved:
    """Solve the fine mesh and make the pictures, in a working folder; what was solved there is not solved again.

    Parameters
    ----------
    truth : Truth
    folder : Path
    threads : int
        Of the solver. With more than one CalculiX's digits change from run to run, and near its limits even whether it
        finds an equilibrium.

    Raises
    ------
    SolverError
        When the body has no solution for these displacements.
    InputError
        When the mesh lacks a set, displacements leave nothing of it, or numbers are so large that forces or intensities
        are not finite; a `LimitError` when mesh or pictures do not fit into the memory.
    """
    try:
        with np.errstate(all="ignore"):  # what is not finite is found in the results
            solved = _solve(truth, folder, threads)
    except MemoryError as error:
        field = "body.mesh" if truth.mesh_file else "mesh"
        raise LimitError(truth.path, field, "no memory for its solution", "a coarser mesh") from error
    for field, values in (("body", solved.force), ("displacement", solved.displacement), ("picture", solved.pictures)):
        if not np.isfinite(values).all():
            found = "numbers so large or small that not all results are finite"
            raise InputError(truth.path, field, found, "numbers whose results are in double precision")
    return solved


def _solve(truth: Truth, folder: Path, threads: int) -> Solved:
    times = truth.time or (None,) * len(truth.displacement)
    steps = tuple(Step(n, t, d) for n, (t, d) in enumerate(zip(times, truth.displacement, strict=True), 1))
    base, indenter = truth.boundary
    study = Study(
        truth.path, truth.title, "displacement", steps, None, Noise(), truth.body, base, indenter
    )  # fmt: skip
    mesh = make_mesh(study, MeshSettings(**truth.mesh) if truth.mesh else None)
    refuse_depth(study, mesh, "displacement")
    check_memory(truth, mesh)
    if truth.mesh_file is not None:
        # those that are no layers have a part in the deck and in the pictures too
        every = {name.upper(): members for name, members in read_mesh(truth.mesh_file).element_sets.items()}
        mesh = replace(mesh, element_sets={**every, **mesh.element_sets})
    for name in truth.tissues:
        if name not in mesh.element_sets:
            expected = "one of " + ", ".join(sorted(mesh.element_sets))
            raise InputError(truth.path, f"body.tissues.{name}", "no element set of this name", expected)
    text = format_mesh(mesh)
    included = f"{digest(text)}.inp"
    write_text(folder / included, text)
    # before the first picture a force holds the body, or none: the forces of the test itself are found without that
    begun = {e.name for e in _present(truth) if e.control != "displacement" and "before" in e.changes}
    without = replace(truth, effects={name: own for name, own in truth.effects.items() if name not in begun})
    outcome, body = _run(without, study, mesh, included, folder, threads)
    outcome = since_first_picture(outcome, len(steps))
    force = -outcome.reaction[:, -1]
    forced = replace(study, steps=tuple(replace(s, force=float(f)) for s, f in zip(steps, force, strict=True)))
    if begun:
        # what was before the first picture is seen when the same forces are prescribed
        outcome, body = _run(truth, replace(forced, control="force"), mesh, included, folder, threads)
        outcome = since_first_picture(outcome, len(steps))
    moved = -outcome.indenter[:, -1]
    seen = Observation.of(_present(truth), truth.values, mesh.body, forced.course)
    if seen is not None:
        moved, force = seen.response(moved, "displacement"), seen.response(force, "force")
    return Solved(_as_measured(truth, force, by_step(forced.course)), *take_pictures(truth, body, outcome, seen), moved)


def _in_the_body(known: Mapping[str, Effect]) -> dict[str, Effect]:
    """Effects without what they change of force and displacement: the body has the true ones, instruments others."""
    return {
        name: replace(e, changes={key: formula for key, formula in e.changes.items() if key not in LOADING})
        for name, e in known.items()
    }


def _present(truth: Truth) -> list[Effect]:
    return [effect for name, effect in truth.known.items() if name in truth.effects]


def _run(truth: Truth, study: Study, mesh: Mesh, included: str, folder: Path, threads: int) -> tuple[Outcome, Mesh]:
    """Solve a deck that includes its mesh by the name of its content, unless its solution is in the folder.

    Also the mesh as the first picture shows it, borders of layers where effects have put them.
    """
    solver = get_solver(truth.solver)
    try:
        effects = _in_the_body(truth.known)
        folders = template_folders(*([truth.own] if truth.own else []), truth.folder)

        def deck_of(body: Mesh) -> str:
            context = deck_context(study, body, included, truth.values, truth.material, effects)
            return render_deck(truth.template, context, folders)

        deck = bodies.deck_of_body(study, mesh, included, effects, truth.values, deck_of)
        write_text(folder / "deck.inp", deck)
        known = folder / f"{simulation_name(deck, solver.identity())}.npz"
        if not known.exists():
            tell(f"{truth.solver}: {len(study.steps)} steps on {len(mesh.points)} nodes")
            solver.solve(folder / "deck.inp", folder, threads).save(known)
        outcome = Outcome.load(known)
    except InputError as error:
        raise _in_description(truth, folder, included, error) from error
    except SolverError as error:
        raise SolverError(f"{truth.path}: solver: {error}") from error
    if outcome.status != CONVERGED:
        raise SolverError(f"{truth.path}: displacement: {truth.solver}: {outcome.message}")
    beside = bodies.moved(mesh, deck)
    return outcome, mesh if beside is None else replace(mesh, points=mesh.points + beside)


def _in_description(truth: Truth, folder: Path, included: str, error: InputError) -> InputError:
    """An error of a deck, which is gone when it is read, as one of what the deck was made from."""
    # an element without the line of a deck is one of the whole body, and a line of the included file one of its mesh
    if Path(error.where) == folder / included or error.field == "*ELEMENT":
        field, what = ("body.mesh", truth.mesh_file.name) if truth.mesh_file else ("mesh", "a mesh")
        found = f"{what}, with {error.field}: {error.found}"
    elif error.where.startswith("effect "):
        field, found = f"effects.{error.where.removeprefix('effect ')}", f"{error.field}: {error.found}"
    elif Path(error.where).parent == folder or error.where == truth.template:
        # numbers of the description are right by now: what effects make of them need not be
        field, what = ("effects", ", ".join(truth.effects)) if truth.effects else ("template", truth.template)
        found = f"{what}, with which a deck has in {error.field}: {error.found}"
    else:
        return error  # a file of the user's own
    return InputError(truth.path, field, found, error.expected)


def _as_measured(truth: Truth, force: np.ndarray, course: Mapping[str, np.ndarray]) -> np.ndarray:
    """What a sensor shows where effects only tell, in a straight line, the force that is there from the one shown.

    Shares of the largest force are of the largest one that is there.
    """
    names = {**course, "largest": np.abs(force).max(), "time": np.array(truth.time or [0.0] * len(force))}
    for effect in _present(truth):
        if "force" in effect.changes and "force" not in effect.observes:
            own = effect.own(truth.values)
            try:
                zero, one = (evaluate(effect.changes["force"], {**names, "force": f, **own}) for f in (0.0, 1.0))
                if np.any(one == zero):
                    raise ValueError("no force moves what the sensor shows")
            except (ValueError, TypeError) as error:
                raise InputError(f"effect {effect.name}", "changes.force", error, "a straight line in force") from error
            force = (force - zero) / (one - zero)
    return force


def add_noise(truth: Truth, solved: Solved, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured forces (N), displacements (mm) and pictures (stored intensity) with noise of a seed."""
    rng = np.random.default_rng([seed, 2])
    with np.errstate(all="ignore"):  # what is not finite is found below
        force = solved.force + rng.normal(0.0, _force_spread(truth, solved), solved.force.shape)
        moved = solved.displacement
        moved = moved + rng.normal(0.0, truth.displacement_noise, moved.shape)
    for field, spread, values in (
        ("force", truth.force_noise, force),
        ("displacement", truth.displacement_noise, moved),
    ):
        if not np.isfinite(values).all():
            raise InputError(truth.path, f"noise.{field}", f"{spread:g}", f"one that leaves each {field} finite")
    pictures = np.empty(solved.pictures.shape, np.uint16)
    for picture, stored in zip(solved.pictures, pictures, strict=True):
        noisy = add_rician(picture, truth.picture["noise"], rng)
        stored[...] = np.rint(np.clip(noisy, 0, BRIGHTEST) * FULL_SCALE)
    return force, moved, pictures


def _force_spread(truth: Truth, solved: Solved) -> float:
    """Standard deviation of the forces, N; a faulty sensor may show negative ones."""
    return truth.force_noise * float(np.abs(solved.force).max())


def write_study(truth: Truth, solved: Solved, out: Path, seed: int | None = None) -> None:
    """Write a study's folder with new noise, whole or not at all; what is there is replaced file by file.

    Parameters
    ----------
    out : Path
        Folder; the truth goes to ``sealed/truth.yaml`` in it.
    seed : int, optional
        Of the noise; that of the truth when left out.
    """
    import yaml

    force, moved, pictures = add_noise(truth, solved, truth.seed if seed is None else seed)
    pictured = truth.picture["pictured"]
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        temporary = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}."))
    except OSError as error:
        raise FingerfitError(f"{out}: cannot be written: {error.strerror}") from error
    try:
        for number in [0, *pictured]:
            name = "before" if number == 0 else f"step_{number}"
            frame = solved.frame
            picture = Picture(pictures[number], frame.spacing, frame.origin, frame.direction)
            write_picture(temporary / "pictures" / f"{name}.nii.gz", picture)
        timed = bool(truth.time)
        rows = ["step,displacement,force,picture" + ",time" * timed]
        for number, (d, f) in enumerate(zip(moved, force, strict=True), 1):
            name = f"pictures/step_{number}.nii.gz" if number in pictured else ""
            rows.append(f"{number},{d:.8g},{f:.8g},{name}" + (f",{truth.time[number - 1]:g}" if timed else ""))
        write_text(temporary / "steps.csv", "\n".join(rows) + "\n")
        write_text(temporary / "study.yaml", _study_text(truth, solved, temporary))
        sealed = {
            "constants": {f"mu_{layer['name']}": layer["mu"] for layer in truth.layers} | truth.material,
            "unit": "MPa",
            "mesh": truth.mesh or (truth.mesh_file.name if truth.mesh_file else ""),
            "solver": get_solver(truth.solver).identity(),
            "force": [round(float(f), 6) for f in solved.force],
            "effects": truth.effects,
        }
        write_text(temporary / "sealed" / "truth.yaml", yaml.safe_dump(sealed, sort_keys=False))
        for path in sorted(p for p in temporary.rglob("*") if p.is_file()):
            target = out / path.relative_to(temporary)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _study_text(truth: Truth, solved: Solved, folder: Path) -> str:
    """Text of study.yaml; meshes that it names are copied beside it."""
    given = truth.written
    body, boundary = _in_plane(truth) if truth.dim == 2 else _in_space(truth, folder)
    spread = {"force": _force_spread(truth, solved), "displacement": truth.displacement_noise}
    data = {
        "title": truth.title,
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": given.get("control", "force"),
        "steps": "steps.csv",
        "pictures": {"before": "pictures/before.nii.gz", "noise": "estimated", **(given.get("pictures") or {})},
        "noise": {name: float(f"{value:.3g}") for name, value in spread.items() if value > 0},
        "body": body,
        "boundary": boundary,
    }
    return _yaml(data)


def _yaml(data: dict[str, Any]) -> str:
    """Text that people read: short lists in one line, letters of any language as they are."""
    import yaml

    return str(yaml.safe_dump(data, sort_keys=False, default_flow_style=None, allow_unicode=True))


def _in_plane(truth: Truth) -> tuple[dict[str, Any], dict[str, Any]]:
    """Body and boundary of a block as study.yaml has them."""
    layers = [{"name": layer["name"], "height": layer["height"]} for layer in truth.layers]
    body = {"width": truth.width, "thickness": truth.thickness, "origin": [0, 0], "layers": layers}
    return body, {"base": "held", "indenter": "glued", **(truth.written.get("boundary") or {})}


def _in_space(truth: Truth, folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The same of a body in space."""
    given = truth.written
    layers = [{"name": layer["name"], "height": layer.get("height")} for layer in truth.layers]
    body = dict(given.get("body") or {"brick": list(truth.brick or ()), "layers": layers})
    for key in ("mesh", "refined"):
        if key in body:
            mesh = truth.folder / str(body[key])
            body[key] = mesh.name
            if mesh.is_file():  # one that is morphed to the first picture comes later
                shutil.copyfile(mesh, folder / mesh.name)
    return body, given.get("boundary") or dict(zip(("base", "indenter"), truth.boundary, strict=True))


def run_experiment(description: Path, out: Path) -> None:
    """Make the study of a described experiment, and tell how far it is.

    Raises
    ------
    FingerfitError
        When the description is wrong or the body has no solution.
    """
    if not description.exists():
        raise InputError(description, "file", "nothing", "the description of an experiment")
    truths = read_truths(description)
    for name, truth in truths.items():
        with tempfile.TemporaryDirectory() as folder:
            write_study(truth, solve(truth, Path(folder)), out / name)
    if "" not in truths:
        _join(out, truths)
    tell(f"{out}: written")


def _join(out: Path, truths: Mapping[str, Truth]) -> None:
    """Write the study of several tests, each of which is in a folder of its own."""
    import yaml

    tests = {}
    for name in truths:
        own = yaml.safe_load((out / name / "study.yaml").read_text(encoding="utf-8"))
        own["steps"] = f"{name}/{own['steps']}"
        for part, keys in (("pictures", ("before",)), ("body", ("mesh", "refined"))):
            own[part] = {key: f"{name}/{value}" if key in keys else value for key, value in own[part].items()}
        tests[name] = own
    first = next(iter(tests.values()))
    shared = {key: value for key, value in first.items() if all(own.get(key) == value for own in tests.values())}
    differ = {name: {k: v for k, v in own.items() if k not in shared} for name, own in tests.items()}
    write_text(out / "study.yaml", _yaml({**shared, TESTS: differ}))
    for name in truths:  # the study is the one above, of all tests
        (out / name / "study.yaml").unlink()
