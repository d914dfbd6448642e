"""What the steps of a deck prescribe: along the way of the indenter, beside it, and what becomes of the material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.changed import changed_by
from fingerfit.deck.questions import temperature
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.effect import ASIDE, Effect
from fingerfit.model.observation import places, unloaded
from fingerfit.study.study import AXES, Step, Study, largest_of


def direction(study: Study, dim: int) -> list[float]:
    """Unit vector of the indenter's way, shape (dim,)."""
    return list(study.direction) or [*[0.0] * (dim - 1), -1.0]


def rail(study: Study, way: Sequence[float]) -> list[tuple[int, float]]:
    """Axes from 1 along which an indenter under a given force goes aside, and how far as a share of its way down."""
    if not study.on_a_rail:
        return []
    return [(axis, part / way[-1]) for axis, part in enumerate(way[:-1], 1)]


def _aside(study: Study, step: Step | None, moved: float) -> dict[int, float]:
    """Prescribed displacements of the indenter by their axes from 1, mm; none before the first picture."""
    if study.direction and study.control == "displacement":
        return {axis: moved * part for axis, part in enumerate(study.direction[:-1], 1)}
    return {AXES.index(axis) + 1: getattr(step, f"displacement_{axis}") for axis in study.moved_sideways if step}


def _goes_aside(
    mesh: Mesh,
    aside: Mapping[int, float],
    names: Mapping[str, float],
    present: Sequence[Effect],
    values: Mapping[str, float],
) -> list[tuple[int, float]]:
    """Where the indenter goes aside at a step, mm, by axes from 1: what is prescribed, as effects change it."""
    changed = {
        axis: float(changed_by(what, aside.get(axis, 0.0), names, present, values))
        for axis, what in enumerate(ASIDE[: mesh.dim - 1], 1)
        if any(what in effect.changes for effect in present)
    }
    return sorted({**aside, **changed}.items())


def from_rest(study: Study, present: Sequence[Effect]) -> bool:
    """Whether an indenter under given displacements goes on from where a force before the first picture has left it."""
    held = study.control == "displacement" and not study.direction
    return held and any("before" in effect.changes for effect in present)


def loading_steps(
    study: Study, mesh: Mesh, present: Sequence[Effect], values: Mapping[str, float], ages: bool
) -> list[dict[str, Any]]:
    """Prescribed quantities of the deck's steps; what was before the first picture is a step of its own.

    Where a layer ages (`ageing`), temperatures count the steps.

    In that step the indenter is pushed by a force, or by none, also where displacements are prescribed afterwards: it
    then goes on from where it came to rest (`from_rest`). An indenter on its way along a direction stays where it is.
    """
    control, count = study.control, len(study.steps)
    resting = from_rest(study, present)
    largest, most = (
        largest_of([getattr(step, what) for step in study.steps]) for what in (control, "force" if resting else control)
    )
    before = float(changed_by("before", 0.0, {"largest": most}, present, values))
    begun = 0.0 if resting else before
    swelling = _swelling(study, mesh, present, values)
    # a clock, or how far the material swells; `check_layers` refuses both
    warm: list[list[tuple[int | str, float]]] = [[("ALL", float(k))] if ages else [] for k in range(count + 1)]
    if swelling.any():
        warm = [temperature(row) for row in swelling]
    steps, last = [], 0.0
    if any("before" in effect.changes for effect in present) or swelling[0].any():
        names = {**unloaded(study.course), "time": 0.0, "largest": largest, "share": 0.0}
        steps.append(
            {
                **({"force": before, "displacement": 0.0} if resting else {control: before}),
                "period": None,
                "temperature": warm[0],
                "aside": _goes_aside(mesh, _aside(study, None, begun), names, present, values),
                "deeper": _deeper(mesh, {**names, "down": 0.0}, present, values),
            }
        )
    for k, (step, known) in enumerate(zip(study.steps, study.course, strict=True), 1):
        period = None
        if step.time is not None:
            period, last = step.time - last, step.time
        entry: dict[str, Any] = {"force": step.force, "displacement": step.displacement, "period": period}
        entry["temperature"] = warm[k]
        names = {**known, "time": step.time or 0.0, "largest": largest}
        if entry[control] is not None:
            entry[control] = float(changed_by(control, entry[control], names, present, values)) + begun
        aside = _aside(study, step, entry["displacement"])
        shared = {**names, "share": abs(getattr(step, control) or 0.0) / (largest or 1.0)}
        entry["aside"] = _goes_aside(mesh, aside, shared, present, values)
        entry["deeper"] = _deeper(mesh, {**names, "down": step.displacement or 0.0}, present, values)
        steps.append(entry)
    return steps


