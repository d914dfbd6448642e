"""The models of a ladder by one likelihood: what each leaves, weighed by the covariance of the last one.

A model's own covariance forgives it what its pictures could not be registered by, so that misfits of their own, and
AIC and BIC, say nothing about which of two models is better (`fingerfit.diagnosis.likelihood`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import log
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.files import read_npz, write_npz
from fingerfit.diagnosis.likelihood import Left, Weighed, by_likelihood_of
from fingerfit.diagnosis.score_tests import Known

RESIDUAL = "residual.npz"
"""What a model leaves, beside its rung: with it models above weigh it again."""


def write_residual(left: Left, path: Path) -> None:
    """Write what a model leaves: its residual in mm and N, slopes of its constants, its priors and bounds."""
    known = left.known or Known.nothing(left.own.shape[1])
    priors = {"priors": known.left, "prior_slopes": known.slopes, "held": known.held}
    write_npz(path, {"kept": left.kept, "vector": left.vector, "own": left.own, **priors})


def compared(study: Path, models: Sequence[str], last: Weighed) -> dict[str, dict[str, float]]:
    """Misfit and degrees of freedom of models by the likelihood of the last one, by name.

    What the last one leaves is written beside its rung, for the models above it.

    Parameters
    ----------
    study : Path
        Results of the study.
    models : sequence of str
        Names of the models on the way to this one, which is the last. Those that were not diagnosed, or whose mesh has
        other values, are left out.
    last : Weighed
    """
    write_residual(last, study / models[-1] / RESIDUAL)
    left: dict[str, Left] = {models[-1]: last}
    for name in models[:-1]:
        file = study / name / RESIDUAL
        if file.exists() and (one := _read(file)).kept.shape == last.kept.shape:
            left[name] = one
    found = by_likelihood_of(last, left)
    return {name: {"misfit": one.misfit, "freedom": one.freedom} for name, one in found.items()}


def criteria(misfit: float, freedom: int, count: int) -> dict[str, float]:
    """AIC and BIC of a model with so many fitted numbers (Akaike 1974; Schwarz 1978)."""
    return {"aic": misfit + 2 * count, "bic": misfit + count * log(max(freedom + count, 1))}


def by_the_last(rungs: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rungs of a ladder with misfits, AIC and BIC by the likelihood of the last one.

    Those of a coarser mesh keep their misfit, as does what the last one could not be compared with; without AIC and
    BIC, since these cannot be compared.
    """
    known = rungs[-1].get("compared", {}) if rungs else {}
    found = []
    for rung in rungs:
        own = known.get(rung["model"]) if not rung.get("coarser") else None
        better = own | criteria(**own, count=rung["parameters_count"]) if own else {"aic": None, "bic": None}
        found.append({**rung, **better})
    return found


def _read(file: Path) -> Left:
    data = read_npz(file)
    held = data.get("held", np.zeros(data["own"].shape[1], dtype=bool))  # results of older versions do not tell
    return Left(data["kept"], data["vector"], data["own"], known=Known(data["priors"], data["prior_slopes"], held))
