"""Virtual experiments: measured data of a body that is described exactly, with noise; the truth sealed apart."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.deck.context import deck_context
from fingerfit.deck.render import render_deck
from fingerfit.effects.catalogue import catalogue
from fingerfit.effects.contract import Effect
from fingerfit.effects.expression import evaluate
from fingerfit.effects.observe import Observation
from fingerfit.errors import FingerfitError, InputError, Problems, SolverError
from fingerfit.files import write_text
from fingerfit.imaging.noise import add_rician
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.imaging.warp import backward_map, sample, spline_coefficients
from fingerfit.keys import Keys, read_yaml
from fingerfit.mesh import Mesh
from fingerfit.mesh_io import format_mesh
from fingerfit.meshing import layered_block
from fingerfit.predict import positions, since_first_picture
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.solvers.registry import get_solver
from fingerfit.study import Body, Layer, Noise, Step, Study

TEMPLATES = Path(__file__).resolve().parent.parent / "templates"
FULL_SCALE = 4000.0
"""Stored intensity of 1."""


@dataclass(frozen=True)
class Truth:
    """What an experiment is made of.

    Parameters
    ----------
    layers : tuple of dict
        ``name, height`` (mm), ``mu`` (MPa), ``intensity`` (0..1), from the indenter down.
    width, thickness : float
        mm.
    material : dict
        ``alpha`` and ``poisson``.
    mesh : dict
        ``element, across, per_layer, grading``.
    solver : str
    displacement : tuple of float
        Of the indenter at the steps, mm.
    picture : dict
        ``pixels`` of a side, ``side`` in mm, ``texture`` (relative spread), ``correlation`` (mm), ``noise`` (0..1),
        ``pictured``: steps with a picture.
    force_noise : float
        Standard deviation as a share of the largest force.
    displacement_noise : float
        mm.
    seed : int
        Of texture and noise.
    time : tuple of float
        At the end of each step, s; needed by effects that depend on it.
    effects : dict
        Hidden effects and their numbers.
    own : Path, optional
        A folder whose ``effects/`` has effects that are not in the catalogue.
    """

    title: str
    layers: tuple[dict[str, Any], ...]
    width: float
    thickness: float
    material: dict[str, float]
    mesh: dict[str, Any]
    solver: str
    displacement: tuple[float, ...]
    picture: dict[str, Any]
    force_noise: float
    displacement_noise: float
    seed: int
    time: tuple[float, ...] = ()
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    own: Path | None = None

    @property
    def known(self) -> dict[str, Effect]:
        """The catalogue and the experiment's own effects."""
        return catalogue(self.own)

    @property
    def values(self) -> dict[str, float]:
        """Constants and the numbers of hidden effects, as a guess names them."""
        own = {f"mu_{layer['name']}": layer["mu"] for layer in self.layers}
        return own | {f"{name}.{key}": v for name, numbers in self.effects.items() for key, v in numbers.items()}


def read_truth(path: Path) -> Truth:
    """Read the description of an experiment.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    problems: list[FingerfitError] = []
    keys = Keys(path, read_yaml(path), "", problems)
    if problems:
        raise Problems(problems)
    keys.known(
        "title", "body", "material", "mesh", "solver", "displacement", "picture", "noise", "seed", "time", "effects",
        "own",
    )  # fmt: skip
    body, noise = keys.mapping("body"), keys.mapping("noise")
    body.known("width", "thickness", "layers")
    noise.known("force", "displacement")
    layers = []
    for number, entry in enumerate(body.items("layers")):
        layer = Keys(path, entry, f"body.layers.{number}.", problems)
        layer.known("name", "height", "mu", "intensity")
        values = {name: layer.number(name, above=0.0) for name in ("height", "mu", "intensity")}
        layers.append({"name": layer.text("name"), **values})
    tables = {}
    for name, wanted in (
        ("material", ("alpha", "poisson")),
        ("mesh", ("element", "across", "per_layer", "grading")),
        ("picture", ("pixels", "side", "texture", "correlation", "noise", "pictured")),
    ):
        table = keys.mapping(name)
        table.known(*wanted)
        for key in wanted:
            if key not in table.data:
                table.wrong(key, "nothing", "a value")
        tables[name] = table.data
    displacement = tuple(keys.items("displacement"))
    truth = (body.number("width", above=0.0), body.number("thickness", above=0.0))
    spread = (noise.number("force"), noise.number("displacement"))
    solver, title, seed = keys.text("solver"), keys.text("title"), keys.number("seed")
    own = path.parent / (keys.text("own") or "") if "own" in keys.data else None
    effects, known = keys.mapping("effects", {}), catalogue(own)
    effects.known(*known)
    hidden = {}
    for name in effects.data:
        inner = effects.mapping(name)
        if name in known:
            inner.known(*known[name].own({}))
        hidden[name] = {key: inner.number(key) or 0.0 for key in inner.data}
    time = tuple(keys.items("time")) if "time" in keys.data else ()
    if problems:
        raise Problems(problems)
    return Truth(
        title or "",
        tuple(layers),
        truth[0] or 0.0,
        truth[1] or 0.0,
        tables["material"],
        tables["mesh"],
        solver or "",
        displacement,
        tables["picture"],
        spread[0] or 0.0,
        spread[1] or 0.0,
        int(seed or 0),
        time,
        hidden,
        own,
    )


@dataclass(frozen=True)
class Solved:
    """A solved experiment without noise.

    Parameters
    ----------
    force : ndarray, shape (steps,)
        N, positive in compression.
    pictures : ndarray, shape (1 + steps, ny, nx)
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


