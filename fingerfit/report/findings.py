"""What a comparison found, written down: compare.npz, diagnosis.json and .npz, and the model's rung of the ladder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.files import keep_json, read_json, write_npz
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.diagnose import Diagnosis
from fingerfit.diagnosis.errors import are_fitted, errors, fitted_steps
from fingerfit.diagnosis.explained import explained
from fingerfit.diagnosis.families import by_refits, families, family_told
from fingerfit.diagnosis.field import field_of
from fingerfit.diagnosis.ranges import ranges, with_effects
from fingerfit.diagnosis.ranking import Ranked, confusions, summary
from fingerfit.diagnosis.refit import explains
from fingerfit.diagnosis.reservations import far_off_of
from fingerfit.diagnosis.residual import BRIGHTNESS, DISPLACEMENT, RESPONSE
from fingerfit.diagnosis.worth import unseen
from fingerfit.fit.far_off import where_to_look
from fingerfit.fit.intervals import bound_of
from fingerfit.forward.predict import in_first_picture
from fingerfit.imaging.sections import border_triangles, parts_of
from fingerfit.imaging.warp import Probe
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.catalogue import as_text
from fingerfit.model.effect import LOADING, Effect
from fingerfit.model.parameters import Parameter
from fingerfit.report.drawing import outline
from fingerfit.report.rungs import made_with
from fingerfit.study.several import TESTS, array_ending

SHOWN = 6
"""Effects whose patterns are kept, and so drawn."""


def write_compare(comparison: Comparison, path: Path) -> None:
    """Measured and synthesized pictures, the residual with all of its noise, forces and meshes, as arrays.

    In a study with several tests each has its own, as ``force@wide``, and ``tests`` are their names.
    """
    if len(comparison.every) == 1:
        write_npz(path, _compared(comparison))
        return
    names, found = [test.problem.test for test in comparison.every], dict[str, np.ndarray]()
    for name, test in zip(names, comparison.every, strict=True):
        found |= {f"{key}{array_ending(name)}": values for key, values in _compared(test).items()}
    write_npz(path, {TESTS: np.array(names), **found})


def by_test(comparison: Comparison, whole: np.ndarray) -> list[np.ndarray]:
    """All values of all tests, shape (all,), in its parts."""
    counts = [len(test.kept) for test in comparison.every]
    return np.split(whole, np.cumsum(counts)[:-1])


def _spread(comparison: Comparison) -> np.ndarray:
    """Standard deviation of each value by all of its noise and its mesh, shape (all,); NaN where not known."""
    known = comparison.residual.kept
    own = comparison.residual.covariance + comparison.rough_covariance(comparison.mesh_signal, known)
    whole = np.full(len(known), np.nan)
    whole[known] = np.sqrt(np.diag(own) + (comparison.nuisance(kept=known) ** 2).sum(axis=1))
    return whole


def _compared(comparison: Comparison) -> dict[str, np.ndarray]:
    problem, data = comparison.problem, comparison.data
    outcome = problem.outcome(comparison.base)
    mesh = in_first_picture(problem.meshes[comparison.mesh], outcome)
    steps = data.entry_step[: shown(comparison)]
    left, noise = (parts_left(comparison, whole) for whole in (comparison.whole, _spread(comparison)))
    error, floor = comparison.error, comparison.floor
    if not len(data.picture_step):  # of measured points: displacements, mm
        error, floor = (np.array([_typical(one) for one in each[DISPLACEMENT]]) for each in (left, noise))
    response, lateral = data.split(comparison.prediction.response)
    off = far_off_of(comparison)
    beside = {"lateral_force": data.lateral_force, "lateral_force_model": lateral} if lateral.size else {}
    moved, force = (response, data.force) if data.control == "force" else (data.displacement, response)
    return {
        "measured": data.measured,
        "synthesized": comparison.prediction.pictures,
        "picture_step": steps,
        "fitted": fitted_steps(problem, data)[: len(steps)],
        "error": error,
        "floor": floor,
        "spacing": data.spacing,
        "origin": data.origin,
        "direction": data.direction,
        **left,
        **{f"{name}_noise": values for name, values in noise.items()},
        "control": np.array(data.control),
        "step_fitted": are_fitted(problem, data, np.arange(len(data.step))),
        "patch_centre": comparison.patches.centre,
        "patch_count": np.array(comparison.patches.count),
        "mesh_points": mesh.points,
        "mesh_moved": mesh.points + outcome.displacement[steps],
        "edge_moved": _edges(mesh, outcome.displacement[steps[-1] if len(steps) else -1]),
        **_outlines(mesh, comparison),
        **_field(comparison),
        "mesh_layer": np.maximum(parts_of(mesh), 0),
        "layer_names": np.array(list(mesh.parts)),
        "step": data.step,
        "force": data.force,
        "displacement": data.displacement,
        "force_model": force,
        "displacement_model": moved,
        "force_noise": np.array(data.force_noise),
        "displacement_noise": np.array(data.displacement_noise),
        "far_off": np.array(f"{off}; {where_to_look(data, problem.settings.fit.score)}" if off else ""),
        **beside,
    }


def _outlines(mesh: Mesh, comparison: Comparison) -> dict[str, np.ndarray]:
    """Outlines of the elements of a plane mesh; in space, faces of its parts, and the part most of each patch is of."""
    if mesh.dim == 3:
        faces, part = border_triangles(mesh)
        residual, centres = comparison.residual, comparison.patches.centre
        points, owner = residual.places, residual.place_patch
        if not len(points):
            points, owner = centres, np.arange(len(centres))
        element, parts = Probe(mesh, points).element, parts_of(mesh)
        inside = (element >= 0) & (parts[element] >= 0)
        votes = np.zeros((len(centres), int(parts.max()) + 1), dtype=int)
        np.add.at(votes, (owner[inside], parts[element[inside]]), 1)
        most = np.where(votes.any(axis=1), votes.argmax(axis=1), -1)
        return {"mesh_faces": faces, "mesh_face_part": part, "patch_layer": most}
    return {"mesh_rings": np.concatenate([block.nodes[:, outline(block.nodes.shape[1])] for block in mesh.blocks])}


def _edges(mesh: Mesh, displacement: np.ndarray) -> np.ndarray:
    """Nodes of the base and of the indenter's face from left to right, in the plane: side, x and displacement."""
    if mesh.dim == 3:
        return np.zeros((0, 4))
    found = []
    for side, name in enumerate(("BOTTOM", "TOP")):
        nodes = mesh.node_sets.get(name, np.zeros(0, dtype=int))
        nodes = nodes[np.argsort(mesh.points[nodes, 0])]
        found.append(np.column_stack([np.full(len(nodes), side), mesh.points[nodes, 0], displacement[nodes]]))
    return np.concatenate(found)


