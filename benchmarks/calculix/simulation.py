"""A study as it is simulated: the body, its displacements, and what is read at each step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from body import Body, Material
from hidden import Effects
from mesh import Mesh, graded, row_lines
from solve import solve
from study_table import Study

SHIFT = 0.12
"""Standard deviation of an indentation from even steps, in steps."""


@dataclass
class Simulated:
    """What the body does.

    Parameters
    ----------
    first : ndarray (front nodes, 2)
        Places in the first picture, mm.
    moved : ndarray (steps, front nodes, 2)
        Displacements from there, mm.
    quads : ndarray (elements, 8)
        Front nodes of the elements that are seen.
    dark : ndarray (elements,) of bool
        Which of them are dark.
    outline : ndarray (nodes,)
        Front nodes around what is seen.
    indentation : ndarray (steps,)
        Of the indenter since the first picture, mm.
    displacement, force : ndarray (steps,)
        What is read, without noise: mm, and N in compression.
    """

    first: np.ndarray
    moved: np.ndarray
    quads: np.ndarray
    dark: np.ndarray
    outline: np.ndarray
    indentation: np.ndarray
    displacement: np.ndarray
    force: np.ndarray


def simulate(study: Study, effects: Effects) -> Simulated:
    """Simulate a study with what is hidden in it."""
    rng = study.generator("steps")
    indentation = _indentations(study, rng)
    body = body_of(study, effects, rng)
    before = effects.preload * study.height
    wanted = np.r_[before, before + indentation] if before else indentation
    moved, force = solve(body, [float(one) for one in wanted])
    force = force * study.thickness
    first = body.mesh.points
    if before:
        first = first + moved[0]
        moved, force = moved[1:] - moved[0], force[1:] - force[0]
    displacement, read = effects.response(indentation, force) if effects.response else (indentation, force)
    seen = slice(body.below * body.mesh.across, None)
    return Simulated(
        first=first,
        moved=moved,
        quads=body.mesh.quads[seen],
        dark=body.parts[seen] == body.dark,
        outline=body.mesh.outline(body.below),
        indentation=indentation,
        displacement=displacement,
        force=read,
    )


def _indentations(study: Study, rng: np.random.Generator) -> np.ndarray:
    """Indentations of the steps since the first picture (steps,), mm: about even steps."""
    count = study.steps
    shares = (np.arange(count) + 1) / count + rng.normal(0, SHIFT / count, count)
    shares[-1] = 1
    return shares * study.compression * study.height


def body_of(study: Study, effects: Effects, rng: np.random.Generator) -> Body:
    """The body without load; with a preload it is higher than study.yaml says."""
    columns, rows = graded(study.elements, study.width, study.grading), row_lines(study)
    if effects.lines:
        columns, rows = effects.lines(columns, rows)
    names = _layers(study, (rows[1:] + rows[:-1]) / 2)
    if effects.preload:
        rows = rows * (study.height + effects.preload * study.height) / study.height
    mesh = Mesh(columns, rows, effects.warp)
    materials = {layer.name: Material(layer.modulus, study.alpha, study.poisson) for layer in study.layers}
    body = Body(mesh, np.repeat(np.array(names, object), mesh.across), materials, study.base, study.indenter)
    if effects.change:
        effects.change(body, rng)
    return body


def _layers(study: Study, heights: np.ndarray) -> list[str]:
    """Names of the layers at heights (rows,) in mm; below the base it is the lowest one."""
    ends = np.cumsum([layer.height for layer in study.layers[:0:-1]])
    upwards = study.layers[::-1]
    return [upwards[int(np.searchsorted(ends, height))].name for height in heights]
