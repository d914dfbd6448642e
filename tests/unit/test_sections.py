"""Slices of volumes and sections of meshes: at the right place in space, whatever the direction of the grid."""

import numpy as np
import pytest

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.sections import section, slice_at, slices_through, spread_slices
from fingerfit.mesh.blocks import brick

TURNED = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def frame(direction=None, origin=(-2.0, -1.0, -3.0)):
    values = np.arange(6 * 8 * 10, dtype=float).reshape(6, 8, 10)
    return Picture(values, np.array([1.0, 1.5, 2.0]), np.array(origin), np.eye(3) if direction is None else direction)


def test_axial_and_sagittal_slices_hold_the_point():
    grid, point = frame(), np.array([3.2, 4.9, 1.2])
    axial, sagittal = slices_through(grid, point)
    assert (axial.name, axial.axis, axial.index, axial.position) == ("axial", 0, 5, 3.0)
    assert (sagittal.name, sagittal.axis, sagittal.index, sagittal.position) == ("sagittal", 1, 4, 5.0)
    assert np.array_equal(axial.of(grid.values), grid.values[:, :, 5])
    assert np.array_equal(sagittal.of(grid.values[None])[0], grid.values[:, 4, :])
    # pixel borders: half a pixel around the outer centres
    assert axial.limits == pytest.approx((-1.75, -1.75 + 8 * 1.5, -4.0, -4.0 + 6 * 2))
    assert axial.labels == ("y in mm", "z in mm")
    assert axial.title == "axial, x = 3.0 mm"


def test_a_turned_grid_is_cut_across_the_same_directions_of_space():
    grid = frame(TURNED, origin=(4.0, -1.0, -3.0))
    axial, sagittal = slices_through(grid, np.array([1.0, 3.0, 1.0]))
    # x of space is minus the picture's second axis
    assert (axial.axis, axial.index, axial.position) == (1, 2, 1.0)
    assert (sagittal.axis, sagittal.index, sagittal.position) == (0, 4, 3.0)
    assert sagittal.labels[0] == "x in mm"
    assert sagittal.limits[:2] == pytest.approx((4.75, 4.75 - 8 * 1.5))


def test_spread_slices_stay_inside_and_apart():
    found = spread_slices(frame(), 0, 2.0, 8.4, 3)
    assert [cut.index for cut in found] == [3, 5, 7]
    assert [cut.index for cut in spread_slices(frame(), 0, -5.0, 50.0, 20)] == list(range(10))


@pytest.mark.parametrize("element", ["C3D4", "C3D8", "C3D10", "C3D20"])
def test_sections_are_the_borders_of_body_and_layers(element):
    mesh = brick((5.0, 6.0, 4.0), (2, 3, 2), element=element, layers=[("top", 1.0), ("bottom", 3.0)])
    grid = frame()
    cut = slice_at(grid, 0, 4)  # x = 2
    lines, part = section(mesh, mesh.points, grid, cut)
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    # the rectangle of 6 x 4 and the border at a height of 3
    assert lengths.sum() == pytest.approx(2 * (6 + 4) + 6)
    assert lines.min(axis=(0, 1)) == pytest.approx([0.0, 0.0], abs=1e-6)
    assert lines.max(axis=(0, 1)) == pytest.approx([6.0, 4.0], abs=1e-6)
    names = list(mesh.element_sets)
    top = lines[part == names.index("TOP")].reshape(-1, 2)
    assert top[:, 1].min() >= 3 - 1e-6
    between = np.isclose(lines[:, :, 1], 3.0).all(axis=1)
    assert lengths[between].sum() == pytest.approx(6.0)


def test_sections_follow_the_deformation():
    mesh = brick((5.0, 6.0, 4.0), (2, 3, 2), element="C3D4")
    points = mesh.points * [1.0, 1.0, 0.5] + [0.0, 1.0, 0.0]
    lines, _ = section(mesh, points, frame(), slice_at(frame(), 0, 4))
    assert lines.min(axis=(0, 1)) == pytest.approx([1.0, 0.0], abs=1e-6)
    assert lines.max(axis=(0, 1)) == pytest.approx([7.0, 2.0], abs=1e-6)
    gone, _ = section(mesh, points, frame(), slice_at(frame(), 0, 9))
    assert len(gone) == 0
