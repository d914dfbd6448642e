"""Results for other programs: fields for ParaView, pictures for 3D Slicer, tables for everything else."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.files import check_kept, read_npz, read_record, read_text, write_text
from fingerfit.deck.mesh_file import read_mesh
from fingerfit.forward import bodies
from fingerfit.forward.predict import in_first_picture, since_first_picture
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.imaging.sections import parts_of
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.mesh import Mesh
from fingerfit.report.fields import Fields, fields
from fingerfit.solvers.contract import Outcome
from fingerfit.study.data import Data
from fingerfit.study.several import TESTS, arrays_of_test, file_ending
from fingerfit.study.study import AXES

CELLS = {
    (2, 3): "triangle", (2, 6): "triangle6", (2, 4): "quad", (2, 8): "quad8",
    (3, 4): "tetra", (3, 10): "tetra10", (3, 8): "hexahedron", (3, 20): "hexahedron20",
}  # fmt: skip
"""Names that meshio has for cells by dimension and number of nodes; the order of their nodes is ABAQUS's."""
OF = ("measured", "model", "residual", "noise")
FIELD = {"field_value": "change_of_log_mu", "field_spread": "its_standard_error", "field_seen": "share_seen"}
"""Names of stiffness as a field, of a model that has it, beside the mesh before compression."""
STIFFNESS = ("change_of_log_mu", "standard_deviations")
"""Columns of the map of stiffness, after the place: the change that would explain most, and the evidence for it."""


@dataclass(frozen=True)
class Results:
    """What a model's folder holds.

    Parameters
    ----------
    mesh : Mesh
        Of the estimate.
    outcome : Outcome
        Its solution, from the reference state.
    deck : Path
    data : Data
        Prepared measurements.
    compare : dict of ndarray
        As `fingerfit.report.findings.write_compare` writes them.
    stiffness : ndarray, shape (places, dim + 2)
        As from `fingerfit.diagnosis.ranking.stiffness_map`; no places where there is no map.
    ranking : list of dict
        Tested effects, as ``diagnosis.json`` has them.
    """

    mesh: Mesh
    outcome: Outcome
    deck: Path
    data: Data
    compare: dict[str, np.ndarray]
    stiffness: np.ndarray
    ranking: list[dict[str, Any]]


def read_results(model: Path, test: int = 0) -> Results:
    """Read what a fit and its diagnosis left in ``results/{study}/{model}``; `test` counts the tests of the study.

    Raises
    ------
    StateError
        When there is no estimate, no diagnosis, or a file is damaged.
    """
    diagnosed = [(name, "fingerfit run --diagnose") for name in ("compare.npz", "diagnosis.npz", "diagnosis.json")]
    for name, made in (("estimate.json", "fingerfit run"), *diagnosed):
        if not (model / name).exists():
            raise StateError(f"{model / name}: is not there; `{made}` makes it")
    estimate = read_record(model / "estimate.json", "sim", "sim_mesh", "parameters")
    compare, diagnosis = read_npz(model / "compare.npz"), read_npz(model / "diagnosis.npz")
    name = str(compare[TESTS][test]) if TESTS in compare else ""
    end, compare = file_ending(name), arrays_of_test(compare, name)
    file = model / f"{'refined' if estimate['sim_mesh'] == 'refined' else 'mesh'}{end}.inp"
    check_kept(file)
    mesh = read_mesh(file)
    folder = model.parent / "sims" / estimate.get("sims", [estimate["sim"]])[test]
    outcome = Outcome.load(folder / "solution.npz")
    ranking = read_record(model / "diagnosis.json", "ranking")["ranking"]
    data = Data.load(model / f"prepared{end}.npz")
    return Results(mesh, outcome, folder / "deck.inp", data, compare, diagnosis["stiffness"], ranking)


def export(model: Path, out: Path) -> list[Path]:
    """Write everything, of a study with several tests each in a folder of its own; returns the files.

    Parameters
    ----------
    model : Path
        ``results/{study}/{model}``, fitted and diagnosed.
    out : Path
        Folder.
    """
    first = read_results(model)
    tests = read_npz(model / "compare.npz").get(TESTS, [""])
    written = []
    for n, name in enumerate(tests):
        found, place = read_results(model, n) if n else first, out / str(name)
        written += [*write_fields(found, place / "fields"), *write_pictures(found, place / "pictures")]
        written += write_tables(found, place)
    return written


