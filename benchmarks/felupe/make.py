"""Make the studies: python make.py --out FOLDER [--only NAME ...] [--seed N]."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from body import Body
from camera import Camera, Texture, brightness
from cases import Case, coarse_body, contact_of, load, outline, stated_material, true_body, true_material
from refit import refit
from scipy.interpolate import LinearNDInterpolator
from solver import Contact, Load, Problem, State
from study import write_config, write_pictures, write_steps, write_study

Array = np.ndarray
GRAVITY = 9.81e-6  # N/mm3 of water


@dataclass
class Made:
    """States of the body as it is: the first one is that of the picture before compression."""

    body: Body
    states: list[State]
    displacement: Array
    force: Array
    shape: Callable[[Array], Array] | None  # the outline as stated, where it is not that of the case


def largest(case: Case) -> tuple[float, float]:
    """Displacement and force of the last step, from a coarse mesh of the body as stated."""
    body = coarse_body(case)
    problem = Problem(body, Contact(case.base, case.plate), case.thickness)
    way = float(f"{case.strain * case.height:.3g}")
    law = stated_material(case, problem, case.moduli)
    found = problem.solve(law, [Load(float(k), way * k / 4) for k in (1, 2, 3, 4)], forced=False)
    return way, float(f"{found[-1].force:.3g}")


def simulate(case: Case, fine: float = 1.0) -> Made:
    """Solve the body as it is at all steps."""
    way, force = largest(case)
    forced = case.control == "force"
    body = true_body(case, fine)
    problem = Problem(body, contact_of(case, force), case.thickness)
    law, drain = true_material(case, problem)
    fx = case.effects
    weight = problem.gravity(fx["gravity"] * GRAVITY) if "gravity" in fx else None
    start = State(np.zeros_like(body.points), 0.0, 0.0, np.zeros(problem.size))
    shape = None
    if weight is not None or "shrink" in fx:
        for part in (0.25, 0.5, 0.75, 1.0):
            now, pull = law, None if weight is None else part * weight
            if "shrink" in fx:
                now = true_material(_partly(case, part), problem)[0]
            start = problem.balance(now, Load(0.0, 0.0), True, start.q, pull)
        shape = _deformed(case, true_body(case, fine, flat=True), start.u)
    d0 = start.displacement
    times = case.times or list(np.arange(1.0, len(case.shares) + 1))
    loads = []
    for k, (share, now) in enumerate(zip(case.shares, times, strict=True)):
        shift = fx["backlash"][0] if "backlash" in fx and k + 1 >= fx["backlash"][1] else 0.0
        value = share * (force if forced else way) + (0.0 if forced else d0)
        if drain is not None:  # the load is raised in 10 s and held until the step is read
            last = loads[-1] if loads else Load(0.0, 0.0)
            ends = last.time + 10 + np.linspace(0, 1, 6)[:-1] ** 2 * max(now - last.time - 10, 0)
            loads.append(Load(last.time + 5, (last.value + value) / 2, shift, step=False))
            loads += [Load(float(t), value, shift, step=False) for t in ends]
        loads.append(Load(float(now), value, shift))
    states = problem.solve(law, loads, forced, start, weight, drain)
    displacement = np.array([s.displacement - d0 for s in states])
    if "screw" in fx:
        error, period = fx["screw"]
        displacement = displacement + error * np.sin(2 * np.pi * displacement / period)
    return Made(body, [start, *states], displacement, np.array([s.force - start.force for s in states]), shape)


def _partly(case: Case, part: float) -> Case:
    """Return the same case with a part of the shrinkage."""
    name, share = case.effects["shrink"]
    return Case(**{**case.__dict__, "effects": {**case.effects, "shrink": [name, part * share]}})


def _deformed(case: Case, flat: Body, u: Array) -> Callable[[Array], Array]:
    """Map the block to the body in the first picture, for the mesh of the study; `flat` is the mesh of the block."""
    read = LinearNDInterpolator(flat.points, u)
    base = outline(case)
    return lambda p: (p if base is None else base(p)) + read(np.clip(p, flat.points.min(0), flat.points.max(0)))


def camera_of(case: Case) -> Camera:
    """Pixels of the pictures, with what moves or changes in them."""
    size = np.array([*case.extent, case.height])
    low, high = -0.32 * size, 1.32 * size
    low[-1], high[-1] = -0.31 * size[-1], 1.31 * size[-1]
    if case.space:
        low, high = -0.14 * size, 1.14 * size
    shape = tuple(int(n) for n in (high - low) / case.pixel)
    camera = Camera(low + case.pixel * np.linspace(0.31, 0.17, len(size)), case.pixel, shape, case.parts)
    camera.blur = case.blur
    fx = case.effects
    if "bracket" in fx:
        angle, right, up = fx["bracket"]
        clamp = np.array([-0.2 * size[0], 0.1 * size[1]])

        def view(points: Array, step: int) -> Array:
            part = np.sqrt(case.shares[step - 1]) if step else 0.0
            turn = np.deg2rad(angle) * part
            spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            return clamp + (points - clamp) @ spin.T + part * np.array([right, up])

        camera.view = view
    if "exposure" in fx:
        camera.light = lambda places, step: np.full(len(places), 1 + (fx["exposure"][step - 1] if step else 0.0))
    return camera


def make(name: str, case: Case, out: Path, seed: int) -> None:
    """Write one study and what is hidden in it."""
    began = time.time()
    rng = np.random.default_rng([seed, int(name[1:]), case.seed])
    made = simulate(case)
    camera = camera_of(case)
    kind, length, spread = case.texture
    points = made.body.points
    texture = Texture(kind, length, points.min(0), points.max(0), camera.pixel / 2.5, rng)
    bright = np.array([layer[3] for layer in case.layers])[::-1]
    borders = made.body.levels[1:-1] if case.ramps else None
    clean, before = [], None
    for k, state in enumerate(made.states):
        found, layer = camera.trace(made.body, state.u, k)
        fine = brightness(texture, found, layer, bright, spread, borders, camera.pixel / camera.parts)
        before = fine if before is None else before
        clean.append(camera.expose(fine, k))
    forced = case.control == "force"
    displacement, force = made.displacement.copy(), made.force.copy()
    response = displacement if forced else force
    deviation = float(f"{case.reading * np.abs(response).max():.2g}")
    size = refit(case, camera, clean, before, displacement, force, deviation, made.shape)
    folder = out / name
    folder.mkdir(parents=True, exist_ok=True)
    noise = write_pictures(case, camera, clean, folder, rng)
    response += rng.normal(0, deviation, len(response))
    times = case.times or list(np.cumsum(rng.choice([20, 30, 45, 60, 90], len(case.shares))).astype(float))
    write_steps(case, folder, times, displacement, force)
    write_study(case, folder, noise, deviation, made.shape)
    write_config(case, folder, out, rng)
    sealed = {
        "hidden": case.hidden,
        "constants": {f"mu_{layer[0]}": layer[2] for layer in case.layers},
        "left by a refit, over the noise": size,
        "effects": {k: str(v) for k, v in case.effects.items()},
        "seed": seed,
    }
    (out / "sealed").mkdir(exist_ok=True)
    (out / "sealed" / f"{name}.json").write_text(json.dumps(sealed, indent=1) + "\n")
    print(f"{name} {time.time() - began:.0f} s, picture {camera.shape}, left: {size}", flush=True)


def main() -> int:
    """Read the arguments and make the studies; mistakes are told in one line."""
    parser = argparse.ArgumentParser(description="Make the studies of the felupe benchmark.")
    parser.add_argument("--out", type=Path, required=True, help="folder of the studies")
    parser.add_argument("--only", nargs="+", help="names of studies; all when left out")
    parser.add_argument("--seed", type=int, default=5, help="of texture and noise")
    args = parser.parse_args()
    name = "cases.yaml"
    try:
        cases = load()
        unknown = [n for n in args.only or [] if n not in cases]
        if unknown:
            msg = f"found {', '.join(unknown)}; expected names of {', '.join(cases)}"
            raise ValueError(msg)
        args.out.mkdir(parents=True, exist_ok=True)
        for name in args.only or list(cases):
            make(name, cases[name], args.out, args.seed)
    except (ValueError, TypeError, KeyError, OSError, FloatingPointError, ArithmeticError) as error:
        print(f"make.py: error: {name}: {str(error).splitlines()[0]}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
