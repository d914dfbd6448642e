"""Every bad input is told in one clear line: each area's table is in a file of its own."""

from __future__ import annotations

import importlib

import battery
import places
import pytest
from table import PROPERTY

pytestmark = pytest.mark.slow
MODULES = ("study", "steps", "config", "files", "effects", "formulas", "templates", "experiment", "anatomy", "pictures",
           "meshes", "regions", "points", "decks", "solvers", "usage")  # fmt: skip
AREAS = {name: importlib.import_module(f"bad_{name}") for name in MODULES}
CASES = [(module.AREA, case) for module in AREAS.values() for case in module.CASES]


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
    names = [f"{area}: {case}" for area, case in CASES]
    assert len(names) >= 300
    assert sorted(set(names)) == sorted(names)
