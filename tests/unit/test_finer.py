"""What a finer mesh changes, where it has no usable solution from some step on."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.fit import finer
from fingerfit.fit.finer import as_on_finer_mesh, usable_steps
from fingerfit.fit.minimum import ORDER, left_over
from fingerfit.fit.problem import FINAL, REFINED, SEARCH
from fingerfit.fit.rounds import Asked
from fingerfit.forward.predict import since_first_picture
from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.warp import Probe
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
        data = SimpleNamespace(step=np.arange(1, 5), controlled=-SIZE, picture_step=np.array([1, 2]), outline=0.0,
                               spacing=np.array([0.2, 0.2]), measured=np.zeros((2, 2)))  # fmt: skip
        answer = lambda sim: Outcome.load(tmp_path / sim / "solution.npz")  # noqa: E731
        since = lambda whole, asked, steps=4: since_first_picture(whole, steps)  # noqa: E731
        load = lambda asked: since(answer(asked.sim), asked)  # noqa: E731
        problem = SimpleNamespace(
            meshes=MESHES, answer=answer, data=data, outcome=load, seen_since=since, seen=lambda values: None,
            ask=lambda values: Asked(values, SEARCH, SEARCH, ""), is_solved=lambda asked: True,
        )  # fmt: skip
        asked = Asked({}, REFINED, REFINED, "", FINAL)
        of.usable = usable_steps(problem, asked)
        return as_on_finer_mesh(problem, asked, data), fine.status == CONVERGED and finer.has_snapped(problem, asked)

    return of


@pytest.fixture
def folded_from(monkeypatch):
    """Sets the step, by its index, from whose picture on the body goes through itself on the finer mesh."""

    def set_to(first):
        monkeypatch.setattr(finer, "Predictor", lambda data, mesh: Fake(mesh, first))

    set_to(len(SIZE))
    return set_to


class Fake:
    """A predictor whose pictures say 0 where the body is as the measured one (all zero): without a fold, or with it."""

    rolled = False

    def __init__(self, mesh, first):
        self.mesh, self.first = mesh, first

    frame = Picture(np.zeros((2, 1)), np.ones(2), np.array([0.0, -100.0]), np.eye(2))
    """The first pixel lies far below the base, as the second one does."""

    def body_at(self, outcome, step, seen):
        return self.mesh, outcome.displacement[step]

    def map_at(self, outcome, step, seen):
        folded = self.mesh is MESHES[REFINED] and step >= self.first
        return SimpleNamespace(folded=folded, pixel=np.array([0]), beside=np.array([False]))

    def picture(self, way, step, seen):
        fine = float(self.mesh is MESHES[REFINED])
        # the second pixel belongs to no body beyond a plate: whatever it says does not count
        return np.array([fine != self.rolled, 9.0 * (fine == self.rolled)])


def same(found, expected):
    assert found.status == CONVERGED
    for name in ("displacement", "reaction", "indenter"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-12)


@pytest.mark.parametrize("steps", [1, 2, 3, 4])
def test_a_change_is_continued_with_the_prescribed_quantity(known, folded_from, steps):
    same(known(solution(SEARCH, COARSE), solution(REFINED, FINE, steps))[0], solution(SEARCH, FINE))
    assert known.usable == steps


def test_a_body_that_goes_through_itself_is_on_another_way(known, folded_from):
    folded_from(2)
    broken = solution(REFINED, FINE)
    broken.displacement[2:] += 1e3
    same(known(solution(SEARCH, COARSE), broken)[0], solution(SEARCH, FINE))
    assert known.usable == 2


def pushed(mesh, factor, far, step=2):
    """A solution in which one node of the side goes below the base from a step on."""
    found, points = solution(mesh, factor), MESHES[mesh].points
    side = int(np.flatnonzero((points[:, 0] == 12.0) & (points[:, 1] == 3.0))[0])
    found.displacement[step:, side, 1] = found.displacement[step:, points[:, 1] == 0.0, 1].min(axis=1) - 3.0 - far
    return found


@pytest.mark.parametrize(
    ("far", "coarse", "rolled", "snapped"),
    [(0.3, 0.0, False, True), (0.1, 0.0, False, False), (0.3, 0.3, False, False), (0.3, 0.0, True, False)],
    ids=["a snap", "less than a pixel", "on both meshes", "as in the pictures"],
)
def test_a_side_that_snaps_through_the_base_as_the_body_does_not(
    known, folded_from, monkeypatch, far, coarse, rolled, snapped
):
    monkeypatch.setattr(Fake, "rolled", rolled)
    before = pushed(SEARCH, COARSE, coarse) if coarse else solution(SEARCH, COARSE)
    found, said = known(before, pushed(REFINED, FINE, far))
    assert said is snapped
    if snapped:
        same(found, solution(SEARCH, FINE))
    else:
        assert np.abs(found.displacement[2:] - solution(SEARCH, FINE).displacement[2:]).max() > far / 2


@pytest.mark.parametrize("steps", [1, 2, 4])
def test_displacements_count_from_the_first_picture(known, folded_from, steps):
    """A solution that ended early has as many steps as one that was never loaded before."""
    found, _ = known(solution(SEARCH, COARSE, begun=0.5), solution(REFINED, FINE, steps, begun=0.5))
    same(found, solution(SEARCH, FINE))


def test_nothing_is_known_without_any_usable_step(known, folded_from):
    assert known(solution(SEARCH, COARSE), solution(REFINED, FINE, 0))[0] is None
    assert known.usable == 0


def test_places_outside_of_the_finer_mesh_move_as_the_nearest_inside():
    mesh = layered_block(2.0, [("a", 1.0)], 2, 1, "CPE4")
    places = np.array([[0.5, 0.5], [2.1, 0.5], [2.0, 0.5]])
    probe, moved = Probe(mesh, places), 0.1 * mesh.points + 1.0
    assert np.isnan(probe.read(moved)[1]).all()
    assert probe.read_near(moved) == pytest.approx(0.1 * places[[0, 2, 2]] + 1.0)
    # with all of them inside nothing is looked for, and with none nothing is known
    assert probe.read_near(moved)[[0, 2]] == pytest.approx(probe.read(moved)[[0, 2]])
    assert np.isnan(Probe(mesh, places[1:2]).read_near(moved)).all()


@pytest.mark.parametrize(("element", "across", "ratio"), [("CPE4", 12, 2), ("CPE8", 6, 2), ("CPE8", 12, 4)])
def test_a_mesh_is_finer_by_more_elements_and_by_their_order(element, across, ratio):
    """Quadratic elements of the same size are not the same mesh: what they change is not continued tenfold."""
    meshes = [layered_block(12.0, [("a", 12.0)], n, n, one) for one, n in (("CPE4", 6), (element, across))]
    problem = SimpleNamespace(every=(None,), meshes=dict(zip((SEARCH, REFINED), meshes, strict=True)))
    assert left_over(problem, REFINED) == pytest.approx(1 / (ratio**ORDER - 1))
