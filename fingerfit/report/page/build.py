"""The page: pictures, numbers and words put together in one file."""

from __future__ import annotations

import base64
import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from fingerfit import __version__
from fingerfit.core.files import keep_text
from fingerfit.core.folders import OURS
from fingerfit.diagnosis.explained import SLOPES
from fingerfit.diagnosis.families import odds
from fingerfit.diagnosis.ranking import FIRST_PASS, REFIT
from fingerfit.model.effect import FAMILIES
from fingerfit.report.drawing import COLOURS
from fingerfit.report.page.edges import EDGES
from fingerfit.report.page.inputs import Inputs, Model, read_inputs
from fingerfit.report.page.ladder import constants_figures, ladder_figure, profile_figure, rung_label
from fingerfit.report.page.panels import Panels
from fingerfit.report.page.regions import in_words, places
from fingerfit.report.page.words import (
    VERDICTS,
    commands,
    first_upper,
    headline,
    in_lines,
    label,
    number,
    place_words,
    titles,
    with_unit,
)

FOLDER = OURS / "report"
SHOWN_ROWS = 8
FOR_SCRIPT = ("pictures", "regions", "first_effect", "parts", "titles", "pattern_by")
"""What the page's script knows of a model."""
PATTERN_BY = {REFIT: "by its refit", FIRST_PASS: "by the first pass", SLOPES: "by slopes at the fitted model"}
"""What says how much of the residual an effect explains, in words."""


def write_page(study: Path, out: Path) -> None:
    """Write the report of a study: one file that opens offline.

    Parameters
    ----------
    study : Path
        ``results/{study}``; what is missing in it is left out.
    out : Path
        The HTML file.

    Raises
    ------
    StateError
        When no model was compared with the measurements yet, or a file is damaged.
    """
    inputs = read_inputs(study)
    env = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters.update(
        number=number, with_unit=with_unit, in_words=in_words, in_lines=in_lines, first_upper=first_upper
    )
    script = (FOLDER / "page.js").read_text(encoding="utf-8")
    stamp = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    # Markup: our own files, not escaped; everything that comes from a study is
    text = env.get_template("page.html.j2").render(
        **page_context(inputs),
        style=Markup((FOLDER / "style.css").read_text(encoding="utf-8")),
        script=Markup(script),
        stamp=stamp,
    )
    keep_text(out, text if text.endswith("\n") else text + "\n")


def page_context(inputs: Inputs) -> dict[str, Any]:
    """All that the templates name."""
    panels = Panels(inputs.models)
    models = [_model(inputs, panels, model, n) for n, model in enumerate(inputs.models)]
    tests, shown = [_script_data(panels, models)], list(models)
    for own in inputs.others:
        drawn = Panels(own, panels)
        beside = [_model(inputs, drawn, model, n) for n, model in enumerate(own)]
        tests.append(_script_data(drawn, beside))
        shown += beside
    rungs, constants = inputs.ladder.get("rungs") or [], constants_figures(inputs.ladder)
    found = headline(inputs)
    return {
        "study": inputs.study,
        "headline": found,
        "models": models,
        "shown": shown,
        "tests": [own[0].test for own in (inputs.models, *inputs.others) if inputs.others],
        "rungs": _rungs(inputs),
        "ladder_figure": panels.keep(ladder_figure(inputs.ladder)) if rungs else None,
        "constants_figures": [(name, panels.keep(figure)) for name, figure in constants.items()],
        "constants": list(constants),
        "profiles": [(one, panels.keep(profile_figure(one))) for one in inputs.profiles],
        "units": {name: p.get("unit", "") for rung in rungs for name, p in (rung.get("parameters") or {}).items()},
        "verdicts": VERDICTS,
        "files": inputs.files,
        "in_space": any(m["in_sections"] for m in shown),
        "versions": _versions(),
        "shown_rows": SHOWN_ROWS,
        "views": panels.view_data(),
        "pictured": any(m["pictured"] for m in models),
        "data": {
            "uris": panels.uris,
            "colours": COLOURS,
            "order": [m["name"] for m in models],
            **({"tests": tests} if inputs.others else tests[0]),
        },
    }


def _script_data(panels: Panels, models: list[dict[str, Any]]) -> dict[str, Any]:
    """What the page's script knows of a test."""
    return {
        **({"test": models[0]["test"]} if models[0]["test"] else {}),
        "panels": panels.keys,
        "meshes": panels.meshes,
        "frames": panels.frame_data(),
        "maps": panels.map_data(),
        "views": panels.view_data(),
        "models": {m["name"]: {k: m[k] for k in FOR_SCRIPT} for m in models},
    }