def _field(comparison: Comparison) -> dict[str, np.ndarray]:
    """Stiffness as a field by element, where the model has one."""
    found = field_of(comparison)
    names = ("value", "spread", "seen")
    return {f"field_{name}": np.asarray(getattr(found, name)) for name in names} if found else {}


def shown(comparison: Comparison) -> int:
    """Fields of displacements that are drawn: those of pictures, or where there are none those of points."""
    return len(comparison.data.picture_step) or len(comparison.residual.value)


def parts_left(comparison: Comparison, whole: np.ndarray) -> dict[str, np.ndarray]:
    """All values by their parts, with NaN for what was not measured.

    Parameters
    ----------
    comparison : Comparison
    whole : ndarray, shape (all,)

    Returns
    -------
    dict of ndarray
        ``residual_displacement``, shape (fields, patches, dim), mm; ``brightness``, shape (pictures, patches);
        ``response``, shape (steps,), N or mm.
    """
    residual = comparison.residual
    fields = whole[: residual.value.size].reshape(residual.value.shape)[: shown(comparison)]
    brightness = fields[: len(comparison.data.picture_step), :, -1]
    along, _ = comparison.data.split(whole[residual.value.size :])
    return {DISPLACEMENT: fields[..., :-1], BRIGHTNESS: brightness, RESPONSE: along}


def part_shown(effect: Effect, pattern: Mapping[str, np.ndarray]) -> str:
    """The part of the residual in which an effect is shown.

    Brightness for those that change the brightness, the response for those that change loads
    or their reading, else displacements; another one where that is not measured or would not change.
    """
    chosen = DISPLACEMENT
    if "intensity" in effect.observes:
        chosen = BRIGHTNESS
    elif effect.acts == LOADING or effect.observes_response:
        chosen = RESPONSE
    order = sorted((DISPLACEMENT, RESPONSE, BRIGHTNESS), key=lambda name: name != chosen)
    return next((name for name in order if np.nan_to_num(pattern[name]).any()), chosen)


