"""Make studies with CalculiX, some with hidden effects.

`python benchmarks/calculix/make.py --out FOLDER [--only h01 ...] [--seed N]`

Each study is a folder FOLDER/hNN with study.yaml, steps.csv, pictures and config.yaml; its true constants and what is
hidden in it stand in FOLDER/sealed/hNN.json. A study that could not be made is told on the terminal and by the exit
code. What is there already is made again. See README.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from hidden_table import effects_of
from pictures import pixels_of, take
from simulation import simulate
from solve import NotSolved
from study_table import STUDIES, Study
from write import write


def make(study: Study, out: Path) -> dict[str, Any]:
    """Make a study and its truth; returns what is told of it on the terminal."""
    began = time.perf_counter()
    effects = effects_of(study)
    simulated = simulate(study, effects)
    folder, sealed = out / study.name, out / "sealed"
    sealed.mkdir(parents=True, exist_ok=True)
    pixels = pixels_of(study)
    write(folder, study, pixels, take(study, effects, simulated), simulated.displacement, simulated.force)
    truth = {
        "hidden": effects.told,
        "constants": {f"mu_{layer.name}": layer.modulus for layer in study.layers},
    }
    (sealed / f"{study.name}.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return {
        "study": study.name,
        "largest_force": round(float(simulated.force.max()), 2),
        "elements": len(simulated.quads),
        "pixel": round(pixels.side, 4),
        "seconds": round(time.perf_counter() - began),
    }


def main() -> int:
    """Make what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the studies")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="names, such as h01")
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="0: the studies of README.md; others: other steps, textures, noise and sizes of what is hidden",
    )
    args = parser.parse_args()
    if args.seed < 0:
        parser.error(f"--seed {args.seed}: expected 0 or more")
    unknown = set(args.only or ()) - {study.name for study in STUDIES}
    if unknown:
        parser.error(f"--only {' '.join(sorted(unknown))}: no such study")
    failed = []
    for study in STUDIES:
        if args.only and study.name not in args.only:
            continue
        try:
            print(json.dumps(make(replace(study, series=args.seed), args.out)), flush=True)
        except NotSolved as error:  # the other studies get their turn
            print(f"{study.name}: {error}", flush=True)
            failed.append(study.name)
    if failed:
        print(f"not made: {', '.join(failed)}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
