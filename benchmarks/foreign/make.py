"""Make phantom studies with hidden effects.

`python benchmarks/foreign/make.py --half study --out FOLDER [--only NAME ...]`

Each case is a folder FOLDER/NAME with study.yaml, steps.csv, pictures and config.yaml; what is hidden in it stands in
FOLDER/sealed/NAME.json. A case that could not be made, or not wholly, is told there, on the terminal and by the exit
code. What is there already is not made again, unless with --again. See README.md.
"""

from __future__ import annotations

import argparse
import fnmatch
import json
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

try:
    import ngsolve  # noqa: F401
except ImportError:
    sys.exit("no NGSolve here: pip install -r benchmarks/foreign/requirements.txt, in an environment of its own")

import effects
import numpy as np
import observing
from body import NoEquilibriumError, Solved, solve
from cases import Case, Hidden, cases
from files import write_study
from observing import Observation
from phantom import phantoms
from pictures import body_size
from sizing import Ruler, amount_for
from world import World

COARSEST = {2: 10, 3: 5}
"""Rows of the mesh on which sizes are looked for, at least; else half of those of the data."""


def function_of(hidden: Hidden) -> tuple[str, Any]:
    """Where an effect acts, `body` or `observation`, and its function."""
    name = hidden.kind.replace(" ", "_")
    for place, module in (("body", effects), ("observation", observing)):
        if callable(getattr(module, name, None)):
            return place, getattr(module, name)
    raise KeyError(f"{hidden.kind}: no such function in effects.py or observing.py")


def build(setting: Mapping[str, Any], hidden: list[tuple[Hidden, float]]) -> tuple[World, Observation]:
    """A world and its observation, with effects of given amounts."""
    world, seen = World(setting), Observation(body_size(setting))
    for one, amount in hidden:
        place, function = function_of(one)
        function(world if place == "body" else seen, one.form, one.numbers, one.sign * amount)
    return world, seen


