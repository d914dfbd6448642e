"""Fits inside one process, for the benchmarks: the course of the workflow without Snakemake."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fingerfit.fit.course import next_round
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / "benchmarks/.cache"


@dataclass
class Fitted:
    """A finished fit.

    Parameters
    ----------
    estimate : dict
        What estimate.json would hold.
    problem : InverseProblem
    last : Round
    seconds : dict
        Processor time of ``propose``, ``simulate``, ``estimate``.
    """

    estimate: dict[str, Any]
    problem: InverseProblem
    last: Round
    seconds: dict[str, float] = field(default_factory=dict)


def processor_time() -> float:
    """Seconds that this process and the programs it started used: other work on the machine does not count."""
    return sum(os.times()[:4])


def fit_study(config: Mapping[str, Any], folder: Path) -> Fitted:
    """Fit the study of a config; simulations go to `folder`."""
    problem, last = begin(load_settings(config), folder)[0], None
    seconds = {"propose": 0.0, "simulate": 0.0, "estimate": 0.0}
    while last is None or last.stop is None:
        start = processor_time()
        last = next_round(problem, last)
        asked = processor_time()
        solve_missing(problem, last.batch, 1)
        seconds["propose"] += asked - start
        seconds["simulate"] += processor_time() - asked
    start = processor_time()
    found = estimate_of(problem, last)
    seconds["estimate"] = processor_time() - start
    return Fitted(found, problem, last, seconds)
