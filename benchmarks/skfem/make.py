"""Make the studies: python make.py --out DIR [--only NAME ...] [--seed N]."""

from __future__ import annotations

import argparse
import csv
import json
import time
from pathlib import Path

import numpy as np
import yaml
from camera import Camera, with_noise, write
from cases import CASES, Case
from material import Material
from refit import refit
from scipy.special import erfc
from solver import Block, Boundary
from texture import Texture

Array = np.ndarray
FULL = 4000.0


def true_body(case: Case, fine: int = 1) -> tuple[Block, Material]:
    """Build the body as it is, with all that is hidden in material, structure and boundary."""
    fx = case.effects
    heights = [height for _, height, _ in case.layers][::-1]
    names = [name for name, _, _ in case.layers][::-1]
    levels = np.concatenate([[0], np.cumsum(heights)])
    bend = None
    if "meniscus" in fx:
        rise, length = fx["meniscus"]

        def bend(x: Array, y: Array) -> Array:
            curve = np.cosh((x - case.width / 2) / length) / np.cosh(case.width / 2 / length)
            curve = rise * (curve - np.tanh(case.width / 2 / length) * 2 * length / case.width)
            share = np.where(y < levels[1], y / levels[1], (levels[-1] - y) / (levels[-1] - levels[1]))
            return y + curve * share

    boundary = Boundary(case.base == "held", case.indenter == "glued")
    boundary.base_shear = fx.get("base_shear")
    if "wall" in fx:
        boundary.wall = (case.width + fx["wall"][0], fx["wall"][1])
    if "rock" in fx:
        boundary.rock = (fx["rock"][0] * case.width, fx["rock"][1])
    count = max(7, round(24 / len(heights)))
    block = Block(case.width, heights, 30 * fine, [count * fine] * len(heights), boundary, bend)
    x, y = block.where
    mu = np.array([mu for _, _, mu in case.layers][::-1])[block.layer_at]
    material = Material(mu, np.full(len(mu), case.alpha), np.full(len(mu), case.nu))
    if "skin" in fx:
        gain, depth = fx["skin"]
        material.mu = mu * (1 + gain * (erfc(x / depth) + erfc((case.width - x) / depth)))
    if "nodule" in fx:
        across, up, radius, factor = fx["nodule"]
        dx, dy = x - across * case.width, y - up * levels[-1]
        angle = np.arctan2(dy, dx)
        border = radius * (1 + 0.18 * np.cos(2 * angle + 0.5) + 0.12 * np.sin(3 * angle) + 0.07 * np.cos(5 * angle + 1))
        material.mu = mu * (1 + (factor - 1) / (1 + np.exp((np.hypot(dx, dy) - border) / (0.06 * radius))))
    if "bubbles" in fx:
        name, share, length = fx["bubbles"]
        k = names.index(name)
        gas = share * np.exp(-(levels[k + 1] - y) / length) * (block.layer_at == k)
        bulk = 1 / (1 / material.bulk() + 3 * gas / (4 * mu * (1 - gas)))
        material.mu = mu * (1 - 5 * gas / 3)
        material.nu = (3 * bulk - 2 * material.mu) / (6 * bulk + 2 * material.mu)
    if "fibres" in fx:
        name, gain, b, angle, wave = fx["fibres"]
        material.fibre_k = gain * mu * (block.layer_at == names.index(name))
        material.fibre_b, material.fibre_angle = b, angle + wave * np.sin(2 * np.pi * x / case.width * 1.5 + y / 3)
    if "relax" in fx:
        name, prony, _ = fx["relax"]
        material.prony = prony
        material.share_at = (block.layer_at == names.index(name)).astype(float)
    return block, material


