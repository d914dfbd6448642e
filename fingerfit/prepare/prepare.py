"""Reading a study's measurements into arrays, and making its mesh."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.deck.mesh_file import read_mesh, with_types
from fingerfit.imaging.outline import Outline
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.check import faults_of_mesh
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import OUTLINE
from fingerfit.prepare.finer import other_body
from fingerfit.prepare.pictures import Prepared, outline_of, prepare_pictures
from fingerfit.prepare.plausible import falls, refuse_depth
from fingerfit.prepare.points import points_covariance, read_points
from fingerfit.prepare.regions import with_regions
from fingerfit.settings.parts import MeshSettings
from fingerfit.study.data import Data
from fingerfit.study.direction import wrong_axes
from fingerfit.study.study import AXES, ESTIMATED, Study


def make_mesh(study: Study, settings: MeshSettings | None, finer: bool = False) -> Mesh:
    """The mesh of a study; of a study that brings its meshes, the finer one if wanted.

    Raises
    ------
    InputError
        When the study's mesh lacks a set, or a region fits to no element.
    Problems
        Also when the study's finer mesh is one of another body than its mesh.
    """
    body = study.body
    if body.brick is not None and settings is not None:
        cells = (settings.across, settings.across, settings.per_layer)
        heights = [(layer.name, layer.height or body.brick[2]) for layer in body.layers]
        mesh = brick(body.brick, cells, element=settings.element, layers=heights)
    elif body.width is not None and settings is not None:
        layers = [(layer.name, layer.height or 0.0) for layer in body.layers]
        mesh = layered_block(
            body.width,
            layers,
            settings.across,
            settings.per_layer,
            settings.element,
            settings.grading,
            body.origin,
        )
        if settings.pictured and not (study.test and study.before is None):  # of several tests those with pictures
            mesh = replace(mesh, points=_pictured(study).moved(mesh.points))
    elif body.mesh is not None:
        file = body.refined if finer and body.refined else body.mesh
        mesh = _read(study, file)
        if wrong := list(wrong_axes(study, mesh.dim)):
            raise Problems(wrong)
        if mesh.dim == 2 and not body.thickness:
            raise InputError(study.path, "body.thickness", "nothing", "a number above 0, since the mesh is plane")
        if file != body.mesh:
            names = [name.upper() for name in study.layer_names]
            if other := other_body(_read(study, body.mesh), mesh, names, file, body.mesh):
                raise Problems(other)
    else:
        raise InputError(study.path, "body", "no shape", "layers with width and height, brick or mesh")
    return with_regions(study, mesh)


def _read(study: Study, file: Path) -> Mesh:
    """A mesh of the user's, as the study names its types and sets."""
    return _named(with_types(read_mesh(file), study.body.types, study.path), study, file)


def _pictured(study: Study) -> Outline:
    """The outline of a block as the picture before compression shows it."""
    expected = f"a picture that shows the body and what is around it, or a model without {OUTLINE}"
    if study.before is None:
        raise InputError(study.path, "pictures", "nothing", expected)
    found = outline_of(study, read_picture(study.before))
    if found is None or np.isnan(found.outward).all():
        raise InputError(study.path, "pictures.before", f"no side of the body in {study.before.name}", expected)
    return found


def _named(mesh: Mesh, study: Study, file: Path) -> Mesh:
    """A user's mesh in mm with its element sets named as the layers and its node sets as the templates want them.

    ``INDENTER`` (the node of ``TOP`` nearest to its middle) and, for a base that slides in the plane, ``MIDDLE`` are
    chosen when the mesh does not name them.
    """
    sets = {name.upper(): index for name, index in mesh.element_sets.items()}
    problems: list[FingerfitError] = []
    chosen = {}
    for layer in study.body.layers:
        name = (layer.elements or layer.name).upper()
        if name not in sets:
            problems.append(InputError(file, f"element set {name}", "nothing",
                                       "one of " + ", ".join(sorted(sets))))  # fmt: skip
        else:
            chosen[layer.name.upper()] = sets[name]
    nodes = dict(mesh.node_sets)
    wanted = {"BOTTOM": study.base_nodes, "TOP": study.indenter_nodes}
    if mesh.dim == 3 and study.base == "slides":
        wanted |= {"X0": "X0", "Y0": "Y0"}
    for name, own in wanted.items():
        if len(nodes.get(own, ())) == 0:
            expected = "one of " + ", ".join(sorted(nodes)) if nodes else "node sets in the mesh"
            problems.append(InputError(file, f"node set {own}", "nothing", expected))
        else:
            nodes[name] = nodes[own]
    if problems:
        raise Problems(problems)
    nodes.setdefault("INDENTER", _in_the_middle(mesh, nodes["TOP"]))
    if mesh.dim == 2:
        nodes.setdefault("MIDDLE", _in_the_middle(mesh, nodes["BOTTOM"]))
    named = Mesh(mesh.points * study.length, mesh.blocks, nodes, {**sets, **chosen}, mesh.surfaces)
    if faults := faults_of_mesh(named, chosen, file):
        raise Problems(faults)
    return named


