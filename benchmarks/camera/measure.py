"""How large hidden effects are, in units of the noise, before and after the base model is refitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from camera import locate
from hidden import Effects
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_erosion, map_coordinates, spline_filter
from simulation import Simulated, background_of, grid_of, indentations_of, measured, pictures, simulate
from study_table import Study

ELEMENTS = 12
"""Elements along the side of a square as large as the body."""
WITHIN = 2
"""Points along the side of a pixel."""
CHANGE = 0.04
"""Relative change of a modulus that the sensitivities are computed with."""
RIM = 3
"""Pixels at the rim of the body that are left out."""


def sizes(study: Study, effects: Effects) -> dict[str, Any]:
    """Root mean square differences of the study and the base model over the noise.

    The base model has the true moduli first; then the logarithms of the moduli are refitted by linear least squares to
    pictures and response (force, or indentation under force control) together. Three of the pictures are used.

    Returns
    -------
    dict
        `pictures_before`, `response_before`: with the true moduli; `pictures`, `response`: after the refit;
        `log_moduli`: change of the logarithms of the moduli by the refit, from the base on.
    """
    moduli = np.array([layer.modulus for layer in study.layers])
    indentations = indentations_of(study)
    world = simulate(study, effects, moduli, indentations, ELEMENTS)
    seen = measured(effects, indentations, world.force)
    count = study.steps
    used = [0, *sorted({1 + count // 3, 1 + 2 * count // 3, count})]
    shown = pictures(study, effects, world, WITHIN, used)
    inside = [binary_erosion(picture.share >= 1, iterations=RIM) for picture in shown]
    values = [picture.values for picture in shown]
    warped = bool(effects.warp or effects.lens or effects.preload)
    first = values[0] if warped else None
    intensity = study.noise.picture * study.look.mean

    def vector(given: list[np.ndarray]) -> np.ndarray:
        parts = [one[mask] for one, mask in zip(given[1:], inside[1:], strict=True)]
        return np.concatenate(parts) / intensity

    base_pictures, base_response = _base_model(study, moduli, seen, used, first)
    at_base = vector(base_pictures)
    response = _response(study, seen, *seen)
    residual = np.r_[vector(values) - at_base, response - base_response]
    pixels = len(residual) - count
    weights = np.r_[np.full(pixels, np.sqrt(count / (len(used) - 1))), np.ones(count)]
    columns = []
    for number in range(len(moduli)):
        changed = moduli.copy()
        changed[number] *= 1 + CHANGE
        near_pictures, near_response = _base_model(study, changed, seen, used, first)
        columns.append(np.r_[vector(near_pictures) - at_base, near_response - base_response] / CHANGE)
    sensitivity = np.array(columns).T
    refit = np.linalg.lstsq(sensitivity * weights[:, None], residual * weights, rcond=None)[0]
    left = residual - sensitivity @ refit
    return {
        "pictures_before": _rms(residual[:pixels]),
        "response_before": _rms(residual[pixels:]),
        "pictures": _rms(left[:pixels]),
        "response": _rms(left[pixels:]),
        "log_moduli": np.round(refit, 3).tolist(),
    }


def _rms(values: np.ndarray) -> float:
    return round(float(np.sqrt((values**2).mean())), 2)


def _response(
    study: Study, seen: tuple[np.ndarray, np.ndarray], indentations: np.ndarray, force: np.ndarray
) -> np.ndarray:
    """What the test measures, over its noise: force, or indentation under force control."""
    if study.control == "displacement":
        return force / (study.noise.force * seen[1].max())
    return indentations / (study.noise.displacement * study.look.pixel)


def _base_model(
    study: Study, moduli: np.ndarray, seen: tuple[np.ndarray, np.ndarray], used: list[int], first: np.ndarray | None
) -> tuple[list[np.ndarray], np.ndarray]:
    """Pictures that are used and response of the base model, under the control of the test.

    The pictures are made of the true texture, or of the study's first picture where one is given.
    """
    nothing = Effects()
    indentations, force = seen
    model = simulate(study, nothing, moduli, indentations, ELEMENTS)
    if study.control == "force":
        indentations = CubicSpline(np.r_[0, model.force], np.r_[0, indentations])(force)
        model = simulate(study, nothing, moduli, indentations, ELEMENTS)
    response = _response(study, seen, indentations, model.force)
    if first is not None:
        return _warped(study, model, used, first), response
    return [picture.values for picture in pictures(study, nothing, model, WITHIN, used)], response


def _warped(study: Study, model: Simulated, used: list[int], first: np.ndarray) -> list[np.ndarray]:
    """The first picture, moved as the model says."""
    grid = grid_of(study)
    splines = spline_filter(first)
    x = grid.x + grid.pixel * np.arange(grid.columns)
    y = grid.y + grid.pixel * np.arange(grid.rows)
    points = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    result = []
    for step, displacements in enumerate([model.before, *model.moved]):
        if step not in used:
            continue
        located = locate(model.block, displacements, points)
        cells = ((located.places - [grid.x, grid.y]) / grid.pixel).T[::-1]
        values = np.full(len(points), background_of(study))
        values[located.inside] = map_coordinates(splines, cells, order=3, prefilter=False, mode="nearest")
        result.append(values.reshape(grid.rows, grid.columns))
    return result
