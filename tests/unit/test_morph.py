"""Morphing: distances, repair, edges of layers, and the reference brought to two other fingers."""

from dataclasses import replace

import numpy as np
import pytest
from seeds import generator, seed_of

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.shape import Anatomy
from fingerfit.core.errors import InputError, SolverError
from fingerfit.imaging.noise import add_rician
from fingerfit.imaging.pictures import Picture
from fingerfit.mesh.blocks import brick
from fingerfit.mesh.repair import mend, spread
from fingerfit.mesh.tetrahedra import corners, faces_on, radius_ratio, to_quadratic, volumes
from fingerfit.morph.distance import surface_distance
from fingerfit.morph.edges import Profiles, find_border, find_layers
from fingerfit.morph.morph import INTENSITY, labelled, morph
from fingerfit.morph.register import Registration, register, tip_of
from fingerfit.morph.render import frame_around, render
from fingerfit.morph.straight import straightened

VOXEL = 0.3


@pytest.fixture(scope="module")
def reference():
    return finger_mesh(size=2.5, element="C3D4")


def turned(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def finger(anatomy, turn, shift):
    mesh = finger_mesh(anatomy, size=2.5, element="C3D4")
    return replace(mesh, points=mesh.points @ turn.T + shift)


FINGERS = {
    "thick skin": (
        Anatomy(length=36.0, width=17.5, palmar=7.2, bone_width=5.6, epidermis=0.75),
        turned(5),
        [1, -2, 0.5],
    ),
    "slender": (
        Anatomy(length=35.0, width=14.5, palmar=6.0, dorsal=5.5, tip=7.2, epidermis=0.5),
        turned(-4),
        [-1, 1, 0],
    ),
}


def largest_distance(mesh, true):
    nodes = np.setdiff1d(np.unique(faces_on(mesh, mesh.surfaces["SKIN"])), mesh.node_sets["END"])
    return surface_distance(mesh.points[nodes], true.points[faces_on(true, true.surfaces["SKIN"])])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["thick skin", "slender"])
def test_reference_takes_the_shape_of_another_finger(reference, name):
    anatomy, turn, shift = FINGERS[name]
    true = finger(anatomy, turn, np.array(shift))
    clean = render(true, frame_around(true, VOXEL, 2.0), {**INTENSITY, "SUBCUTANEOUS": 0.8})
    seen = replace(clean, values=add_rician(clean.values, 0.03, generator(1)))
    found = morph(reference, seen, Registration(sampling=0.15, iterations=40, seed=seed_of(1)))
    distance = largest_distance(found.mesh, true)
    # faces of 2 mm lie up to 0.1 mm within the round finger, other ones on each mesh
    assert distance.mean() < 0.1 < VOXEL
    assert np.percentile(distance, 95) < VOXEL
    assert found.quality.inverted == 0 == (volumes(found.mesh.points, corners(found.mesh)) <= 0).sum()
    assert found.thickness["measured"]
    assert found.thickness["mean"] == pytest.approx(anatomy.epidermis, rel=0.12)
    assert found.surface["mean"] < 0.05
    assert found.mesh.blocks is reference.blocks
    assert f"epidermis {found.thickness['mean']:.3f}" in str(found)


def test_a_segmentation_is_enough(reference):
    anatomy, turn, shift = FINGERS["slender"]
    true = finger(anatomy, turn, np.array(shift))
    frame = frame_around(true, VOXEL, 2.0)
    numbers = dict(enumerate(INTENSITY, 1))
    whole = render(true, frame, {name: float(n) for n, name in numbers.items()}, fine=1)
    seen = labelled(whole, numbers)
    assert set(np.unique(seen.values)) == {0.0, *INTENSITY.values()}
    found = morph(reference, seen, Registration(metric="ssd", iterations=40, seed=seed_of(1)))
    assert largest_distance(found.mesh, true).mean() < 0.1
    with pytest.raises(InputError, match="label 9: found no voxel"):
        labelled(whole, {9: "NAIL"})
    with pytest.raises(InputError, match="label 1: found HORN"):
        labelled(whole, {1: "HORN"})


def test_same_volumes_same_registration(reference):
    volume = render(reference, frame_around(reference, 0.8, 2.0), INTENSITY)
    settings = Registration(levels=1, iterations=3, seed=seed_of(1))
    points = reference.points[:50]
    moved = replace(volume, origin=volume.origin + np.array([0.4, -0.3, 0.2]))
    assert np.array_equal(register(volume, moved, settings)(points), register(volume, moved, settings)(points))
    assert np.abs(register(volume, moved, settings)(points) - points - [0.4, -0.3, 0.2]).max() < 0.15


def test_tip_is_found(reference):
    volume = render(reference, frame_around(reference, 0.5, 2.0), INTENSITY)
    assert np.allclose(tip_of(volume)[:2], [reference.points[:, 0].max(), 0.0], atol=0.5)  # a voxel