def solve(truth: Truth, folder: Path, threads: int = 2) -> Solved:
    """Solve the fine mesh and make the pictures, in a working folder.

    Raises
    ------
    SolverError
        When the body has no solution for these displacements.
    """
    mesh = layered_block(
        truth.width,
        [(layer["name"], layer["height"]) for layer in truth.layers],
        truth.mesh["across"],
        truth.mesh["per_layer"],
        truth.mesh["element"],
        truth.mesh["grading"],
    )
    write_text(folder / "mesh.inp", format_mesh(mesh))
    layers = tuple(Layer(layer["name"], layer["height"]) for layer in truth.layers)
    times = truth.time or (None,) * len(truth.displacement)
    steps = tuple(Step(n, t, d) for n, (t, d) in enumerate(zip(times, truth.displacement, strict=True), 1))
    study = Study(
        folder, truth.title, "displacement", steps, None, Noise(), Body(layers, thickness=truth.thickness),
        "held", "glued",
    )  # fmt: skip
    outcome = _run(truth, study, mesh, folder, threads)
    force = -outcome.reaction[:, 1]
    if any(effect.control == "force" and "before" in effect.changes for effect in _present(truth)):
        # what the load before the first picture does is seen when the same forces are prescribed
        loaded = tuple(replace(step, force=float(f)) for step, f in zip(steps, force, strict=True))
        outcome = _run(truth, replace(study, control="force", steps=loaded), mesh, folder, threads)
        outcome = since_first_picture(outcome, len(steps))
    moved = -outcome.indenter[:, 1]
    seen = Observation.of(_present(truth), truth.values, mesh.points, len(steps))
    if seen is not None:
        moved = seen.conjugate(moved, "displacement")
    return Solved(_as_measured(truth, force), *_pictures(truth, mesh, outcome, seen), moved)


def _present(truth: Truth) -> list[Effect]:
    return [effect for name, effect in truth.known.items() if name in truth.effects]


def _run(truth: Truth, study: Study, mesh: Mesh, folder: Path, threads: int) -> Outcome:
    context = deck_context(study, mesh, "mesh.inp", truth.values, truth.material, truth.known)
    folders = [*([truth.own] if truth.own else []), TEMPLATES]
    write_text(folder / "deck.inp", render_deck("block.inp.j2", context, folders))
    outcome = get_solver(truth.solver).solve(folder / "deck.inp", folder, threads)
    if outcome.status != CONVERGED:
        raise SolverError(f"experiment: {truth.solver}: {outcome.message}")
    return outcome


def _as_measured(truth: Truth, force: np.ndarray) -> np.ndarray:
    """What a faulty sensor shows: effects tell, in a straight line, the force that is there from the one shown."""
    for effect in _present(truth):
        if "force" in effect.changes:
            own = effect.own(truth.values)
            zero, one = (float(evaluate(effect.changes["force"], {"force": f, **own})) for f in (0.0, 1.0))
            force = (force - zero) / (one - zero)
    return force


