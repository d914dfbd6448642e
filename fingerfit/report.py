"""The estimate of a finished fit as data and as a table."""

from __future__ import annotations

from typing import Any

import numpy as np

from fingerfit.errors import StateError
from fingerfit.estimate import Replicates
from fingerfit.fit import REFINED, SEARCH, Fit, correction, linear_model, refined_guess, without_mesh_error
from fingerfit.rounds import Round
from fingerfit.uncertainty import as_json, repeat, summarise


def estimate_of(fit: Fit, last: Round) -> dict[str, Any]:
    """The estimate: what goes to estimate.json.

    Raises
    ------
    StateError
        When no guess had a solution.
    """
    if last.best is None:
        raise StateError("no guess had a solution: widen or move the bounds, or look at the mesh and the forces")
    settings, parameters = fit.settings, fit.settings.parameters()
    model = linear_model(fit, last)
    nearest = refined_guess(fit, last)
    size = len(parameters)
    values = without_mesh_error(fit, last) if nearest else dict(last.best["values"])
    asked = nearest or fit.ask(last.best["values"])
    predictor = fit.predictor(REFINED if nearest else SEARCH)
    maps = predictor.maps(fit.outcome(asked))
    replicates = Replicates(model, fit.data, maps, settings.fit.score, settings.fit.bins, settings.fit.seed)
    shifts, hessian = repeat(replicates.draw, size, settings.fit.replicates)
    point = [values[p.name] for p in parameters]
    found = summarise(shifts, hessian, parameters, point)
    names = [p.name for p in parameters]
    everything = {e["sim"] for e in last.history} | {a.sim for a in last.batch}
    return {
        "study": settings.study,
        "model": settings.model.name,
        "solver": last.solver,
        "parameters": as_json(found, parameters, point),
        "correlation": {
            "names": names,
            "matrix": np.round(found.correlation, 4).tolist(),
        },
        "remarks": [*found.remarks, *_mesh_remarks(fit, nearest is not None)],
        "score": {
            "kind": settings.fit.score,
            "search": last.best["score"],
            "final": fit.score(model.base),
        },
        "search": {
            "best": last.best["values"],
            "stop": last.stop,
            "rounds": last.number + 1,
            "guesses": len(last.history),
            "diverged": sum(e["score"] is None for e in last.history),
            "faults": sorted({e["message"] for e in last.history if e["score"] is not None and e["message"]}),
        },
        "simulations": {"asked": len(last.history) + len(last.batch), "run": len(everything)},
        "mesh_correction": correction(fit, last, values) if nearest else None,
        "sim": asked.sim,
        "sim_mesh": REFINED if nearest else SEARCH,
    }


def _mesh_remarks(fit: Fit, corrected: bool) -> list[str]:
    if REFINED in fit.mesh_files and not corrected:
        return ["the finer mesh has no solution at the best guess: the estimate is not corrected for its mesh"]
    return []


def table_of(found: dict[str, Any]) -> str:
    """Table on the terminal, as the paper's Table 1."""
    lines = [
        f"{found['study']}, model {found['model']}, solver {found['solver']['name']}",
        "",
        f"{'constant':<14}{'unit':<6}{'estimate':>12}{'std. error':>12}{'95 % interval':>26}",
    ]
    for name, entry in found["parameters"].items():
        low, high = entry["interval95"]
        unit = entry["unit"] if entry["unit"] != "1" else "-"
        interval = f"{low:.4g} to {high:.4g}"
        lines.append(f"{name:<14}{unit:<6}{entry['value']:>12.4g}{entry['standard_error']:>12.2g}{interval:>26}")
    search, sims = found["search"], found["simulations"]
    lines += [
        "",
        f"score {found['score']['kind']} {found['score']['final']:.6f}; {search['rounds']} rounds,"
        f" {sims['asked']} simulations asked for, {sims['run']} different ones run; stop: {search['stop']}",
    ]
    if found["mesh_correction"]:
        shift = ", ".join(f"{name} {100 * np.expm1(c):+.1f} %" for name, c in found["mesh_correction"].items())
        lines.append(f"moved by the finer mesh: {shift}")
    if search["diverged"]:
        lines.append(f"{search['diverged']} guesses had no solution")
    return "\n".join([*lines, *found["remarks"], *search["faults"]]) + "\n"
