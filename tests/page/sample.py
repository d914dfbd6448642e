"""Results of a study as the page reads them: a layered block whose indenter is tilted, which the first model lacks."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from seeds import generator

from fingerfit.core.files import keep_json, write_npz
from fingerfit.model.catalogue import catalogue

KNOWN = catalogue()

WIDTH = HEIGHT = 12.0
LAYERS = ("top", "middle", "bottom")
PIXEL, EDGE = 0.14, 1.0
STEPS = np.arange(1, 8)
PICTURES = np.array([0, 2, 4, 6])
FITTED = np.array([True, True, False, True])
NOISE, RESIDUAL_NOISE = 0.012, 0.008
TILT = 0.045


def displacement(points, depth, tilt=0.0, friction=0.0):
    """Compression of a block on a base, with a tilt of the indenter or sliding below it."""
    x, y = points[..., 0] / WIDTH - 0.5, np.clip(points[..., 1] / HEIGHT, 0, None)
    down = -depth * y**1.2 - tilt * depth * 6 * x * y**1.5
    bulge = 1.1 * depth * x * np.sin(np.pi * np.clip(y, 0, 1)) ** 1.0 + tilt * depth * 1.5 * np.sin(np.pi * y)
    return np.stack([bulge + friction * depth * x * y**3, down], axis=-1)


def mesh(n=12):
    line = np.linspace(0, WIDTH, n + 1)
    points = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    rings = np.stack([a, a + 1, a + n + 2, a + n + 1], axis=1)
    layer = 2 - (points[rings].mean(axis=1)[:, 1] / 4).astype(int)
    return points, rings, layer


def compare(tilt_left, mu=1.0, seed=3, names=LAYERS):
    """compare.npz of a model that misses `tilt_left` of the tilt."""
    rng = generator(seed)
    n = round((WIDTH + 2 * EDGE) / PIXEL)
    origin = np.array([-EDGE + PIXEL / 2] * 2)
    grid = origin + PIXEL * np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1)
    texture = gaussian_filter(rng.normal(size=(n, n)), 2.2)
    texture = 0.45 + 0.22 * texture / texture.std()
    inside = ((grid >= 0) & (grid <= WIDTH)).all(axis=-1)
    before = np.clip(np.where(inside, texture + 0.06 * (2 - grid[..., 1] // 4), 0.05), 0, 1)
    depths = 0.35 * STEPS

    def picture(depth, tilt, seed):
        moved = grid - displacement(grid, depth, tilt)
        for _ in range(6):
            moved = grid - displacement(moved, depth, tilt)
        index = (moved - origin) / PIXEL
        warped = map_coordinates(before, [index[..., 1], index[..., 0]], order=1, mode="nearest")
        return np.clip(warped + generator(seed).normal(0, NOISE, warped.shape), 0, 1)

    measured = np.array([picture(depths[i], TILT, 10 + i) for i in PICTURES])
    synthesized = np.array([picture(depths[i], TILT - tilt_left, 50 + i) for i in PICTURES])
    points, rings, layer = mesh()
    count = np.array([10, 10])
    centre = np.stack(np.meshgrid(*[(np.arange(10) + 0.5) * WIDTH / 10] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    residual = np.array(
        [displacement(centre, depths[i], TILT) - displacement(centre, depths[i], TILT - tilt_left) for i in PICTURES]
    )
    residual += rng.normal(0, RESIDUAL_NOISE, residual.shape)
    residual[:, [0, 9]] = np.nan
    moved = np.array([points + displacement(points, depths[i], TILT - tilt_left) for i in PICTURES])
    force_model = 0.9 * depths + 0.35 * depths**2
    force = mu * force_model * (1 + 1.2 * tilt_left) + rng.normal(0, 0.03, len(STEPS))
    error = np.sqrt(((measured - synthesized)[:, inside] ** 2).mean(axis=1))
    return {
        "measured": measured, "synthesized": synthesized, "picture_step": PICTURES, "fitted": FITTED, "error": error,
        "floor": np.full(4, NOISE * np.sqrt(2)), "spacing": np.full(2, PIXEL), "origin": origin, "residual_displacement": residual,
        "residual_displacement_noise": np.where(np.isfinite(residual), RESIDUAL_NOISE, np.nan), "patch_centre": centre, "patch_count": count,
        "brightness": np.where(np.isfinite(residual[..., 0]), 0.004, np.nan), "brightness_noise": np.full(residual.shape[:2], 0.003),
        "response": depths * 0.01 - 0.004, "response_noise": np.full(len(STEPS), 0.006), "control": np.array("force"),
        "step_fitted": STEPS != 5, "mesh_points": points, "mesh_moved": moved, "mesh_rings": rings, "mesh_layer": layer,
        "layer_names": np.array(names), "step": STEPS, "force": force, "displacement": depths,
        "force_model": force_model, "displacement_model": depths, "force_noise": 0.03, "displacement_noise": 0.005,
    }  # fmt: skip


def parameters(values, spread):
    return {name: {"value": v, "unit": "N/mm2" if name.startswith("mu") else "deg", "standard_error": spread * v,
                   "interval95": [v * (1 - 2 * spread), v * (1 + 2 * spread)]} for name, v in values.items()}  # fmt: skip


def candidate(effect, title, share, refit, size, unit, shows=None, **more):
    return {
        "effect": effect, "title": title, "words": f"{title}: what the body does then, in plain words.",
        "look": "a difference between left and right that grows with the indentation", "confirm": "put a level on the indenter",
        "acts": "displacement", "place": {}, "size": {effect: size}, "units": {effect: unit},
        "predicted_fall": 5200.0 * share, "share_of_excess": share, "visible": 0.9, "refit": refit, "shows": shows,
        "imitated": False, "pattern_by": "refit" if refit else "first pass", "told": dict(KNOWN[effect].told) if effect in KNOWN else {}, **more,
    }  # fmt: skip


def rung(model, effects, values, spread, error, misfit, verdict, sentence, simulations):
    count = len(values)
    return {"model": model, "effects": effects, "parameters": parameters(values, spread),
            "error": dict(zip(("fitted", "held_out"), error, strict=True)), "misfit": misfit, "freedom": 604 - count, "parameters_count": count,
            "aic": misfit + 2 * count, "bic": misfit + 6.4 * count, "verdict": verdict, "sentence": sentence,
            "simulations": dict(zip(("run", "reused"), simulations, strict=True))}  # fmt: skip


def ladder(done=True):
    rungs = [
        rung("base", [], {"mu_top": 0.0254, "mu_middle": 0.0331, "mu_bottom": 0.0702}, 0.02, (2.71, 3.02), 5710.0, "missing",
             "missing: tilt of the indenter; it explains 94 % of the misfit beyond the noise", (41, 0)),
        rung("base+tilt", ["tilt"], {"mu_top": 0.0212, "mu_middle": 0.0356, "mu_bottom": 0.0655, "tilt": 2.02}, 0.012, (1.01, 1.04),
             611.0, "adequate", "the model explains the measurements to within their noise", (17, 44)),
    ]  # fmt: skip
    listed = [("as measured", (0.02, 0.3), False), ("the same test to 1.2 times the force", (0.06, 0.07), True)]
    rungs[1]["further"] = {
        "mu_bottom": [dict(zip(("title", "interval95", "identified"), one, strict=True)) for one in listed]
    }
    return {"study": "hidden-tilt", "rungs": rungs if done else rungs[:1]}


def diagnosis_of_base():
    refit = {
        "misfit": 611.0,
        "error": {"fitted": 1.01, "held_out": 1.04},
        "parameters": {"tilt": 2.02},
        "explained": 0.87,
    }
    ranking = [
        candidate("indenter_slip", "Indenter slips", 0.98, None, 0.3, "mm", "residual_displacement"),
        candidate("tilt", "Indenter tilt", 0.94, refit, 2.1, "deg", "residual_displacement"),
        candidate(
            "inclusion",
            "An inclusion",
            0.3,
            None,
            0.195,
            "log",
            "residual_displacement",
            place={"across": 0.85, "along": 0.5},
        ),
        candidate("skin", "A skin", 0.2, None, 0.3, "log", "residual_displacement", place={"thickness": 0.5}),
        candidate("intensity_drift", "Drift of the intensity", 0.2, None, 0.01, "1", "brightness"),
        candidate("onset", "Contact onset offset", 0.1, None, 0.02, "mm", "response"),
        candidate("gradient", "Stiffness gradient", 0.05, None, 0.02, "log", "residual_displacement"),
        candidate("split_layer", "A layer that is two", 0.05, None, 0.02, "log", place={"layer": 1.0}),
        candidate("force_gain", "Force gain", 0.04, None, 1.02, "1", visible=0.005, imitated=True),
    ]
    return {
        "model": "base", "verdict": "missing", "sentence": "missing: tilt of the indenter; it explains 94 % of the misfit beyond the noise",
        "effects": ["tilt"], "family": "indenter", "families": [
            {"family": "indenter", "effect": "tilt", "log_odds": 2440.0, "fall": 4890.0,
             "refit": {"effect": "tilt", "log_odds": 0.0}},
            {"family": "structure", "effect": "inclusion", "log_odds": 3.9, "fall": 30.0,
             "refit": {"effect": "inclusion", "log_odds": -12.0}},
            {"family": "loading", "effect": "onset", "log_odds": -1.2, "fall": 1.0}],
        "misfit": 5710.0, "freedom": 601, "threshold": 672.0, "ranking": ranking,
        "confusions": [{"a": "tilt", "b": "gradient", "likeness": 0.91}],
        "measurements": [{"title": "a step with the indenter turned by 180 degrees", "gain": 7.4}, {"title": "two finer pictures", "gain": 1.6}],
        "add": "fingerfit add tilt", "layers": list(LAYERS),
        "patterns": ["tilt", "indenter_slip", "inclusion", "skin", "intensity_drift", "onset", "gradient"],
    }  # fmt: skip


def save(path, arrays):
    path.parent.mkdir(parents=True, exist_ok=True)
    write_npz(path, arrays)


def write(folder, names=LAYERS, done=True, only_compare=False):
    """Write results/{study}; return the folder."""
    base = compare(TILT, names=names)
    save(folder / "base/compare.npz", base)
    if only_compare:
        return folder
    centre, depths = base["patch_centre"], 0.35 * STEPS[PICTURES]
    patterns = {}
    zero = np.array([displacement(centre, d) for d in depths])
    patterns["residual_displacement_tilt"] = np.array([displacement(centre, d, TILT) for d in depths]) - zero
    patterns["residual_displacement_indenter_slip"] = np.array([displacement(centre, d, 0, 0.3) for d in depths]) - zero
    for name, share in (("inclusion", 0.3), ("skin", 0.2), ("gradient", 0.1)):
        patterns[f"residual_displacement_{name}"] = share * patterns["residual_displacement_tilt"]
    patterns["brightness_intensity_drift"] = 0.01 * np.arange(1, 5)[:, None] * np.ones(len(centre))
    patterns["response_onset"] = np.full(len(STEPS), 0.02)
    save(folder / "base/diagnosis.npz", patterns)
    keep_json(folder / "base/diagnosis.json", diagnosis_of_base())
    keep_json(folder / "ladder.json", ladder(done))
    if done:
        save(folder / "base+tilt/compare.npz", compare(0.0, names=names))
        found = {"model": "base+tilt", "verdict": "adequate", "sentence": ladder()["rungs"][1]["sentence"], "effects": [],
                 "misfit": 611.0, "freedom": 600, "threshold": 672.0, "patterns": [], "not_tried": [{"title": "Relaxation", "lacks": "a time at every step"}],
                 "ranking": [candidate("force_gain", "Force gain", 0.0, None, 1.02, "1", imitated=True)], "confusions": [], "measurements": [], "add": ""}  # fmt: skip
        keep_json(folder / "base+tilt/diagnosis.json", found)
    return folder
