"""Meshes of segmentations: borders where the labels have them, sets, sides, holes; and segmentations that are none."""

from dataclasses import replace

import numpy as np
import pytest
import SimpleITK as sitk

from fingerfit.cli import main
from fingerfit.core.errors import InputError, SolverError
from fingerfit.deck.mesh_file import read_mesh
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.mesh.faces import faces_of
from fingerfit.mesh.inside import sizes
from fingerfit.mesh.tetrahedra import quality
from fingerfit.segment.labels import read_names
from fingerfit.segment.mesher import mesh_labels

pytest.importorskip("netgen.meshing")
SPACING = 0.5
STRAIGHT = np.eye(2)
TURNED = np.array([[0.8, -0.6], [0.6, 0.8]])


def disk(direction=STRAIGHT):
    """A disk with a radius of 20 mm with another of 7 mm in it; in the plane."""
    x, y = np.meshgrid(np.arange(100) * SPACING - 25, np.arange(100) * SPACING - 25)
    values = np.where(x**2 + y**2 < 20**2, 1.0, 0.0)
    values[(x - 5) ** 2 + y**2 < 7**2] = 2
    return Picture(values, np.full(2, SPACING), np.array([3.0, -4.0]), direction)


def beside(picture, label):
    """The same with a label in a corner, away from the body."""
    values = picture.values.copy()
    values[:3, :3] = label
    return replace(picture, values=values)


def test_areas_in_the_plane_are_those_of_the_labels_wherever_the_picture_lies():
    for direction in (STRAIGHT, TURNED):
        picture = disk(direction)
        mesh = mesh_labels(picture, 2.0, {1: "FAT", 2: "BONE"})
        assert [block.element for block in mesh.blocks] == ["CPE6"]
        area = sizes(mesh)
        assert area.min() > 0
        # chords of 2 mm instead of an arc with a radius of 7 mm lose 1.4 %
        assert area[mesh.element_sets["BONE"]].sum() == pytest.approx(np.pi * 7**2, rel=0.05)
        assert area.sum() == pytest.approx(np.pi * 20**2, rel=0.02)
        middle = picture.to_points(np.array([[60.0, 50.0]]))
        bone = mesh.points[mesh.blocks[0].nodes[mesh.element_sets["BONE"]]]
        # nodes of the border lie on the circle within a quarter of a pixel on average
        far = np.linalg.norm(bone - middle, axis=2)
        assert far.max() < 7 + SPACING
        assert np.sort(np.unique(far))[-20:].mean() == pytest.approx(7, abs=SPACING / 4)


