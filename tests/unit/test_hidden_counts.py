"""How the benchmark of hidden effects counts: against what is required, constants by their intervals, times."""

import sys

from conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
from hidden_effects import counts, off

RIGHT = {"mu_top": 0.01, "mu_bottom": -0.02}


def case(hidden, *rungs, found=60.0):
    return {"hidden": {name: {} for name in hidden}, "rungs": list(rungs), "found": found}


def rung(effects=(), verdict="adequate", named=(), errors=RIGHT, **more):
    return {
        "effects": list(effects),
        "verdict": verdict,
        "named": list(named),
        "errors": errors,
        "held_out": 1.0,
        **more,
    }


def row(cases, start):
    return next(line for line in counts(cases) if line.startswith(f"| {start}"))


def test_a_constant_is_right_by_either():
    assert off(rung(errors={"mu_top": 0.029, "mu_bottom": -0.031})) == ["mu_bottom"]
    assert off(rung(errors={"mu_top": 0.2}, inside={"mu_top": True})) == []
    assert off(rung(errors={"mu_top": 0.2}, inside={"mu_top": False})) == ["mu_top"]


def test_what_is_required_stands_beside_it():
    after = rung(["tilt"])
    tilt = case(["tilt"], rung(verdict="missing", named=["tilt"], errors={"mu_top": 0.2}), after)
    quiet, alarm = case([], rung()), case([], rung(verdict="missing", named=["skin"]), found=301.0)
    cases = {"tilt": tilt, "nothing, noise 1": quiet, "nothing, noise 2": alarm}
    assert row(cases, "clear: its name alone") == "| clear: its name alone | 1 of 1 (100 %) | 85 %: met | 0 |"
    assert row(cases, "nothing hidden: no effect").endswith("| 1 of 2 (50 %) | 95 %: NOT met | 1: nothing, noise 2 |")
    assert row(cases, "right effect added: every").endswith("| 1 of 1 (100 %) | - | 0 |")
    assert row(cases, "before it was added").endswith("| 1 of 1 (100 %) | - | 0 |")
    assert row(cases, "found within 5 minutes").endswith("| 2 of 3 (67 %) | - | 1: nothing, noise 2 |")
    tilt["rungs"][1]["errors"] = {"mu_top": 0.05}
    assert row(cases, "right effect added: every").endswith("| 0 of 1 (0 %) | - | 1: tilt |")
