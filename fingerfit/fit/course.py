"""The course of a fit: score what was simulated, ask the search, render the decks of the next guesses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fingerfit.core.processes import side_by_side
from fingerfit.fit.problem import FINAL, REFINED, SEARCH, SENSITIVITY, InverseProblem
from fingerfit.fit.refine import ADDED, around_best, refine_round
from fingerfit.fit.rounds import Asked, Round
from fingerfit.forward.predict import Predictor
from fingerfit.search import Evaluation, Match, propose


def next_round(problem: InverseProblem, last: Round | None, threads: int = 1) -> Round:
    """Score the batch of the last round and ask for the next guesses, or say stop.

    Parameters
    ----------
    problem : InverseProblem
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
        problem.predict_all(last.batch, threads)
        current = refine_round(problem, last)
        if current.stage == FINAL:  # the rounds that follow and the estimate use the same slopes
            problem.keep(current.batch)
        return current
    parameters = problem.settings.parameters()
    if last is None and problem.settings.model.effects:
        # a model with effects starts where the one without them stopped
        start = problem.settings.starts()
        base: dict[str, Any] = {
            "number": 0,
            "solver": problem.solver,
            "meshes": _meshes(problem),
            "best": {"values": start, "score": None},
        }
        _refuse(problem, start)
        return around_best(problem, base, start, ADDED, rough=True)
    names = [parameter.name for parameter in parameters]
    history = list(last.history) if last else []
    if last:
        history += _evaluate_all(problem, last.batch, threads)
    evaluations = [Evaluation(tuple(e["values"][n] for n in names), e["score"], _match(e)) for e in history]
    proposal = propose(evaluations, parameters, problem.settings.plan())
    scored = [e for e in history if e["score"] is not None]
    best = min(scored, key=lambda e: e["score"]) if scored else None
    if proposal.stop is not None and problem.descends:
        # where the least squares ended, not a guess beside it: its slopes are known
        best = next((e for e in scored if proposal.best == tuple(e["values"][n] for n in names)), best)
    base = {
        "number": last.number + 1 if last else 0,
        "solver": problem.solver,
        "meshes": _meshes(problem),
        "history": history,
        "best": best,
    }
    if proposal.stop is None:
        batch = [problem.ask(dict(zip(names, point, strict=True))) for point in proposal.batch]
        if last is None:
            _refuse(problem, batch[0].values)
        told = {name: [*numbers] for name, numbers in proposal.tolerances.items()}
        return Round(stage=proposal.stage, stop=None, batch=batch, tolerances=told, **base)
    if best is None:
        return Round(stage=proposal.stage, stop="no guess has a solution", **base)
    return around_best(problem, base, best["values"], proposal.stop)


def _as_json(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in values]


def _match(entry: Mapping[str, Any]) -> Match | None:
    """What an entry of the history says of displacements."""
    return Match(**{k: np.array(v, dtype=float) for k, v in entry["match"].items()}) if "match" in entry else None


def _refuse(problem: InverseProblem, values: Mapping[str, float]) -> None:
    """Ask the solver about the first deck, on each mesh, before anything runs."""
    for role in (SEARCH, *[FINAL] * (REFINED in problem.mesh_files)):
        refused = problem.refusal(problem.ask(values, role))
        if refused is not None:
            raise refused


def _meshes(problem: InverseProblem) -> dict[str, str]:
    return {name: path.name for name, path in problem.mesh_paths.items()}


def _evaluate_all(problem: InverseProblem, batch: list[Asked], threads: int) -> list[dict[str, Any]]:
    predictors = [test.predictor(SEARCH) for test in problem.every]
    for test in problem.every:
        if test.descends:
            test.matcher  # noqa: B018 - made once
        test.seen({})  # what is read here is not read again by each process

    def evaluated(asked: Asked) -> dict[str, Any]:
        tests = zip(problem.every, asked.every, predictors, strict=True)
        return _joined(problem, asked, [_evaluate(*test) for test in tests])

    return side_by_side(evaluated, batch, threads)


def _joined(problem: InverseProblem, asked: Asked, entries: list[dict[str, Any]]) -> dict[str, Any]:
    """The entry of a guess with its priors, from those of its tests."""
    found = entries[0] if len(entries) == 1 else _of_tests(asked, entries)
    if problem.priors and found["score"] is not None:
        found["score"] += problem.penalty(asked.values)
        for name, values in problem.priors.match(asked.values).items():
            if "match" in found:
                found["match"][name] += values
    return found


def _of_tests(asked: Asked, entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Of several tests: likelihoods multiply, and all must have a solution."""
    scores = [entry["score"] for entry in entries]
    found = {
        "values": asked.values,
        "sim": asked.sim,
        "sims": [one.sim for one in asked.every],
        "score": None if None in scores else sum(scores),
        "message": "; ".join(dict.fromkeys(entry["message"] for entry in entries if entry["message"])),
    }
    if found["score"] is not None and all("match" in entry for entry in entries):
        names = entries[0]["match"]
        found["match"] = {name: [v for entry in entries for v in entry["match"][name]] for name in names}
    return found


def _evaluate(problem: InverseProblem, asked: Asked, predictor: Predictor) -> dict[str, Any]:
    """Score one simulated guess of one test: its entry of the history."""
    outcome = problem.outcome(asked)
    made = predictor.predict(outcome, problem.seen(asked.values))
    entry: dict[str, Any] = {"values": asked.values, "sim": asked.sim, "score": None}
    if made is None:
        return {**entry, "message": outcome.message}
    score = problem.fit_to_data(made.prediction)
    if not math.isfinite(score):  # of huge displacements or tiny noise: worse than all others
        return {**entry, "message": f"a score of {score}"}
    entry = {**entry, "score": score, "message": ""}
    if problem.descends:
        match = problem.matcher.match(outcome, made)
        entry["match"] = {name: _as_json(values) for name, values in match.__dict__.items()}
    if made.inverted or made.overlaps:
        entry["message"] = f"{made.inverted} inverted elements, {made.overlaps} pixels covered twice"
    return entry
