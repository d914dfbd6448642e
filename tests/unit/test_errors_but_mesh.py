"""What the mesh makes of pictures is taken off their errors, picture by picture."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.core.errors import StateError
from fingerfit.diagnosis import mesh_errors
from fingerfit.diagnosis.comparison import Comparison
from fingerfit.diagnosis.mesh_errors import errors_but_mesh
from fingerfit.fit.problem import REFINED

FLOOR = 0.02


def compared(error, fitted=None):
    """A model whose pictures have these errors, in units of the noise; all are fitted unless some are said to be."""
    steps = np.arange(len(error))
    test = SimpleNamespace(
        error=FLOOR * np.array(error),
        floor=FLOOR,
        data=SimpleNamespace(picture_step=steps, entry_step=steps, step=steps + 1),
        problem=SimpleNamespace(settings=SimpleNamespace(fit=SimpleNamespace(steps=fitted))),
    )
    test.every = (test,)
    return test


@pytest.mark.parametrize(
    ("error", "by_mesh", "left"),
    [
        ([2.0, 2.0], [0.0, 0.0], 2.0),
        ([2.0, 2.0], [1.0, 1.0], 3.0**0.5),
        ([1.0, 6.0], [0.0, 7.0], 1.0),  # no less than the noise in all of them together
        ([1.5, 6.0], [0.0, 7.0], (1.5**2 / 2) ** 0.5),  # too much of one picture hides none of another
        ([0.9, 0.9], [0.0, 0.0], 0.9),
        ([0.9, 0.9], [0.8, 0.8], 0.9),
    ],
)
def test_what_is_left_but_for_the_mesh(error, by_mesh, left, monkeypatch):
    monkeypatch.setattr(mesh_errors, "_in_pictures", lambda comparison: np.array(by_mesh))
    found, held = errors_but_mesh(compared(error))
    assert (found, held) == (pytest.approx(left), None)


@pytest.mark.parametrize(
    ("expected", "left", "made"),
    [
        ((0.2, 0.2), (0.2, 0.2), 0.2),  # as large as expected; each patch has noise beside it
        ((0.4, 0.0), (0.0, 0.2), 0.0),  # it would be large where nothing is left
        ((0.4, 0.0), (0.2, 0.2), 0.2 / 2**0.5),
        ((0.1, 0.1), (0.3, 0.3), 0.1),
        ((-0.2, 0.2), (0.2, -0.2), 0.2),  # only its size is known
    ],
)
def test_a_mesh_makes_no_more_of_a_patch_than_that_leaves(expected, left, made, monkeypatch):
    """Two patches of half a picture each."""
    patch = np.repeat([0, 1], 8)
    signs = np.tile([1.0, -1.0], 8)
    own = np.full((1, 4, 4), 0.5)
    spread = np.hypot(np.array(left)[patch], FLOOR)
    comparison = SimpleNamespace(
        data=SimpleNamespace(picture_step=np.array([0]), measured=own + (spread * signs).reshape(own.shape)),
        problem=SimpleNamespace(meshes={REFINED: None}),
        mesh=REFINED,
        anchor=None,
        pictures=lambda asked: own - np.array(expected)[patch].reshape(own.shape) / 2.0,
        prediction=SimpleNamespace(pictures=own),
        residual=SimpleNamespace(
            fits=[SimpleNamespace(patch=patch, pixel=np.arange(16))], floor=np.array([FLOOR])
        ),
        floor=np.array([FLOOR]),
    )  # fmt: skip
    monkeypatch.setattr(mesh_errors, "left_over", lambda problem, mesh: 2.0)
    assert mesh_errors._in_pictures(comparison) * FLOOR == pytest.approx([made], abs=1e-6)


def test_held_out_pictures_have_errors_of_their_own(monkeypatch):
    monkeypatch.setattr(mesh_errors, "_in_pictures", lambda comparison: np.array([0.0, 3.0]))
    assert errors_but_mesh(compared([2.0, 5.0], fitted=[1])) == (pytest.approx(2.0), pytest.approx(4.0))


def test_where_no_finer_mesh_tells_errors_are_as_they_are(monkeypatch):
    monkeypatch.setattr(mesh_errors, "_in_pictures", lambda comparison: None)
    assert errors_but_mesh(compared([2.0, 4.0])) == (pytest.approx(10.0**0.5), None)


def test_pictures_without_noise_are_no_unit_for_errors():
    comparison = Comparison.__new__(Comparison)
    comparison.problem = SimpleNamespace(settings=SimpleNamespace(study="studies/mine"))
    comparison.residual = SimpleNamespace(floor=np.array([0.02, 0.0]))
    comparison.__dict__["_by_control"] = np.zeros(2), np.zeros(2)
    with pytest.raises(StateError, match=r"studies/mine: its pictures have no noise: give pictures\.noise"):
        _ = comparison.floor
