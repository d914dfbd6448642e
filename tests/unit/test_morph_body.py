"""Meshes of any body brought to another subject: by a known map, from its segmentation or its volume."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates
from seeds import generator

from fingerfit.cli import main
from fingerfit.core.errors import InputError
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.mesh.blocks import brick
from fingerfit.mesh.inside import sizes
from fingerfit.morph.body import morph_body, morph_labels
from fingerfit.morph.interfaces import interfaces_of
from fingerfit.segment.mesher import mesh_labels

pytest.importorskip("netgen.meshing")
VOXEL = 1.5
SIZE = 6.0
STRETCH, SHIFT = np.array([1.15, 0.9, 1.1]), np.array([4.0, -3.0, 2.0])
BEND = 0.006
"""How far the body leans to x by the square of its height, 1/mm: volumes do not change by it."""
NAMES = {1: "FAT", 2: "GLAND"}
RADII = {"FAT": np.array([26.0, 24.0, 22.0]), "GLAND": np.array([15.0, 14.0, 12.0])}
FOOT = -12.0
"""Height of the flat side of the body, mm."""


def there(points):
    """Where the points of the reference are in the subject."""
    moved = points * STRETCH
    moved[:, 0] += BEND * moved[:, 2] ** 2
    return moved + SHIFT


def back(points):
    """Where the points of the subject are in the reference."""
    moved = points - SHIFT
    moved[:, 0] -= BEND * moved[:, 2] ** 2
    return moved / STRETCH


def frame(origin):
    return Picture(np.zeros((38, 48, 52)), np.full(3, VOXEL), np.array(origin, float), np.eye(3))


REFERENCE, SUBJECT = frame((-38.0, -35.0, -20.0)), frame((-34.0, -37.0, -20.0))


def segmented(picture, to_reference):
    index = np.indices(picture.values.shape)[::-1].reshape(3, -1).T
    points = to_reference(picture.to_points(index.astype(float)))
    values = np.zeros(len(points))
    values[(((points / RADII["FAT"]) ** 2).sum(axis=1) < 1) & (points[:, 2] > FOOT)] = 1
    values[((points / RADII["GLAND"]) ** 2).sum(axis=1) < 1] = 2
    values[points[:, 2] < FOOT] = 0
    return replace(picture, values=values.reshape(picture.values.shape))


@pytest.fixture(scope="module")
def reference():
    return mesh_labels(segmented(REFERENCE, lambda x: x), SIZE, NAMES, sides={"BOTTOM": "z-", "TOP": "z+"})


def distances(mesh, part, to_reference):
    """From the nodes on the round side of a part to it, mm, to first order."""
    nodes = np.unique(np.concatenate([one.triangles for one in interfaces_of(mesh) if one_of(one) == part]))
    place = mesh.points[nodes]
    place = place[to_reference(place)[:, 2] > FOOT + 2 * VOXEL]

    def level(at):
        return np.linalg.norm(to_reference(at) / RADII[part], axis=1) - 1

    slope = np.stack([level(place + step) - level(place - step) for step in 0.01 * np.eye(3)], axis=1) / 0.02
    return np.abs(level(place) / np.linalg.norm(slope, axis=1))


def one_of(interface):
    return "GLAND" if "GLAND" in (interface.inner, interface.outer) else "FAT"


def test_a_mesh_takes_the_shape_of_another_subject_by_its_segmentation(reference, tmp_path, capsys):
    write_picture(tmp_path / "labels.mha", segmented(SUBJECT, back))
    (tmp_path / "reference.inp").write_text(format_mesh(reference))
    arguments = [str(tmp_path / name) for name in ("reference.inp", "labels.mha")]
    out = tmp_path / "subject.inp"
    assert main(["morph", *arguments, "--labels", "1=FAT,2=GLAND", "--out", str(out)]) == 0
    found, said = read_mesh(out), capsys.readouterr().out
    assert (sizes(found) > 0).all()
    for name in ("BOTTOM", "TOP"):
        assert found.node_sets[name].tolist() == reference.node_sets[name].tolist()
    for name in RADII:
        far = distances(found, name, back)
        assert far.mean() < VOXEL / 8
        assert np.percentile(far, 95) < VOXEL / 3
        assert found.element_sets[name].tolist() == reference.element_sets[name].tolist()
        assert f"{name}: {sizes(found)[found.element_sets[name]].sum():.5g} mm^3; by labels" in said
    # the map has a determinant of its own, and the gland is whole
    gland = 4 / 3 * np.pi * RADII["GLAND"].prod() * STRETCH.prod()
    assert sizes(found)[found.element_sets["GLAND"]].sum() == pytest.approx(gland, rel=0.02)
    # the flat side stays where it is, but for its rim
    low = found.points[found.node_sets["BOTTOM"], 2]
    assert np.median(low) == pytest.approx(there(np.array([[0.0, 0.0, FOOT]]))[0, 2], abs=VOXEL / 2)


def test_a_volume_of_each_subject_is_enough(reference):
    labels = segmented(REFERENCE, lambda x: x)
    texture = gaussian_filter(generator(1).normal(size=labels.values.shape), 2.0)
    level = np.array([0.1, 0.5, 0.9])[labels.values.astype(int)] + (labels.values > 0) * 0.05 * texture / texture.std()
    own = replace(labels, values=gaussian_filter(level, 0.5))
    index = np.indices(SUBJECT.values.shape)[::-1].reshape(3, -1).T
    places = own.to_index(back(SUBJECT.to_points(index.astype(float))))[:, ::-1].T
    seen = map_coordinates(own.values, places, order=1, mode="nearest").reshape(SUBJECT.values.shape)
    noisy = replace(SUBJECT, values=seen + generator(2).normal(scale=0.02, size=seen.shape))
    found = morph_body(reference, own, noisy)
    far = np.linalg.norm(found.mesh.points - there(reference.points), axis=1)
    # nodes within the body are those of the same tissue, as its texture tells
    assert far.mean() < VOXEL / 2
    for name in RADII:
        assert distances(found.mesh, name, back).mean() < VOXEL / 4
    assert (sizes(found.mesh) > 0).all()
    assert "GLAND to FAT: mean" in str(found)


def test_borders_without_contrast_stay_where_the_registration_brings_them(reference):
    own = segmented(REFERENCE, lambda x: x)
    own = replace(own, values=np.minimum(own.values, 1.0))
    noisy = [replace(own, values=own.values + generator(n).normal(scale=0.05, size=own.values.shape)) for n in (1, 2)]
    found = morph_body(reference, *noisy)
    assert found.left["GLAND to FAT"] is None
    assert found.left["FAT to outside"] is not None
    assert "GLAND to FAT: not seen" in str(found)
    assert np.linalg.norm(found.mesh.points - reference.points, axis=1).mean() < VOXEL / 2


def test_borders_of_a_mesh_are_closed():
    cube = brick((3.0, 3.0, 3.0), (3, 3, 3), element="C3D4")
    middle = cube.points[cube.blocks[0].nodes].mean(axis=1)
    held = np.flatnonzero((np.abs(middle - 1.5) < 0.5).all(axis=1))
    found = {str(one): one for one in interfaces_of(replace(cube, element_sets={"CORE": held}))}
    assert set(found) == {"REST to CORE", "REST to outside"}
    for name, volume in (("REST to CORE", 1.0), ("REST to outside", 27.0)):
        a, b, c = np.moveaxis(cube.points[found[name].triangles], 1, 0)
        # of the core its sides look inward, as seen from it
        assert abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6) == pytest.approx(volume)


@pytest.mark.parametrize(
    ("labels", "says"),
    [
        ({1: "FAT", 2: "BONE"}, "label 2: found BONE; expected one of FAT, GLAND"),
        ({1: "FAT", 3: "GLAND"}, "label 3: found no voxel; expected voxels of GLAND"),
        ({1: "FAT"}, "labels: found no label of element set GLAND"),
    ],
)
def test_labels_that_do_not_fit_are_one_line(labels, says, reference):
    with pytest.raises(InputError, match=says):
        morph_labels(reference, segmented(SUBJECT, back), labels)


def test_volumes_that_do_not_fit_are_one_line(reference):
    own = segmented(REFERENCE, lambda x: x)
    flat = Picture(np.ones((5, 5)), np.ones(2), np.zeros(2), np.eye(2))
    with pytest.raises(InputError, match="subject: picture: found 2 dimensions"):
        morph_body(reference, own, flat)
    with pytest.raises(InputError, match="reference: own picture: found 2 dimensions"):
        morph_body(reference, flat, own)
    with pytest.raises(InputError, match="own volume: found no voxel in the mesh"):
        morph_body(reference, replace(own, origin=own.origin + 500.0), own)
    with pytest.raises(InputError, match="elements: found C3D8; expected a mesh of tetrahedra"):
        morph_body(brick((3.0, 3.0, 3.0), (3, 3, 3)), own, own)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "--at, --own, --labels: found none of them"),
        (["--own", "own.mha", "--labels", "1=FAT"], "found --own and --labels"),
        (["--own", "own.mha", "--at", "1", "2"], "--at, --own: found both"),
        (["--own", "own.mha", "--out", "body.msh"], "--out: name: found body.msh"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, says, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["morph", "reference.inp", "subject.mha", "--out", "body.inp", *arguments]) == 1
    said = capsys.readouterr().err
    assert says in said
    assert len(said.splitlines()) == 1
