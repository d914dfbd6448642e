"""A layer whose stiffness changes during the test: at each step the answer of the stiffness that it has then."""

import numpy as np
import pytest
from small_body import written
from test_laws import CONSTANTS, config

from fingerfit.core.errors import FingerfitError
from fingerfit.diagnosis.candidates import candidates
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings

MU = {"mu_top": 0.03, "mu_bottom": 0.06}
CHANGE = 0.4
NOW = (0.25, 1.0)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return written(tmp_path_factory.mktemp("study"), displacement=[1.0, 3.0], time=[1, 4], effects={},
                   picture={"pixels": 32, "side": 19, "texture": 0.15, "correlation": 0.6, "noise": 0.02, "pictured": [2]},
                   noise={"force": 1e-6, "displacement": 1e-6})  # fmt: skip


def problem_of(study, folder, law, effects, solver="builtin", element="CPE4"):
    given = config(study, law, **CONSTANTS[law])
    given["model"]["effects"], given["solver"] = effects, solver
    given["model"]["mesh"] = {**given["model"]["mesh"], "element": element}
    return begin(load_settings(given), folder)[0]


def moved(problem, values):
    """How far the indenter goes under both forces, mm."""
    asked = problem.ask(values)
    solve_missing(problem, [asked], 1)
    return problem.prediction(asked).response


OTHERS = {
    "yeoh": {"c2": 0.5, "c3": 0.1},
    "exponential": {"b": 0.5},
    "softening": {"change": -0.4, "rate": 6.0},
    "second_term": {"share": 0.3},
    "material_probe": {"share": 0.3},
}


@pytest.mark.parametrize(("law", "other"), [*((law, None) for law in CONSTANTS), *(("ogden", one) for one in OTHERS)])
def test_each_step_is_that_of_the_stiffness_then(study, tmp_path, law, other):
    beside = {other: OTHERS[other]} if other else {}
    ageing = {"layer_ageing": {"change": CHANGE, "layer": 2}}
    numbers = {f"{other}.{name}": value for name, value in OTHERS.get(other, {}).items()}
    problem = problem_of(study, tmp_path / "ageing", law, beside | ageing)
    found = moved(problem, MU | numbers | {"layer_ageing.change": CHANGE})
    plain = problem_of(study, tmp_path / "plain", law, beside)
    for step, now in enumerate(NOW):
        stiffer = MU | numbers | {"mu_bottom": MU["mu_bottom"] * np.exp(CHANGE * now)}
        assert found[step] == pytest.approx(moved(plain, stiffer)[step], rel=1e-6)


def test_calculix_says_the_same(study, tmp_path, needs_ccx):
    values = MU | {"layer_ageing.change": CHANGE}
    ours, theirs = (
        moved(problem_of(study, tmp_path / solver, "ogden", {"layer_ageing": {"layer": 1}}, solver, "CPE8"), values)
        for solver in ("builtin", "calculix")
    )
    assert theirs == pytest.approx(ours, rel=1e-6)  # seven digits in its .dat


def test_it_is_tried_in_each_of_several_layers_and_beside_no_body_that_swells(study, tmp_path):
    def tried(effects):
        problem = problem_of(study, tmp_path / "-".join(effects or ["none"]), "ogden", effects)
        values = {one.name: one.start for one in problem.settings.parameters()}
        found = candidates(problem, values)[0]
        return [one.place["layer_ageing.layer"] for one in found if one.effect.name == "layer_ageing"]

    assert tried({}) == [1, 2]
    assert tried({"swelling": {}}) == []
    with pytest.raises(
        FingerfitError, match=r"layer_ageing.* found stiffness of one layer; expected no effect swelling"
    ):
        tried({"swelling": {"volume": 0.01}, "layer_ageing": {"layer": 1, "change": 0.1}})
