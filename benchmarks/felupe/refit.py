"""Rough size of what is hidden: what a refit of the body as stated leaves, over the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from camera import DARK, Camera
from cases import Case, coarse_body, stated_material
from scipy.ndimage import binary_erosion, gaussian_filter, map_coordinates
from solver import Contact, Load, Problem

Array = np.ndarray


def refit(
    case: Case,
    camera: Camera,
    clean: list[Array],
    before: Array,
    displacement: Array,
    force: Array,
    deviation: float,
    shape: Callable[[Array], Array] | None,
) -> dict[str, object]:
    """Fit all moduli to pictures without noise and the response, by two Gauss-Newton steps on a coarse mesh.

    `before` are the sub-pixels of the first picture, without blur. Return the root mean square of what is left over
    that of the noise: in pictures (smoothed by one pixel, without three pixels along the outline) and the response.
    """
    body = coarse_body(case, shape=shape)
    problem = Problem(body, Contact(case.base, case.plate), case.thickness)
    forced = case.control == "force"
    given, answer = (force, displacement) if forced else (displacement, force)
    plain = replace(camera, view=None, light=None)
    splines = before.reshape([n * camera.parts for n in camera.shape])
    origin = camera.first - camera.pixel / 2 + camera.pixel / camera.parts / 2
    level = case.noise[1]

    def predict(logs: Array) -> tuple[list[Array], Array, list[Array]]:
        law = stated_material(case, problem, np.exp(logs))
        states = problem.solve(law, [Load(float(k), float(v)) for k, v in enumerate(given)], forced)
        pictures, masks = [], []
        for k, state in enumerate(states):
            found, kind = plain.trace(body, state.u, k + 1)
            fine = np.full(len(found), DARK)
            on = kind >= 0
            at = (found[on] - origin) / (camera.pixel / camera.parts)
            fine[on] = map_coordinates(splines, at.T, order=1, mode="nearest")
            pictures.append(plain.expose(fine, k + 1))
            blocks = [n for size in camera.shape for n in (size, camera.parts)]
            whole = on.reshape(blocks).all(tuple(range(1, 2 * body.dim, 2)))
            masks.append(binary_erosion(whole, iterations=3))
        got = np.array([s.displacement if forced else s.force for s in states])
        return pictures, got, masks

    def stack(pictures: list[Array], got: Array, masks: list[Array]) -> Array:
        parts = [((p - c) / level)[m] for p, c, m in zip(pictures, clean[1:], masks, strict=True)]
        return np.concatenate([*parts, (got - answer) / deviation])

    logs = np.log(case.moduli.astype(float))
    for _ in range(2):
        pictures, got, masks = predict(logs)
        rest, columns = stack(pictures, got, masks), []
        for k in range(len(logs)):
            other = logs + 0.03 * (np.arange(len(logs)) == k)
            more, answer_more, _ = predict(other)
            columns.append((stack(more, answer_more, masks) - rest) / 0.03)
        step = np.linalg.lstsq(np.stack(columns, 1), -rest, rcond=None)[0]
        logs = logs + np.clip(step, -0.5, 0.5)
    pictures, got, masks = predict(logs)
    damp = (2 * np.sqrt(np.pi)) ** (-body.dim / 2)  # of white noise, by the smoothing
    steps = []
    for p, c, m in zip(pictures, clean[1:], masks, strict=True):
        smooth = gaussian_filter(p - c, 1.0)[m]
        steps.append(float(np.sqrt((smooth**2).mean()) / (level * damp)))
    rest = (got - answer) / deviation
    return {
        "pictures": round(float(np.sqrt(np.mean(np.square(steps)))), 2),
        "pictures by step": [round(s, 2) for s in steps],
        "response": round(float(np.sqrt((rest**2).mean())), 2),
        "response by step": [round(float(r), 1) for r in rest],
        "constants refitted": {f"mu_{n}": float(f"{np.exp(v):.4g}") for n, v in zip(case.names, logs, strict=True)},
    }
