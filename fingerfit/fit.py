"""The rounds of a fit: score what was simulated, ask the search, render the decks of the next guesses.

A search on a coarse mesh is followed by a correction: at its best guess the body is solved on the finer mesh once,
and the slopes of the coarse mesh say how far the constants have to move for the pictures of the finer mesh to
fit best (docs/decisions/0003-two-meshes.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.data import Data
from fingerfit.deck.render import deck_context, render_deck
from fingerfit.errors import StateError
from fingerfit.estimate import STEP, LinearModel, coordinates, moved, sensitivity_values
from fingerfit.files import digest
from fingerfit.imaging.warp import Probe
from fingerfit.mesh import Mesh
from fingerfit.mesh_io import read_mesh
from fingerfit.predict import Predictor
from fingerfit.rounds import Asked, Round, simulation_name
from fingerfit.score import Prediction, score
from fingerfit.search import Evaluation, propose
from fingerfit.settings import Settings
from fingerfit.solvers.contract import CONVERGED, Outcome
from fingerfit.solvers.registry import get_solver
from fingerfit.study import Study
from fingerfit.study_file import load_study, with_gain

TEMPLATES = Path(__file__).resolve().parent.parent / "templates"
SEARCH, SENSITIVITY, REFINED = "search", "sensitivity", "refined"


@dataclass(frozen=True)
class Fit:
    """Everything a round needs.

    Parameters
    ----------
    settings : Settings
    data : Data
        Measurements, prepared.
    mesh_files : dict
        ``search`` and, where there is one, ``refined``.
    sims : Path
        Folder of the simulations.
    """

    settings: Settings
    data: Data
    mesh_files: dict[str, Path]
    sims: Path

    @cached_property
    def study(self) -> Study:
        """The study."""
        return load_study(Path(self.settings.study))

    @cached_property
    def solver(self) -> dict[str, Any]:
        """Identity of the solver."""
        return get_solver(self.settings.solver).identity()

    @cached_property
    def meshes(self) -> dict[str, Mesh]:
        """The meshes."""
        return {name: read_mesh(path) for name, path in self.mesh_files.items()}

    @cached_property
    def mesh_names(self) -> dict[str, str]:
        """Hashes of the mesh files."""
        return {name: digest(path.read_bytes()) for name, path in self.mesh_files.items()}

    def predictor(self, mesh: str) -> Predictor:
        """Predictor of solutions on a mesh."""
        return Predictor(self.data, self.meshes[mesh])

    def ask(self, values: Mapping[str, float], role: str = SEARCH, gain: float = 1.0) -> Asked:
        """Deck and name of the simulation of a guess; `gain` multiplies the prescribed quantity."""
        mesh = REFINED if role == REFINED else SEARCH
        context = deck_context(
            with_gain(self.study, gain),
            self.meshes[mesh],
            f"../../meshes/{self.mesh_names[mesh]}.inp",
            dict(values),
            self.settings.model.material,
        )
        folders = [Path(self.settings.study), TEMPLATES]
        deck = render_deck(self.settings.model.template, context, folders)
        return Asked(dict(values), simulation_name(deck, self.solver), self.mesh_names[mesh], deck, role)

    def outcome(self, asked: Asked) -> Outcome:
        """Solution of a guess."""
        return Outcome.load(self.sims / asked.sim / "solution.npz")

    def prediction(self, asked: Asked) -> Prediction:
        """Prediction of a guess that must have a solution."""
        mesh = REFINED if asked.role == REFINED else SEARCH
        predicted = self.predictor(mesh).predict(self.outcome(asked))
        if predicted is None:
            raise StateError(f"{self.sims / asked.sim}: no solution beside the best guess ({asked.role})")
        return predicted[0]

    def score(self, prediction: Prediction) -> float:
        """Score of a prediction."""
        return score(self.settings.fit.score, prediction, self.data, self.settings.fit.bins)


def next_round(fit: Fit, last: Round | None) -> Round:
    """Score the batch of the last round and ask for the next guesses, or say stop.

    Parameters
    ----------
    fit : Fit
    last : Round or None
        The round before; None for the first.
    """
    if last is not None and last.stage == SENSITIVITY:
        return _refine(fit, last)
    parameters = fit.settings.parameters()
    names = [parameter.name for parameter in parameters]
    history = list(last.history) if last else []
    if last:
        predictor = fit.predictor(SEARCH)
        history += [_evaluate(fit, asked, predictor) for asked in last.batch]
    evaluations = [Evaluation(tuple(e["values"][n] for n in names), e["score"]) for e in history]
    proposal = propose(evaluations, parameters, fit.settings.plan())
    scored = [e for e in history if e["score"] is not None]
    best = min(scored, key=lambda e: e["score"]) if scored else None
    base: dict[str, Any] = {
        "number": last.number + 1 if last else 0,
        "solver": fit.solver,
        "meshes": {fit.mesh_names[name]: path.name for name, path in fit.mesh_files.items()},
        "history": history,
        "best": best,
    }
    if proposal.stop is None:
        batch = [fit.ask(dict(zip(names, point, strict=True))) for point in proposal.batch]
        return Round(stage=proposal.stage, stop=None, batch=batch, **base)
    if best is None:
        return Round(stage=proposal.stage, stop="no guess has a solution", **base)
    batch = [fit.ask(values, role) for role, values in sensitivity_values(parameters, best["values"]).items()]
    batch += [
        fit.ask(best["values"], "+control", 1.0 + STEP),
        fit.ask(best["values"], "-control", 1.0 - STEP),
    ]
    if REFINED not in fit.mesh_files:
        return Round(stage=SENSITIVITY, stop=proposal.stop, batch=batch, **base)
    # the costly one first: it runs beside the others
    batch.insert(0, fit.ask(best["values"], REFINED))
    return Round(stage=SENSITIVITY, stop=None, batch=batch, reason=proposal.stop, **base)


def _refine(fit: Fit, last: Round) -> Round:
    """Take the coarse mesh's error off the best guess, and ask for the finer mesh there."""
    if last.best is None:
        raise StateError("the search has no best guess to refine")
    values = without_mesh_error(fit, last)
    return Round(
        number=last.number + 1,
        stage=REFINED,
        stop=last.reason,
        solver=last.solver,
        meshes=last.meshes,
        history=last.history,
        batch=[*last.batch, fit.ask(values, REFINED)],
        best=last.best,
    )