def under_indenter(mesh: Mesh, nodes: np.ndarray) -> dict[str, np.ndarray]:
    """Names that formulas have for places of nodes as seen from the indenter's own: mm along x, and in space along y.

    In the plane `beside` is 0; shape (nodes,) each.
    """
    found = mesh.points[nodes] - mesh.points[mesh.node_sets["INDENTER"][0]]
    return {"aside": found[:, 0], "beside": found[:, 1] if mesh.dim == 3 else np.zeros(len(nodes))}


def _deeper(
    mesh: Mesh, names: Mapping[str, float], present: Sequence[Effect], values: Mapping[str, float]
) -> list[tuple[int, float]]:
    """How much deeper than its own node the indenter goes at each node under it, mm, nodes counted from 1.

    Empty where no effect changes that.
    """
    if not any("deeper" in effect.changes for effect in present):
        return []
    top, indenter = mesh.node_sets["TOP"], mesh.node_sets["INDENTER"][0]
    places: dict[str, Any] = under_indenter(mesh, np.array([indenter, *top]))
    places |= {"width": float(np.ptp(mesh.points[top, 0]))}
    found = changed_by("deeper", np.zeros(1 + len(top)), {**names, **places}, present, values)
    found = np.broadcast_to(found, 1 + len(top))
    return [(int(node) + 1, float(one)) for node, one in zip(top, found[1:] - found[0], strict=True)]


def ageing(study: Study, present: Sequence[Effect], values: Mapping[str, float]) -> np.ndarray:
    """Logarithms of a factor on the stiffness of each layer at the first picture and each step, (layers, steps + 1)."""
    layers, course = range(1, len(study.layer_names) + 1), (unloaded(study.course), *study.course)
    names = ({"number": n, "layers": layers[-1], **known} for n in layers for known in course)
    found = [float(changed_by("ageing", 0.0, own, present, values)) for own in names]
    return np.reshape(found, (len(layers), len(course)))


def course_of(logs: np.ndarray) -> list[dict[str, Any]]:
    """Factors on the stiffness of a layer, each with the temperature, as text behind the constants, that stands for its
    step; one without any where it stays as it is. Shape of `logs`: (steps + 1,).
    """
    if not logs.any():
        return [{"factor": 1.0, "at": ""}]
    return [{"factor": float(np.exp(log)), "at": f", {k}."} for k, log in enumerate(logs)]


def _swelling(study: Study, mesh: Mesh, present: Sequence[Effect], values: Mapping[str, float]) -> np.ndarray:
    """Stretches less 1 by which the material swells, shape (steps + 1, nodes): at the first picture and each step."""
    count = len(study.steps)
    if not any("swelling" in effect.changes for effect in present):
        return np.zeros((count + 1, 1))
    low, high = mesh.body.min(axis=0), mesh.body.max(axis=0)
    found = np.zeros((count + 1, len(mesh.points)))
    for k, known in enumerate((unloaded(study.course), *study.course)):
        names = {**places(mesh.points, low, high), **known}
        for effect in present:
            volume = changed_by("swelling", 0.0, names, [effect], values)
            if np.min(volume) <= -1:
                expected = "a change of volume above -1"
                raise InputError(f"effect {effect.name}", "changes.swelling", f"{np.min(volume):g}", expected)
            found[k] += np.cbrt(1 + volume) - 1
    return found
