"""What a finer mesh changes, also where it has no usable solution from some step on.

At glued corners a fine mesh lets the free side fold over the edge, or finds no equilibrium, where a coarse one does. Up
to that step both are solved, and what the finer one changes there is known. A side that folds may also snap through the
plate beside it, at a load that depends on the mesh: then the pictures say whether the body has done so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fingerfit.fit.problem import FINAL, REFINED, SEARCH, InverseProblem
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import Predictor, in_first_picture, positions
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.flat import is_flat
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.observation import Observation
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
    return _continued(problem, coarse, fine, data, _usable(problem, asked, coarse, fine, data))


def usable_steps(problem: InverseProblem, asked: Asked) -> int:
    """Number of steps of one test before the first one without a usable solution on the finer mesh."""
    coarse, fine = problem.outcome(problem.ask(asked.values)), _reached(problem, asked)
    if coarse.status != CONVERGED or fine is None:
        return 0
    return _usable(problem, asked, coarse, fine, problem.data)


def has_snapped(problem: InverseProblem, asked: Asked) -> bool:
    """Whether a guess on the finer mesh, which has a solution, goes through a plate in a picture as the body does not.

    At some step it does by more than a pixel, where the mesh of the search does not; and beyond the plate the picture
    of that step is nearer both to the mesh of the search and to that with what the finer one changed in the steps
    before. No body goes through a plate; but neither data nor decks that know nothing of contact beside the glued face
    need to know that.
    """
    twin = problem.ask(asked.values)
    if not problem.is_solved(twin) or problem.answer(twin.sim).status != CONVERGED:
        return False
    coarse, fine = problem.outcome(twin), problem.outcome(asked)
    steps = problem.data.picture_step
    return any(_snaps(problem, asked, coarse, fine, problem.data, n) for n in range(len(steps)))


def _continued(problem: InverseProblem, coarse: Outcome, fine: Outcome, data: Data, usable: int) -> Outcome | None:
    """The solution of the search mesh with what the finer one changes in its usable steps; None without any."""
    if not usable:
        return None
    nodes = in_first_picture(problem.meshes[SEARCH], coarse).points
    read = Probe(in_first_picture(problem.meshes[REFINED], fine), nodes).read_near
    moved = np.array([read(one) for one in fine.displacement[:usable]])
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
    return problem.seen_since(whole, asked, whole.steps - begun)


def _usable(problem: InverseProblem, asked: Asked, coarse: Outcome, fine: Outcome, data: Data) -> int:
    """Number of steps before the first one that was not reached, or that another way leads to.

    In its picture the body goes through itself, or through a plate (`has_snapped`).
    """
    predictor, seen = Predictor(data, problem.meshes[REFINED]), problem.seen(asked.values)
    for number, step in enumerate(data.picture_step):
        if step < fine.steps and (
            predictor.map_at(fine, int(step), seen).folded or _snaps(problem, asked, coarse, fine, data, number)
        ):
            return int(step)
    return min(fine.steps, len(data.step))


def _snaps(problem: InverseProblem, asked: Asked, coarse: Outcome, fine: Outcome, data: Data, number: int) -> bool:
    """Whether the finer mesh goes through a plate in a picture, by its number, as the body does not."""
    step, pixel = int(data.picture_step[number]), float(np.min(data.spacing))
    if _through(problem.meshes[REFINED], fine, step) <= pixel:
        return False
    before = _continued(problem, coarse, fine, data, step)
    if before is None or _through(problem.meshes[SEARCH], coarse, step) > pixel:
        return False
    # a guess is the best one for the mesh of the search: anywhere else its pictures say nothing of the plate
    seen, left = problem.seen(asked.values), list[float]()
    predictors = {mesh: Predictor(data, problem.meshes[mesh]) for mesh in (REFINED, SEARCH)}
    beyond = _beyond(predictors[REFINED], fine, step, seen)
    for mesh, outcome in ((REFINED, fine), (SEARCH, before), (SEARCH, coarse)):
        predictor = predictors[mesh]
        shown = predictor.picture(predictor.map_at(outcome, step, seen), step, seen)
        left.append(float(np.sum((shown - data.measured[number]).ravel()[beyond] ** 2)))
    return left[0] > max(left[1:])


def _beyond(predictor: Predictor, outcome: Outcome, step: int, seen: Observation | None) -> np.ndarray:
    """Flat indices of the pixels of a body that lie beyond its plates in the picture of a step."""
    way = predictor.map_at(outcome, step, seen)
    height = positions(predictor.frame, way.pixel)[-1]
    plates = _plates(*predictor.body_at(outcome, step, seen))
    outside = np.any([side * height > end for side, end in plates], axis=0)
    return np.asarray(way.pixel[outside & ~way.beside])


def _through(mesh: Mesh, outcome: Outcome, step: int) -> float:
    """How far a body goes through the plates at its flat base and top, mm; 0 where it does not, or has none."""
    mesh, displacement = in_first_picture(mesh, outcome), outcome.displacement[step]
    nodes = mesh.nodes_of(np.arange(mesh.element_count))
    height = mesh.points[nodes, -1] + displacement[nodes, -1]
    return max([0.0, *(float((side * height).max()) - end for side, end in _plates(mesh, displacement))])


def _plates(mesh: Mesh, displacement: np.ndarray) -> list[tuple[float, float]]:
    """The plates at a flat base and top: below (-1) or above (1) the body, and their height times that, mm."""
    found = []
    for name, side in (("BOTTOM", -1.0), ("TOP", 1.0)):
        if is_flat(mesh, name):
            nodes = mesh.node_sets[name]
            found.append((side, float((side * (mesh.points[nodes, -1] + displacement[nodes, -1])).max())))
    return found
