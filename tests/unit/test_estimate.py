"""The table and the remarks of an estimate, also at bounds and where a number is 0."""

import copy
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY

from fingerfit.core.errors import Problems
from fingerfit.fit import estimate
from fingerfit.fit.estimate import _far_off, estimate_of, table_of
from fingerfit.fit.replicates import Replicates
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.model.catalogue import catalogue
from fingerfit.report.findings import at_bounds
from fingerfit.settings.config import load_settings

ENTRY = {
    "value": 0.01, "unit": "1/mm", "standard_error": 0.0, "mesh_error": 0.0, "interval95": [0.01, 0.01],
    "bounds": [-0.05, 0.05], "at_bound": None, "log": False,
}  # fmt: skip
FOUND = {
    "study": "s", "model": "base+tilt", "solver": {"name": "builtin"}, "parameters": {"tilt.slope": ENTRY},
    "remarks": [], "score": {"kind": "nmi", "final": -1.4}, "search_mesh": {"tilt.slope": 0.0},
    "search": {"rounds": 3, "stop": "effects added", "diverged": 0, "faults": []},
    "simulations": {"asked": 3, "run": 3},
}  # fmt: skip


def test_an_effect_that_is_absent_on_the_search_mesh_moved_by_a_difference():
    assert "change from the coarse to the finer mesh: tilt.slope +0.01 1/mm\n" in table_of(FOUND)


def test_a_constant_moved_by_a_share():
    entry = {**ENTRY, "unit": "MPa", "value": 0.021, "log": True}
    found = {**FOUND, "parameters": {"mu": entry}, "search_mesh": {"mu": 0.02}}
    assert "change from the coarse to the finer mesh: mu +5.0 %\n" in table_of(found)


def test_the_table_says_what_is_at_its_bound():
    lines = {entry["at_bound"]: table_of({**FOUND, "parameters": {"tilt.slope": entry}}).splitlines()[3]
             for entry in (ENTRY, {**ENTRY, "at_bound": "upper"})}  # fmt: skip
    assert lines["upper"] == lines[None] + "  at its upper bound"


def fitted(folder, monkeypatch, changes=None, steps=STEPS, **own):
    """Estimate of a block whose forces say a modulus of about 0.02 MPa."""
    monkeypatch.chdir(folder)
    (folder / "study").mkdir()
    (folder / "study/study.yaml").write_text(yaml.safe_dump({**STUDY, **own}))
    (folder / "study/steps.csv").write_text(steps)
    model = copy.deepcopy({**MODEL, **(changes or {})})
    problem, _ = begin(
        load_settings({"study": "study", "model": model, "fit": {**FIT, "replicates": 20}}), folder / "m"
    )
    return estimate_of(problem, run_fit(problem, 1)[0])


def test_no_thread_is_left(tmp_path, monkeypatch):
    made, before = [], set(threading.enumerate())

    def kept(*args):
        made.append(Replicates(*args))
        return made[-1]

    monkeypatch.setattr(estimate, "Replicates", kept)
    fitted(tmp_path, monkeypatch)
    assert made
    assert set(threading.enumerate()) == before


MU = MODEL["parameters"]["mu"]


def test_a_constant_within_its_bounds_has_no_remark(tmp_path, monkeypatch):
    found = fitted(tmp_path, monkeypatch)
    entry = found["parameters"]["mu"]
    assert entry["at_bound"] is None
    assert entry["bounds"] == [0.005, 0.5]
    assert not any("bound" in remark for remark in found["remarks"])


@pytest.mark.parametrize(
    ("score", "control", "look"),
    [
        ("nmi", "displacement", "the score nmi does not contain the force: score: likelihood does"),
        ("nmi", "force", "look at noise.displacement, at its unit, and at what the model lacks"),
        ("likelihood", "displacement", "look at noise.force, at its unit, and at what the model lacks"),
    ],
)
def test_a_force_far_off_that_the_score_does_not_contain_is_told_so(score, control, look):
    measured, name = np.array([10.0, 11.0]), ("displacement", "mm") if control == "force" else ("force", "N")
    data = SimpleNamespace(
        response=(measured, np.full(2, 0.1)), response_gain=0.0, control_share=np.zeros(2),
        response_name=lambda _: name, step=np.array([1, 4]), response_step=np.array([0, 1]), control=control,
    )  # fmt: skip
    test = SimpleNamespace(test="", data=data, settings=SimpleNamespace(fit=SimpleNamespace(score=score)))
    model = SimpleNamespace(
        base=SimpleNamespace(response=np.array([10.0, 199.6])), control=SimpleNamespace(response=np.zeros(2))
    )
    best = SimpleNamespace(model=SimpleNamespace(every=[model]))
    (told,) = _far_off(SimpleNamespace(every=[test]), best, [np.zeros(2)])
    assert told.startswith(f"{name[0]} of step 4 is 1886 standard deviations off: 11 {name[1]} measured")
    assert told.endswith(f"; {look}")


