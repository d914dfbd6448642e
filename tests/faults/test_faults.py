"""After a fault the next run gives what an undisturbed one would have given, or says in one line what to do."""

from __future__ import annotations

import importlib
import shutil

import pytest
import workspace
from battery import NEITHER
from seeds import part_of
from table import PROPERTY

pytestmark = pytest.mark.slow
MODULES = [importlib.import_module(f"fault_{name}") for name in ("kills", "files", "places", "edits", "solver")]
ALL = [(module.AREA, fault) for module in MODULES for fault in module.FAULTS]
FAULTS = part_of(ALL, 15)
"""An odd part: of each file four ways of damage follow each other, and of each stage four ways of ending."""


@pytest.fixture(scope="session")
def workspaces(tmp_path_factory):
    """Workspaces before the fault, made when they are asked for: the study, fitted, and diagnosed."""
    made = {}
    targets = {"fitted": "all", "diagnosed": "diagnose"}
    below = {"fitted": "study", "diagnosed": "fitted"}

    def of(name):
        if name not in made:
            folder = tmp_path_factory.mktemp("workspace") / "w"
            if name == "study":
                folder.mkdir()
                made[name] = workspace.make_study(folder)
            else:
                made[name] = workspace.copied(of(below[name]), folder)
                code, said = made[name].run(targets[name])
                assert code == 0, said[-3000:]
        return made[name]

    return of


@pytest.mark.parametrize(("area", "fault"), FAULTS, ids=[f"{area}: {fault}" for area, fault in FAULTS])
def test_healed_or_told(area, fault, workspaces, tmp_path, record_property):
    if why := fault.needs():
        pytest.skip(why)
    expected = workspaces("fitted").estimate()
    place = workspace.copied(workspaces(fault.start), tmp_path / "w")

    def fresh(used):
        """What comes out of the same inputs without the results of before."""
        other = workspace.copied(used, tmp_path / "fresh")
        shutil.rmtree(other / "results")
        shutil.rmtree(other / ".snakemake")
        other.environment = used.environment
        code, said = other.run()
        assert code == 0, said[-3000:]
        return other.estimate()

    try:
        outcome, why = workspace.assess(fault, place, expected, fresh)
    except AssertionError as error:
        outcome, why = NEITHER, " ".join(str(error).split())[:300]
    record_property(PROPERTY, [area, fault.name, outcome, why])
    assert outcome != NEITHER, why


def test_an_undisturbed_run_has_nothing_to_heal(workspaces, tmp_path):
    for name, targets in (("fitted", ()), ("diagnosed", ("diagnose",))):
        place = workspace.copied(workspaces(name), tmp_path / name)
        code, said = place.run(*targets, "-n")
        assert code == 0
        assert "Nothing to be done" in said


def test_there_are_enough_and_none_twice():
    names = [f"{area}: {fault}" for area, fault in ALL]
    assert len(names) >= 160
    assert len(set(names)) == len(names)
