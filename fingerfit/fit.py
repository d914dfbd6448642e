"""The rounds of a fit: score what was simulated, ask the search, render the decks of the next guesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from fingerfit.data import Data
from fingerfit.deck.render import deck_context, render_deck
from fingerfit.estimate import STEP, sensitivity_values
from fingerfit.files import digest
from fingerfit.layout import TEMPLATES
from fingerfit.mesh import Mesh
from fingerfit.predict import Predictor
from fingerfit.rounds import Asked, Round, simulation_name
from fingerfit.score import score
from fingerfit.search import Evaluation, propose
from fingerfit.settings import Settings
from fingerfit.solvers.contract import Outcome
from fingerfit.solvers.registry import get_solver
from fingerfit.study import Study, load_study


class Renderer:
    """Renders the deck of a guess.

    Parameters
    ----------
    settings : Settings
        Names the template and the fixed constants.
    study : Study
        What was prescribed and how the body is held.
    mesh_file : Path
        The deck includes it by the hash of its content.
    """

    def __init__(self, settings: Settings, study: Study, mesh_file: Path) -> None:
        self.settings, self.study = settings, study
        self.mesh = digest(mesh_file.read_bytes())
        self.solver = get_solver(settings.solver).identity()

    def ask(self, values: Mapping[str, float], role: str = "search", gain: float = 1.0) -> Asked:
        """Deck and name of the simulation of a guess; `gain` multiplies the prescribed quantity."""
        steps = tuple(
            replace(step, **{self.study.control: getattr(step, self.study.control) * gain})
            for step in self.study.steps
        )
        context = deck_context(
            replace(self.study, steps=steps),
            f"../../meshes/{self.mesh}.inp",
            dict(values),
            self.settings.model.material,
        )
        folders = [Path(self.settings.study), TEMPLATES]
        deck = render_deck(self.settings.model.template, context, folders)
        return Asked(dict(values), simulation_name(deck, self.solver), deck, role)


def next_round(settings: Settings, data: Data, mesh: Mesh, mesh_file: Path, last: Round | None, sims: Path) -> Round:
    """Score the batch of the last round and ask for the next guesses.

    Parameters
    ----------
    settings : Settings
        Of the study.
    data, mesh : Data, Mesh
        What `prepare` made.
    mesh_file : Path
        The mesh as included by decks.
    last : Round or None
        The round before; None for the first.
    sims : Path
        Folder of the simulations.

    Returns
    -------
    Round
        With ``stop`` set, its batch holds the sensitivities around the best guess.
    """
    parameters = settings.parameters()
    names = [parameter.name for parameter in parameters]
    history = list(last.history) if last else []
    if last:
        predictor = Predictor(data, mesh)
        history += [evaluate(asked, predictor, data, settings, sims) for asked in last.batch]
    evaluations = [Evaluation(tuple(e["values"][n] for n in names), e["score"]) for e in history]
    proposal = propose(evaluations, parameters, settings.search())
    renderer = Renderer(settings, load_study(Path(settings.study)), mesh_file)
    best = min((e for e in history if e["score"] is not None), key=lambda e: e["score"], default=None)
    if proposal.stop is None or best is None:
        batch = [renderer.ask(dict(zip(names, point, strict=True))) for point in proposal.batch]
    else:
        asked = sensitivity_values(parameters, best["values"])
        batch = [renderer.ask(values, role) for role, values in asked.items()]
        batch += [
            renderer.ask(best["values"], sign + "control", gain)
            for sign, gain in (("+", 1.0 + STEP), ("-", 1.0 - STEP))
        ]
    number = last.number + 1 if last else 0
    return Round(number, proposal.stage, proposal.stop, renderer.solver, renderer.mesh, history, batch, best)


def evaluate(
    asked: Asked, predictor: Predictor, data: Data, settings: Settings, sims: Path
) -> dict[str, Any]:
    """Score one simulated guess: its entry of the history."""
    outcome = Outcome.load(sims / asked.sim / "solution.npz")
    predicted = predictor.predict(outcome)
    entry: dict[str, Any] = {"values": asked.values, "sim": asked.sim, "score": None}
    if predicted is None:
        return {**entry, "message": outcome.message}
    prediction, faults = predicted
    value = score(settings.fit.score, prediction, data, settings.fit.bins)
    entry = {**entry, "score": value, "message": ""}
    if faults.inverted or faults.overlaps:
        entry["message"] = f"{faults.inverted} inverted elements, {faults.overlaps} pixels claimed twice"
    return entry