def without_mesh_error(fit: Fit, last: Round) -> dict[str, float]:
    """The best guess of the search mesh, corrected for that mesh's own error.

    The search mesh at the constants c fits the data; the finer mesh at d gives other displacements than the
    search mesh at d. The shift e that makes the search mesh give the finer mesh's displacements follows from the
    slopes of the search mesh, and d = c - e makes the finer mesh fit the data (space mapping, Bandler et al.
    1994). No noise enters: both sides are computed.
    """
    parameters = fit.settings.parameters()
    if last.best is None:
        raise StateError("the search found no guess with a solution")
    best = last.best["values"]
    by_role = {asked.role: asked for asked in last.batch}
    grid = _grid(fit.meshes[SEARCH])
    probes = {name: Probe(mesh, grid) for name, mesh in fit.meshes.items()}

    def response(asked: Asked) -> np.ndarray:
        return _response(fit, fit.outcome(asked), probes[REFINED if asked.role == REFINED else SEARCH])

    slopes = np.array(
        [(response(by_role["+" + p.name]) - response(by_role["-" + p.name])) / (2 * STEP) for p in parameters]
    ).T
    finer = refined_guess(fit, last)
    if finer is None:
        return dict(best)
    at = coordinates(parameters, finer.values) - coordinates(parameters, best)
    gap = response(finer) - response(fit.ask(best)) - slopes @ at
    error = np.linalg.lstsq(slopes, gap, rcond=1e-6)[0]
    return moved(parameters, best, -error)


def refined_guess(fit: Fit, last: Round) -> Asked | None:
    """The last guess that was solved on the finer mesh; None where there is none with a solution."""
    found = None
    for asked in last.batch:
        path = fit.sims / asked.sim / "solution.npz"
        if asked.role == REFINED and path.exists() and Outcome.load(path).status == CONVERGED:
            found = asked
    return found


def _grid(mesh: Mesh, count: int = 24) -> np.ndarray:
    """Even grid of points over the box around a mesh, shape (points, dim): as even as the pixels are."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    share = (np.arange(count) + 0.5) / count
    axes = np.meshgrid(*[low[k] + share * (high[k] - low[k]) for k in range(mesh.dim)], indexing="ij")
    return np.stack([axis.ravel() for axis in axes], axis=1)


def _response(fit: Fit, outcome: Outcome, probe: Probe) -> np.ndarray:
    """Displacements of material points at the compared steps, flat; without pictures the conjugate quantity."""
    if outcome.status != CONVERGED:
        raise StateError(f"no solution beside the best guess: {outcome.message}")
    data = fit.data
    if not len(data.picture_step):
        return (outcome.indenter if data.control == "force" else outcome.reaction)[:, -1]
    found = np.array([probe.read(outcome.displacement[step]) for step in data.picture_step])
    return found[np.isfinite(found)]


def linear_model(fit: Fit, last: Round) -> LinearModel:
    """Prediction near the best guess: slopes of the search mesh, base of the finest solution there is."""
    parameters = fit.settings.parameters()
    by_role = {asked.role: asked for asked in last.batch}

    def slope(name: str, width: float) -> Prediction:
        ahead, behind = fit.prediction(by_role["+" + name]), fit.prediction(by_role["-" + name])
        return (ahead - behind) * (1 / (2 * width))

    slopes = tuple(slope(parameter.name, STEP) for parameter in parameters)
    control = slope("control", STEP)
    refined = refined_guess(fit, last)
    if refined is not None:
        return LinearModel(fit.prediction(refined), slopes, control, refined.values)
    if last.best is None:
        raise StateError("the search found no guess with a solution")
    best = fit.ask(last.best["values"])
    return LinearModel(fit.prediction(best), slopes, control, last.best["values"])


def _evaluate(fit: Fit, asked: Asked, predictor: Predictor) -> dict[str, Any]:
    """Score one simulated guess: its entry of the history."""
    outcome = fit.outcome(asked)
    predicted = predictor.predict(outcome)
    entry: dict[str, Any] = {"values": asked.values, "sim": asked.sim, "score": None}
    if predicted is None:
        return {**entry, "message": outcome.message}
    prediction, faults = predicted
    entry = {**entry, "score": fit.score(prediction), "message": ""}
    if faults.inverted or faults.overlaps:
        entry["message"] = f"{faults.inverted} inverted elements, {faults.overlaps} pixels claimed twice"
    return entry


def correction(fit: Fit, last: Round, values: Mapping[str, float]) -> dict[str, float]:
    """How far the finer mesh moved each constant, as a logarithm or in its unit."""
    parameters = fit.settings.parameters()
    if last.best is None:
        return {}
    change = coordinates(parameters, values) - coordinates(parameters, last.best["values"])
    return {p.name: float(c) for p, c in zip(parameters, np.asarray(change), strict=True)}
