"""How many starts of the first pass are made: as many as take 20 minutes of one processor."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.diagnosis.budget import FEWEST, FIRST_MOVES, LONGEST, MOVES, QUICK, going_on, starts
from fingerfit.fit.problem import SEARCH
from fingerfit.solvers.cost import expected_seconds


def problem(*nodes, solver="builtin", dim=3):
    tests = [SimpleNamespace(meshes={SEARCH: SimpleNamespace(dim=dim, points=np.zeros((n, dim)))}) for n in nodes]
    return SimpleNamespace(settings=SimpleNamespace(solver=solver), every=tests)


def test_their_first_moves_take_that_time_in_all_tests_together():
    for every in ((265,), (2000,), (500, 700)):
        seconds = sum(expected_seconds("builtin", 3, nodes) for nodes in every)
        assert starts(problem(*every)) == pytest.approx(LONGEST / FIRST_MOVES / seconds, abs=1)


def test_a_fingertip_has_a_few_and_the_largest_mesh_the_fewest():
    assert FEWEST < starts(problem(7000)) < 20
    assert starts(problem(200_000)) == FEWEST


def test_in_the_plane_all_effects_have_room_with_another_program_as_well():
    """Some 130 starts on the meshes of the phantom."""
    assert starts(problem(900, dim=2)) > 130
    assert starts(problem(400, solver="calculix", dim=2)) > 130


def test_a_third_goes_on_and_all_where_that_takes_no_time():
    brick = problem(8)
    assert going_on(brick, 60) > 60
    assert going_on(brick, 60) == pytest.approx(
        QUICK / (MOVES - FIRST_MOVES) / expected_seconds("builtin", 3, 8), abs=1
    )
    assert going_on(problem(900, dim=2), 66) == 22
    assert going_on(problem(7000), 9) == FEWEST