def _pictures(truth: Truth, mesh: Mesh, outcome: Outcome, seen: Observation | None) -> tuple[np.ndarray, Picture]:
    pixels, side, fine = truth.picture["pixels"], truth.picture["side"], 4
    height = sum(layer["height"] for layer in truth.layers)
    corner = np.array([truth.width - side, height - side]) / 2
    spacing = np.full(2, side / pixels)
    frame = Picture(np.zeros((pixels, pixels)), spacing, corner + spacing / 2, np.eye(2))
    dense = Picture(np.zeros((pixels * fine, pixels * fine)), spacing / fine, corner + spacing / fine / 2, np.eye(2))
    texture = _texture(truth, side, dense)
    intensity = np.zeros(mesh.element_count)
    for layer in truth.layers:
        intensity[mesh.element_sets[layer["name"].upper()]] = layer["intensity"]
    pictures = []
    x, y = positions(frame)
    for k, u in enumerate([np.zeros(mesh.points.shape), *outcome.displacement]):
        shift = np.zeros(2) if seen is None or k == 0 else seen.shift(k)
        way = backward_map(mesh, u + shift, dense)
        full = np.zeros(dense.values.size)
        full[way.pixel] = intensity[way.element] * (1 + sample(texture, way.index))
        picture = full.reshape(pixels, fine, pixels, fine).mean(axis=(1, 3))
        pictures.append(picture if seen is None or k == 0 else seen.intensity(picture, k, x, y))
    return np.array(pictures), frame


def _texture(truth: Truth, side: float, dense: Picture) -> np.ndarray:
    """Spline coefficients of a random field that is fixed to the material."""
    from scipy.ndimage import gaussian_filter

    field = np.random.default_rng([truth.seed, 1]).normal(size=dense.values.shape)
    field = gaussian_filter(field, truth.picture["correlation"] / dense.spacing[0] / 2, mode="wrap")
    return spline_coefficients(field / field.std() * truth.picture["texture"])


def add_noise(truth: Truth, solved: Solved, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Measured forces (N), displacements (mm) and pictures (stored intensity) with noise of a seed."""
    rng = np.random.default_rng([seed, 2])
    force = solved.force + rng.normal(0.0, truth.force_noise * solved.force.max(), solved.force.shape)
    moved = solved.displacement
    moved = moved + rng.normal(0.0, truth.displacement_noise, moved.shape)
    pictures = [add_rician(p, truth.picture["noise"], rng) for p in solved.pictures]
    return force, moved, np.rint(np.clip(np.array(pictures), 0, 16) * FULL_SCALE)


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
    temporary = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}."))
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
            rows.append(f"{number},{d:.4f},{f:.4f},{name}" + (f",{truth.time[number - 1]:g}" if timed else ""))
        write_text(temporary / "steps.csv", "\n".join(rows) + "\n")
        write_text(temporary / "study.yaml", _study_text(truth, solved))
        sealed = {
            "constants": {f"mu_{layer['name']}": layer["mu"] for layer in truth.layers} | truth.material,
            "unit": "MPa",
            "mesh": truth.mesh,
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


def _study_text(truth: Truth, solved: Solved) -> str:
    layers = "".join(f"    - {{name: {lay['name']}, height: {lay['height']:g}}}\n" for lay in truth.layers)
    return (
        f"title: {truth.title}\n"
        "units: {length: mm, force: N, time: s}\n"
        "control: force\n"
        "steps: steps.csv\n"
        "pictures: {before: pictures/before.nii.gz, noise: estimated}\n"
        f"noise: {{force: {truth.force_noise * solved.force.max():.3g},"
        f" displacement: {truth.displacement_noise:g}}}\n"
        "body:\n"
        f"  width: {truth.width:g}\n"
        f"  thickness: {truth.thickness:g}\n"
        f"  origin: [0, 0]\n"
        f"  layers:\n{layers}"
        "boundary: {base: held, indenter: glued}\n"
    )


def run_experiment(description: Path, out: Path) -> None:
    """Make the study of a described experiment.

    Raises
    ------
    FingerfitError
        When the description is wrong or the body has no solution.
    """
    if not description.exists():
        raise InputError(description, "file", "nothing", "the description of an experiment")
    truth = read_truth(description)
    with tempfile.TemporaryDirectory() as folder:
        write_study(truth, solve(truth, Path(folder)), out)
