"""The simplex and the least squares of the search, on the same studies: constants, simulations, time."""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from fitting import ROOT, Fitted
from phantom import config_of, fitted, table

STUDIES = ("phantom", "hidden-tilt", "hidden-inclusion")
DESCENT = {"name": "least squares", "kind": "least_squares", "tolx": 0.02}
HEAD = """# Simplex and least squares

Made by `benchmarks/least_squares.py`: fits in one process with one thread, one simulation after the other, both kinds
in turn. Settings of `config.yaml`; least squares: `stages: [{{name: least squares, kind: least_squares, tolx: 0.02}}]`,
from the same start, without a grid. `hidden-tilt` and `hidden-inclusion` hide an effect that this model lacks. Both
searches end on the coarse mesh; what follows them (slopes, finer mesh) is the same and counted in *all*. Error: of the
estimate against the truth. Apart: estimates of both searches, in standard errors (noise only).
Load of the machine: {load:.1f} at the beginning.

"""


def measure(name: str, stages: list[dict[str, Any]] | None) -> tuple[Fitted, float]:
    """A fit and its seconds on the clock."""
    config = config_of("config.yaml")
    config["study"] = str(ROOT / "studies" / name)
    if stages:
        config["fit"]["stages"] = stages
    start = time.perf_counter()
    return fitted(config), time.perf_counter() - start


def rows_of(name: str) -> list[list[str]]:
    """Both searches of one study."""
    truth = yaml.safe_load((ROOT / f"studies/{name}/sealed/truth.yaml").read_text(encoding="utf-8"))["constants"]
    found = {kind: measure(name, stages) for kind, stages in (("simplex", None), ("least squares", [DESCENT]))}
    reference = found["simplex"][0].estimate["parameters"]
    rows, base = [], None
    for kind, (fit, wall) in found.items():
        entries = fit.estimate["parameters"]
        errors = [f"{100 * (entry['value'] / truth[key] - 1):+.2f} %" for key, entry in entries.items()]
        apart = max(
            abs(e["value"] - reference[k]["value"]) / reference[k]["standard_error"] for k, e in entries.items()
        )
        cpu = sum(fit.seconds.values())
        base = base or (cpu, wall)
        rows.append(
            [
                name,
                kind,
                ", ".join(errors),
                f"{apart:.2f}",
                f"{fit.estimate['search']['guesses']}",
                f"{fit.estimate['simulations']['run']}",
                f"{cpu:.1f} s ({cpu / base[0]:.2f})",
                f"{wall:.1f} s ({wall / base[1]:.2f})",
                fit.estimate["search"]["stop"],
            ]
        )
    return rows


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/least_squares.md")
    args = parser.parse_args()
    text = HEAD.format(load=os.getloadavg()[0])
    rows = [row for name in STUDIES for row in rows_of(name)]
    head = ["study", "search", "errors: top, middle, bottom", "apart", "guesses", "all simulations",
            "processor time (ratio)", "clock (ratio)", "end"]  # fmt: skip
    shares = np.array([float(row[6].split("(")[1][:-1]) for row in rows[1::2]])
    last = f"\nProcessor time of least squares as a share of the simplex: {shares.min():.2f} to {shares.max():.2f}.\n"
    args.out.write_text(text + "\n".join(table(head, rows)) + "\n" + last, encoding="utf-8")
    print(args.out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
