"""The course of a fit: score what was simulated, ask the search, render the decks of the next guesses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from fingerfit.core.processes import side_by_side
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, SENSITIVITY, Fit
from fingerfit.fit.refine import ADDED, around_best, refine_round
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import Predictor
from fingerfit.search import Evaluation, propose


def next_round(fit: Fit, last: Round | None, threads: int = 1) -> Round:
    """Score the batch of the last round and ask for the next guesses, or say stop.

    Parameters
    ----------
    fit : Fit
    last : Round or None
        The round before; None for the first.
    threads : int
        Processes that warp and score the guesses of the last batch.

    Raises
    ------
    InputError
        In the first round, for a deck that the solver does not take.
    """
    if last is not None and last.stage in (SENSITIVITY, FINAL):
        fit.predict_all(last.batch, threads)
        return refine_round(fit, last)
    parameters = fit.settings.parameters()
    if last is None and fit.settings.model.effects:
        # a model with effects starts where the one without them stopped
        start = fit.settings.starts()
        base: dict[str, Any] = {
            "number": 0,
            "solver": fit.solver,
            "meshes": _meshes(fit),
            "best": {"values": start, "score": None},
        }
        _refuse(fit, start)
        return around_best(fit, base, start, ADDED, rough=True)
    names = [parameter.name for parameter in parameters]
    history = list(last.history) if last else []
    if last:
        history += _evaluate_all(fit, last.batch, threads)
    evaluations = [Evaluation(tuple(e["values"][n] for n in names), e["score"]) for e in history]
    proposal = propose(evaluations, parameters, fit.settings.plan())
    scored = [e for e in history if e["score"] is not None]
    best = min(scored, key=lambda e: e["score"]) if scored else None
    base = {
        "number": last.number + 1 if last else 0,
        "solver": fit.solver,
        "meshes": _meshes(fit),
        "history": history,
        "best": best,
    }
    if proposal.stop is None:
        batch = [fit.ask(dict(zip(names, point, strict=True))) for point in proposal.batch]
        if last is None:
            _refuse(fit, batch[0].values)
        return Round(stage=proposal.stage, stop=None, batch=batch, **base)
    if best is None:
        return Round(stage=proposal.stage, stop="no guess has a solution", **base)
    return around_best(fit, base, best["values"], proposal.stop)


def _refuse(fit: Fit, values: Mapping[str, float]) -> None:
    """Ask the solver about the first deck, on each mesh, before anything runs."""
    for role in (SEARCH, *[FINAL] * (REFINED in fit.mesh_files)):
        refused = fit.refusal(fit.ask(values, role))
        if refused is not None:
            raise refused


def _meshes(fit: Fit) -> dict[str, str]:
    return {fit.mesh_names[name]: path.name for name, path in fit.mesh_files.items()}


def _evaluate_all(fit: Fit, batch: list[Asked], threads: int) -> list[dict[str, Any]]:
    predictor = fit.predictor(SEARCH)
    fit.seen({})  # what is read here is not read again by each process
    return side_by_side(lambda asked: _evaluate(fit, asked, predictor), batch, threads)


def _evaluate(fit: Fit, asked: Asked, predictor: Predictor) -> dict[str, Any]:
    """Score one simulated guess: its entry of the history."""
    outcome = fit.outcome(asked)
    made = predictor.predict(outcome, fit.seen(asked.values))
    entry: dict[str, Any] = {"values": asked.values, "sim": asked.sim, "score": None}
    if made is None:
        return {**entry, "message": outcome.message}
    score = fit.score(made.prediction)
    if not math.isfinite(score):  # of huge displacements or tiny noise: worse than all others
        return {**entry, "message": f"a score of {score}"}
    entry = {**entry, "score": score, "message": ""}
    if made.inverted or made.overlaps:
        entry["message"] = f"{made.inverted} inverted elements, {made.overlaps} pixels claimed twice"
    return entry
