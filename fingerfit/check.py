"""What was understood of a study, for a person to read before a fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fingerfit.effects.catalogue import catalogue
from fingerfit.effects.contract import Effect
from fingerfit.effects.observe import Observation
from fingerfit.effects.sense import unmet
from fingerfit.errors import FingerfitError, InputError, Problems
from fingerfit.imaging.pictures import Picture, read_picture
from fingerfit.mesh import Mesh
from fingerfit.prepare import make_mesh, prepare
from fingerfit.settings import Settings, load_settings
from fingerfit.settings_check import changes_the_deck, check_against_study, check_effects
from fingerfit.study import Study
from fingerfit.study_file import load_study, study_path


def check_study(path: Path, config: Path, picture: Path | None) -> str:
    """Read everything a fit would read, and describe it.

    Parameters
    ----------
    path : Path
        Study.
    config : Path
        Settings: they give the mesh and the constants.
    picture : Path or None
        Where to draw the mesh over the picture before compression.

    Raises
    ------
    FingerfitError
        Listing every problem.
    """
    study = load_study(path)
    settings = load_settings(config)
    check_against_study(settings, study, config)
    mesh = make_mesh(study, settings.model.mesh)
    if settings.model.refined is not None or study.body.refined is not None:
        make_mesh(study, settings.model.refined, finer=True)
    check_effects(settings, study, mesh, config)
    data = prepare(study, mesh, settings.fit.steps, settings.fit.smooth, settings.fit.crop)
    lines = [
        f"{study_path(path)}: {study.title}",
        f"control: {study.control}; base {study.base}, indenter {study.indenter}",
        f"body: layers {', '.join(study.layer_names)} (from the indenter down)"
        + (f", thickness {study.thickness:g} mm" if mesh.dim == 2 else ""),
        f"mesh: {len(mesh.points)} nodes, {mesh.element_count} {mesh.blocks[0].element}",
        "",
        _table(study),
        "",
        f"noise: force {np.max(data.force_noise):.3g} N, displacement {data.displacement_noise:.3g} mm,"
        f" points {data.points_noise:.3g} mm",
    ]
    if study.before is not None and len(data.measured):
        frame = read_picture(study.before)
        size = " x ".join(map(str, frame.values.shape[::-1]))
        spacing = " x ".join(f"{s:.4g}" for s in frame.spacing)
        lines.append(
            f"pictures: {size} pixels of {spacing} mm{_turn(frame)},"
            f" noise {100 * data.picture_noise:.2g} % of the brightest"
        )
        lines += ["prepared, in this order:", *(f"  {line}" for line in data.history.splitlines())]
    lines += own_effects(settings, study, mesh)
    lines.append(_identifiable(study, bool(len(data.measured)), settings.fit.score))
    if picture is not None and len(data.measured):
        from fingerfit.plots import extent, figure_overlay, save
        from fingerfit.volumes import figure_place, frame_of

        plane = mesh.dim == 2
        save(figure_overlay(mesh, data.before, extent(data)) if plane else figure_place(mesh, frame_of(data)), picture)
        lines.append(f"mesh over picture: {picture}")
    return "\n".join(lines)


def own_effects(settings: Settings, study: Study, mesh: Mesh) -> list[str]:
    """A line for each effect of the study's own folder, after its formulas and its part were tried at a small size.

    Raises
    ------
    Problems
        With one line for each that cannot be read, or whose formulas or part name what is not there.
    """
    folder = Path(settings.study) / "effects"
    known = catalogue(Path(settings.study))
    problems: list[FingerfitError] = [
        InputError(part, "file", "no .yaml beside it", f"{name}, or no such part")
        for part in sorted(folder.glob("*.inp.j2"))
        if not (folder / (name := f"{part.name.removesuffix('.inp.j2')}.yaml")).exists()
    ]
    lines = []
    for path in sorted(folder.glob("*.yaml")):
        effect = known[path.stem]
        lacking = unmet(effect, study, mesh.dim)
        try:
            use = (
                f"needs {' and '.join(lacking)}: not tested here" if lacking else _tried(settings, study, mesh, effect)
            )
        except InputError as error:
            own = error.where == f"effect {effect.name}"
            problems.append(InputError(path, error.field, error.found, error.expected) if own else error)
        else:
            lines.append(f"effect {effect.name}: {effect.title}; {use}")
    if problems:
        raise Problems(problems)
    return lines


def _tried(settings: Settings, study: Study, mesh: Mesh, effect: Effect) -> str:
    """What an effect at the size of a first look changes."""
    sizes = {effect.key(p.name): p.null + p.step for p in effect.parameters}
    values = {**settings.starts(), **effect.places()[0], **sizes}
    found = []
    if changes_the_deck(settings, study, mesh, effect):
        found.append("the deck")
    seen = Observation.of([effect], values, mesh.body, len(study.steps))
    if seen is not None:
        seen.shift(1)
        seen.intensity(np.zeros(1), 1, *mesh.body[:1].T)
        for name in ("force", "displacement"):
            seen.conjugate(np.zeros(len(study.steps)), name)
        found.append(", ".join(effect.observes))
    return f"changes {' and '.join(found)}" if found else "changes nothing in this study: not tested here"


def _turn(frame: Picture) -> str:
    """How the axes of a picture lie in space, where they are not simply its axes."""
    if np.allclose(frame.direction, np.eye(frame.dim), atol=1e-6):
        return ""
    axes = ["(" + ", ".join(f"{x:.3g}" for x in axis) + ")" for axis in np.round(frame.direction.T, 6) + 0.0]
    return f" along {', '.join(axes)}"


def _table(study: Study) -> str:
    rows = [f"{'step':>5}{'time s':>9}{'displacement mm':>17}{'force N':>10}  picture"]
    for step in study.steps:
        cells = [f"{v:.4g}" if v is not None else "-" for v in (step.time, step.displacement, step.force)]
        name = step.picture.name if step.picture else "-"
        rows.append(f"{step.number:>5}{cells[0]:>9}{cells[1]:>17}{cells[2]:>10}  {name}")
    return "\n".join(rows)


def _identifiable(study: Study, pictures: bool, kind: str) -> str:
    if study.control == "displacement" and pictures and kind != "likelihood":
        return "identifiable: only ratios of stiffness, since the force is prescribed nowhere and not in the score"
    return "identifiable: stiffness itself, since the force is prescribed or in the score"