def make(case: Case, folder: Path) -> dict[str, Any]:
    """Make a case in a folder; returns its truth.

    Raises
    ------
    NoEquilibriumError
        Where the data have no equilibrium at all.
    """
    setting = dict(case.setting)
    began = time.perf_counter()
    rows = setting["rows"]
    coarse = max(COARSEST[setting["dimension"]], rows // 2)
    acting = [one for one in case.hidden if one.families[0] != "numerics"]
    ruler = Ruler(setting, lambda given: solve(World(given), coarse), case.seed)
    amounts, told = [], []
    for one in acting:

        def measured(amount: float, one: Hidden = one) -> float | None:
            return _measured(ruler, one, amount, coarse)

        if one.start == one.largest:  # the amount is given
            amount, size, tried = one.start, measured(one.start), []
        else:
            amount, size, tried = amount_for(one.size, one.start, one.largest, measured)
        amounts.append((one, amount))
        told.append({**asdict(one), "alone": size, "tried": tried})
    solved, less = _as_far_as_it_goes(setting, amounts, rows)
    amounts = [(one, less * amount) for one, amount in amounts]
    for entry, (one, amount) in zip(told, amounts, strict=True):
        entry["amount"] = one.sign * amount
    told += [{**asdict(one), "amount": None} for one in case.hidden if one not in acting]
    world, seen = build(setting, amounts)
    rough = solve(world, coarse)
    noise = write_study(folder, case.name, setting, solved, seen, case.seed)
    constants = {f"mu_{name}": mu for name, mu in zip(setting["names"], setting["mu"], strict=True)}
    return {
        "name": case.name,
        "half": case.half,
        "family": case.family,
        "hidden": told,
        "lessened": less,
        "size": asdict(ruler.size(rough, seen)),
        "constants": constants,
        "noise": noise,
        "steps": {"asked": solved.asked, "reached": solved.reached},
        "first_picture": {"indentation": solved.start[0], "force": solved.start[1]},
        "discretisation": {
            **_difference(rough, solved, coarse, rows),
            "size": None if case.hidden else ruler.size(solved, seen).largest,
        },
        "setting": setting,
        "seed": case.seed,
        "seconds": round(time.perf_counter() - began, 1),
    }


def _as_far_as_it_goes(
    setting: Mapping[str, Any], amounts: list[tuple[Hidden, float]], rows: int
) -> tuple[Solved, float]:
    """Solve the data; where the finer mesh does not reach all steps, with less of what is hidden, and how much less."""
    best: tuple[Solved, float] | None = None
    for less in (1.0, 0.7, 0.5, 0.35) if amounts else (1.0,):
        try:
            solved = solve(build(setting, [(one, less * amount) for one, amount in amounts])[0], rows)
        except NoEquilibriumError:
            continue
        if best is None or solved.reached > best[0].reached:
            best = solved, less
        if solved.reached == solved.asked:
            break
    if best is None:
        raise NoEquilibriumError("the data have no equilibrium, with little of what is hidden either")
    return best


def _measured(ruler: Ruler, one: Hidden, amount: float, rows: int) -> float | None:
    """Size of one effect at an amount; None where its body has no equilibrium, or not at all steps."""
    world, seen = build(ruler.setting, [(one, amount)])
    if function_of(one)[0] == "observation":
        return ruler.size(ruler.null, seen).largest
    try:
        solved = solve(world, rows)
    except NoEquilibriumError:
        return None
    return ruler.size(solved, seen).largest if solved.reached >= len(ruler.depth) else None


def _difference(rough: Solved, fine: Solved, rough_rows: int, rows: int) -> dict[str, Any]:
    """Two meshes of the same body, one half as fine. The error converges in the first order (verify.py), because of the
    glued corners: the data's own error is about as large as this difference.
    """
    steps = min(rough.reached, fine.reached)
    inside = (slice(None), slice(None), *[slice(n // 20, -(n // 20) or None) for n in fine.places.shape[1:]])
    apart = ((rough.moved[:steps] - rough.before) - (fine.moved[:steps] - fine.before))[inside]
    return {
        "rows": [rough_rows, rows],
        "force": [round(float(x), 5) for x in rough.force[:steps] / fine.force[:steps] - 1],
        "displacement": [round(float(np.sqrt((one**2).sum(axis=0).mean())), 6) for one in apart],
    }


def main() -> int:
    """Make what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--half", required=True, help="study, exam, phantom, or another name with --seed")
    parser.add_argument("--seed", type=int, help="seed of another half")
    parser.add_argument(
        "--shaped", action="store_true", help="bodies of other shapes than rectangles, by meshes of their own"
    )
    parser.add_argument("--out", type=Path, help="folder of the studies")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="names, or patterns such as 'nothing-*'")
    parser.add_argument("--list", action="store_true", help="names of the cases, and nothing else")
    parser.add_argument("--again", action="store_true", help="make also what is there")
    args = parser.parse_args()
    if args.half == "phantom" and (args.seed is not None or args.shaped):
        parser.error("--half phantom has neither seed nor shapes")
    try:
        table = phantoms() if args.half == "phantom" else cases(args.half, args.seed, args.shaped)
    except KeyError:
        parser.error(f"--half {args.half}: expected study, exam or phantom, or --seed with it")
    wanted = [c for c in table if not args.only or any(fnmatch.fnmatch(c.name, name) for name in args.only)]
    if not wanted:
        parser.error(f"--only {' '.join(args.only)}: no such case; --list shows all")
    if args.list:
        print("\n".join(case.name for case in wanted))
        return 0
    if args.out is None:
        parser.error("--out is needed")
    failed = [case.name for case in wanted if not _one(case, args.out, args.again)]
    if failed:
        print(f"not made, or not wholly: {', '.join(failed)}")
    return int(bool(failed))


def _one(case: Case, out: Path, again: bool) -> bool:
    """Make a case, and last its truth; whether all of it is there. A case without truth is made anew."""
    sealed = out / "sealed" / f"{case.name}.json"
    if sealed.exists() and not again:
        return _whole(json.loads(sealed.read_text(encoding="utf-8")))
    sealed.parent.mkdir(parents=True, exist_ok=True)
    try:
        truth = make(case, out / case.name)
    except Exception as error:  # one case that fails leaves the others their turn; it is told, and counts as not made
        truth = {**case.as_dict(), "failed": f"{type(error).__name__}: {error}"}
    sealed.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    said = (
        truth.get("failed") or f"{truth['seconds']} s, {truth['steps']['reached']} of {truth['steps']['asked']} steps"
    )
    print(f"{case.name}: {said}", flush=True)
    return _whole(truth)


def _whole(truth: Mapping[str, Any]) -> bool:
    """Whether a case has all the steps that it was to have."""
    return "failed" not in truth and truth["steps"]["asked"] == truth["steps"]["reached"]


if __name__ == "__main__":
    sys.exit(main())
