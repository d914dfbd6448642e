"""Make studies whose pictures are blurred as a camera blurs them, some with hidden effects.

`python benchmarks/camera/make.py --out FOLDER [--only w01 ...]`

Each study is a folder FOLDER/wNN with study.yaml, steps.csv, pictures and config.yaml; its true constants and what is
hidden in it stand in FOLDER/sealed/wNN.json. A study that could not be made is told on the terminal and by the exit
code. What is there already is made again. See README.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from hidden import Effects
from hidden_table import effects_of
from measure import sizes
from simulation import Simulated, grid_of, indentations_of, measured, pictures, simulate
from study_table import STUDIES, Study
from write import write_config, write_pictures, write_steps, write_study

COARSE = 14
"""Elements along the side of a square as large as the body, in a coarser mesh for comparison."""
WITHIN = 3
"""Points along the side of a pixel."""


def make(study: Study, folder: Path) -> dict[str, Any]:
    """Make a study in a folder; returns what is told of it on the terminal."""
    began = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    effects = effects_of(study)
    moduli = np.array([layer.modulus for layer in study.layers])
    indentations = indentations_of(study)
    count = study.steps
    rng = np.random.default_rng(7000 + study.number)
    # drawn in any case, so that the noise does not depend on whether an effect has times of its own
    times = np.round(np.cumsum(40 + 50 * rng.random(count)))
    if effects.times is not None:
        times = effects.times
    simulated = simulate(study, effects, moduli, indentations, study.elements)
    coarse = simulate(study, effects, moduli, indentations, COARSE)
    displacement, force = measured(effects, indentations, simulated.force)
    force_noise = float(f"{study.noise.force * force.max():.2g}")
    displacement_noise = float(f"{study.noise.displacement * study.look.pixel:.2g}")
    noisy_force = force + force_noise * rng.standard_normal(count)
    noisy_displacement = displacement + displacement_noise * rng.standard_normal(count)
    clean = pictures(study, effects, simulated, WITHIN)
    written = write_pictures(folder, study, clean, rng)
    write_steps(folder, times, noisy_displacement, noisy_force)
    heights = first_heights(study, effects, simulated)
    write_study(folder, study, heights, force_noise, displacement_noise, written.noise)
    write_config(folder, study)
    grid = grid_of(study)
    return {
        "study": study.name,
        "largest_force": round(float(force[-1]), 2),
        "compression": round(float(displacement[-1] / sum(heights)), 3),
        "force_noise": force_noise,
        "displacement_noise": displacement_noise,
        "pixels": [grid.columns, grid.rows],
        "elements": len(simulated.block.elements),
        "mesh_change": round(float(np.abs(coarse.force / simulated.force - 1).max()), 5),
        "inverse_error": float(clean[-1].error),
        "saturated": written.saturated,
        "seconds": round(time.perf_counter() - began),
    }


def first_heights(study: Study, effects: Effects, simulated: Simulated) -> list[float]:
    """Heights of the layers in the first picture, mean over the width, from the base on, mm."""
    if not effects.preload:
        return study.heights
    levels = np.r_[0, np.cumsum(study.heights)] / (1 - effects.preload)
    block = simulated.block
    seen = block.nodes + simulated.before
    tolerance = 1e-9 * block.height + 1e-9
    places = [seen[np.abs(block.nominal[:, 1] - level) < tolerance, 1].mean() for level in levels]
    return [round(float(height), 2) for height in np.diff(places)]


def truth(study: Study) -> dict[str, Any]:
    """What is hidden in a study, and its constants in MPa."""
    return {
        "hidden": effects_of(study).told,
        "constants": {f"mu_{layer.name}": layer.modulus for layer in study.layers},
    }


def _one(study: Study, out: Path, measure: bool) -> bool:
    """Make a study and its truth; whether it could be made."""
    sealed = out / "sealed"
    sealed.mkdir(parents=True, exist_ok=True)
    try:
        said = make(study, out / study.name)
        _dump(sealed / f"{study.name}.json", truth(study))
        if measure:
            effects = effects_of(study)
            _dump(sealed / f"{study.name}-size.json", sizes(study, effects) if effects.told else None)
    except Exception as error:  # the other studies get their turn; it is told, and counts as not made
        print(f"{study.name}: {type(error).__name__}: {error}", flush=True)
        return False
    print(json.dumps(said), flush=True)
    return True


def _dump(file: Path, content: dict[str, Any] | None) -> None:
    file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    """Make what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the studies")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="names, such as w01")
    parser.add_argument(
        "--measure",
        action="store_true",
        help="write also how large the hidden effects are over the noise, to sealed/wNN-size.json",
    )
    args = parser.parse_args()
    unknown = set(args.only or ()) - {study.name for study in STUDIES}
    if unknown:
        parser.error(f"--only {' '.join(sorted(unknown))}: no such study")
    wanted = [study for study in STUDIES if not args.only or study.name in args.only]
    failed = [study.name for study in wanted if not _one(study, args.out, args.measure)]
    if failed:
        print(f"not made: {', '.join(failed)}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
