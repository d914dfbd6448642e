"""What was understood of a study, for a person to read before a fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fingerfit.check.own import own_effects
from fingerfit.core.keys import read_yaml
from fingerfit.fit.check import check_data, check_effects
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.mesh.mesh import Mesh
from fingerfit.prepare.plausible import refuse_magnitudes
from fingerfit.prepare.prepare import make_mesh, prepare
from fingerfit.prepare.regions import region_lines
from fingerfit.provenance.results import study_folder
from fingerfit.provenance.runs import planned
from fingerfit.settings.config import FitSettings, MeshSettings, Settings
from fingerfit.settings.runs import settings_for
from fingerfit.study.reader import load_study, study_path
from fingerfit.study.study import SIDEWAYS, Study

if TYPE_CHECKING:
    from fingerfit.study.data import Data


@dataclass(frozen=True)
class Checked:
    """What a check has read.

    Parameters
    ----------
    path : Path
        Study, as it was named.
    study : Study
    settings : Settings or None
        None where no settings are for this study.
    source : str
        Where they are from, in words.
    mesh : Mesh
        Of the search; without settings a coarse one of the same shape.
    data : Data
        All that was measured, prepared.
    finer : Mesh or None
        Of the last steps of a fit, where there is one.
    """

    path: Path
    study: Study
    settings: Settings | None
    source: str
    mesh: Mesh
    data: Data
    finer: Mesh | None = None


def check_study(path: Path, config: Path | None = None, picture: Path | None = None, solve: bool = True) -> str:
    """Do everything that comes before the second simulation of a fit, and describe it.

    Parameters
    ----------
    path : Path
        Study.
    config : Path or None
        Settings: they give mesh, constants, template and solver. None for those in the study's folder, or else for
        config.yaml in the working directory where it names this study; where neither does, the study is checked alone.
    picture : Path or None
        Where to draw mesh, sets and points.
    solve : bool
        Whether the start of the search is simulated.

    Raises
    ------
    FingerfitError
        Listing every problem.
    """
    study = load_study(path)
    settings, where, source = settings_for(path, config)
    if settings is not None:
        planned(read_yaml(where), where, str(study_folder(settings)), whole=False)  # what a run would refuse
        check_effects(settings, study, make_mesh(study, settings.model.mesh), where)
    every = [_checked(path, test, settings, where, source) for test in study.every]
    lines = [*_study(every[0], study.title), f"settings: {source}"]
    for checked in every:
        lines += [line for remark in REMARKS for line in remark(checked)]
    if settings is not None:
        from fingerfit.check.trial import try_out

        lines += ["", *try_out(settings, [(one.study, one.mesh, one.data) for one in every], solve)]
    if picture is not None:
        from fingerfit.check.overview import figure_study
        from fingerfit.report.drawing import save

        for one in every:
            name = one.study.test
            file = picture.with_stem(f"{picture.stem}-{name}") if name else picture
            save(figure_study(one.study, one.mesh, one.data, one.finer), file)
            lines.append(f"drawn: {file}")
    return "\n".join(lines)


def _checked(path: Path, study: Study, settings: Settings | None, where: Path, source: str) -> Checked:
    """One test of a study, read and prepared."""
    finer = None
    if settings is None:
        mesh = make_mesh(study, _coarse(study))
        steps, smooth, crop = None, *(FitSettings.model_fields[name].default for name in ("smooth", "crop"))
    else:
        mesh = make_mesh(study, settings.model.mesh)
        if settings.finer(study):
            finer = make_mesh(study, settings.model.refined, finer=True)
        steps, smooth, crop = settings.fit.steps, settings.fit.smooth, settings.fit.crop
    data = prepare(study, mesh, steps, smooth, crop)
    if settings is not None:
        check_data(settings, study, data)
        refuse_magnitudes(settings, study, mesh, where)
    return Checked(path, study, settings, source, mesh, data, finer)


def _coarse(study: Study) -> MeshSettings | None:
    """A mesh that says where the body is, no more."""
    if study.body.mesh is not None:
        return None
    across, high = (20, 10) if study.body.regions else (4, 2)  # fine enough that a region of a tenth has elements
    return MeshSettings(element="C3D8" if study.body.brick else "CPE4", across=across, per_layer=high)


def _study(checked: Checked, title: str) -> list[str]:
    return [f"{study_path(checked.path)}: {title}"]


def _control(checked: Checked) -> list[str]:
    study = checked.study
    head = ["", f"test {study.test}: {study.title}"] if study.test else []
    aside = f"; direction of the indenter {', '.join(f'{x:.4g}' for x in study.direction)}" if study.direction else ""
    return [*head, f"control: {study.control}; base {study.base}, indenter {study.indenter}{aside}"]


def _body(checked: Checked) -> list[str]:
    study, mesh = checked.study, checked.mesh
    thick = f", thickness {study.thickness:g} mm" if mesh.dim == 2 else ""
    lines = [f"body: layers {', '.join(study.layer_names)} (from the indenter down){thick}"]
    if checked.settings is not None or study.body.mesh is not None:
        lines.append(f"mesh: {_size(mesh)}")
    if checked.finer is not None:
        lines.append(f"finer mesh: {_size(checked.finer)}")
    return lines + region_lines(study, [mesh for mesh in (mesh, checked.finer) if mesh is not None])


def _size(mesh: Mesh) -> str:
    return f"{len(mesh.points)} nodes, {mesh.element_count} {mesh.blocks[0].element}"


def _points(checked: Checked) -> list[str]:
    """How many points, where, and in which layers; those of a step."""
    from fingerfit.imaging.sections import parts_of
    from fingerfit.imaging.warp import Probe

    data, mesh = checked.data, checked.mesh
    if not len(data.points):
        return []
    steps, counts = np.unique(data.points_step, return_counts=True)
    first = data.points[data.points_step == steps[0]]
    part = parts_of(mesh)[Probe(mesh, first).element]
    layers = ", ".join(f"{name.lower()} {(part == n).sum()}" for n, name in enumerate(mesh.parts))
    extent = ", ".join(f"{axis} from {low:.4g} to {high:.4g}" for axis, low, high in zip(
        "xyz", first.min(axis=0), first.max(axis=0), strict=False))  # fmt: skip
    number = f"{counts[0]}" if np.ptp(counts) == 0 else f"{counts.min()} to {counts.max()}"
    return [f"points: {number} at each of {len(steps)} steps; {extent} mm; in {layers}"]


def _steps(checked: Checked) -> list[str]:
    return ["", _table(checked.study), ""]


def _noise(checked: Checked) -> list[str]:
    data = checked.data
    return [
        f"noise: force {np.max(data.force_noise):.3g} N, displacement {data.displacement_noise:.3g} mm"
        + (f", points {data.points_noise:.3g} mm" if len(data.points) else "")
    ]


def _pictures(checked: Checked) -> list[str]:
    study, data = checked.study, checked.data
    if study.before is None or not len(data.measured):
        return []
    frame = read_picture(study.before)
    size = " x ".join(map(str, frame.values.shape[::-1]))
    spacing = " x ".join(f"{s:.4g}" for s in frame.spacing)
    return [
        f"pictures: {size} pixels of {spacing} mm{_turn(frame)},"
        f" noise {100 * data.picture_noise:.2g} % of the brightest",
        "prepared, in this order:",
        *(f"  {line}" for line in data.history.splitlines()),
    ]


def _told(checked: Checked) -> list[str]:
    return [f"remark: {line}" for line in checked.data.remarks.splitlines()]


def _effects(checked: Checked) -> list[str]:
    if checked.settings is None:
        return []
    return own_effects(checked.settings, checked.study, checked.mesh)


def _identifiable(checked: Checked) -> list[str]:
    if checked.settings is None:
        return []
    pictures, kind = bool(len(checked.data.measured)), checked.settings.fit.score
    if checked.study.control == "displacement" and pictures and kind != "likelihood":
        return ["identifiable: only ratios of stiffness, since the force is prescribed nowhere and not in the score"]
    if not checked.study.body.thick:
        return ["identifiable: only stiffness times thickness, since the thickness is not known"]
    return ["identifiable: stiffness itself, since the force is prescribed or in the score"]


def _turn(frame: Picture) -> str:
    """How the axes of a picture lie in space, where they are not simply its axes."""
    if np.allclose(frame.direction, np.eye(frame.dim), atol=1e-6):
        return ""
    axes = ["(" + ", ".join(f"{x:.3g}" for x in axis) + ")" for axis in np.round(frame.direction.T, 6) + 0.0]
    return f" along {', '.join(axes)}"


def _table(study: Study) -> str:
    aside = [name for name in SIDEWAYS if any(getattr(step, name) is not None for step in study.steps)]
    units = {"displacement": "mm", "force": "N"}
    head = "".join(f"{f'{name} ' + units[name.partition('_')[0]]:>19}" for name in aside)
    rows = [f"{'step':>5}{'time s':>9}{'displacement mm':>17}{'force N':>10}{head}  picture"]
    for step in study.steps:
        values = (step.time, step.displacement, step.force, *(getattr(step, name) for name in aside))
        cells = [f"{v:.4g}" if v is not None else "-" for v in values]
        beside = "".join(f"{cell:>19}" for cell in cells[3:])
        name = step.picture.name if step.picture else "-"
        rows.append(f"{step.number:>5}{cells[0]:>9}{cells[1]:>17}{cells[2]:>10}{beside}  {name}")
    return "\n".join(rows)


REMARKS: tuple[Callable[[Checked], list[str]], ...] = (
    _control,
    _body,
    _steps,
    _noise,
    _points,
    _pictures,
    _told,
    _effects,
    _identifiable,
)
"""What is told, in this order; each may raise what makes a fit impossible."""