def _model(inputs: Inputs, panels: Panels, model: Model, index: int) -> dict[str, Any]:
    compare, diagnosis = model.compare, model.diagnosis
    pictures, regions, rows = [], [], []
    if compare is not None:
        for n in range(compare.views):
            ratio = compare.ratio(n)
            pictures.append(
                {"label": compare.label(n), "seen": compare.seen(n), "error": number(compare.error[n], 3)
                 if n < len(compare.error) else "?", "floor": number(compare.floor[n], 3) if n < len(compare.floor)
                 else "?", "ratio": number(ratio, 3), "words": in_words(ratio)}
            )  # fmt: skip
        for place in places(compare):
            regions.append({"patches": place.patches, "elements": panels.elements(model, place.patches)})
            rows.append({"place": place, "label": compare.label(place.picture), "seen": compare.seen(place.picture)})
    entries = diagnosis.get("ranking") or []
    ranking = [_candidate(model, entry) for entry in entries]
    effects, named = [str(name) for name in diagnosis.get("effects") or []], titles(diagnosis)
    return {
        "name": model.name,
        "test": model.test,
        "label": rung_label(model.rung or {"model": model.name}, index == 0),
        "model": model,
        "pictures": pictures,
        "pictured": compare is not None and compare.pictures > 0,
        "regions": regions,
        "rows": rows,
        "forces": _forces(model),
        "far_off": str(compare.far_off) if compare is not None else "",
        "has_map": panels.has("map", model.name),
        "has_force": panels.has("force", model.name),
        "force": panels.keys.get(f"force|{model.name}"),
        "stiffness": [panels.keys[key] for key in panels.keys if key.startswith(f"stiffness|{model.name}|")],
        "field": [panels.keys[key] for key in panels.keys if key.startswith(f"field|{model.name}|")],
        "edges": {edge: panels.keys[key] for edge in EDGES if (key := f"edge|{model.name}|{edge}") in panels.keys},
        "by_fall": compare is not None and compare.mesh_points.shape[-1] == 3,
        "in_sections": compare is not None and compare.volumes,
        "diagnosis": diagnosis,
        "ranking": ranking,
        "families": [
            {
                "words": FAMILIES[one["family"]],
                "best": named.get(one["effect"], one["effect"]),
                "odds": odds(one["log_odds"]),
                "refit": _refit_of_family(one.get("refit"), named),
            }
            for one in diagnosis.get("families") or []
            if one["log_odds"] > 0
        ],
        "first_effect": next(iter(model.patterns), ""),
        "parts": {effect: part for effect, (part, _) in model.patterns.items()},
        "titles": named,
        "pattern_by": {str(e.get("effect")): PATTERN_BY[e["pattern_by"]] for e in entries if e.get("pattern_by")},
        "named": [c for c in ranking if c["effect"] in effects],
        "commands": commands(effects[0]) if effects else (),
        "steps": _steps(model),
        "curve": panels.keys.get(f"there|{model.name}|steps|response"),
        "response": (compare.response_name if compare is not None else ("", "")),
        "settings": json.dumps(model.settings, indent=1) if model.settings else "",
        "solver": ", ".join(f"{key} {value}" for key, value in model.solver.items() if isinstance(value, str)),
        "verdict": label(model),
        "verdict_key": model.verdict if model.verdict in VERDICTS else "none",
        "last": index == len(inputs.models) - 1,
    }


def _refit_of_family(refit: Mapping[str, Any] | None, named: Mapping[str, str]) -> dict[str, Any] | None:
    """The best refit of a family, and its odds against the best of all families; None where there is none."""
    if not refit:
        return None
    return {
        "best": named.get(refit["effect"], refit["effect"]),
        "odds": odds(refit["log_odds"]),
        "first": not refit["log_odds"],
    }


def _candidate(model: Model, entry: dict[str, Any]) -> dict[str, Any]:
    effect, units, refit = str(entry.get("effect", "")), entry.get("units") or {}, entry.get("refit") or {}
    first, again = entry.get("share_of_excess"), refit.get("explained")
    if not _exceeds(model.diagnosis):
        first = again = None
    # numbers of the refit, where there is one
    ended = {name.removeprefix(f"{effect}."): value for name, value in (refit.get("parameters") or {}).items()}
    size, place = (
        {name: ended.get(name, value) for name, value in (entry.get(key) or {}).items()} for key in ("size", "place")
    )
    return {
        "effect": effect,
        "title": entry.get("title") or effect,
        "texts": {key: entry.get(key) or "" for key in ("words", "look", "confirm", "acts")},
        "place": place_words(place, entry.get("told") or {}, model.diagnosis.get("layers") or []),
        "size": [(name, with_unit(value, units.get(name, ""))) for name, value in size.items()],
        "fall": entry.get("predicted_fall"),
        "first": {"share": first, "bar": _percent(first)},
        "refit": {"share": again, "bar": _percent(again)} if refit else None,
        "visible": not entry.get("imitated"),
        "error": refit.get("error") or {},
        "ends": [f"{name} at its {which} bound" for name, which in (refit.get("at_bound") or {}).items()],
        "missed": bool(refit.get("missed")),
        "unended": (entry.get("first_pass") or {}).get("converged") is False,
        "drawn": entry.get("effect") in model.patterns,
    }