def _patterns(comparison: Comparison, values: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """What an effect explains, by its parts, for each test by the ending of its names: none where there is one."""
    every = by_test(comparison, values)
    names = [array_ending(test.problem.test) for test in comparison.every]
    return {name: parts_left(test, own) for name, test, own in zip(names, comparison.every, every, strict=True)}


def _part_shown(effect: Effect, patterns: Mapping[str, Mapping[str, np.ndarray]]) -> str:
    seen = (own for own in patterns.values() if any(np.nan_to_num(part).any() for part in own.values()))
    return part_shown(effect, next(seen, next(iter(patterns.values()))))


def kept_ranking(found: Diagnosis) -> list[Ranked]:
    """The effects whose patterns are kept: those that are named, those that were refitted, then the likeliest."""
    named = list(found.verdict.effects)

    def rank(one: Ranked) -> tuple[int, bool]:
        name = one.candidate.effect.name
        return named.index(name) if name in named else len(named), name not in found.refits

    return sorted(found.ranking, key=rank)[:SHOWN]


def _typical(values: np.ndarray) -> float:
    """Root mean square of known values, 0 where there are none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def write_diagnosis(found: Diagnosis, path: Path) -> dict[str, Any]:
    """Verdict and ranking as JSON, patterns beside it as .npz; returns the former."""
    model = found.comparison.problem.settings.model
    hidden = {one.candidate.effect.name for one in unseen(found.score_test, found.ranking)}
    kept = {one.candidate.effect.name: one for one in kept_ranking(found)}
    # of the tests, the first in which an effect is seen says where it is shown
    known = {name: explained(found.comparison, one, found.refits.get(name)) for name, one in kept.items()}
    patterns = {name: _patterns(found.comparison, values) for name, (values, _) in known.items()}
    ranking = []
    for one, entry in zip(found.ranking, summary(found.score_test, found.ranking), strict=True):
        effect, refit = one.candidate.effect, found.refits.get(one.candidate.effect.name)
        ranking.append(
            {
                **as_text(effect),
                **entry,
                "units": {p.name: p.unit for p in effect.parameters},
                "imitated": effect.name in hidden,
                "shows": _part_shown(effect, patterns[effect.name]) if effect.name in patterns else None,
                "pattern_by": known[effect.name][1] if effect.name in known else None,
                "refit": refit
                and {
                    "misfit": refit.misfit,
                    "fall": refit.fall,
                    "explained": min(1.0, refit.explained(found.score_test.misfit)),
                    "error": {"fitted": refit.fitted, "held_out": refit.held_out},
                    "parameters": {name: float(value) for name, value in refit.values.items()},
                    "intervals": {name: list(ends) for name, ends in refit.intervals.items()},
                    "at_bound": at_bounds(effect, refit.values),
                    "missed": refit.missed,
                    "start": dict(refit.start),
                    "constants": dict(refit.constants),
                    "simulations": refit.simulations,
                },
            }
        )
    verdict = found.verdict
    data = {
        "model": model.full_name,
        "verdict": verdict.kind,
        "sentence": verdict.sentence,
        "effects": list(verdict.effects),
        "family": verdict.family,
        "numerics": verdict.numerics,
        "families": _families(found),
        "misfit": found.score_test.misfit,
        "freedom": found.score_test.freedom,
        "threshold": verdict.threshold,
        "ranking": ranking,
        "patterns": list(patterns),
        "layers": [name.lower() for name in found.comparison.problem.study.layer_names],
        "confusions": confusions(found.score_test, found.ranking),
        "measurements": [{"title": title, "gain": gain} for title, gain in found.measurements],
        "not_tried": [
            {"title": title, "lacks": str(error.found), "expected": error.expected}
            for title, error in {**found.lacking, **found.untestable}.items()
        ],
        "left_out": found.left_out,
        "unsolved": [{"title": title, "why": why} for title, why in found.unsolved.items()],
        "outlined": found.outlined
        and {
            "parameters": dict(found.outlined.values),
            "intervals": {name: list(ends) for name, ends in found.outlined.intervals.items()},
        },
        "spare": [effect.name for effect in found.spare],
        "add": f"fingerfit add {verdict.effects[0]}" if verdict.effects else "",
        "simulations": found.run,
    }
    arrays = {"stiffness": found.stiffness}
    for name, own in patterns.items():
        for test, pattern in own.items():
            arrays |= {f"{part}_{name}{test}": values for part, values in pattern.items()}
    write_npz(path.with_suffix(".npz"), arrays)
    keep_json(path, data)
    return data


def _families(found: Diagnosis) -> list[dict[str, Any]]:
    """Families, the likeliest first by slopes or the first pass, each with its best effect, and with its best refit."""
    entries, refitted = [], by_refits(found.ranking, found.refits)
    for family, (one, odds) in families(found.score_test, found.ranking).items():
        entry = {"family": family, "effect": one.candidate.effect.name, "log_odds": odds, "fall": one.finding.fall}
        name, against = refitted.get(family, (None, None))
        entries.append({**entry, "refit": name and {"effect": name, "log_odds": against}})
    return entries


def at_bounds(effect: Effect, values: Mapping[str, float]) -> dict[str, str]:
    """Which numbers and places of a refitted effect ended at a bound: ``lower`` or ``upper`` by their short names."""
    sizes = [Parameter(p.name, p.unit, p.lower, p.upper, p.null, False, p.scale) for p in effect.parameters]
    places = [Parameter(name, "", low, high, low, False) for name, (low, high) in effect.refine.items()]
    known = [p for p in (*sizes, *places) if effect.key(p.name) in values]
    found = {p.name: bound_of(p, values[effect.key(p.name)]) for p in known}
    return {name: which for name, which in found.items() if which}


def count_simulations(study: Path, models: list[str], fit: set[str], diagnosis: set[str]) -> dict[str, int]:
    """How many simulations a fit ran and how many it reused: those that the models below it had asked for.

    The names go to ``simulations.json`` beside the model's rung, so that the models above it can be counted.

    Parameters
    ----------
    study : Path
        Results of the study.
    models : list of str
        Names of the models on the way to this one, which is the last.
    fit, diagnosis : set of str
        Names of the simulations that its fit and its diagnosis asked for.
    """
    files = [study / name / "simulations.json" for name in models]
    keep_json(files[-1], {"fit": sorted(fit), "diagnosis": sorted(diagnosis)})
    below = [read_json(file) for file in files[:-1] if file.exists()]
    reused = fit & {name for one in below for part in one.values() for name in part}
    return {"run": len(fit) - len(reused), "reused": len(reused)}


def rung_of(
    found: Diagnosis,
    diagnosis: dict[str, Any],
    estimate: dict[str, Any],
    simulations: dict[str, int],
    compared: dict[str, dict[str, float]],
) -> dict[str, Any]:
    """The model's rung of the ladder.

    Parameters
    ----------
    found : Diagnosis
    diagnosis : dict
        Its ``diagnosis.json``.
    estimate : dict
        Its ``estimate.json``.
    simulations : dict
        How many its fit ran and how many it reused, as from `count_simulations`.
    compared : dict
        The models on the way to it by its likelihood, as from `fingerfit.report.compared.compared`.
    """
    fitted, held_out = errors(found.comparison)
    settings, score_test = found.comparison.problem.settings, found.score_test
    count, entries = len(settings.parameters()), estimate["parameters"]
    doubtful = found.verdict.kind != "adequate" or not explains(score_test)
    maybe = with_effects(settings.parameters(), found.not_excluded, found.refits, entries)
    return {
        "model": settings.model.full_name,
        "made_with": made_with(settings.model_dump(mode="json")),
        "effects": list(settings.model.effects),
        "parameters": entries,
        "ranges": ranges(found.comparison, found.refits.values(), entries) if doubtful else {},
        "not_excluded": {"effects": [one.candidate.effect.title for one in found.not_excluded], "ranges": maybe},
        "further": {
            name: [{"title": one.title, "interval95": one.interval, "identified": one.identified} for one in listed]
            for name, listed in found.further.items()
        },
        "error": {"fitted": fitted, "held_out": held_out},
        "misfit": score_test.misfit,
        "freedom": score_test.freedom,
        "parameters_count": count,
        "compared": compared,
        "verdict": found.verdict.kind,
        "sentence": found.verdict.sentence,
        "family_sentence": family_told(diagnosis),
        "simulations": simulations,
    }