def test_bad_registrations_are_one_line(reference):
    flat = Picture(np.zeros((4, 4, 4)), np.ones(3), np.zeros(3), np.eye(3))
    plane = Picture(np.ones((4, 4)), np.ones(2), np.zeros(2), np.eye(2))
    good = replace(flat, values=np.arange(64.0).reshape(4, 4, 4))
    with pytest.raises(InputError, match="subject: picture: found one intensity everywhere"):
        register(good, flat)
    with pytest.raises(InputError, match="reference: picture: found 2 dimensions"):
        register(plane, good)
    with pytest.raises(InputError, match="registration: metric: found nmi"):
        Registration(metric="nmi")
    with pytest.raises(InputError, match="registration: grid"):
        Registration(grid=0.0)
    with pytest.raises(InputError, match="reference mesh: node set EPIDERMIS_OUTER"):
        morph(replace(reference, node_sets={}), good)


@pytest.fixture
def cube():
    return brick((3.0, 3.0, 3.0), (3, 3, 3), element="C3D4")


def test_spread_is_linear_where_borders_are(cube):
    outside = np.flatnonzero(((cube.points < 1e-9) | (cube.points > 3 - 1e-9)).any(axis=1))
    field = cube.points @ np.array([[0.1, 0.0, 0.2], [0.0, 0.3, 0.0], [0.0, 0.1, 0.0]])
    found = spread(cube, outside, field[outside])
    # weights by lengths of sides are not exact for a linear field; on a regular grid they are
    assert np.allclose(found, field, atol=0.02)
    assert np.array_equal(found[outside], field[outside])


def test_inverted_elements_are_mended(cube):
    inside = np.flatnonzero(((cube.points > 1e-9) & (cube.points < 3 - 1e-9)).all(axis=1))
    points = cube.points.copy()
    points[inside[0]] += 1.7
    assert (volumes(points, corners(cube)) <= 0).any()
    held = np.setdiff1d(np.arange(len(points)), inside)
    mended, moved = mend(cube, points, held)
    assert (volumes(mended, corners(cube)) > 0).all()
    assert inside[0] in moved and np.array_equal(mended[held], cube.points[held])
    untouched, none = mend(cube, cube.points, held)
    assert np.array_equal(untouched, cube.points) and not len(none)


def test_hopeless_elements_are_told(cube, monkeypatch):
    monkeypatch.setattr("fingerfit.mesh.repair.ROUNDS", 2)
    with pytest.raises(SolverError, match="elements stay inverted or flat"):
        mend(cube, cube.points * [1.0, 1.0, -1.0], np.zeros(0, dtype=int))


def test_quadratic_tetrahedra_become_eight_linear_ones():
    finger = to_quadratic(finger_mesh(size=4.0, element="C3D4H"))
    fine = straightened(finger)
    assert fine.element_count == 8 * finger.element_count
    assert volumes(fine.points, corners(fine)).min() > 0
    for name in ("EPIDERMIS", "BONE"):
        one, other = (volumes(m.points, corners(m))[m.element_sets[name]].sum() for m in (finger, fine))
        assert one == pytest.approx(other, rel=1e-12)
    on = np.unique(faces_on(fine, fine.surfaces["SKIN"]))
    assert np.array_equal(np.sort(fine.node_sets["EPIDERMIS_OUTER"]), on)
    apart = fine.points[fine.node_sets["EPIDERMIS_OUTER"]] - fine.points[fine.node_sets["EPIDERMIS_INNER"]]
    # in the middle of an edge between normals that are not parallel the layer is a little thinner
    assert np.allclose(np.linalg.norm(apart, axis=1), 0.6, atol=0.06)
    assert straightened(fine) is fine


def test_pieces_of_bent_tetrahedra_are_not_flat():
    bent = straightened(finger_mesh(size=5.0, element="C3D10H"))
    assert radius_ratio(bent.points, corners(bent)).min() > 0.02


@pytest.mark.parametrize("thickness", [0.45, 0.8])
def test_layer_of_known_depth_and_thickness(thickness):
    from scipy.sparse import identity

    # a wall: outside below z = 5.1, a layer, tissue; voxels are means over four samples
    z = (np.arange(160) + 0.5) * 0.0625 - 0.125
    fine = np.where(z < 5.1, 0.0, np.where(z < 5.1 + thickness, 0.4, 0.9))
    values = np.tile(fine.reshape(-1, 4).mean(axis=1)[:, None, None], (1, 6, 6))
    picture = Picture(values, np.full(3, 0.25), np.zeros(3), np.eye(3))
    points = np.array([[0.6, 0.6, 4.9], [0.7, 0.6, 5.3]])
    inward = np.tile([0.0, 0.0, 1.0], (2, 1))
    found = find_layers(Profiles(picture), points, inward, np.full(2, 0.6), identity(2, format="csr"))
    # a third of a voxel
    assert np.allclose(found.depth, [0.2, -0.2], atol=0.08)
    assert np.allclose(found.thickness, thickness, atol=0.08)
    border, contrast = find_border(
        Profiles(replace(picture, values=np.where(values > 0.65, 0.9, 0.4))),
        points + np.array([0, 0, thickness]),
        -inward,
        identity(2),
    )
    # half a voxel
    assert np.allclose(border, [-0.2, 0.2], atol=0.125)
    assert contrast > 100  # there is no noise
