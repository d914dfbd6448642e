"""Whether the numbers of a study can belong to its body: how deep, which way, and how stiff it would have to be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError, Problems
from fingerfit.core.units import UNITS
from fingerfit.imaging.content import surely
from fingerfit.mesh.mesh import Mesh
from fingerfit.settings.config import CONFIG, Settings
from fingerfit.study.data import Data
from fingerfit.study.study import Study

SLIP = min(
    large / small for kind in ("length", "force") for small in UNITS[kind].values() for large in UNITS[kind].values()
    if large > small
)  # fmt: skip
"""Smallest ratio of two units that a study may name: a slip of units is at least as large. What a simple formula leaves
out (large strain, compressibility, a face that slips) is smaller: together a factor of two or three."""
HEIGHT = "the height of the body"


def too_deep(
    moved: Mapping[int, float], height: float, what: str, where: Path | str, field: str
) -> list[FingerfitError]:
    """Problems of displacements (mm, by the number of their step) that leave nothing of a body (mm)."""
    return [
        InputError(where, field, f"step {number}: displacement {d:.6g} mm", f"less than {height:.6g} mm, {what}")
        for number, d in moved.items()
        if d >= height
    ]


def refuse_depth(study: Study, mesh: Mesh, field: str = "steps") -> None:
    """Refuse displacements that leave nothing of the body; `field` is named in errors.

    Raises
    ------
    Problems
        With one line for each step. Of a mesh of the user's, whose loading may have any direction, the largest extent
        counts.
    """
    sizes = np.ptp(mesh.body, axis=0)
    own = study.body.mesh is not None
    height, what = (float(sizes.max()), "the largest extent of the body") if own else (float(sizes[-1]), HEIGHT)
    down = -study.direction[-1] if study.direction else 1.0
    moved = {step.number: down * step.displacement for step in study.steps if step.displacement is not None}
    problems = too_deep(moved, height, what, study.path, field)
    if problems:
        raise Problems(problems)


def needed_modulus(study: Study, sizes: np.ndarray, force: float, displacement: float) -> float:
    """Shear modulus in MPa that joins a force and a displacement, roughly.

    A flat face on a block of width w and height h needs the force F = c mu A d / h, with c = 3 in space and 4 in plane
    strain, and (1 + 2 S^2) or (1 + S^2) times that where it is glued, S being the pressed over the free area (Gent and
    Lindley 1959, Proc. Inst. Mech. Eng. 173).

    Parameters
    ----------
    study : Study
    sizes : ndarray, shape (dim,)
        Extents of the body, mm; the last one is along the load.
    force, displacement : float
        N and mm, above 0.
    """
    *across, height = map(float, sizes)
    if len(sizes) == 2:
        area, factor, shape = across[0] * study.thickness, 4.0, (across[0] / (2 * height)) ** 2
    else:
        area, factor = across[0] * across[1], 3.0
        shape = 2 * (area / (2 * sum(across) * height)) ** 2
    if study.indenter == "glued" and study.base == "held":
        factor *= 1 + shape
    return force / area / (displacement / height) / factor


def refuse_magnitudes(settings: Settings, study: Study, mesh: Mesh, where: Path | str = CONFIG) -> None:
    """Refuse forces and displacements that no shear modulus near the bounds could join, by the largest of both.

    A body of the user's mesh may be pressed on a part of its face only, and needs a higher modulus then: so small
    forces are not held against it.

    Raises
    ------
    InputError
        When the modulus is further outside the bounds than the smallest slip of units, with the numbers.
    """
    force, moved = (
        max((getattr(s, name) or 0.0 for s in study.steps), default=0.0) for name in ("force", "displacement")
    )
    bounds = list(_bounds(settings, study))
    if not force or not moved or not bounds or not study.body.thick:
        return
    needed = needed_modulus(study, np.ptp(mesh.body, axis=0), force, moved)
    low, high = min(low for low, _ in bounds), max(high for _, high in bounds)
    whole = study.body.mesh is None
    if needed > SLIP * high or (whole and needed < low / SLIP):
        side, bound = ("end at", high) if needed > high else ("begin at", low)
        found = f"up to {force:.4g} N and {moved:.4g} mm, for which mu would be about {needed:.2g} MPa"
        expected = f"forces and displacements for bounds that {side} {bound:g} MPa ({where})"
        expected += f"; look at units.force, units.length and {study.table.name if study.table else 'the steps'}"
        raise InputError(study.path, "steps", found, expected)


def _bounds(settings: Settings, study: Study) -> Iterator[tuple[float, float]]:
    """Lowest and highest shear modulus of each layer, MPa."""
    model = settings.model
    for layer in study.layer_names:
        for name in (f"mu_{layer}", "mu"):
            if name in model.parameters:
                yield model.parameters[name].lower, model.parameters[name].upper
                break
            if name in model.material:
                yield model.material[name], model.material[name]
                break


def falls(data: Data) -> list[str]:
    """Steps over which the force falls while the displacement grows, or the other way round, by more than noise.

    A body that relaxes or softens may do that: so it is a remark, not an error. Where a noise is not known, any fall
    is told.
    """
    name, _ = data.response_name(0)
    response, spread = (data.split(values)[0] for values in data.response)
    controlled = data.controlled
    steps = np.flatnonzero(np.isfinite(response) & np.isfinite(controlled))
    sure = surely(len(steps) - 1)
    units = {"force": "N", "displacement": "mm"}
    found = []
    for last, step in pairwise(steps):
        more, gained = controlled[step] - controlled[last], response[step] - response[last]
        error = float(np.hypot(spread[step], spread[last]))
        own = float(np.hypot(data.control_noise[step], data.control_noise[last]))
        if more * gained < 0 and abs(gained) > sure * error and abs(more) > sure * own:
            which = "falls" if gained < 0 else "grows"
            other = "grows" if more > 0 else "falls"
            found.append(
                f"step {data.step[step]}: {name} {which} from {response[last]:.4g} to {response[step]:.4g}"
                f" {units[name]} (noise {spread[step]:.2g} {units[name]}) while {data.control} {other} from"
                f" {controlled[last]:.4g} to {controlled[step]:.4g} {units[data.control]}:"
                " a slip, or a body that relaxes or softens"
            )
    return found
