"""What the page shows, read from the results of a study; what is not there yet is left out."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, StateError
from fingerfit.core.files import digest, free_memory, read_bytes, read_json, read_npz
from fingerfit.diagnosis.residual import RESPONSE
from fingerfit.provenance.inputs import study_files
from fingerfit.settings.choices import KNOWN
from fingerfit.study.several import TESTS, array_ending, arrays_of_test

LADDER, COMPARE, DIAGNOSIS, PATTERNS = "ladder.json", "compare.npz", "diagnosis.json", "diagnosis.npz"
SETTINGS, ESTIMATE = "settings.json", "estimate.json"
UNTESTED = "untested"
"""Of a model that no measurement is left to test: of a diagnosis it is one of *unexplained*."""


def _seen(fitted: np.ndarray, index: int) -> str:
    """Of results that do not say it everything was fitted."""
    return "fitted" if index >= len(fitted) or fitted[index] else "held out"


def _empty(*shape: int, kind: type = float) -> np.ndarray:
    return np.zeros(shape, kind)


@dataclass(frozen=True)
class Compare:
    """A model beside the measurements, as in ``compare.npz``.

    Parameters
    ----------
    measured, synthesized : ndarray, shape (pictures, ny, nx)
        Intensity, 0 to 1.
    picture_step : ndarray of int, shape (pictures,)
        Index of the step of each picture in `step`.
    fitted : ndarray of bool, shape (pictures,)
        Whether the fit saw the picture; else it was held out.
    error, floor : ndarray, shape (pictures,)
        Root mean square difference of intensity, and what noise alone leaves of it.
    spacing, origin : ndarray, shape (2,)
        Of the pixels, mm; `origin` is the centre of the first one, y upwards.
    residual_displacement, residual_displacement_noise : ndarray, shape (pictures, patches, 2)
        Residual displacement and its standard error, mm; NaN where unknown.
    patch_centre : ndarray, shape (patches, 2)
        Reference positions, mm.
    patch_count : ndarray of int, shape (2,)
        Along x and y; the flat index is ``ix * ny + iy``.
    mesh_points, mesh_moved : ndarray, shape (nodes, 2) and (pictures, nodes, 2)
        Reference and deformed positions, mm.
    mesh_rings : ndarray of int, shape (elements, k)
        Outlines; negative numbers are left out.
    mesh_layer : ndarray of int, shape (elements,)
    layer_names : ndarray of str
    step : ndarray of int, shape (steps,)
    edge_moved : ndarray, shape (nodes, 4)
        Of the base (0) and of the indenter's face (1), in the plane: x before compression, and displacement, mm.
    force, displacement, force_model, displacement_model : ndarray, shape (steps,)
        N and mm; NaN where unknown.
    direction, mesh_faces, mesh_face_part, patch_layer : ndarray
        Of studies in space, where the arrays above have three dimensions: direction of the grid, triangles of the
        surfaces of the mesh and between its parts with the part of each, and the part that each patch lies in.
    edges : ndarray, shape (edges, 2, 2)
        Of the reference mesh in a slice, mm.
    axes : tuple of str
        Names of the axes of pictures.
    force_noise, displacement_noise : ndarray, shape (steps,)
        Standard deviations, N and mm.
    brightness, brightness_noise : ndarray, shape (pictures, patches)
        Residual brightness and its standard error; NaN where unknown.
    response, response_noise : ndarray, shape (steps,)
        Residual of the response, and its standard error, N or mm.
    lateral_force, lateral_force_model : ndarray, shape (steps, axes)
        Forces of the indenter across the load, N; NaN where unknown.
    control, far_off : ndarray of str, shape ()
        The quantity that is prescribed, ``force`` or ``displacement``; what is said of a force that is far off.
    step_fitted : ndarray of bool, shape (steps,)
        Whether the fit used the step.
    field_value, field_spread, field_seen : ndarray, shape (elements,)
        Of a model with stiffness as a field: change of log mu, its standard error, and the share of what was not known
        before that the data tell. No elements where it has none.
    """

    measured: np.ndarray = field(default_factory=lambda: _empty(0, 1, 1))
    synthesized: np.ndarray = field(default_factory=lambda: _empty(0, 1, 1))
    picture_step: np.ndarray = field(default_factory=lambda: _empty(0, kind=int))
    fitted: np.ndarray = field(default_factory=lambda: _empty(0, kind=bool))
    error: np.ndarray = field(default_factory=lambda: _empty(0))
    floor: np.ndarray = field(default_factory=lambda: _empty(0))
    spacing: np.ndarray = field(default_factory=lambda: np.ones(2))
    origin: np.ndarray = field(default_factory=lambda: np.zeros(2))
    residual_displacement: np.ndarray = field(default_factory=lambda: _empty(0, 0, 2))
    residual_displacement_noise: np.ndarray = field(default_factory=lambda: _empty(0, 0, 2))
    patch_centre: np.ndarray = field(default_factory=lambda: _empty(0, 2))
    patch_count: np.ndarray = field(default_factory=lambda: _empty(2, kind=int))
    mesh_points: np.ndarray = field(default_factory=lambda: _empty(0, 2))
    mesh_moved: np.ndarray = field(default_factory=lambda: _empty(0, 0, 2))
    mesh_rings: np.ndarray = field(default_factory=lambda: _empty(0, 3, kind=int))
    mesh_layer: np.ndarray = field(default_factory=lambda: _empty(0, kind=int))
    edge_moved: np.ndarray = field(default_factory=lambda: _empty(0, 4))
    layer_names: np.ndarray = field(default_factory=lambda: np.zeros(0, "U1"))
    step: np.ndarray = field(default_factory=lambda: _empty(0, kind=int))
    force: np.ndarray = field(default_factory=lambda: _empty(0))
    displacement: np.ndarray = field(default_factory=lambda: _empty(0))
    force_model: np.ndarray = field(default_factory=lambda: _empty(0))
    displacement_model: np.ndarray = field(default_factory=lambda: _empty(0))
    direction: np.ndarray = field(default_factory=lambda: _empty(0, 0))
    mesh_faces: np.ndarray = field(default_factory=lambda: _empty(0, 3, kind=int))
    mesh_face_part: np.ndarray = field(default_factory=lambda: _empty(0, kind=int))
    patch_layer: np.ndarray = field(default_factory=lambda: _empty(0, kind=int))
    edges: np.ndarray = field(default_factory=lambda: _empty(0, 2, 2))
    axes: tuple[str, str] = ("x in mm", "y in mm")
    force_noise: np.ndarray = field(default_factory=lambda: _empty(0))
    displacement_noise: np.ndarray = field(default_factory=lambda: _empty(0))
    brightness: np.ndarray = field(default_factory=lambda: _empty(0, 0))
    brightness_noise: np.ndarray = field(default_factory=lambda: _empty(0, 0))
    response: np.ndarray = field(default_factory=lambda: _empty(0))
    response_noise: np.ndarray = field(default_factory=lambda: _empty(0))
    lateral_force: np.ndarray = field(default_factory=lambda: _empty(0, 0))
    lateral_force_model: np.ndarray = field(default_factory=lambda: _empty(0, 0))
    control: np.ndarray = field(default_factory=lambda: np.array("force"))
    far_off: np.ndarray = field(default_factory=lambda: np.array(""))
    step_fitted: np.ndarray = field(default_factory=lambda: _empty(0, kind=bool))
    field_value: np.ndarray = field(default_factory=lambda: _empty(0))
    field_spread: np.ndarray = field(default_factory=lambda: _empty(0))
    field_seen: np.ndarray = field(default_factory=lambda: _empty(0))

    @property
    def response_name(self) -> tuple[str, str]:
        """Name and unit of the response."""
        return ("indentation", "mm") if str(self.control) == "force" else ("force", "N")

    @property
    def pictures(self) -> int:
        """Number of pictures."""
        return len(self.measured)

    @property
    def volumes(self) -> bool:
        """Whether the pictures are volumes."""
        return self.measured.ndim == 4

    @property
    def views(self) -> int:
        """Number of steps that can be looked at: with a picture, or without any pictures with measured points."""
        left = self.residual_displacement
        return self.pictures or (len(left) if left.ndim == 3 and left.shape[2] == 2 else 0)

    @cached_property
    def difference(self) -> np.ndarray:
        """Measured minus synthesized intensity, shape (pictures, ny, nx)."""
        return self.measured - self.synthesized

    def ratio(self, picture: int) -> float:
        """Error of a picture in multiples of the noise; NaN when one of them is unknown."""
        if picture >= min(len(self.error), len(self.floor)) or not self.floor[picture] > 0:
            return float("nan")
        return float(self.error[picture] / self.floor[picture])

    def label(self, picture: int) -> str:
        """Name of the step of a picture."""
        index = int(self.picture_step[picture]) if picture < len(self.picture_step) else picture
        return f"step {int(self.step[index]) if 0 <= index < len(self.step) else index + 1}"

    def seen(self, picture: int) -> str:
        """Whether a picture was fitted or held out."""
        return _seen(self.fitted, picture)

    def seen_step(self, index: int) -> str:
        """Whether a step was fitted or held out."""
        return _seen(self.step_fitted, index)

    @property
    def limits(self) -> tuple[float, float, float, float]:
        """Borders of the pictures in mm: left, right, bottom, top."""
        ny, nx = self.measured.shape[1:]
        x, y = self.origin - self.spacing / 2
        return float(x), float(x + nx * self.spacing[0]), float(y), float(y + ny * self.spacing[1])

    @property
    def mapped(self) -> bool:
        """Whether there is a residual displacement to draw."""
        shape = (self.views, int(np.prod(self.patch_count)), 3 if self.volumes else 2)
        return self.residual_displacement.shape == shape and len(self.patch_centre) == shape[1] > 0 and self.views > 0

    @property
    def meshed(self) -> bool:
        """Whether there is a deformed mesh for each picture."""
        return len(self.mesh_rings) > 0 and self.mesh_moved.shape == (self.views, len(self.mesh_points), 2)


def read_compare(path: Path, test: str = "") -> Compare:
    """Read ``compare.npz``, of a study with several tests one of them.

    Raises
    ------
    StateError
        When it is damaged, or pictures do not belong together.
    """
    data = arrays_of_test(read_npz(path), test)
    known: dict[str, Any] = {name: data[name] for name in Compare.__dataclass_fields__ if name in data}
    for name in ("force_noise", "displacement_noise"):  # one for all steps, or one for each
        known[name] = np.broadcast_to(known.get(name, 0.0), np.shape(known.get("step", ()))).astype(float)
    for name in ("response", "response_noise"):  # not known of results without them
        steps = np.shape(known.get("step", ()))
        if np.shape(known.get(name, 0.0)) != steps:
            known[name] = np.full(steps, np.nan)
    if "layer_names" in known:
        known["layer_names"] = np.char.lower(known["layer_names"].astype(str))
    for name in ("measured", "synthesized"):  # without pictures there is nothing to show, in any dimension
        if name in known and not known[name].size:
            known[name] = _empty(0, 1, 1)
    found = Compare(**known)
    if found.measured.ndim not in (3, 4) or found.measured.shape != found.synthesized.shape:
        raise StateError(
            f"{path}: measured has the shape {found.measured.shape}, synthesized {found.synthesized.shape}:"
            " expected both as (pictures, ny, nx) or (pictures, nz, ny, nx)"
        )
    return found


@dataclass(frozen=True)
class Model:
    """A rung: a model with what is known of it.

    Parameters
    ----------
    name : str
    rung : dict
        Its entry of ``ladder.json``, empty when there is none.
    compare : Compare or None
    diagnosis : dict
        As in ``diagnosis.json``, empty when there is none.
    patterns : dict of (str, ndarray)
        What effects explain, the named ones first: by its name, the part of the residual in which it is shown
        (``residual_displacement``, ``brightness`` or ``response``), and its values, shaped like those of `compare`.
    stiffness : ndarray, shape (places, dim + 2)
        Position in mm, predicted change of log mu, and the evidence for it in standard deviations.
    settings : dict
        As the workflow wrote them, empty when they are not there.
    solver : dict
        Identity of the solver of the estimate, empty when it is not known.
    test : str
        Which test of the study it is compared with, where there are several.
    """

    name: str
    rung: dict[str, Any]
    compare: Compare | None
    diagnosis: dict[str, Any]
    patterns: dict[str, tuple[str, np.ndarray]]
    stiffness: np.ndarray = field(default_factory=lambda: _empty(0, 4))
    settings: dict[str, Any] = field(default_factory=dict)
    solver: dict[str, Any] = field(default_factory=dict)
    test: str = ""

    @property
    def verdict(self) -> str:
        """One of missing, indistinguishable, adequate, unexplained, untested; empty before the diagnosis."""
        found = str(self.diagnosis.get("verdict") or self.rung.get("verdict") or "")
        freedom = self.diagnosis.get("freedom", self.rung.get("freedom"))
        # as many constants as measured values: nothing is left to tell a wrong model by
        return UNTESTED if found == "unexplained" and freedom is not None and freedom < 1 else found

    @property
    def sentence(self) -> str:
        """The verdict in a sentence."""
        return str(self.diagnosis.get("sentence") or self.rung.get("sentence") or "")

    @property
    def error(self) -> dict[str, float | None]:
        """Error in multiples of the noise, of the fitted and of the held-out pictures."""
        known = self.rung.get("error") or {}
        found = {part: known.get(part) for part in ("fitted", "held_out")}
        if found["fitted"] is None and self.compare is not None:
            for part, chosen in (("fitted", "fitted"), ("held_out", "held out")):
                own = [n for n in range(self.compare.views) if self.compare.seen(n) == chosen]
                ratio = np.array([self.compare.ratio(n) for n in own])
                if len(ratio) and np.isfinite(ratio).all():
                    found[part] = float(np.sqrt(np.mean(ratio**2)))
        return found


@dataclass(frozen=True)
class Inputs:
    """All that the page shows.

    Parameters
    ----------
    study : str
    ladder : dict
        As in ``ladder.json``, without rungs when it is not there.
    models : list of Model
        From the first rung to the last.
    files : list of (name, fingerprint)
        What was read.
    others : list of list of Model
        The same models beside the other tests of a study with several; `models` are beside the first.
    profiles : list of dict
        Of constants of the last model, as in ``profile_NAME.json``, made with its settings.
    """

    study: str
    ladder: dict[str, Any]
    models: list[Model]
    files: list[tuple[str, str]]
    others: list[list[Model]] = field(default_factory=list)
    profiles: list[dict[str, Any]] = field(default_factory=list)


def read_inputs(study: Path) -> Inputs:
    """Read the results of a study.

    Parameters
    ----------
    study : Path
        ``results/{study}``.

    Raises
    ------
    StateError
        When nothing is there, or a file is damaged.
    """
    study = Path(study)
    ladder = _json(study / LADDER)
    if not isinstance(ladder, dict):
        raise StateError(f"{study / LADDER}: cannot be read: not a mapping")
    if not all(isinstance(one, dict) and "model" in one for key in ("rungs", "others") for one in ladder.get(key, [])):
        raise StateError(f"{study / LADDER}: cannot be read: a rung without a model")
    rungs = {str(rung["model"]): rung for rung in ladder.get("rungs", [])}
    there = {path.parent.name for name in (COMPARE, DIAGNOSIS) for path in study.glob(f"*/{name}")}
    there -= {str(other["model"]) for other in ladder.get("others", [])}  # of side branches and other settings
    names = [*rungs, *sorted(there - set(rungs), key=lambda name: (name.count("+"), name))]
    if not names:
        raise StateError(f"{study}: no model was compared with the measurements yet")
    models, *others = [
        [_model(study / name, name, rungs.get(name, {}), test) for name in names] for test in _tests(study, names)
    ]
    parts = [
        LADDER,
        *(f"{name}/{part}" for name in names for part in (SETTINGS, ESTIMATE, COMPARE, DIAGNOSIS, PATTERNS)),
    ]
    files = [(part, digest((study / part).read_bytes())) for part in parts if (study / part).exists()]
    files += [(name, digest(read_bytes(path, limit=free_memory()))) for name, path in _study_files(models).items()]
    drawn = [read_json(path) for path in sorted(study.glob(f"{names[-1]}/profile_*.json"))]
    made = rungs.get(names[-1], {}).get("made_with")
    drawn = [one for one in drawn if one["made_with"] == made]
    return Inputs(str(ladder.get("study") or study.name), ladder, models, files, others, drawn)


def _tests(study: Path, names: list[str]) -> list[str]:
    """Names of the tests that models were compared with; one that is empty for a study with one."""
    for name in names:
        if (study / name / COMPARE).exists():
            return [str(test) for test in read_npz(study / name / COMPARE).get(TESTS, [""])]
    return [""]


def _model(folder: Path, name: str, rung: dict[str, Any], test: str) -> Model:
    compare = read_compare(folder / COMPARE, test) if (folder / COMPARE).exists() else None
    diagnosis = _json(folder / DIAGNOSIS)
    arrays = read_npz(folder / PATTERNS) if (folder / PATTERNS).exists() else {}
    patterns = {}
    shows = {str(entry.get("effect")): str(entry.get("shows")) for entry in diagnosis.get("ranking") or []}
    for effect in diagnosis.get("patterns") or []:
        part = shows.get(effect, "")
        values = arrays.get(f"{part}_{effect}{array_ending(test)}")
        known = compare is not None and (compare.mapped or part == RESPONSE)
        if known and values is not None and values.shape == getattr(compare, part).shape:
            patterns[str(effect)] = (part, values)
    stiffness = arrays.get("stiffness", _empty(0, 4))
    file = folder.parent / "sims" / str(_json(folder / ESTIMATE).get("sim")) / "solver.json"
    solver = read_json(file, kept=False) if file.exists() else {}
    settings = {key: value for key, value in _json(folder / SETTINGS).items() if key != KNOWN}
    return Model(name, rung, compare, diagnosis, patterns, stiffness, settings, solver, test)


def _json(path: Path) -> Any:
    """What a file says, empty when it is not there."""
    return read_json(path) if path.exists() else {}


def _study_files(models: list[Model]) -> dict[str, Path]:
    """Files of the study that the models were fitted to, where they still are, by name with that of its folder."""
    found: dict[str, Path] = {}
    for folder in dict.fromkeys(Path(m.settings["study"]) for m in models if m.settings.get("study")):
        with contextlib.suppress(FingerfitError):  # a study that has gone, or is not what it was
            for file in map(Path, study_files(folder)):
                inside = file.is_relative_to(folder.parent)
                found[str(file.relative_to(folder.parent) if inside else file)] = file
    return found