def test_an_error_of_the_mesh_that_is_not_known_is_told(tmp_path, monkeypatch):
    """The table has a dash there, and the intervals lack it."""
    for name, finer in (("one", {}), ("two", {"refined": {**MODEL["mesh"], "across": 6, "per_layer": 6}})):
        (tmp_path / name).mkdir()
        found = fitted(tmp_path / name, monkeypatch, finer)
        told = "no finer mesh was given (model.refined): standard errors and intervals do not contain the error" in (
            table_of(found)
        )
        assert told == (not finer) == (found["parameters"]["mu"]["mesh_error"] == 0)


def test_it_is_told_from_which_step_on_the_finer_mesh_has_no_solution(monkeypatch):
    def test_of(name, control):
        data = SimpleNamespace(step=np.array([1, 3, 4]), control=control, controlled=np.array([0.5, 1.25, 2.0]))
        return SimpleNamespace(test=name, data=data)

    usable = {"": 2, "wide": 1, "soft": 3}
    monkeypatch.setattr(estimate, "usable_steps", lambda test, asked: usable[test.test])
    for tests, told in (
        ([test_of("", "displacement")], " from step 4 on (displacement 2 mm)"),
        ([test_of("wide", "force"), test_of("soft", "force")], " in test wide from step 3 on (force 1.25 N)"),
    ):
        monkeypatch.setattr(estimate, "on_finer_mesh", lambda problem, last: SimpleNamespace(every=problem.every))
        assert estimate._from_where(SimpleNamespace(every=tests), None) == told
    monkeypatch.setattr(estimate, "on_finer_mesh", lambda problem, last: None)
    assert estimate._from_where(SimpleNamespace(every=tests), None) == ""


@pytest.mark.parametrize(("which", "share"), [("lower", 1.5), ("upper", 0.7)])
def test_a_constant_that_ends_at_its_bound_is_told(tmp_path, monkeypatch, which, share):
    (tmp_path / "free").mkdir()
    best = fitted(tmp_path / "free", monkeypatch)["parameters"]["mu"]["value"]
    bound = float(f"{share * best:.4g}")
    mu = {**MU, which: bound, "start": bound * (1.2 if which == "lower" else 0.8)}
    (tmp_path / "bounded").mkdir()
    found = fitted(tmp_path / "bounded", monkeypatch, {"parameters": {"mu": mu}})
    assert found["parameters"]["mu"]["value"] == bound
    assert found["parameters"]["mu"]["at_bound"] == which
    wanted = {"lower": "smaller", "upper": "larger"}[which]
    remark = f"mu ends at its {which} bound, {bound:g} MPa: a {wanted} value may fit better (model.parameters.mu)"
    assert any(one.startswith(remark) for one in found["remarks"])
    assert remark in table_of(found)
    assert f"  at its {which} bound\n" in table_of(found)


def test_a_number_of_an_effect_that_ends_where_it_is_absent_is_told(tmp_path, monkeypatch):
    # the second force falls behind the first, as that of no block that slips on its base does
    steps = "step,displacement,force\n1,0.4,10.0\n2,0.8,30.0\n"
    found = fitted(tmp_path, monkeypatch, {"effects": {"base_slip": {}}}, steps)
    (name,) = [name for name in found["parameters"] if name.startswith("base_slip.")]
    assert found["parameters"][name]["at_bound"] == "lower"
    assert any(
        f"{name} ends at its lower bound, 0" in r and "where the effect is absent" in r for r in found["remarks"]
    )