def schedule(case: Case) -> list[tuple[float, float, bool]]:
    """List times, shares of the largest load, and whether it is a step."""
    shares = (np.arange(case.steps) + 1) / case.steps
    if "relax" not in case.effects:
        dwells = np.random.default_rng(len(case.title)).choice([5, 10, 20, 45, 90], case.steps)
        return [(float(now), share, True) for now, share in zip(np.cumsum(dwells), shares, strict=True)]
    events, now = [], 0.0
    for share, dwell in zip(shares, case.effects["relax"][2], strict=True):
        before = events[-1][1] if events else 0.0
        events += [(now + 2 * part, before + part * (share - before), False) for part in (0.5, 1.0)]
        now += 2
        ends = dwell * np.array([0.1, 0.3, 0.6, 1.0])
        events += [(now + end, share, end == dwell) for end in ends]
        now += dwell
    return events


def camera_of(case: Case, height: float) -> Camera:
    """Pixels of the pictures, with light and lens."""
    pixel = case.width / case.pixels * 1.0137
    side, below, above = 0.34 * case.width, 0.33 * height, 0.33 * height
    shape = (int((case.width + 2 * side) / pixel), int((height + below + above) / pixel))
    camera = Camera((-side + 0.31 * pixel, -below + 0.17 * pixel), pixel, shape)
    if "lens" in case.effects:
        gain, across, up = case.effects["lens"]
        centre = np.array([across * case.width, up * height])
        camera.lens = lambda at: (
            at + gain * (((at - centre) / (0.5 * case.width)) ** 2).sum(axis=1)[:, None] * (at - centre)
        )
    if "lamp" in case.effects:
        far, way = case.effects["lamp"]

        def light(at: Array, step: int) -> Array:
            lamp = np.array([case.width * 0.3 + way * step / case.steps, height * 1.1 - 1.5 * way * step / case.steps])
            return 1 / (1 + ((at - lamp) ** 2).sum(axis=1) * (far / case.width) ** 2)

        camera.light = light
    return camera


def simulate(case: Case) -> dict[str, object]:
    """States of the body at the steps, with displacement and force as they are (not yet read off)."""
    block, material = true_body(case)
    forced = case.control == "force"
    height = float(sum(layer[1] for layer in case.layers))
    start = np.zeros(block.into.shape[1])
    d0 = f0 = 0.0
    largest = case.strain * height
    if forced:  # the force that gives about the wanted displacement
        probe, same = true_body(case)
        probe.boundary.rock = None
        found = probe.solve([(1.0, largest / 2), (2.0, largest)], same, forced=False)
        largest = float(f"{found[-1][2] * case.thickness:.3g}") / case.thickness
    if "preload" in case.effects:
        f0 = case.effects["preload"] * largest
        start, d0, _ = block.solve([(0.0, f0)], material, True)[-1]
    if "askew" in case.effects:
        for part in np.linspace(0.1, 1, 10):
            start[-3] = part * case.effects["askew"]
            start, d0, _ = block.solve([(0.0, 0.0)], material, True, start)[-1]
    offset = f0 if forced else d0
    events = schedule(case)
    answers = block.solve(
        [(t, offset + share * largest) for t, share, _ in events], material, forced, start, value=offset
    )
    kept = [(t, answer) for (t, _, step), answer in zip(events, answers, strict=True) if step]
    return {
        "block": block,
        "states": [start] + [a[0] for _, a in kept],
        "times": [t for t, _ in kept],
        "displacement": np.array([a[1] - d0 for _, a in kept]),
        "force": np.array([a[2] - f0 for _, a in kept]) * case.thickness,
        "height": height - d0,
    }


