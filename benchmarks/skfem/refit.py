"""Rough size of what is hidden: refit the moduli on a coarse mesh and compare what is left with the noise."""

from __future__ import annotations

import numpy as np
from camera import Camera, inverse
from cases import Case
from material import Material
from scipy.ndimage import binary_closing, binary_erosion, gaussian_filter, map_coordinates, spline_filter
from solver import Block, Boundary

Array = np.ndarray


def refit(
    case: Case,
    heights: list[float],
    camera: Camera,
    pictures: list[Array],
    displacement: Array,
    force: Array,
    deviation: float,
) -> tuple[dict[str, float], dict[str, float]]:
    """Gauss-Newton steps from the true moduli on pictures without noise, smoothed by one pixel, and the response.

    Returns
    -------
    dict, dict
        Root mean square of what is left over that of the noise, in pictures (largest step, all steps) and response;
        the moduli.
    """
    block = Block(
        case.width,
        heights[::-1],
        14,
        [max(4, 12 // len(heights))] * len(heights),
        Boundary(case.base == "held", case.indenter == "glued"),
    )
    forced = case.control == "force"
    path = [(float(k), v) for k, v in enumerate(force / case.thickness if forced else displacement)]
    spline = spline_filter(pictures[0], order=3)
    at = camera.places()[:, 0]
    noise = case.noise[1] * np.sqrt(2) / np.sqrt(4 * np.pi)  # of a difference of smoothed pictures
    bodies = [binary_erosion(binary_closing(p > 0.02, iterations=3), iterations=4) for p in pictures[1:]]
    smooth = [gaussian_filter(p, 1.0) for p in pictures]

    def residual(log_mu: Array) -> tuple[Array, list[Array]]:
        mu = np.exp(log_mu)[::-1][block.layer_at]
        material = Material(mu, np.full(len(mu), case.alpha), np.full(len(mu), case.nu))
        answers = block.solve(path, material, forced)
        parts = []
        for (q, _, _), picture, body in zip(answers, smooth[1:], bodies, strict=True):
            source, inside = inverse(block.sample(q, 3), at)
            warped = np.zeros(len(at))
            grid = (source[inside] - np.array(camera.origin)).T / camera.pixel
            warped[inside] = map_coordinates(spline, grid, order=3, prefilter=False, mode="nearest")
            difference = gaussian_filter(warped.reshape(camera.shape), 1.0) - picture
            parts.append((difference / noise * body).ravel())
        model = np.array([d if forced else f * case.thickness for _, d, f in answers])
        response = (model - (displacement if forced else force)) / deviation
        return response, parts

    def stacked(log_mu: Array) -> Array:
        # one picture's pixels are correlated after smoothing: about one in four pi counts
        response, parts = residual(log_mu)
        return np.concatenate([response] + [p / np.sqrt(4 * np.pi) for p in parts])

    log_mu = np.log([layer[2] for layer in case.layers])
    for _ in range(2):
        base = stacked(log_mu)
        steps = 0.02 * np.eye(len(log_mu))
        matrix = np.stack([stacked(log_mu + step) - base for step in steps], axis=1) / 0.02
        log_mu = log_mu - np.linalg.lstsq(matrix, base, rcond=None)[0].clip(-0.5, 0.5)
    response, parts = residual(log_mu)
    rms = [float(np.sqrt(np.mean(p[b.ravel()] ** 2))) for p, b in zip(parts, bodies, strict=True)]
    size = {
        "pictures, worst step": round(max(rms), 2),
        "pictures, all": round(float(np.sqrt(np.mean(np.square(rms)))), 2),
        "response": round(float(np.sqrt(np.mean(response**2))), 2),
    }
    return size, {f"mu_{layer[0]}": float(f"{m:.4g}") for layer, m in zip(case.layers, np.exp(log_mu), strict=True)}
