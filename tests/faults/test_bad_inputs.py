"""Every bad input is told in one clear line: each area's table is in a file of its own."""

from __future__ import annotations

import contextlib
import importlib

import battery
import places
import pytest
from seeds import part_of
from table import PROPERTY

from fingerfit.cli import main

pytestmark = pytest.mark.slow
MODULES = ("study", "steps", "config", "files", "effects", "formulas", "templates", "experiment", "anatomy", "pictures",
           "meshes", "regions", "points", "decks", "solvers", "usage")  # fmt: skip
AREAS = {name: importlib.import_module(f"bad_{name}") for name in MODULES}
ALL = [(module.AREA, case) for module in AREAS.values() for case in module.CASES]
CASES = part_of(ALL, 7)


@pytest.fixture(scope="session")
def studies(tmp_path_factory):
    """Studies that are fine, made when they are asked for."""
    made = {}

    def of(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name)
            places.PLACES[name](made[name])
        return made[name]

    return of


@pytest.fixture(scope="session", autouse=True)
def libraries(studies, tmp_path_factory):
    """Loaded once: each case is a fork of this process, and half of its time would be imports."""
    place = tmp_path_factory.mktemp("first") / "w"
    battery.copy(studies("plane"), place)
    # under another name: effects are kept by their paths, which are relative ones here
    (place / "study").rename(place / "other")
    battery.put("config.yaml", "study", "other")(place)
    with contextlib.chdir(place):
        assert main([one.replace("study", "other") for one in battery.CHECK]) == 0


@pytest.mark.parametrize(("area", "case"), CASES, ids=[f"{area}: {case}" for area, case in CASES])
def test_one_clear_line(area, case, studies, tmp_path, record_property):
    place = tmp_path / "w"
    battery.copy(studies(case.place), place)
    case.change(place)
    before = set(place.rglob("*"))
    outcome, why = battery.assess(case, place, *battery.run(case, place), before)
    record_property(PROPERTY, [area, case.name, outcome, why])
    assert outcome != battery.NEITHER, why


@pytest.mark.parametrize("name", [name for name in places.PLACES if name != "deck"])
def test_the_studies_are_fine_before_they_are_changed(name, studies, tmp_path):
    battery.copy(studies(name), tmp_path / "w")
    case = battery.fine(name, battery.nothing, place=name)
    assert battery.assess(case, tmp_path / "w", *battery.run(case, tmp_path / "w"), []) == (battery.ACCEPTED, "")


def test_there_are_enough_and_none_twice():
    names = [f"{area}: {case}" for area, case in ALL]
    assert len(names) >= 1500
    assert sorted(set(names)) == sorted(names)