def write_fields(found: Results, folder: Path) -> list[Path]:
    """Mesh with displacement, strain and stress before compression and at each step (.vtu), and their series (.pvd);
    beside them points with the residual displacements, and with the map of stiffness.

    Places and displacements count from the state of the first picture, stresses from the one without any.
    """
    folder.mkdir(parents=True, exist_ok=True)
    count, data = len(found.data.step), found.data
    text = read_text(found.deck)
    beside = bodies.lift(found.mesh, text), bodies.moved(found.mesh, text)
    since = since_first_picture(found.outcome, count, data.outline > 0, *beside)
    mesh = in_first_picture(found.mesh, since)
    extra = found.outcome.steps - count
    still = np.zeros_like(found.outcome.displacement[0])
    states = [(still, *((found.outcome.displacement[0], 0) if extra else (still, None)))]
    states += [(since.displacement[n], found.outcome.displacement[n + extra], n + extra) for n in range(count)]
    more = {title: found.compare[key] for key, title in FIELD.items() if key in found.compare}
    names, written = ["before", *(f"step_{n}" for n in data.step)], []
    for name, (moved, total, step) in zip(names, states, strict=True):
        written.append(folder / f"{name}.vtu")
        state = fields(bodies.without_load(found.mesh, text), found.deck, total, step)
        _write_vtu(mesh, moved[: len(mesh.points)], state, written[-1], more if name == "before" else {})
    rows = [
        f'    <DataSet timestep="{time}" part="0" file={quoteattr(path.name)}/>'
        for time, path in zip([0, *data.step.tolist()], written, strict=True)
    ]
    series = folder / "model.pvd"
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>'
    write_text(series, "\n".join([head, *rows, "  </Collection>", "</VTKFile>"]) + "\n")
    dim, centre = found.mesh.dim, found.compare["patch_centre"]
    for index, left, noise in zip(
        *(found.compare[key] for key in ("picture_step", "residual_displacement", "residual_displacement_noise")),
        strict=True,
    ):
        known = np.isfinite(left).all(axis=1)
        written.append(folder / f"residual_step_{found.compare['step'][index]}.vtu")
        values = {"residual_displacement_mm": _in_space(left[known]), "noise_mm": _in_space(noise[known])}
        _write_points(centre[known], values, written[-1])
    if len(found.stiffness):
        written.append(folder / "stiffness.vtu")
        values = {name: found.stiffness[:, dim + n] for n, name in enumerate(STIFFNESS)}
        _write_points(found.stiffness[:, :dim], values, written[-1])
    return [series, *written]