def test_a_number_of_one_test_that_ends_where_the_effect_is_absent_is_told(tmp_path, monkeypatch):
    steps = "step,displacement,force\n1,0.4,10.0\n2,0.8,30.0\n"
    own = {"effects": {"base_slip": {}}, "per_test": ["base_slip"]}
    found = fitted(tmp_path, monkeypatch, own, steps, tests={"one": {}, "other": {}})
    told = [r for r in found["remarks"] if "ends at its lower bound, 0" in r and "where the effect is absent" in r]
    assert [remark.partition(" ")[0] for remark in told] == ["base_slip.share@one", "base_slip.share@other"]


def test_a_refitted_effect_at_its_bound_is_told():
    slip = catalogue()["base_slip"]
    (p,) = slip.parameters
    assert at_bounds(slip, {slip.key(p.name): p.lower}) == {p.name: "lower"}
    assert at_bounds(slip, {slip.key(p.name): p.upper, "mu": 1.0}) == {p.name: "upper"}
    assert at_bounds(slip, {slip.key(p.name): (p.lower + p.upper) / 2}) == {}
    layer = catalogue()["split_layer"]
    low, high = layer.refine["share"]
    for share, ends in ((low, {"share": "lower"}), (high, {"share": "upper"}), ((low + high) / 2, {})):
        assert at_bounds(layer, {"split_layer.contrast": 0.3, "split_layer.share": share}) == ends


def test_intervals_reach_to_the_models_that_the_data_cannot_tell_from_this_one(tmp_path, monkeypatch):
    (tmp_path / "alone").mkdir()
    alone = fitted(tmp_path / "alone", monkeypatch)
    own = alone["parameters"]["mu"]
    (tmp_path / "among").mkdir()
    # one is known as well as this model at best, the other worse
    rivals = {"base+skin": {"mu": [0.8, 0.8]}, "base+band": {"mu": [0.5, 4.5]}}
    among = fitted(tmp_path / "among", monkeypatch, {"rivals": rivals})
    entry = among["parameters"]["mu"]
    assert entry["value"] == own["value"]
    low, high = own["interval95"]
    assert entry["interval95"] == pytest.approx([min(0.8 * low, 0.5 * own["value"]), 4.5 * own["value"]])
    assert 1.5 * high < 4.5 * own["value"]
    told = [remark for remark in among["remarks"] if "cannot tell" in remark]
    assert len(told) == 2
    assert told[1] == (
        f"these data cannot tell this model from base+band, which has mu {0.5 * own['value']:.4g} to"
        f" {4.5 * own['value']:.4g}: the intervals reach that far"
    )
    assert not any("cannot tell" in remark for remark in alone["remarks"])


def test_a_rival_on_one_side_leaves_the_other_end_where_it_is(tmp_path, monkeypatch):
    linear = {"rivals": {"base+skin": {"mu": [-0.004, -0.004]}}, "parameters": {"mu": {**MU, "log": False}}}
    (tmp_path / "alone").mkdir()
    low, high = fitted(tmp_path / "alone", monkeypatch, {**linear, "rivals": {}})["parameters"]["mu"]["interval95"]
    (tmp_path / "among").mkdir()
    found = fitted(tmp_path / "among", monkeypatch, linear)["parameters"]["mu"]["interval95"]
    assert found == pytest.approx([low - 0.004, high])


@pytest.mark.parametrize(
    ("away", "message"),
    [
        ({"mu_tip": [1.0, 1.1]}, "mu_tip: found an unknown key; expected one of mu"),
        (
            {"mu": [0.0, 1.0]},
            "mu: found [0.0, 1.0]; expected above 0, factors of a constant that is searched in the logarithm",
        ),
        ({"mu": 1.1}, "mu: found 1.1; expected both ends of an interval: [0.9, 1.2]"),
        ({"mu": [1.2, 1.1]}, "mu: found [1.2, 1.1]; expected a lower end and a higher one"),
    ],
)
def test_rivals_are_told_by_constants_and_factors_that_there_are(tmp_path, monkeypatch, away, message):
    with pytest.raises(Problems) as caught:
        fitted(tmp_path, monkeypatch, {"rivals": {"base+skin": away}})
    assert f"config.yaml: model.rivals.base+skin.{message}" in str(caught.value)
