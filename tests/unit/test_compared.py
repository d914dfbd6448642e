"""Models of a ladder are compared by one likelihood, that of the last one."""

import numpy as np
import pytest
from seeds import generator

from fingerfit.core.files import keep_json
from fingerfit.diagnosis.likelihood import Weighed, misfits
from fingerfit.diagnosis.score_tests import Known
from fingerfit.report.compared import RESIDUAL, by_the_last, compared, write_residual

COUNT = 120


def model(offset, noise, count=2, kept=None):
    """A model of some numbers that leaves noise and a pattern, and says how large the noise is."""
    rng = generator(4)
    kept = np.ones(COUNT, dtype=bool) if kept is None else kept
    pattern, vector, own = rng.normal(size=COUNT), 0.1 * rng.normal(size=COUNT), rng.normal(size=(COUNT, count))
    priors = Known(np.array([0.5]), np.ones((1, count)), np.zeros(count, dtype=bool))
    return Weighed(
        kept, (vector + offset * pattern)[kept], own[kept], noise**2 * np.eye(kept.sum()), np.zeros((kept.sum(), 1)),
        known=priors,
    )  # fmt: skip


def rung(name, count, **more):
    return {"model": name, "misfit": 50.0, "freedom": 117, "parameters_count": count, **more}


def test_what_was_written_weighs_as_what_was_there(tmp_path):
    base, better = model(0.3, 1.0), model(0.0, 0.1, 3)
    write_residual(base, tmp_path / "base" / RESIDUAL)
    found = compared(tmp_path, ["base", "base+tilt"], better)
    wanted = misfits({"base": base, "base+tilt": better}, "base+tilt")
    assert {name: one["misfit"] for name, one in found.items()} == pytest.approx(wanted)
    # the prior is one value more
    assert {name: one["freedom"] for name, one in found.items()} == {"base": COUNT + 1 - 2, "base+tilt": COUNT + 1 - 3}


def test_a_model_that_forgives_itself_much_is_not_the_better_one(tmp_path):
    """By its own covariance the base model leaves less than the one that is right."""
    base, better = model(0.3, 1.0), model(0.0, 0.1, 3)
    own = {name: misfits({name: one}, name)[name] for name, one in (("base", base), ("base+tilt", better))}
    assert own["base"] < own["base+tilt"]
    write_residual(base, tmp_path / "base" / RESIDUAL)
    last = rung("base+tilt", 3, compared=compared(tmp_path, ["base", "base+tilt"], better))
    first, second = by_the_last([rung("base", 2), last])
    assert second["misfit"] == pytest.approx(own["base+tilt"])
    for name in ("misfit", "aic", "bic"):
        assert first[name] > second[name] + 10
    assert second["aic"] == pytest.approx(second["misfit"] + 2 * 3)
    assert second["bic"] == pytest.approx(second["misfit"] + 3 * np.log(COUNT + 1))


def test_what_cannot_be_compared_has_no_criteria(tmp_path):
    better = model(0.0, 0.1, 3)
    write_residual(model(0.0, 0.1, kept=np.arange(COUNT) > 5), tmp_path / "fewer" / RESIDUAL)
    keep_json(tmp_path / "other" / "rung.json", {})
    base = Weighed(*(getattr(better, name)[:50] for name in ("kept", "vector", "own")), np.eye(50), np.zeros((50, 0)))
    write_residual(base, tmp_path / "of another mesh" / RESIDUAL)
    found = compared(tmp_path, ["of another mesh", "other", "fewer", "last"], better)
    assert list(found) == ["last", "fewer"]
    assert found["last"]["freedom"] == COUNT - 6 + 1 - 3
    rungs = [rung("other", 2), rung("fewer", 2, coarser=True), rung("last", 3, compared=found)]
    told = by_the_last(rungs)
    assert [(one["misfit"], one["aic"], one["bic"]) for one in told[:2]] == [(50.0, None, None)] * 2
    assert told[2]["misfit"] == found["last"]["misfit"]
    # results of a model that was diagnosed before there was anything to compare
    assert by_the_last([rung("last", 3)])[0]["aic"] is None
    assert by_the_last([]) == []
