"""How many starts of the first pass are made: as many as take 20 minutes of one processor."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.diagnosis.budget import FEWEST, FIRST_MOVES, LONGEST, affordable
from fingerfit.fit.problem import SEARCH
from fingerfit.solvers.cost import expected_seconds


def problem(*nodes, solver="builtin", dim=3):
    tests = [SimpleNamespace(meshes={SEARCH: SimpleNamespace(dim=dim, points=np.zeros((n, dim)))}) for n in nodes]
    return SimpleNamespace(settings=SimpleNamespace(solver=solver), every=tests)


def test_their_first_moves_take_that_time_in_all_tests_together():
    for every in ((265,), (2000,), (500, 700)):
        seconds = sum(expected_seconds("builtin", 3, nodes) for nodes in every)
        assert affordable(problem(*every)) * FIRST_MOVES * seconds == pytest.approx(LONGEST)


def test_a_fingertip_has_a_few_and_the_largest_mesh_the_fewest():
    assert FEWEST < affordable(problem(7000)) < 20
    assert affordable(problem(200_000)) == FEWEST


def test_in_the_plane_all_effects_have_room_with_another_program_as_well():
    """Some 130 starts on the meshes of the phantom."""
    assert affordable(problem(900, dim=2)) > 130
    assert affordable(problem(400, solver="calculix", dim=2)) > 130