def _in_space(vectors: np.ndarray) -> np.ndarray:
    """Vectors with a zero for what is out of the plane, shape (vectors, 3)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _write_points(points: np.ndarray, values: dict[str, np.ndarray], path: Path) -> None:
    """Values at points, to be drawn as glyphs."""
    import meshio

    cells = [("vertex", np.arange(len(points))[:, None])]
    _replace(meshio.Mesh(_in_space(points), cells, values), path)


def _replace(grid: Any, path: Path) -> None:
    temporary = path.with_name(f".{path.name}.part.vtu")
    grid.write(temporary)
    temporary.replace(path)


def _write_vtu(
    mesh: Mesh, moved: np.ndarray, state: Fields, path: Path, more: Mapping[str, np.ndarray] | None = None
) -> None:
    import meshio

    def flat(values: np.ndarray) -> list[np.ndarray]:
        """Values of elements by block, tensors as nine numbers."""
        ends = np.cumsum([len(block.nodes) for block in mesh.blocks])[:-1]
        return np.split(values.reshape(len(values), -1) if values.ndim > 1 else values, ends)

    cells = [(CELLS[mesh.dim, block.nodes.shape[1]], block.nodes) for block in mesh.blocks]
    cell_data = {
        "layer": flat(parts_of(mesh)),
        "green_lagrange_strain": flat(state.strain),
        "volume_ratio": flat(state.volume),
    }
    cell_data |= {name: flat(values) for name, values in (more or {}).items()}
    if state.stress is not None and state.von_mises is not None:
        cell_data["cauchy_stress_MPa"] = flat(state.stress)
        cell_data["von_mises_stress_MPa"] = flat(state.von_mises)
    grid = meshio.Mesh(_in_space(mesh.points), cells, {"displacement_mm": _in_space(moved)}, cell_data)
    _replace(grid, path)


def write_pictures(found: Results, folder: Path) -> list[Path]:
    """Measured, synthesized, difference and residual displacement of each pictured step, as NIfTI."""
    compare = found.compare
    if not compare["measured"].size:
        return []
    frame = Picture(compare["measured"][0], compare["spacing"], compare["origin"], compare["direction"])
    written = []

    def write(name: str, values: np.ndarray) -> None:
        written.append(folder / f"{name}.nii.gz")
        write_picture(
            written[-1], Picture(values, frame.spacing, frame.origin, frame.direction), np.float32,
        )  # fmt: skip

    displacement = compare["residual_displacement"]
    owner = _patches(compare, frame)
    for n, index in enumerate(compare["picture_step"]):
        step = f"step_{compare['step'][index]}"
        write(f"measured_{step}", compare["measured"][n])
        write(f"synthesized_{step}", compare["synthesized"][n])
        write(f"difference_{step}", compare["measured"][n] - compare["synthesized"][n])
        field = np.where((owner >= 0)[..., None], displacement[n][owner], np.nan)
        write(f"residual_displacement_mm_{step}", np.nan_to_num(field))
    return written


def _patches(compare: dict[str, np.ndarray], frame: Picture) -> np.ndarray:
    """Patch of material at each pixel of the undeformed body's surroundings, shape of a picture; -1 outside."""
    count, centre = compare["patch_count"].astype(int), compare["patch_centre"]
    low, high = compare["mesh_points"].min(axis=0), compare["mesh_points"].max(axis=0)
    low = np.minimum(low, centre.min(axis=0))
    size = np.where(count > 1, np.ptp(centre, axis=0) / np.maximum(count - 1, 1), high - low)
    corner = centre.min(axis=0) - size / 2
    index = np.indices(frame.values.shape)[::-1].reshape(frame.dim, -1).T.astype(float)
    place = np.floor((frame.to_points(index) - corner) / size).astype(int)
    inside = ((place >= 0) & (place < count)).all(axis=1)
    flat = np.ravel_multi_index(tuple(np.clip(place, 0, count - 1).T), tuple(count))
    return np.where(inside, flat, -1).reshape(frame.values.shape)


def write_tables(found: Results, folder: Path) -> list[Path]:
    """Forces, errors by step, residual displacement by patch and by layer and step, as CSV."""
    names, axes = list(found.mesh.parts), _axes(found)
    patches, layers = _residuals(found)
    written = []
    tables = (
        ("forces", _forces(found.compare)), ("error_by_step", _errors(found.compare)),
        ("residual_by_patch", patches), ("residual_by_layer", layers),
        ("layers", [["layer", "name"], *enumerate(name.lower() for name in names)]),
        ("stiffness", [[*(f"{a}_mm" for a in axes), *STIFFNESS], *found.stiffness.tolist()]),
        ("candidates", _candidates(found.ranking)),
    )  # fmt: skip
    for title, rows in tables:
        written.append(folder / f"{title}.csv")
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([[_cell(value) for value in row] for row in rows])
        write_text(written[-1], text.getvalue())
    return written


def _axes(found: Results) -> str:
    return "xyz"[: found.mesh.dim]