def test_a_hole_is_left_out_and_its_border_is_a_node_set():
    mesh = mesh_labels(disk(), 2.0, {1: "FAT"}, {2: "PAD"}, sides={"BOTTOM": "y-"})
    assert sizes(mesh).sum() == pytest.approx(np.pi * (20**2 - 7**2), rel=0.03)
    far = np.linalg.norm(mesh.points[mesh.node_sets["PAD"]] - [33, 21], axis=1)
    assert len(far) > 20
    assert np.abs(far - 7).max() < 0.75
    low = mesh.points[mesh.node_sets["BOTTOM"], 1]
    assert low.max() <= mesh.points[:, 1].min() + 1.0


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A ball with a radius of 16 mm on a flat side, with another of 8 mm in it."""
    z, y, x = np.meshgrid(*[np.arange(36) - 17.5] * 3, indexing="ij")
    values = np.where((x**2 + y**2 + z**2 < 16**2) & (z > -10), 1.0, 0.0)
    values[(x**2 + y**2 + z**2) < 8**2] = 2
    path = tmp_path_factory.mktemp("ball") / "labels.mha"
    write_picture(path, Picture(values, np.ones(3), np.zeros(3), np.eye(3)))
    return path


def test_a_body_in_space_is_meshed_from_its_file(ball, tmp_path, capsys):
    out = tmp_path / "body.inp"
    assert main(["mesh", str(ball), "--size", "5", "--labels", "1=FAT,2=GLAND", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    mesh = read_mesh(out)
    found = quality(mesh)
    assert mesh.blocks[0].element == "C3D10"
    assert found.inverted == 0
    assert f"GLAND: {len(mesh.element_sets['GLAND'])} elements" in said
    # elements of 5 mm in a ball with a radius of 8 mm: three across; the body is a ball without its cap
    volume = sizes(mesh)
    assert volume[mesh.element_sets["GLAND"]].sum() == pytest.approx(4 / 3 * np.pi * 8**3, rel=0.12)
    assert volume.sum() == pytest.approx(4 / 3 * np.pi * 16**3 - np.pi * 6**2 * (3 * 16 - 6) / 3, rel=0.01)
    # the flat side is where the voxels end, and it is flat
    assert np.ptp(mesh.points[mesh.node_sets["BOTTOM"], 2]) < 1e-9
    assert mesh.points[mesh.node_sets["BOTTOM"], 2].mean() == pytest.approx(17.5 - 10)


@pytest.mark.parametrize("size", [4.0, 6.0])
def test_flat_ends_keep_their_rims(size):
    """A drum with a pad on a part of its upper end."""
    z, y, x = np.meshgrid(np.arange(30) - 4.0, np.arange(44) - 21.6, np.arange(44) - 21.4, indexing="ij")
    values = np.where((np.hypot(x, y) < 18) & (z > 0) & (z < 20), 1.0, 0.0)
    values[(np.hypot(x, y) < 10) & (z >= 20)] = 2
    picture = Picture(values, np.ones(3), np.zeros(3), np.eye(3))
    mesh = mesh_labels(picture, size, {1: "FAT"}, {2: "TOP"}, sides={"BOTTOM": "z-"})
    # before rims had a place of their own, the base was 6 to 11 % too small, and the pad 10 to 20 %
    assert area(mesh, "BOTTOM") == pytest.approx(np.pi * 18**2, rel=0.02)
    assert area(mesh, "TOP") == pytest.approx(np.pi * 10**2, rel=0.03)
    assert sizes(mesh).sum() == pytest.approx(np.pi * 18**2 * 19, rel=0.02)
    for name in ("BOTTOM", "TOP"):
        assert np.ptp(mesh.points[mesh.node_sets[name], 2]) < 1e-9


def area(mesh, name):
    """Of the sides of the body between nodes of a set, each as four triangles."""
    sides = mesh.blocks[0].nodes[:, np.array(faces_of("C3D10"))].reshape(-1, 6)
    places = mesh.points[sides[np.isin(sides, mesh.node_sets[name]).all(axis=1)]]
    pieces = places[:, [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)]].reshape(-1, 3, 3)
    return np.linalg.norm(np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0]), axis=1).sum() / 2


def test_what_netgen_cannot_fill_is_one_line(monkeypatch):
    from netgen import geom2d

    def fails(*_, **__):
        raise RuntimeError("Meshing failed")

    monkeypatch.setattr(geom2d.SplineGeometry, "GenerateMesh", fails)
    with pytest.raises(SolverError, match="netgen could not fill the body: Meshing failed; try another size"):
        mesh_labels(disk(), 2.0, {1: "FAT", 2: "BONE"})


def test_names_of_segments_of_slicer_are_read_and_layers_refused(tmp_path):
    image = sitk.GetImageFromArray(np.ones((2, 2, 2), np.uint8))
    for key, value in {"Name": "Left breast", "LabelValue": "3", "Layer": "0"}.items():
        image.SetMetaData(f"Segment0_{key}", value)
    sitk.WriteImage(image, str(tmp_path / "one.seg.nrrd"))
    assert read_names(tmp_path / "one.seg.nrrd") == {3: "LEFT_BREAST"}
    image.SetMetaData("Segment0_Layer", "1")
    sitk.WriteImage(image, str(tmp_path / "two.seg.nrrd"))
    with pytest.raises(InputError, match=r"several layers.*do not overlap"):
        read_names(tmp_path / "two.seg.nrrd")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"picture": replace(disk(), values=np.zeros((100, 100)))}, "labels"),
        ({"tissues": {1: "FAT"}}, "2 without a name"),
        ({"tissues": {1: "FAT", 2: "BONE", 3: "SKIN"}}, "3, which no pixel has"),
        ({"size": 30.0}, "two elements or more along each axis"),
        ({"size": 0.01}, "10000000 cells at most"),
        ({"element": "C3D10"}, "one of CPE6"),
        ({"picture": beside(disk(), 3), "holes": {3: "PAD"}}, "PAD, which touches no tissue"),
        ({"sides": {"TOP": "z+"}}, "one of x-, x[+], y-, y[+]"),
    ],
)
def test_what_cannot_be_meshed_is_one_line(given, says):
    with pytest.raises(InputError, match=says):
        mesh_labels(**{"picture": disk(), "size": 2.0, "tissues": {1: "FAT", 2: "BONE"}, **given})


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--size", "0"], "--size: size: found 0"),
        (["--size", "nan"], "--size"),
        (["--size", "5", "--grading", "2"], "--grading"),
        (["--size", "5", "--labels", "FAT"], "--labels: label: found FAT"),
        (["--size", "5", "--labels", "1=FAT", "--holes", "foo"], "--holes: label: found foo"),
        (["--size", "5", "--base", "up"], "side: found up"),
        (["--size", "5", "--out", "body.msh"], "ends in .inp"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, says, ball, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["mesh", str(ball), "--out", "body.inp", *arguments]) == 1
    said = capsys.readouterr().err
    assert says in said
    assert len(said.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
