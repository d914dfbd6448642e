"""The estimate of a finished fit as data and as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.fit.far_off import far_off, response_by_mesh, where_to_look
from fingerfit.fit.finer import on_finer_mesh, usable_steps
from fingerfit.fit.identified import seen_directions
from fingerfit.fit.intervals import Uncertainty, as_json, bound_of, repeat, summarise, widths
from fingerfit.fit.minimum import Minimum, by_data, mesh_error, minimum, on_search_mesh, partly_on_finer_mesh
from fingerfit.fit.objective import Objective
from fingerfit.fit.priors import told, weigh
from fingerfit.fit.problem import REFINED, InverseProblem
from fingerfit.fit.refine import CLOSE, stopped_early
from fingerfit.fit.replicates import Replicates
from fingerfit.fit.rounds import Round, simulations
from fingerfit.fit.slopes import coordinates, moved
from fingerfit.model.parameters import Parameter
from fingerfit.study.several import AT

MANY = 12
"""Numbers up to which minima of repetitions are found: of 38, as a field has them, that takes minutes. A choice."""


def estimate_of(
    problem: InverseProblem, last: Round, threads: int = 1, asked: Sequence[str] | None = None
) -> dict[str, Any]:
    """The estimate: what goes to estimate.json.

    Parameters
    ----------
    problem : InverseProblem
    last : Round
    threads : int
        Pictures of repetitions that are made beside each other.
    asked : sequence of str, optional
        Simulations as `fingerfit.fit.rounds.asked_for` tells them; else those that the last round knows of.

    Raises
    ------
    StateError
        When no guess had a solution; else as `minimum`.
    InputError
        As `minimum`.
    """
    if last.best is None:
        why = "; ".join(sorted({e["message"] for e in last.history if e["message"]}))
        raise StateError(
            f"no guess had a solution ({why}): widen or move the bounds, or look at mesh, forces and their noise"
        )
    settings, parameters = problem.settings, problem.settings.parameters()
    best, priors = minimum(problem, last), problem.priors
    mesh = problem.mesh_of(best.base)
    searched = on_search_mesh(problem, last) if mesh == REFINED else best
    partly = partly_on_finer_mesh(problem, last) if mesh != REFINED and REFINED in problem.mesh_files else None
    values, left_by_mesh = best.values, mesh_error(problem, best, searched, partly)
    shifts, hessian = _repeated(problem, best, threads)
    known, on_search = None, searched.values
    if priors:
        left, move = priors.left(best.base.values), by_data(problem, best)
        weighed = weigh(priors, left, move, shifts, left_by_mesh, seen_directions(hessian, problem.sure))
        values = moved(parameters, best.base.values, weighed.shift)
        on_search = moved(parameters, on_search, coordinates(parameters, values) - coordinates(parameters, best.values))
        shifts, left_by_mesh, known = shifts @ weighed.gain.T, weighed.mesh, weighed.known
    point = [values[p.name] for p in parameters]
    found = summarise(shifts, hessian, parameters, point, left_by_mesh, problem.sure, known)
    names = [p.name for p in parameters]
    if asked is None:
        asked = [sim for e in last.history for sim in e.get("sims", [e["sim"]])]
        asked += [a.sim for a in simulations(last.batch)]
    return {
        "study": settings.study,
        "model": settings.model.full_name,
        "solver": last.solver,
        "parameters": as_json(_with_rivals(found, problem, values), parameters, point),
        "correlation": {
            "names": names,
            "matrix": np.round(found.correlation, 4).tolist(),
        },
        "remarks": [
            *found.remarks,
            *(told(priors, priors.left(values), np.hypot(found.relative, found.mesh)) if priors else []),
            *_extrapolated(problem, best, values),
            *_early(problem, last, best),
            *_rival_remarks(problem, values),
            *_bound_remarks(problem, values),
            *_mesh_remarks(problem, last, mesh, partly),
            *_thickness_remarks(problem),
            *(f"{_of(test)}measurements: {line}" for test in problem.every for line in test.data.remarks.splitlines()),
            *_far_off(problem, best, response_by_mesh(problem, last, best.base)),
            *_counted(problem, best),
        ],
        "score": {
            "kind": settings.fit.score,
            "search": last.best["score"],
            "final": problem.score(best.model.base, best.base.values),
        },
        "search": {
            "best": last.best["values"],
            "stop": last.stop,
            "rounds": last.number + 1,
            "guesses": len(last.history),
            "diverged": sum(e["score"] is None for e in last.history),
            "faults": sorted({e["message"] for e in last.history if e["score"] is not None and e["message"]}),
        },
        "simulations": {"asked": len(asked), "run": len(set(asked))},
        "search_mesh": on_search if mesh == REFINED else None,
        "sim": best.base.every[0].sim,
        **({"sims": [one.sim for one in best.base.every]} if best.base.tests else {}),
        "sim_mesh": mesh,
    }


def _repeated(problem: InverseProblem, best: Minimum, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """Shifts and curvature of repetitions of all tests at once, as of `repeat`; their noises do not know of each other.

    Numbers of effects on the observation that the score may not see are those of the least squares, as in the estimate.
    """
    how, makers = problem.settings.fit, list[Replicates]()
    width = widths(problem.settings.parameters(), best.model.moving)
    # exponents and effects may compensate moduli
    mixed = bool(problem.settings.model.effects) or not all(p.log for p in problem.settings.parameters())

    def draw() -> Objective:
        return Objective.total([maker.draw() for maker in makers])

    with ExitStack() as ends:
        for n, (test, model, asked) in enumerate(zip(problem.every, best.model.every, best.base.every, strict=True)):
            maps, seed = test.synthesis(asked).maps, [how.seed, n] if n else how.seed
            noisy, observed = test.as_counted(model.base).data, test.observed
            maker = Replicates(model, noisy, maps, how.score, how.bins, seed, threads, how.replicates, observed)
            makers.append(ends.enter_context(closing(maker)))
        shifts, hessian = repeat(draw, width, how.replicates, problem.sure, minima=mixed and len(width) <= MANY)
    for maker in makers:
        if maker.squares:
            number = maker.squares.number
            shifts[:, number] = np.array(maker.moves) + maker.squares.follow(shifts)
            hessian[np.ix_(number, number)] += problem.unit * maker.squares.curvature
    return shifts, hessian


def _extrapolated(problem: InverseProblem, best: Minimum, values: Mapping[str, float]) -> list[str]:
    """A sentence where priors, weighed at the end, take the estimate far from the last simulation."""
    parameters = problem.settings.parameters()
    far = float(np.abs(coordinates(parameters, values) - coordinates(parameters, best.base.values)).max(initial=0.0))
    if not problem.priors or far <= CLOSE:
        return []
    return [f"with its priors the estimate is {100 * far:.0f} % from the last simulation, by slopes alone"]


def _early(problem: InverseProblem, last: Round, best: Minimum) -> list[str]:
    """A sentence where the fit did not come to the minimum that its slopes promise."""
    if not stopped_early(problem, last, best):
        return []
    text = "the fit stopped early: slopes promise a better score"
    return [f"{text} {100 * best.move:.0f} % away, which its last steps missed; try other starting values"]


def _with_rivals(found: Uncertainty, problem: InverseProblem, values: Mapping[str, float]) -> Uncertainty:
    """Uncertainty whose intervals hold those that the models would have that the data cannot tell from this one.

    Theirs are taken to be as wide as its own at least, which knows more of the mesh.
    """
    ends = found.interval.copy()
    for n, p in enumerate(problem.settings.parameters()):
        for away in (one[p.name] for one in problem.settings.model.rivals.values() if p.name in one):
            middle = float(np.sqrt(away[0] * away[1]) if p.log else np.mean(away))
            low, high = (_away(p, values[p.name], far) for far in away)
            ends[n, 0] = min(ends[n, 0], low, _away(p, found.interval[n, 0], middle))
            ends[n, 1] = max(ends[n, 1], high, _away(p, found.interval[n, 1], middle))
    return replace(found, interval=ends)


def _away(parameter: Parameter, value: float, far: float) -> float:
    """What a rival makes of a value, as `rivals` in `fingerfit.settings.extend` tells how far away it is."""
    return value * far if parameter.log else value + far


def _rival_remarks(problem: InverseProblem, values: Mapping[str, float]) -> list[str]:
    """A sentence on each model that the data could not tell from this one, with its constants."""
    parameters, found = {p.name: p for p in problem.settings.parameters()}, []
    for model, away in problem.settings.model.rivals.items():
        told = [
            f"{name} {' to '.join(f'{_away(parameters[name], values[name], far):.4g}' for far in ends)}"
            for name, ends in away.items()
        ]
        text = f"these data cannot tell this model from {model}, which has {', '.join(told)}"
        found.append(f"{text}: the intervals reach that far")
    return found


def _of(test: InverseProblem) -> str:
    return f"{test.test}: " if test.test else ""


def _far_off(problem: InverseProblem, best: Minimum, by_mesh: Sequence[np.ndarray]) -> list[str]:
    """A sentence on the force (or displacement) of each test that the fit leaves far off, and where to look."""
    found = []
    for test, model, mesh in zip(problem.every, best.model.every, by_mesh, strict=True):
        # `_repeated` has asked for the slope by what is prescribed, and needs it
        control = model.control.response if model.control else np.zeros(len(mesh))
        said = far_off(test.data, model.base.response, control, mesh, test.test)
        found += [f"{said}; {where_to_look(test.data, test.settings.fit.score)}"] if said else []
    return found


def _counted(problem: InverseProblem, best: Minimum) -> list[str]:
    """A sentence on what each kind of data counts in the score, where it allows for what the model is wrong by."""
    found = []
    for test, model in zip(problem.every, best.model.every, strict=True):
        if test.discrepancy:
            weights = test.discrepancy.weights(model.base, test.data)
            told = ", ".join(f"{kind} {100 * weight:.3g} %" for kind, weight in weights.items())
            found.append(f"{_of(test)}what the data count beside an error of the model: {told}")
    return found


def _bound_remarks(problem: InverseProblem, values: Mapping[str, float]) -> list[str]:
    """A sentence on each constant or number of an effect that ends at its bound."""
    absent = {e.key(p.name): p.null for e in problem.settings.effects() for p in e.parameters}
    found = []
    for p in problem.settings.parameters():
        which = bound_of(p, values[p.name])
        if which is None:
            continue
        bound = p.lower if which == "lower" else p.upper
        text = f"{p.name} ends at its {which} bound, {bound:g}{'' if p.unit == '1' else f' {p.unit}'}"
        if (own := p.name.partition(AT)[0]) in problem.settings.model.parameters:
            text += f": a {'smaller' if which == 'lower' else 'larger'} value may fit better (model.parameters.{own})"
        elif absent.get(own) == bound:
            text += ", where the effect is absent"
        found.append(f"{text}; standard error and interval are those of a constant without bounds")
    return found


def _mesh_remarks(problem: InverseProblem, last: Round, mesh: str, partly: Minimum | None) -> list[str]:
    if mesh == REFINED:
        return []
    if REFINED not in problem.mesh_files:
        key = "body.refined" if problem.every[0].study.body.mesh else "model.refined"
        return [f"no finer mesh was given ({key}): standard errors and intervals do not contain the error of the mesh"]
    lacks = "the finer mesh has no solution at the best guess, or one in which the body goes through itself"
    error = "follows from the steps before that" if partly else "is not known"
    return [f"{lacks}{_from_where(problem, last)}: the estimate is that of the search mesh, whose mesh error {error}"]


def _from_where(problem: InverseProblem, last: Round) -> str:
    """From which step on, and which force or displacement, the finer mesh has no usable solution, by test."""
    asked = on_finer_mesh(problem, last)
    if asked is None:
        return ""
    found = list[str]()
    for test, one in zip(problem.every, asked.every, strict=True):
        data, usable = test.data, usable_steps(test, one)
        if usable < len(data.step):
            whose = f" in test {test.test}" if test.test else ""
            unit = "N" if data.control == "force" else "mm"
            size = f"{data.control} {data.controlled[usable]:.3g} {unit}"
            found.append(f"{whose} from step {data.step[usable]} on ({size})")
    return ",".join(found)


def _thickness_remarks(problem: InverseProblem) -> list[str]:
    if all(test.study.body.thick for test in problem.every):
        return []
    return ["the thickness is not known: moduli are those of 1 mm; only modulus times thickness (N/mm) is identified"]


def table_of(found: dict[str, Any]) -> str:
    """Table on the terminal, as the paper's Table 1."""
    width = max(14, *(len(name) + 1 for name in found["parameters"]))
    lines = [
        f"{found['study']}, model {found['model']}, solver {found['solver']['name']}",
        "",
        f"{'constant':<{width}}{'unit':<6}{'estimate':>12}{'std. error':>12}{'mesh error':>12}{'95 % interval':>26}",
    ]
    for name, entry in found["parameters"].items():
        low, high = entry["interval95"]
        unit = entry["unit"] if entry["unit"] != "1" else "-"
        mesh = f"{entry['mesh_error']:.2g}" if entry["mesh_error"] or found["search_mesh"] else "-"
        interval = f"{low:.4g} to {high:.4g}"
        bound = f"  at its {entry['at_bound']} bound" if entry["at_bound"] else ""
        lines.append(
            f"{name:<{width}}{unit:<6}{entry['value']:>12.4g}{entry['standard_error']:>12.2g}{mesh:>12}{interval:>26}"
            + bound
        )
    search, sims = found["search"], found["simulations"]
    lines += [
        "",
        f"score {found['score']['kind']} {found['score']['final']:.6f}; {search['rounds']} rounds,"
        f" {sims['run']} distinct simulations ({sims['asked']} requested); stop: {search['stop']}",
    ]
    if found["search_mesh"]:
        searched = found["search_mesh"]
        changed = {name: one for name, one in found["parameters"].items() if one["value"] != searched[name]}
        changes = [_change(name, entry, searched[name]) for name, entry in changed.items()] or ["none"]
        lines.append(f"change from the coarse to the finer mesh: {', '.join(changes)}")
    if search["diverged"]:
        lines.append(f"{search['diverged']} guesses had no solution")
    return "\n".join([*lines, *found["remarks"], *search["faults"]]) + "\n"


def _change(name: str, entry: Mapping[str, Any], searched: float) -> str:
    """From the coarse to the finer mesh: a share, or where the value may be 0 a difference in its unit."""
    if entry["log"]:
        return f"{name} {100 * (entry['value'] / searched - 1):+.1f} %"
    unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
    return f"{name} {entry['value'] - searched:+.2g}{unit}"
