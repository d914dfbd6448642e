"""Pixels of tetrahedra by scan lines: the same as by trying all pixels of all boxes, and what cannot be mapped is told."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fingerfit.imaging.pictures import Picture
from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.tetrahedra import Claims, border_faces
from fingerfit.imaging.warp import _search, _winners, backward_map, sample, spline_coefficients, warp
from fingerfit.mesh.blocks import brick
from fingerfit.mesh.mesh import Block, Mesh

KINDS = ("C3D4", "C3D10")
TILTED = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])


def grid(shape=(20, 24, 30), size=14.0, direction=None):
    spacing = np.array([size / n for n in shape[::-1]])
    return Picture(
        np.zeros(shape), spacing, np.full(3, -1.0) + spacing / 2, np.eye(3) if direction is None else direction
    )


def bent(points):
    x, y, z = points.T
    return np.stack([0.5 * np.sin(y / 4), 0.4 * np.sin(z / 3 + x / 5), -0.1 * z * np.sin(x / 4)], axis=1)


def by_search(mesh, u, frame, margin):
    """What the way for elements of any type finds."""
    deformed, reference = frame.to_index(mesh.points + u), frame.to_index(mesh.points)
    size = np.array(frame.values.shape[::-1])
    (block,) = mesh.blocks
    claims = _search(block.element, deformed[block.nodes], reference[block.nodes], size, margin)
    return claims, _winners(claims, frame.values.shape, 0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("direction", [np.eye(3), TILTED], ids=["level", "turned"])
def test_the_same_as_by_search(kind, direction):
    mesh, frame = brick((12.0, 11.0, 9.0), (4, 3, 3), element=kind), grid(direction=direction)
    u = bent(mesh.points)
    _, expected = by_search(mesh, u, frame, 0.0)
    found = backward_map(mesh, u, frame)
    assert len(found.pixel) > 2000
    assert np.array_equal(found.pixel, expected.pixel)
    # the fixed point of a curved element ends at 1e-5 of its size
    assert found.index == pytest.approx(expected.index, abs=1e-9 if kind == "C3D4" else 2e-5)
    assert np.array_equal(found.element, expected.element)
    assert (found.inverted, found.overlaps) == (0, expected.overlaps) == (0, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_around_the_body_the_border_elements_are_carried_on(kind):
    mesh, frame = brick((12.0, 11.0, 9.0), (4, 3, 3), element=kind), grid()
    u = bent(mesh.points)
    claims, expected = by_search(mesh, u, frame, 1.5)
    found = backward_map(mesh, u, frame, 1.5)
    inside = np.isin(expected.pixel, claims.pixel[claims.depth <= 1])
    assert set(expected.pixel[inside]) <= set(found.pixel)
    outside = np.setdiff1d(found.pixel, expected.pixel[inside])
    assert len(outside) > 1000
    # within 1.5 pixels of the deformed surface, by a fine cloud of points on it
    cloud = surface(mesh, u, kind)
    away = cKDTree(frame.to_index(cloud)).query(places(frame))[0]
    covered = np.isin(np.arange(frame.values.size), expected.pixel[inside])
    assert set(np.flatnonzero((away < (1.48 if kind == "C3D4" else 1.4)) & ~covered)) <= set(outside)
    assert away[outside].max() < 1.55
    # the search reckons by the face that is furthest in local coordinates: another neighbour at most
    every = dict(zip(expected.pixel, expected.index, strict=True))
    both = np.isin(found.pixel, outside) & np.isin(found.pixel, expected.pixel)
    gap = np.linalg.norm(found.index[both] - np.array([every[p] for p in found.pixel[both]]), axis=1)
    assert np.median(gap) < 1e-4
    assert gap.max() < 1.0


def places(frame):
    """Pixel indices (x, y, z) of all pixels."""
    return np.indices(frame.values.shape)[::-1].reshape(3, -1).T.astype(float)


def surface(mesh, u, kind):
    """Points of the deformed sides of the brick, from the shape functions of the elements."""
    from fingerfit.mesh.elements import shape

    line = np.linspace(0.0, 1.0, 25)
    s, t = (g.ravel() for g in np.meshgrid(line, line))
    s, t = s[s + t <= 1 + 1e-9], t[s + t <= 1 + 1e-9]
    zero, found = np.zeros(len(s)), []
    size = mesh.points.max(axis=0)
    nodes = mesh.blocks[0].nodes
    for xi in ((s, t, zero), (s, zero, t), (zero, s, t), (s, t, 1 - s - t)):
        weights = shape(kind, np.stack(xi, axis=1))[0]
        rest = np.einsum("pn,eni->epi", weights, mesh.points[nodes])
        on = np.any((np.abs(rest) < 1e-9).all(axis=1) | (np.abs(rest - size) < 1e-9).all(axis=1), axis=1)
        found.append(np.einsum("pn,eni->epi", weights, (mesh.points + u)[nodes[on]]).reshape(-1, 3))
    return np.concatenate(found)


@pytest.mark.parametrize("kind", KINDS)
def test_affine_deformations_are_mapped_back_exactly_around_the_body_too(kind, rng):
    mesh, frame = brick((12.0, 10.0, 8.0), (3, 2, 2), element=kind), grid()
    gradient = np.eye(3) + 0.1 * rng.normal(size=(3, 3))
    way = backward_map(mesh, mesh.points @ gradient.T - mesh.points, frame, 1.5)
    pixels = np.stack(np.unravel_index(way.pixel, frame.values.shape)[::-1], axis=1)
    back = frame.to_points(pixels.astype(float)) @ np.linalg.inv(gradient).T
    assert frame.to_points(way.index) == pytest.approx(back, abs=1e-4 if kind == "C3D10" else 1e-9)
    # no pixel centre in reach of a side is left out: 1.5 pixels are 0.7 mm or more, 0.6 mm after the way back
    every = frame.to_points(np.indices(frame.values.shape)[::-1].reshape(3, -1).T.astype(float))
    every = every @ np.linalg.inv(gradient).T
    reach = 1.5 * frame.spacing.min() / np.linalg.norm(gradient, 2)
    size = np.array([12.0, 10.0, 8.0])
    beside = np.maximum(np.maximum(-every, every - size), 0.0)
    wanted = np.flatnonzero(np.linalg.norm(beside, axis=1) < reach)
    assert set(wanted) <= set(way.pixel)


def test_strongly_curved_elements_are_left_to_newton():
    """A lone element whose edges bulge by a third of their length: the fixed point alone does not settle everywhere."""
    mesh = brick((10.0, 10.0, 10.0), (1, 1, 1), element="C3D10")
    one = Mesh(mesh.points, (Block("C3D10", mesh.blocks[0].nodes[:1]),))
    nodes = one.blocks[0].nodes[0]
    u = np.zeros(one.points.shape)
    u[nodes[4:]] = 0.3 * (one.points[nodes[:4]].mean(axis=0) - one.points[nodes[4:]])
    frame = grid()
    _, expected = by_search(one, u, frame, 0.0)
    found = backward_map(one, u, frame)
    assert len(found.pixel) > 100
    assert np.array_equal(found.pixel, expected.pixel)
    assert found.index == pytest.approx(expected.index, abs=1e-3)


def test_inverted_elements_cover_nothing_and_are_counted():
    mesh, frame = brick((12.0, 12.0, 12.0), (2, 2, 2), element="C3D4"), grid()
    middle = int(np.argmin(np.linalg.norm(mesh.points - 6.0, axis=1)))
    u = np.zeros(mesh.points.shape)
    u[middle] = [9.0, 0.0, 0.0]  # out at the side
    way = backward_map(mesh, u, frame)
    deformed = (mesh.points + u)[mesh.blocks[0].nodes]
    turned = np.linalg.det(deformed[:, 1:] - deformed[:, :1]) <= 0
    assert way.inverted == turned.sum() > 0
    assert not turned[way.element].any()
    assert way.overlaps > 100


def test_two_bodies_in_one_place_are_told():
    one = brick((6.0, 6.0, 6.0), (2, 2, 2), element="C3D4")
    nodes = one.blocks[0].nodes
    both = Mesh(
        np.vstack([one.points, one.points + np.array([7.0, 0, 0])]),
        (Block("C3D4", np.vstack([nodes, nodes + len(one.points)])),),
    )
    u = np.zeros(both.points.shape)
    assert backward_map(both, u, grid()).overlaps == 0
    u[len(one.points) :, 0] = -3.0
    frame = grid()
    way = backward_map(both, u, frame)
    x, y, z = (frame.to_points(np.indices(frame.values.shape)[::-1].reshape(3, -1).T.astype(float))).T
    shared = (x > 4) & (x < 6) & (y > 0) & (y < 6) & (z > 0) & (z < 6)
    # but for pixels on faces between elements
    assert 0.7 * shared.sum() < way.overlaps <= shared.sum()


def test_a_mesh_of_bricks_and_tetrahedra():
    bricks, cut = brick((6.0, 6.0, 6.0), (2, 2, 2)), brick((6.0, 6.0, 6.0), (2, 2, 2), element="C3D4")
    points = np.vstack([bricks.points, cut.points + np.array([6.0, 0, 0])])
    mesh = Mesh(points, (bricks.blocks[0], Block("C3D4", cut.blocks[0].nodes + len(bricks.points))))
    frame = grid()
    way = backward_map(mesh, np.zeros(points.shape), frame, 1.4)
    pixels = np.stack(np.unravel_index(way.pixel, frame.values.shape)[::-1], axis=1)
    assert way.index == pytest.approx(pixels.astype(float), abs=1e-6)
    inside = backward_map(mesh, np.zeros(points.shape), frame)
    assert set(inside.element[frame.to_points(inside.index)[:, 0] > 6.1]) == set(range(8, 8 + 48))
    # as many as of one body of twice the length; around bricks the distance is that of their furthest coordinate
    whole = brick((12.0, 6.0, 6.0), (4, 2, 2), element="C3D4")
    count = len(backward_map(whole, np.zeros(whole.points.shape), frame, 1.4).pixel)
    assert len(way.pixel) == pytest.approx(count, rel=0.05)
    only = backward_map(whole, np.zeros(whole.points.shape), frame).pixel
    assert np.array_equal(inside.pixel, only)


def test_pixels_on_a_shared_face_belong_to_one_element():
    mesh = brick((10.0, 10.0, 10.0), (2, 2, 2), element="C3D4")
    frame = Picture(np.zeros((11, 11, 11)), np.ones(3), np.zeros(3), np.eye(3))  # pixels on nodes, edges, faces
    way = backward_map(mesh, np.zeros(mesh.points.shape), frame)
    assert np.array_equal(way.pixel, np.arange(11**3))
    assert way.overlaps == 0


def test_border_faces_are_those_of_the_surface():
    mesh = brick((3.0, 2.0, 1.0), (3, 2, 1), element="C3D4")
    ((element, face),) = border_faces([mesh.blocks[0].nodes])
    assert len(element) == 2 * 2 * (3 * 2 + 2 * 1 + 3 * 1)
    for one, opposite in zip(element, face, strict=True):
        corners = mesh.points[np.delete(mesh.blocks[0].nodes[one], opposite)]
        sides = np.concatenate([corners.T, corners.T - [[3], [2], [1]]])
        assert (np.abs(sides).max(axis=1) < 1e-12).any()


def test_values_between_voxels_are_those_of_the_spline(rng):
    x = np.arange(16.0)
    values = np.add.outer(np.add.outer((x - 8) ** 3 / 50, x**2), 3 * x)
    at = rng.uniform(5.0, 10.0, size=(50, 3))
    found = sample(spline_coefficients(values), at)
    assert found == pytest.approx((at[:, 2] - 8) ** 3 / 50 + at[:, 1] ** 2 + 3 * at[:, 0], rel=2e-3)
    assert sample(values, np.array([[-2.0, 3.0, 4.0]])) == pytest.approx(sample(values, np.array([[2.0, 3.0, 4.0]])))


@pytest.mark.parametrize("kind", KINDS)
def test_smoothing_where_the_body_is_smooths_everything(kind, rng):
    mesh, frame = brick((5.0, 6.0, 4.0), (2, 2, 2), element=kind), grid()
    way = backward_map(mesh, bent(mesh.points), frame, 1.5)
    coefficients = rng.uniform(size=frame.values.shape)
    assert warp(coefficients, 0.2, way, 1.0) == pytest.approx(smooth(warp(coefficients, 0.2, way), 1.0), abs=1e-12)
    single = warp(coefficients.astype(np.float32), 0.2, way, 1.0)
    assert single.dtype == np.float32
    assert single == pytest.approx(warp(coefficients, 0.2, way, 1.0), abs=1e-5)


def test_nothing_claimed():
    mesh, frame = brick((5.0, 6.0, 4.0), (2, 2, 2), element="C3D4"), grid()
    way = backward_map(mesh, np.full(mesh.points.shape, 100.0), frame, 1.5)
    assert len(way.pixel) == 0
    assert (warp(np.ones(frame.values.shape), 0.2, way, 1.0) == 0.2).all()
    assert len(Claims.joined([]).pixel) == 0


def test_a_moved_body_in_a_moved_frame_is_the_same():
    mesh, frame = brick((5.0, 6.0, 4.0), (2, 2, 2), element="C3D4"), grid()
    shift = np.array([0.7, -0.4, 0.3])
    one = backward_map(mesh, bent(mesh.points) + shift, frame, 1.5)
    moved = backward_map(mesh, bent(mesh.points), replace(frame, origin=frame.origin - shift), 1.5)
    assert np.array_equal(one.pixel, moved.pixel)
    back = moved.index - shift / frame.spacing
    assert one.index == pytest.approx(back, abs=1e-9)
