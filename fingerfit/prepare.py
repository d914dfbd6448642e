"""Reading a study's measurements into arrays, and making its mesh."""

from __future__ import annotations

import numpy as np

from fingerfit.data import Data
from fingerfit.errors import FingerfitError, InputError, Problems
from fingerfit.imaging.noise import estimate_noise
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.imaging.preprocess import scale_of, smooth
from fingerfit.mesh import Mesh
from fingerfit.mesh_io import read_mesh
from fingerfit.meshing import brick, layered_block
from fingerfit.settings import MeshSettings
from fingerfit.study import ESTIMATED, Study


def make_mesh(study: Study, settings: MeshSettings | None) -> Mesh:
    """The mesh of a study.

    Raises
    ------
    InputError
        When the study's mesh lacks a set.
    """
    body = study.body
    if body.brick is not None and settings is not None:
        mesh = brick(body.brick, (settings.across, settings.across, settings.per_layer), body.layers[0].name)
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
    elif body.mesh is not None:
        mesh = _named(read_mesh(body.mesh), study)
    else:
        raise InputError(study.path, "body", "no shape", "layers with width and height, brick or mesh")
    return mesh


def _named(mesh: Mesh, study: Study) -> Mesh:
    """A user's mesh in mm with its element sets named as the layers and its node sets as the templates want them.

    ``INDENTER`` (one node of ``TOP``) and, for a base that slides in the plane, ``MIDDLE`` are chosen when the mesh
    does not name them.
    """
    sets = {name.upper(): index for name, index in mesh.element_sets.items()}
    problems: list[FingerfitError] = []
    chosen = {}
    for layer in study.body.layers:
        name = (layer.elements or layer.name).upper()
        if name not in sets:
            problems.append(InputError(study.body.mesh or "", f"element set {name}", "nothing",
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
            problems.append(InputError(study.body.mesh or "", f"node set {own}", "nothing", expected))
        else:
            nodes[name] = nodes[own]
    if problems:
        raise Problems(problems)
    nodes.setdefault("INDENTER", nodes["TOP"][:1])
    if mesh.dim == 2:
        x = mesh.points[nodes["BOTTOM"], 0]
        nodes.setdefault("MIDDLE", nodes["BOTTOM"][[np.abs(x - x.mean()).argmin()]])
    return Mesh(mesh.points * study.length, mesh.blocks, nodes, {**sets, **chosen}, mesh.surfaces)


def prepare(study: Study, mesh: Mesh, steps: list[int] | None, sigma: float, crop: float) -> Data:
    """Read, check, smooth and scale all measurements of a study.

    Parameters
    ----------
    study : Study
    mesh : Mesh
        To see where the body is.
    steps : list of int or None
        Steps whose pictures are compared; None for all that have one.
    sigma : float
        Gaussian, pixels.
    crop : float
        How far beyond the undeformed body the pictures are compared, as a share of its extent.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    problems: list[FingerfitError] = []
    numbers = [step.number for step in study.steps]
    used = [i for i, s in enumerate(study.steps) if s.picture and (steps is None or s.number in steps)]
    for number in steps or []:
        if number not in numbers or not study.steps[numbers.index(number)].picture:
            found = f"step {number}, which has no picture" if number in numbers else f"step {number}"
            problems.append(InputError("config.yaml", "fit.steps", found, "steps with a picture"))
    before, pictures = _read_pictures(study, used, problems)
    if before is not None and before.dim != mesh.dim:
        problems.append(
            InputError(study.before or "", "picture", f"{before.dim} dimensions", f"{mesh.dim}, as the mesh")
        )
    points = _read_points(study, mesh, problems)
    if problems:
        raise Problems(problems)
    values = raw = np.zeros((0,) * mesh.dim)
    measured = np.zeros((0, *values.shape))
    noise, background = 0.0, 0.0
    if before is not None:
        covered = covers(mesh, before)
        if covered.mean() == 0:
            raise InputError(study.before or "", "picture", "no pixel on the mesh", "a picture that overlaps the body")
        low, size = scale_of(before.values)
        empty = _empty(before, mesh)
        noise = _picture_noise(study, before, empty) / size
        before, *pictures = [picture.crop(mesh.points, crop) for picture in (before, *pictures)]
        empty = _empty(before, mesh)
        raw = (before.values - low) / size
        values = smooth(raw, sigma)
        measured = np.array([smooth((p.values - low) / size, sigma) for p in pictures])
        background = float(np.median(values[empty])) if empty.any() else float(values.min())
    from fingerfit.imaging.warp import spline_coefficients

    def column(name: str) -> np.ndarray:
        return np.array([np.nan if getattr(s, name) is None else getattr(s, name) for s in study.steps])

    return Data(
        step=np.array(numbers),
        force=column("force"),
        displacement=column("displacement"),
        control=study.control,
        force_noise=_noise(study, "force", column("force"), column("displacement")),
        displacement_noise=_noise(study, "displacement", column("displacement"), column("force")),
        picture_noise=noise,
        points_noise=float(study.noise.points or 0.0) if study.noise.points != ESTIMATED else 0.0,
        before=values,
        coefficients=spline_coefficients(raw) if raw.size else raw,
        measured=measured,
        picture_step=np.array(used if before is not None else [], dtype=int),
        spacing=before.spacing if before else np.ones(mesh.dim),
        origin=before.origin if before else np.zeros(mesh.dim),
        direction=before.direction if before else np.eye(mesh.dim),
        background=background,
        smooth=sigma,
        points=points[0],
        points_displacement=points[1],
        points_step=points[2],
    )


def covers(mesh: Mesh, picture: Picture) -> np.ndarray:
    """Pixels on the undeformed body, shape of the picture, bool."""
    from fingerfit.imaging.warp import backward_map

    covered = np.zeros(picture.values.size, dtype=bool)
    covered[backward_map(mesh, np.zeros(mesh.points.shape), picture).pixel] = True
    return covered.reshape(picture.values.shape)


def _empty(picture: Picture, mesh: Mesh) -> np.ndarray:
    """Pixels far from the body: outside its bounding box by more than a fifth of its size."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    margin = 0.2 * (high - low)
    index = np.indices(picture.values.shape)[::-1].reshape(picture.dim, -1).T
    where = picture.to_points(index.astype(float))
    outside = ((where < low - margin) | (where > high + margin)).any(axis=1)
    return outside.reshape(picture.values.shape)


def _picture_noise(study: Study, before: Picture, empty: np.ndarray) -> float:
    if isinstance(study.noise.picture, float):
        return study.noise.picture
    return estimate_noise(before.values, empty)


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
    x = against[known] / np.abs(against[known]).max()
    basis = np.stack([x, x**2, x**3], axis=1)
    residual = values[known] - basis @ np.linalg.lstsq(basis, values[known], rcond=None)[0]
    return float(np.sqrt((residual**2).sum() / (known.sum() - 3)))


def _read_pictures(
    study: Study, used: list[int], problems: list[FingerfitError]
) -> tuple[Picture | None, list[Picture]]:
    if not used or study.before is None:
        return None, []
    try:
        before = read_picture(study.before)
    except InputError as error:
        problems.append(error)
        return None, []
    pictures = []
    for index in used:
        path = study.steps[index].picture
        if path is None:
            continue
        try:
            picture = read_picture(path)
        except InputError as error:
            problems.append(error)
            continue
        if not picture.same_place(before):
            found = f"{'x'.join(map(str, picture.values.shape[::-1]))} at {np.round(picture.origin, 6).tolist()}"
            problems.append(InputError(path, "geometry", found, f"that of {study.before.name}"))
        pictures.append(picture)
    return before, pictures


def _read_points(study: Study, mesh: Mesh, problems: list[FingerfitError]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    columns = [*"xyz"[: mesh.dim], *("u" + axis for axis in "xyz"[: mesh.dim])]
    tables, owners = [], []
    for number, step in enumerate(study.steps):
        if step.points is None:
            continue
        try:
            text = step.points.read_text().splitlines()
            head = [cell.strip() for cell in text[0].split(",")] if text else []
            if head != columns:
                raise InputError(step.points, "columns", ",".join(head) or "nothing", ",".join(columns))
            table = np.array([[float(cell) for cell in row.split(",")] for row in text[1:] if row.strip()])
            if table.ndim != 2 or table.shape[1] != len(columns) or not np.isfinite(table).all():
                raise InputError(step.points, "rows", "missing or infinite numbers", f"{len(columns)} finite numbers")
        except InputError as error:
            problems.append(error)
            continue
        except (OSError, ValueError) as error:
            problems.append(InputError(step.points, "rows", error, f"{len(columns)} finite numbers"))
            continue
        tables.append(table * study.length)
        owners.append(np.full(len(table), number))
    if not tables:
        return np.zeros((0, mesh.dim)), np.zeros((0, mesh.dim)), np.zeros(0, dtype=int)
    table = np.concatenate(tables)
    return table[:, : mesh.dim], table[:, mesh.dim :], np.concatenate(owners)