def _percent(share: float | None) -> int:
    return 0 if share is None else round(100 * min(1.0, max(0.0, share)))


def _exceeds(diagnosis: dict[str, Any]) -> bool:
    """Whether the misfit exceeds that of noise by more than chance: of less there are no shares to explain."""
    misfit, freedom = diagnosis.get("misfit"), diagnosis.get("freedom")
    return misfit is None or freedom is None or misfit - freedom > (diagnosis.get("threshold") or 0.0)


def _steps(model: Model) -> list[dict[str, Any]]:
    """Residual of the response by step, against its noise."""
    compare = model.compare
    if compare is None or not np.isfinite(compare.response).any():
        return []
    found = []
    for n, step in enumerate(compare.step):
        left, noise = float(compare.response[n]), float(compare.response_noise[n])
        ratio = abs(left) / noise if noise > 0 else float("nan")
        found.append({"label": f"step {int(step)}", "seen": compare.seen_step(n), "left": number(left, 3),
                      "noise": number(noise, 3), "words": in_words(ratio), "ratio": number(ratio, 3)})  # fmt: skip
    return found


def _clean(values: np.ndarray) -> np.ndarray:
    """Without what rounding leaves of zeros beside the largest of them."""
    return np.where(np.abs(values) < 1e-9 * np.nan_to_num(np.abs(values)).max(initial=0.0), 0.0, values)


def _forces(model: Model) -> list[dict[str, Any]]:
    compare = model.compare
    if compare is None or not len(compare.step):
        return []
    table = []
    sizes = {len(compare.step)}
    for name in ("force", "displacement", "force_model", "displacement_model"):
        sizes.add(len(getattr(compare, name)))
    if len(sizes) > 1:
        return []
    for n, step in enumerate(compare.step):
        lateral = (_clean(values)[n] for values in (compare.lateral_force, compare.lateral_force_model) if len(values))
        table.append(
            {"step": int(step), **{name: number(getattr(compare, name)[n]) for name in
             ("force", "displacement", "force_model", "displacement_model")},
             "lateral": [(number(one), number(other)) for one, other in zip(*lateral, strict=True)]}
        )  # fmt: skip
    return table


def _rungs(inputs: Inputs) -> list[dict[str, Any]]:
    rungs = inputs.ladder.get("rungs") or []
    best = {k: min((r[k] for r in rungs if r.get(k) is not None), default=None) for k in ("aic", "bic")}
    shown = []
    every = [e for m in inputs.models for e in m.error.values() if e is not None and np.isfinite(e)]
    top = max([1.5, *every])
    for n, model in enumerate(inputs.models):
        rung, error = model.rung, model.error
        simulations = rung.get("simulations") or {}
        shown.append(
            {
                "name": model.name,
                "label": rung_label(rung or {"model": model.name}, n == 0),
                "verdict": label(model),
                "verdict_key": model.verdict if model.verdict in VERDICTS else "none",
                "sentence": model.sentence,
                "error": error,
                "bars": {k: None if v is None else round(100 * v / top, 1) for k, v in error.items()},
                "line": round(100 / top, 1),
                "known": bool(rung),
                "coarser": bool(rung.get("coarser")),
                "count": rung.get("parameters_count"),
                "misfit": rung.get("misfit"),
                "freedom": rung.get("freedom"),
                "above": {
                    k: None if rung.get(k) is None or best[k] is None else rung[k] - best[k] for k in ("aic", "bic")
                },
                "aic": rung.get("aic"),
                "bic": rung.get("bic"),
                "run": simulations.get("run"),
                "reused": simulations.get("reused"),
                "parameters": rung.get("parameters") or {},
                "ranges": rung.get("ranges") or {},
                "not_excluded": rung.get("not_excluded") or {"effects": [], "ranges": {}},
                "further": rung.get("further") or {},
            }
        )
    return shown


def _versions() -> list[tuple[str, str]]:
    found = [("fingerfit", __version__), ("Python", platform.python_version())]
    for name in ("numpy", "scipy", "matplotlib", "jinja2"):
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return found