def _forces(compare: dict[str, np.ndarray]) -> list[list[object]]:
    """Force and displacement of the indenter at each step."""
    columns = []
    for what in ("force", "displacement"):
        measured, model = compare[what], compare[f"{what}_model"]
        noise = np.broadcast_to(compare[f"{what}_noise"], measured.shape)
        columns += [measured, model, measured - model, noise]
    given = ["step", *(f"{what}_{of}_{unit}" for what, unit in (("force", "N"), ("displacement", "mm")) for of in OF)]
    if "lateral_force" in compare:
        for axis, measured, model in zip(
            AXES, compare["lateral_force"].T, compare["lateral_force_model"].T, strict=False
        ):
            noise = np.broadcast_to(compare["force_noise"], measured.shape)
            columns += [measured, model, measured - model, noise]
            given += [f"force_{axis}_{of}_N" for of in OF]
    return [given, *map(list, zip(compare["step"], *columns, strict=True))]


def _errors(compare: dict[str, np.ndarray]) -> list[list[object]]:
    """Residual of each step's picture or points, and of the response."""
    rows: list[list[object]] = [["step", "fitted", *(f"rms_{of}" for of in ("residual", "noise")), "times_the_noise",
                                 "response_times_the_noise"]]  # fmt: skip
    field = {int(index): n for n, index in enumerate(compare["picture_step"])}
    for index, step in enumerate(compare["step"]):
        n = field.get(index)
        error, floor = (None, None) if n is None else (float(compare["error"][n]), float(compare["floor"][n]))
        spread = compare["response_noise"][index]
        response = abs(compare["response"][index]) / spread if spread > 0 else None
        fitted = "yes" if compare["step_fitted"][index] else "no"
        rows.append([int(step), fitted, error, floor, error / floor if error and floor else None, response])
    return rows


def _residuals(found: Results) -> tuple[list[list[object]], list[list[object]]]:
    """Residual displacements of patches, and what they come to by layer."""
    compare, names, axes = found.compare, list(found.mesh.parts), _axes(found)
    of_patch = [f"{what}{a}_mm" for what in ("", "residual_", "noise_") for a in axes]
    patches: list[list[object]] = [["step", "layer", *of_patch]]
    layers: list[list[object]] = [["step", "layer", "patches", "rms_mm", "p95_mm", "largest_mm", "times_the_noise"]]
    layer = _layers(found.mesh, compare["patch_centre"])
    for n, index in enumerate(compare["picture_step"]):
        step = int(compare["step"][index])
        displacement, noise = compare["residual_displacement"][n], compare["residual_displacement_noise"][n]
        known = np.isfinite(displacement).all(axis=1)
        for patch in np.flatnonzero(known):
            name = names[layer[patch]].lower() if layer[patch] >= 0 else ""
            patches.append([step, name, *compare["patch_centre"][patch], *displacement[patch], *noise[patch]])
        for number, name in enumerate(names):
            own = known & (layer == number)
            if own.any():
                length = np.linalg.norm(displacement[own], axis=1)
                ratio = np.sqrt(np.nanmean((displacement[own] / noise[own]) ** 2))
                layers.append([step, name.lower(), int(own.sum()), np.sqrt(np.mean(length**2)),
                               np.quantile(length, 0.95), length.max(), ratio])  # fmt: skip
    return patches, layers


def _candidates(ranking: list[dict[str, Any]]) -> list[list[object]]:
    """Tested effects, the best first, and the misfits of their refits."""
    rows: list[list[object]] = [
        [
            "effect",
            "predicted_fall",
            "share_of_excess",
            "misfit_refitted",
            "share_refitted",
            "error_fitted",
            "error_held_out",
        ]
    ]
    for one in ranking:
        refit = one["refit"] or {"misfit": None, "error": {"fitted": None, "held_out": None}}
        error = refit["error"]
        rows.append([one["name"], one["predicted_fall"], one["share_of_excess"], refit["misfit"],
                     refit.get("explained"), error["fitted"], error["held_out"]])  # fmt: skip
    return rows


def _cell(value: object) -> object:
    """Six digits of numbers, nothing of what is not known."""
    if value is None or (isinstance(value, float | np.floating) and not np.isfinite(value)):
        return ""
    return f"{value:.6g}" if isinstance(value, float | np.floating) else value


def _layers(mesh: Mesh, points: np.ndarray) -> np.ndarray:
    """Number of the part of a mesh that points lie in, in the reference state, shape (points,); -1 outside."""
    element = Probe(mesh, points).element
    return np.where(element >= 0, parts_of(mesh)[element], -1)
