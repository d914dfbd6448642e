"""What a finer mesh changes, where it has no usable solution from some step on."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.fit import finer
from fingerfit.fit.finer import as_on_finer_mesh
from fingerfit.fit.problem import FINAL, REFINED, SEARCH
from fingerfit.fit.rounds import Asked
from fingerfit.forward.predict import since_first_picture
from fingerfit.mesh.blocks import layered_block
from fingerfit.solvers.contract import CONVERGED, DIVERGED, Outcome

LAYERS = [("top", 6.0), ("bottom", 6.0)]
MESHES = {SEARCH: layered_block(12.0, LAYERS, 4, 2), REFINED: layered_block(12.0, LAYERS, 8, 4)}
SIZE = np.array([1.0, 2.0, 4.0, 5.0])
"""Prescribed at the steps."""
COARSE, FINE = 0.01, 0.012
"""What the solutions on the two meshes are in proportion to."""


def solution(mesh, factor, steps=4, begun=0.0):
    """One that is linear in place and load; at the state of the first picture, a step of its own, it is at `begun`."""
    points, size = MESHES[mesh].points, SIZE[:steps] + begun
    field = points @ np.array([[0.3, -0.1], [0.2, -1.0]])
    size = np.concatenate([[begun], size]) if begun else size
    forces = np.multiply.outer(factor * size, [0.5, -3.0])
    status = CONVERGED if steps == len(SIZE) else DIVERGED
    return Outcome(status, np.multiply.outer(factor * size, field), forces, 0.1 * forces, "", ())


@pytest.fixture
def known(tmp_path):
    """A problem whose simulations are kept by the names of their meshes, and its data without pictures."""

    def of(coarse, fine):
        for name, outcome in ((SEARCH, coarse), (REFINED, fine)):
            (tmp_path / name).mkdir()
            outcome.save(tmp_path / name / "solution.npz")
        data = SimpleNamespace(step=np.arange(1, 5), controlled=-SIZE, picture_step=np.array([1, 2]), outline=0.0)
        answer = lambda sim: Outcome.load(tmp_path / sim / "solution.npz")  # noqa: E731
        load = lambda asked: since_first_picture(answer(asked.sim), 4)  # noqa: E731
        problem = SimpleNamespace(
            meshes=MESHES, answer=answer, data=data, outcome=load, seen=lambda values: None,
            ask=lambda values: Asked(values, SEARCH, SEARCH, ""),
        )  # fmt: skip
        return as_on_finer_mesh(problem, Asked({}, REFINED, REFINED, "", FINAL), data)

    return of


@pytest.fixture
def folded_from(monkeypatch):
    """Sets the step, by its index, from whose picture on the body goes through itself on the finer mesh."""

    def set_to(first):
        fake = SimpleNamespace(map_at=lambda outcome, step, seen: SimpleNamespace(folded=step >= first))
        monkeypatch.setattr(finer, "Predictor", lambda data, mesh: fake)

    set_to(len(SIZE))
    return set_to


def same(found, expected):
    assert found.status == CONVERGED
    for name in ("displacement", "reaction", "indenter"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 3, 4])
def test_a_change_is_continued_with_the_prescribed_quantity(known, folded_from, steps):
    same(known(solution(SEARCH, COARSE), solution(REFINED, FINE, steps)), solution(SEARCH, FINE))


def test_a_body_that_goes_through_itself_is_on_another_way(known, folded_from):
    folded_from(2)
    broken = solution(REFINED, FINE)
    broken.displacement[2:] += 1e3
    same(known(solution(SEARCH, COARSE), broken), solution(SEARCH, FINE))


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_displacements_count_from_the_first_picture(known, folded_from, steps):
    """A solution that ended early has as many steps as one that was never loaded before."""
    found = known(solution(SEARCH, COARSE, begun=0.5), solution(REFINED, FINE, steps, begun=0.5))
    same(found, solution(SEARCH, FINE))


def test_nothing_is_known_without_any_usable_step(known, folded_from):
    assert known(solution(SEARCH, COARSE), solution(REFINED, FINE, 0)) is None


def test_nodes_outside_of_the_finer_mesh_have_the_change_of_the_nearest():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.1, 0.0]])
    change = np.array([[1.0, 2.0], [3.0, 4.0], [np.nan, np.nan]])
    assert finer._filled(change, points) == pytest.approx(np.array([[1.0, 2.0], [3.0, 4.0], [3.0, 4.0]]))