def _in_the_middle(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """The node of a side that is nearest to its middle."""
    away = mesh.points[nodes, :-1] - mesh.points[nodes, :-1].mean(axis=0)
    return nodes[[(away**2).sum(axis=1).argmin()]]


def prepare(study: Study, mesh: Mesh, steps: list[int] | None, sigma: float, crop: float) -> Data:
    """Read, check, smooth and scale all measurements of a study.

    Parameters
    ----------
    study : Study
    mesh : Mesh
        To see where the body is.
    steps : list of int or None
        Steps whose pictures and points are compared, in a study without pictures also their forces or displacements;
        None for all.
    sigma : float
        Gaussian, pixels.
    crop : float
        How far beyond the undeformed body the pictures are compared, as a share of its extent.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    problems = _steps_without_measurements(study, steps)
    numbers = [step.number for step in study.steps]
    used = [i for i, s in enumerate(study.steps) if s.picture and (steps is None or s.number in steps)]
    pictured = any(step.picture for step in study.steps)
    prepared = None
    try:
        refuse_depth(study, mesh)
    except Problems as error:
        problems += error.problems
    try:
        prepared = prepare_pictures(study, mesh, used, sigma, crop)
    except Problems as error:
        problems += error.problems
    except InputError as error:
        problems.append(error)
    points = read_points(study, mesh, problems)
    spread = points_covariance(study, points, problems)
    chosen = np.array([steps is None or number in steps for number in numbers], dtype=bool)
    points = tuple(part[chosen[points[2]]] for part in points)
    if problems:
        raise Problems(problems)
    nothing = np.zeros((0,) * mesh.dim)
    if prepared is None:
        place = Picture(nothing, np.ones(mesh.dim), np.zeros(mesh.dim), np.eye(mesh.dim))
        prepared = Prepared(place, nothing, np.zeros((0, *nothing.shape)), 0.0, 0.0, sigma, "", [], None)
        used = []

    def column(name: str) -> np.ndarray:
        return np.array([np.nan if getattr(s, name) is None else getattr(s, name) for s in study.steps])

    measured_beside: dict[str, Any] = {name: column(name) for name in ("force", "displacement")}
    beside = [column(f"force_{axis}") for axis in AXES[: mesh.dim - 1]]
    if np.isfinite(beside).any():
        measured_beside["lateral_force"] = np.stack(beside, axis=1)
    else:
        measured_beside["lateral_force"] = np.zeros((len(numbers), 0))
    if not pictured:
        measured_beside[study.response][~chosen] = np.nan
        measured_beside["lateral_force"][~chosen] = np.nan
    data = Data(
        step=np.array(numbers),
        **measured_beside,
        control=study.control,
        force_noise=_force_noise(study, _noise(study, "force", column("force"), column("displacement"))),
        displacement_noise=_noise(study, "displacement", column("displacement"), column("force")),
        picture_noise=prepared.noise,
        points_noise=float(np.sqrt(spread.diagonal()[np.unique(points[2])].mean())) if len(points[2]) else 0.0,
        points_covariance=spread,
        frame_noise=study.noise.frame,
        before=prepared.before.values,
        coefficients=prepared.coefficients,
        measured=prepared.measured,
        picture_step=np.array(used, dtype=int),
        spacing=prepared.before.spacing,
        origin=prepared.before.origin,
        direction=prepared.before.direction,
        background=prepared.background,
        smooth=prepared.smooth,
        blur=study.chain.blur,
        points=points[0],
        points_displacement=points[1],
        points_step=points[2],
        force_gain=study.noise.force_gain,
        direction_of_load=np.array(study.direction),
        history=prepared.history,
        **_sides(prepared.outline),
    )
    return replace(data, remarks="\n".join([*prepared.remarks, *falls(data)]))


def _sides(outline: Outline | None) -> dict[str, Any]:
    """What is kept of an outline."""
    if outline is None:
        return {}
    return {
        "outline": max(map(abs, outline.elsewhere().values()), default=0.0),
        "sides": np.column_stack([outline.outward, outline.error]),
        "stated": np.stack([outline.low, outline.high]),
    }


def _steps_without_measurements(study: Study, steps: list[int] | None) -> list[FingerfitError]:
    """Chosen steps that the study lacks, or that have no picture in a study with pictures."""
    problems: list[FingerfitError] = []
    numbers = [step.number for step in study.steps]
    pictured = any(step.picture for step in study.steps)
    for number in steps or []:
        if number not in numbers or (pictured and not study.steps[numbers.index(number)].picture):
            found = f"step {number}, which has no picture" if number in numbers else f"step {number}"
            problems.append(InputError("config.yaml", "fit.steps", found, "steps with a picture" if pictured else
                                       f"steps of the study, {numbers[0]} to {numbers[-1]}"))  # fmt: skip
    return problems


def _noise(study: Study, name: str, values: np.ndarray, against: np.ndarray) -> float:
    """Standard deviation as given, or from the residual of a cubic through the measured curve."""
    given = getattr(study.noise, name)
    if given is None:
        return 0.0
    if given != ESTIMATED:
        return float(given)
    known = np.isfinite(values) & np.isfinite(against)
    if known.sum() < 6:
        raise InputError(study.path, f"noise.{name}", f"estimated, from {known.sum()} steps", "a number, or 6 steps")
    other = "displacement" if name == "force" else "force"
    if not against[known].any():
        raise InputError(study.path, f"noise.{name}", f"estimated, from steps without a {other}", "a number")
    x = against[known] / np.abs(against[known]).max()
    basis = np.stack([x, x**2, x**3], axis=1)
    residual = values[known] - basis @ np.linalg.lstsq(basis, values[known], rcond=None)[0]
    # sums of as many numbers are no better known than this
    if np.abs(residual).max() <= known.sum() * np.finfo(float).eps * np.abs(values[known]).max():
        raise InputError(study.path, f"noise.{name}", "estimated, from values on a smooth curve", "a number")
    return float(np.sqrt((residual**2).sum() / (known.sum() - 3)))


def _force_noise(study: Study, common: float) -> float | np.ndarray:
    """The same for all forces, or, where the table of steps has a column for it, step by step."""
    if all(step.force_noise is None for step in study.steps):
        return common
    return np.array([common if step.force_noise is None else step.force_noise for step in study.steps])
