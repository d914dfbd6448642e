"""Fit and diagnose the studies that make.py made, one after the other, and write one JSON line for each.

`python benchmarks/foreign/run.py FOLDER --out results.jsonl [--goal diagnose] [--only NAME ...] [--cores 2]`, with the
project's Python. fingerfit is called as a program, as a user calls it; what is sealed is not opened here. Cases that
have a line are not run again. A case that fails or takes too long has a line that says so.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import yaml
from score import final

ROOT = Path(__file__).resolve().parents[2]


def run(study: Path, work: Path, goal: str, cores: int, limit: float) -> dict[str, Any]:
    """Run one study in a folder of its own; the config is copied, since `discover` writes effects into it."""
    work.mkdir(parents=True, exist_ok=True)
    settings = yaml.safe_load((study / "config.yaml").read_text(encoding="utf-8"))
    settings |= {"study": str(study.resolve()), "results": str((work / "results").resolve())}
    config = work / "config.yaml"
    if not config.exists() or goal != "discover":
        config.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-m", "snakemake", goal, "--cores", str(cores), "--configfile", str(config.resolve())]
    began, used = time.perf_counter(), processor_seconds()
    with (work / "log.txt").open("w", encoding="utf-8") as log:
        called = subprocess.Popen(
            command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True
        )
        try:
            code: int | None = called.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(called.pid, signal.SIGTERM)
            called.wait()
            code = None
    row = {
        "name": study.name, "goal": goal, "seconds": round(time.perf_counter() - began, 1),
        "processor_seconds": round(processor_seconds() - used, 1), "code": code,
    }  # fmt: skip
    row["rungs"] = rungs(work / "results")
    row["last"] = fitted(config)
    if code != 0:
        lines = (work / "log.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        row["message"] = f"longer than {limit:g} s" if code is None else next(
            (line for line in reversed(lines) if "error" in line.lower()), lines[-1] if lines else ""
        )  # fmt: skip
    return row


def processor_seconds() -> float:
    """What all programs called so far, and those called by them, have used; other programs beside do not change it."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


def fitted(config: Path) -> list[str]:
    """Effects that the config ends with: `discover` may have dropped some that were in a model of the climb."""
    return list(yaml.safe_load(config.read_text(encoding="utf-8"))["model"].get("effects") or {})


def rungs(results: Path) -> list[dict[str, Any]]:
    """What was said of each model, from the base model on."""
    found = []
    for path in sorted(results.rglob("rung.json"), key=lambda path: path.parent.name.count("+")):
        rung = json.loads(path.read_text(encoding="utf-8"))
        file = path.with_name("diagnosis.json")
        diagnosis = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        reach = rung["not_excluded"]["ranges"]
        found.append(
            {
                "model": rung["model"],
                "effects": rung["effects"],
                "verdict": diagnosis.get("verdict", rung["verdict"]),
                "sentence": diagnosis.get("sentence", rung["sentence"]),
                "named": diagnosis.get("effects", []),
                "family": diagnosis.get("family"),
                "error": rung["error"],
                "misfit": [rung["misfit"], rung["freedom"]],
                "parameters": {
                    name: {
                        "value": one["value"],
                        "interval": one["interval95"],
                        "at_bound": one.get("at_bound"),
                        "reach": reach.get(name, one["interval95"]),
                    }
                    for name, one in rung["parameters"].items()
                },
                "simulations": rung["simulations"],
            }
        )
    return found


def main() -> None:
    """Run what has no line yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what make.py was given as --out")
    parser.add_argument("--out", type=Path, required=True, help="file of JSON lines; lines are added")
    parser.add_argument("--work", type=Path, help="folder of the results; FOLDER/runs if left out")
    parser.add_argument("--goal", choices=("diagnose", "discover"), default="discover")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="names, or patterns such as 'nothing-*'")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--quiet", action="store_true", help="tell times only, not what was found")
    parser.add_argument("--limit", type=float, default=3600.0, help="seconds that a case may take")
    args = parser.parse_args()
    done = set()
    if args.out.exists():
        done = {json.loads(line)["name"] for line in args.out.read_text(encoding="utf-8").splitlines() if line}
    work = args.work or args.folder / "runs"
    for file in sorted(args.folder.glob("*/study.yaml")):
        name = file.parent.name
        if name in done or (args.only and not any(fnmatch.fnmatch(name, one) for one in args.only)):
            continue
        row = run(file.parent, work / name, args.goal, args.cores, args.limit)
        with args.out.open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
        last = final(row) if row["rungs"] else {"model": "-", "sentence": row.get("message", "nothing")}
        said = "" if args.quiet else f"; {last['model']}: {last['sentence']}"
        print(f"{name}: {row['seconds']} s{said}", flush=True)


if __name__ == "__main__":
    main()
