"""What a finer mesh changes, also where it has no usable solution from some step on.

At glued corners a fine mesh lets the free side fold over the edge, or finds no equilibrium, where a coarse one does. Up
to that step both are solved, and what the finer one changes there is known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.fit.problem import FINAL, REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import Predictor, since_first_picture
from fingerfit.imaging.warp import Probe
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.study.data import Data


def on_finer_mesh(problem: InverseProblem, last: Round) -> Asked | None:
    """The last simulation of the finer mesh; it may have no solution, or one in which the body goes through itself."""
    asked = [one for one in last.batch if one.role == FINAL and problem.mesh_of(one) == REFINED]
    return asked[-1] if asked else None


def as_on_finer_mesh(problem: InverseProblem, asked: Asked, data: Data) -> Outcome | None:
    """The solution of the search mesh with what the finer one changes.

    From the step on at which the finer mesh has no usable solution, the change continues in proportion to the
    prescribed quantity.

    Parameters
    ----------
    problem : InverseProblem
        Of one test.
    asked : Asked
        On the finer mesh.
    data : Data
        Whose pictures tell whether the body goes through itself: those of the problem, or more.

    Returns
    -------
    Outcome or None
        On the nodes of the search mesh; None where it has no solution, or the finer one none at any step.
    """
    coarse, fine = problem.outcome(problem.ask(asked.values)), _reached(problem, asked)
    if coarse.status != CONVERGED or fine is None:
        return None
    usable = _usable(problem, asked, fine, data)
    if not usable:
        return None
    nodes = problem.meshes[SEARCH].points
    read = Probe(problem.meshes[REFINED], nodes).read
    moved = np.array([_filled(read(one), nodes) for one in fine.displacement[:usable]])
    size = np.abs(data.controlled)
    share = size[usable:] / size[usable - 1] if size[usable - 1] else np.zeros(len(size) - usable)

    def changed(before: np.ndarray, after: np.ndarray) -> np.ndarray:
        known = after - before[:usable]
        return before + np.concatenate([known, np.multiply.outer(share, known[-1])])

    return replace(
        coarse,
        displacement=changed(coarse.displacement, moved),
        reaction=changed(coarse.reaction, fine.reaction[:usable]),
        indenter=changed(coarse.indenter, fine.indenter[:usable]),
    )


def _reached(problem: InverseProblem, asked: Asked) -> Outcome | None:
    """The steps that the finer mesh has reached, since the first picture; None without any."""
    steps = len(problem.data.step)
    whole = problem.answer(asked.sim)
    if whole.status == CONVERGED:
        return problem.outcome(asked)
    # one that ended early does not tell whether its first step is the state of the first picture; its twin does
    twin = problem.answer(problem.ask(asked.values).sim)
    begun = twin.steps > steps
    if whole.steps <= begun:
        return None
    body = replace(whole, displacement=whole.displacement[:, : len(problem.meshes[REFINED].points)])
    return since_first_picture(body, whole.steps - begun, problem.data.outline > 0)


def _usable(problem: InverseProblem, asked: Asked, fine: Outcome, data: Data) -> int:
    """Number of steps before the first one that was not reached, or in whose picture the body goes through itself."""
    predictor, seen = Predictor(data, problem.meshes[REFINED]), problem.seen(asked.values)
    for step in data.picture_step:
        if step < fine.steps and predictor.map_at(fine, int(step), seen).folded:
            return int(step)
    return min(fine.steps, len(data.step))


def _filled(change: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values at points; those that lie outside of the finer mesh, by a curved border, have that of the nearest one."""
    from scipy.spatial import cKDTree

    known = np.isfinite(change).all(axis=1)
    if not known.all():
        nearest = cKDTree(points[known]).query(points[~known])[1]
        change = change.copy()
        change[~known] = change[known][nearest]
    return change