def make(name: str, case: Case, out: Path, seed: int) -> None:
    """Write one study and what is hidden in it."""
    began = time.time()
    rng = np.random.default_rng([seed, int(name[1:])])
    made = simulate(case)
    block: Block = made["block"]
    height = float(made["height"])
    camera = camera_of(case, height)
    texture = Texture(case.texture, case.width, block.height, camera.pixel, rng)
    clean = [camera.picture(block.sample(q), texture, k) for k, q in enumerate(made["states"])]
    displacement, force = made["displacement"].copy(), made["force"].copy()
    if "frame" in case.effects:
        displacement += case.effects["frame"] * force ** (2 / 3)
    measured = displacement if case.control == "force" else force
    deviation = float(f"{case.reading * measured.max():.2g}")
    heights = [round(float(layer[1] * height / block.height), 2) for layer in case.layers]
    size, fitted = refit(case, heights, camera, clean, displacement, force, deviation)

    kind, level, stated = case.noise
    folder = out / "studies" / name
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    (out / "sealed").mkdir(exist_ok=True)
    files = ["before"] + [f"step_{k + 1}" for k in range(case.steps)]
    for file, picture in zip(files, clean, strict=True):
        write(folder / "pictures" / f"{file}.nii.gz", with_noise(picture, kind, level, FULL, rng), camera, case.origin)
    noise: object = {"estimated": "estimated", "number": level * FULL, "repeats": ["pictures/again.nii.gz"]}[stated]
    if stated == "repeats":
        write(folder / "pictures" / "again.nii.gz", with_noise(clean[0], kind, level, FULL, rng), camera, case.origin)
    measured += rng.normal(0, deviation, case.steps)
    rows = [
        [k + 1, f"{made['times'][k]:g}", f"{displacement[k]:.5g}", f"{force[k]:.6g}", f"pictures/{files[k + 1]}.nii.gz"]
        for k in range(case.steps)
    ]
    with (folder / "steps.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([["step", "time", "displacement", "force", "picture"], *rows])
    _write_texts(name, case, folder, out, heights, noise, deviation, rng)
    sealed = {
        "hidden": [{"family": family, "what": what, "size": size} for family, what in case.hidden],
        "constants": {f"mu_{layer[0]}": layer[2] for layer in case.layers},
        "refit on a coarse mesh": fitted,
        "residual over noise": size,
        "effects": {k: str(v) for k, v in case.effects.items()},
    }
    (out / "sealed" / f"{name}.json").write_text(json.dumps(sealed, indent=1) + "\n")
    print(f"{name} {time.time() - began:.0f} s, residual over noise: {size}", flush=True)


def _write_texts(
    name: str,
    case: Case,
    folder: Path,
    out: Path,
    heights: list[float],
    noise: object,
    deviation: float,
    rng: np.random.Generator,
) -> None:
    """Write study.yaml and config.yaml."""
    response = "displacement" if case.control == "force" else "force"
    study = {
        "title": case.title,
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": case.control,
        "steps": "steps.csv",
        "pictures": {"before": "pictures/before.nii.gz", "noise": noise},
        "noise": {response: deviation},
        "body": {
            "width": case.width,
            "thickness": case.thickness,
            "origin": list(case.origin),
            "layers": [{"name": la[0], "height": h} for la, h in zip(case.layers, heights, strict=True)],
        },
        "boundary": {"base": case.base, "indenter": case.indenter},
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False, width=120))
    parameters = {}
    for layer in case.layers:
        start = float(f"{layer[2] * 2 ** rng.uniform(-1, 1):.2g}")
        parameters[f"mu_{layer[0]}"] = {
            "unit": "MPa",
            "start": start,
            "lower": float(f"{start / 30:.1g}"),
            "upper": float(f"{start * 30:.1g}"),
        }
    rows = {1: 8, 2: 5, 3: 4, 4: 3}[len(case.layers)]
    config = {
        "study": str(folder.resolve()),
        "results": str(out.resolve().parent / "results"),
        "model": {
            "material": {"alpha": case.alpha, "poisson": case.nu},
            "mesh": {"element": "CPE8H", "across": 10, "per_layer": rows, "grading": 4},
            "refined": {"element": "CPE8H", "across": 16, "per_layer": round(1.6 * rows), "grading": 4},
            "parameters": parameters,
        },
        "fit": {"score": "likelihood", "stages": [{"name": "search", "kind": "least_squares"}]},
    }
    (folder / "config.yaml").write_text(yaml.safe_dump(config, sort_keys=False, width=120))


def main() -> None:
    """Read the arguments and make the studies."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="+", default=list(CASES))
    parser.add_argument("--seed", type=int, default=3)
    args = parser.parse_args()
    for name in args.only:
        make(name, CASES[name], args.out, args.seed)


if __name__ == "__main__":
    main()
