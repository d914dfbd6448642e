"""Do the intervals hold the truth? The phantom measured twenty times over, each time with new noise.

The body of studies/phantom/experiment.yaml is solved once by the solver that it names; its answer without noise is
kept in benchmarks/.cache. Each measurement is then fitted as config.yaml says. Result: benchmarks/noise.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from fitting import CACHE, ROOT, fit_study
from scipy.stats import t as student

from fingerfit.core.files import digest
from fingerfit.imaging.pictures import Picture
from fingerfit.virtual.experiment import Solved, Truth, solve, write_study
from fingerfit.virtual.file import read_truth

DESCRIPTION = ROOT / "studies/phantom/experiment.yaml"


def solved_once(truth: Truth) -> Solved:
    """The answer without noise, from the cache where it is."""
    # another description, or other quantities, are another file
    cache = CACHE / f"solved_{digest(DESCRIPTION.read_text(encoding='utf-8'), *Solved.__annotations__)}.npz"
    if not cache.exists():
        with tempfile.TemporaryDirectory() as folder:
            made = solve(truth, Path(folder))
        cache.parent.mkdir(exist_ok=True)
        frame = {"spacing": made.frame.spacing, "origin": made.frame.origin}
        np.savez_compressed(cache, force=made.force, pictures=made.pictures, displacement=made.displacement, **frame)
    with np.load(cache) as kept:
        empty = np.zeros(kept["pictures"].shape[1:])
        frame = Picture(empty, kept["spacing"], kept["origin"], np.eye(2))
        return Solved(kept["force"], kept["pictures"], frame, kept["displacement"])


def entries(found: dict[str, Any], truth: dict[str, float], replicates: int) -> list[dict[str, Any]]:
    """One row for each constant."""
    factor, rows = student.ppf(0.975, replicates - 1), []
    for name, entry in found["parameters"].items():
        value, (low, high) = entry["value"], entry["interval95"]
        apart = abs(np.log(truth[name] / value))
        rows.append(
            {
                "name": name,
                "value": value,
                "error": value / truth[name] - 1,
                "standard_error": entry["standard_error"] / value,
                "mesh_error": entry["mesh_error"] / value,
                "held": low <= truth[name] <= high,
                "held_by_noise": apart <= factor * entry["standard_error"] / value,
            }
        )
    return rows


def report(fits: list[list[dict[str, Any]]], seeds: list[int], seconds: float) -> str:
    """The tables, in Markdown."""
    count = len(fits)
    lines = [
        f"# The phantom with {count} realisations of the noise",
        "",
        "Made by `benchmarks/noise.py` (`make benchmark`): the body of `studies/phantom/experiment.yaml`, noise of the",
        f"seeds {seeds[0]} to {seeds[-1]}, fitted as `config.yaml` says; {seconds:.0f} s of processor time for each",
        "fit in one process.",
        "",
        "| constant | mean error | spread | mean std. error | mean mesh error | largest error | intervals that hold the"
        " truth | by noise alone |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for rows in zip(*fits, strict=True):
        error = np.array([row["error"] for row in rows])
        within = [np.mean([row[key] for row in rows]) for key in ("standard_error", "mesh_error")]
        held = [sum(row[key] for row in rows) for key in ("held", "held_by_noise")]
        lines.append(
            f"| {rows[0]['name']} | {100 * error.mean():+.2f} % | {100 * error.std(ddof=1):.2f} % |"
            f" {100 * within[0]:.2f} % | {100 * within[1]:.2f} % | {100 * error[np.abs(error).argmax()]:+.2f} % |"
            f" {held[0]} of {count} | {held[1]} of {count} |"
        )
    together = [sum(all(row[key] for row in rows) for rows in fits) for key in ("held", "held_by_noise")]
    lines += [
        "",
        f"All constants of a fit at once: {together[0]} of {count} hold the truth; by noise alone {together[1]} of"
        f" {count}.",
        "",
        "*Spread*: standard deviation of the estimates over the realisations, to be compared with the *standard error*",
        "that each fit states. The 95 % interval that a fit states joins noise and mesh error; *by noise alone* is the",
        "interval that the standard error alone would give. The error of the mesh is the same in all realisations:",
        "what it does to the estimate is in the *mean error*.",
        "",
        "| seed | constant | estimate, MPa | error | std. error | mesh error | interval holds | noise alone |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for seed, rows in zip(seeds, fits, strict=True):
        for row in rows:
            answers = ["yes" if row[key] else "no" for key in ("held", "held_by_noise")]
            lines.append(
                f"| {seed} | {row['name']} | {row['value']:.5f} | {100 * row['error']:+.2f} % |"
                f" {100 * row['standard_error']:.2f} % | {100 * row['mesh_error']:.2f} % | {' | '.join(answers)} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20, help="realisations")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/noise.md")
    args = parser.parse_args()
    truth = read_truth(DESCRIPTION)
    solved = solved_once(truth)
    config = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))
    constants = {f"mu_{layer['name']}": layer["mu"] for layer in truth.layers}
    seeds, fits, start = list(range(1, args.count + 1)), [], time.process_time()
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            study = Path(folder) / "study"
            write_study(truth, solved, study, seed)
            fitted = fit_study({**config, "study": str(study)}, Path(folder))
        replicates = fitted.problem.settings.fit.replicates
        fits.append(entries(fitted.estimate, constants, replicates))
        shown = ", ".join(f"{row['name']} {100 * row['error']:+.2f} %" for row in fits[-1])
        print(f"seed {seed:2d}: {shown}", flush=True)
    args.out.write_text(report(fits, seeds, (time.process_time() - start) / args.count))


if __name__ == "__main__":
    main()
