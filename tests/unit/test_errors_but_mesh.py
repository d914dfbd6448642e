"""What the mesh makes of pictures is taken off their errors, picture by picture."""

from types import SimpleNamespace

import numpy as np
import pytest

from fingerfit.diagnosis import mesh_errors
from fingerfit.diagnosis.mesh_errors import errors_but_mesh

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


def test_held_out_pictures_have_errors_of_their_own(monkeypatch):
    monkeypatch.setattr(mesh_errors, "_in_pictures", lambda comparison: np.array([0.0, 3.0]))
    assert errors_but_mesh(compared([2.0, 5.0], fitted=[1])) == (pytest.approx(2.0), pytest.approx(4.0))


def test_where_no_finer_mesh_tells_errors_are_as_they_are(monkeypatch):
    monkeypatch.setattr(mesh_errors, "_in_pictures", lambda comparison: None)
    assert errors_but_mesh(compared([2.0, 4.0])) == (pytest.approx(10.0**0.5), None)
