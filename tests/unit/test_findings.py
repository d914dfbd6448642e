"""The ladder of a model: the rungs on the way to it, and nothing of side branches and older settings."""

import copy

import pytest

from fingerfit.core.files import keep_json
from fingerfit.provenance.stages import write_settings
from fingerfit.report.rungs import ladder, made_with
from fingerfit.settings.config import load_settings

CONFIG = {
    "study": "study",
    "model": {
        "material": {"alpha": 1.4, "poisson": 0.45},
        "parameters": {"mu": {"unit": "MPa", "start": 0.05, "lower": 0.005, "upper": 0.5}},
        "mesh": {"element": "CPE8", "across": 2, "per_layer": 2},
    },
    "fit": {"score": "nmi", "stages": [{"name": "grid", "kind": "grid", "points": 3}]},
}


def settings(effects=(), **changes):
    data = copy.deepcopy(CONFIG)
    data["model"]["effects"] = {name: {} for name in effects}
    for key, value in changes.items():
        at = data
        *parents, last = key.split("__")
        for parent in parents:
            at = at[int(parent)] if parent.isdigit() else at[parent]
        at[last] = value
    return load_settings(data)


def rung_of(study, effects=(), **changes):
    """A model whose rung is there; its settings.json."""
    found = settings(effects, **changes)
    folder = study / found.model.full_name
    rung = {
        "model": found.model.full_name,
        "effects": list(effects),
        "made_with": made_with(found.model_dump(mode="json")),
    }
    keep_json(folder / "rung.json", rung)
    write_settings(found, folder / "settings.json")
    return folder / "settings.json"


def models(found):
    return [rung["model"] for rung in found["rungs"]]


def test_the_rungs_of_the_path_in_order(tmp_path):
    for effects in (("tilt",), ("tilt", "skin"), ()):
        last = rung_of(tmp_path, effects)
    assert models(ladder(tmp_path, last)) == ["base"]
    last = rung_of(tmp_path, ("tilt", "skin"))
    assert models(ladder(tmp_path, last)) == ["base", "base+tilt", "base+tilt+skin"]
    assert ladder(tmp_path, last)["others"] == []


def test_what_was_dropped_is_a_side_branch(tmp_path):
    base = rung_of(tmp_path)
    rung_of(tmp_path, ("tilt",))
    rung_of(tmp_path, ("tilt", "friction"))
    skin = rung_of(tmp_path, ("tilt", "skin"))
    assert models(ladder(tmp_path, skin)) == ["base", "base+tilt", "base+tilt+skin"]
    back = ladder(tmp_path, base)
    assert models(back) == ["base"]
    assert [other["model"] for other in back["others"]] == ["base+tilt", "base+tilt+friction", "base+tilt+skin"]
    assert {other["why"] for other in back["others"]} == {"not on the way to this model"}


@pytest.mark.parametrize(
    "changes",
    [
        {"model__mesh": {"element": "CPE8", "across": 4, "per_layer": 2}},
        {"fit__steps": [1]},
        {"fit__score": "ssd"},
        {"model__material": {"alpha": 2.0, "poisson": 0.45}},
        {"model__parameters": {"mu": {"unit": "MPa", "start": 0.05, "lower": 0.01, "upper": 0.5}}},
    ],
)
def test_rungs_of_other_settings_are_told_apart(tmp_path, changes):
    rung_of(tmp_path)
    last = rung_of(tmp_path, ("tilt",), **changes)
    found = ladder(tmp_path, last)
    assert models(found) == ["base+tilt"]
    assert found["others"] == [{"model": "base", "why": "made with other settings"}]


@pytest.mark.parametrize(
    ("finer", "on_it"),
    [({"element": "CPE8H"}, True), ({"element": "CPE8H", "across": 28, "per_layer": 10}, True),
     ({"element": "CPE8H", "across": 28}, False), ({"element": "CPE3"}, False)],
)  # fmt: skip
def test_rungs_of_the_mesh_that_was_made_finer_stay_on_the_ladder(tmp_path, finer, on_it):
    """Where the mesh is all that differs, and is one that `discover` makes: elements of the next order, then halved."""
    coarse = {"element": "CPE4H", "across": 14, "per_layer": 5}
    rung_of(tmp_path, model__mesh=coarse)
    last = rung_of(tmp_path, ("tilt",), model__mesh=coarse | finer)
    found = ladder(tmp_path, last)
    assert models(found) == (["base", "base+tilt"] if on_it else ["base+tilt"])
    assert [rung.get("coarser", False) for rung in found["rungs"]] == ([True, False] if on_it else [False])
    assert all(rung["aic"] is None for rung in found["rungs"] if rung.get("coarser"))
    last = rung_of(tmp_path, ("tilt",), model__mesh=coarse | finer, fit__steps=[1])
    assert models(ladder(tmp_path, last)) == ["base+tilt"]


def test_where_and_how_it_is_searched_makes_no_other_ladder(tmp_path):
    rung_of(tmp_path)
    changes = {"model__parameters__mu__start": 0.1, "fit__stages__0__points": 5, "fit__batch": 4, "results": "r"}
    last = rung_of(tmp_path, ("tilt",), **changes)
    assert models(ladder(tmp_path, last)) == ["base", "base+tilt"]


def test_rungs_that_do_not_say_what_they_were_made_with(tmp_path):
    last = rung_of(tmp_path, ("tilt",))
    keep_json(tmp_path / "base/rung.json", {"model": "base", "effects": []})
    assert models(ladder(tmp_path, last)) == ["base+tilt"]
