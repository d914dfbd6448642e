"""The reference finger: its mesh, its sets, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import CLEARANCE, add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.errors import InputError
from fingerfit.mesh_io import format_mesh, read_mesh
from fingerfit.tetrahedra import corners, faces_on, outer_faces, quality, radius_ratio, volumes

COARSE = 3.0


@pytest.fixture(scope="module")
def finger():
    return finger_mesh(size=COARSE)


def test_tissues_fill_the_finger_once(finger):
    tissues = ("EPIDERMIS", "SUBCUTANEOUS", "DISTAL", "MIDDLE", "NAIL")
    members = np.concatenate([finger.element_sets[name] for name in tissues])
    assert np.array_equal(np.sort(members), np.arange(finger.element_count))
    assert np.array_equal(np.unique(corners(finger)), np.arange(len(finger.points)))
    assert quality(finger).inverted == 0
    # netgen's part of the body and the prisms close it: the faces outside enclose what the elements fill
    faces = finger.points[faces_on(finger, outer_faces(finger))]
    enclosed = np.linalg.det(faces).sum() / 6
    assert enclosed == pytest.approx(volumes(finger.points, corners(finger)).sum(), rel=1e-9)


def test_surface_is_the_skin_and_the_end(finger):
    outside = outer_faces(finger)
    flat = finger.points[faces_on(finger, outside)][:, :, 0].max(axis=1) < 1e-9
    assert len(finger.surfaces["SKIN"]) == (~flat).sum()
    assert np.array_equal(np.unique(faces_on(finger, outside[flat])), np.sort(finger.node_sets["END"]))


@pytest.mark.parametrize("across", [1, 2])
def test_epidermis_has_its_thickness(across):
    anatomy = Anatomy(epidermis=0.5, dermis=0.6)
    mesh = finger_mesh(anatomy, size=COARSE, across=across)
    inner, count = mesh.node_sets["EPIDERMIS_INNER"], len(mesh.node_sets["EPIDERMIS_INNER"])
    depth = np.linalg.norm(mesh.points[inner] - mesh.points[:count], axis=1)
    assert np.allclose(depth, 0.5, atol=1e-12)
    # the layer's nodes on both sides and no other tissue between: area times thickness is nearly its volume
    faces = mesh.points[faces_on(mesh, mesh.surfaces["SKIN"])]
    area = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1).sum() / 2
    found = quality(mesh).volume
    assert 0.9 * area * 0.5 < found["EPIDERMIS"] + found["NAIL"] < area * 0.5


def test_same_numbers_same_mesh(finger):
    assert format_mesh(finger_mesh(size=COARSE)) == format_mesh(finger)


def test_one_number_makes_it_finer(finger):
    fine = quality(finger_mesh(size=0.6 * COARSE))
    assert 1.8 * finger.element_count < fine.elements < 5 * finger.element_count
    assert fine.volume["SOFT"] == pytest.approx(quality(finger).volume["SOFT"], rel=0.02)


def test_quadratic_variant_has_the_same_corners(finger):
    curved = finger_mesh(size=COARSE, element="C3D10H")
    assert [block.element for block in curved.blocks] == ["C3D10H", "C3D10"]
    assert np.array_equal(corners(curved), corners(finger))
    middle = curved.points[curved.blocks[0].nodes[:, 4]]
    ends = curved.points[curved.blocks[0].nodes[:, :2]].mean(axis=1)
    assert np.allclose(middle, ends)
    assert set(finger.node_sets["END"]) < set(curved.node_sets["END"])
    assert np.allclose(curved.points[curved.node_sets["END"], 0], 0)


def test_sets_and_surfaces_survive_a_file(finger, tmp_path):
    mesh = add_fixtures(finger, (Anatomy().pulp_centre, 0.0))
    (tmp_path / "mesh.inp").write_text(format_mesh(mesh))
    again = read_mesh(tmp_path / "mesh.inp")
    assert np.allclose(again.points, mesh.points)
    for name, faces in mesh.surfaces.items():
        assert np.array_equal(again.surfaces[name], faces)
    for name, members in mesh.element_sets.items():
        assert np.array_equal(again.element_sets[name], members)


def test_indenter_and_tube_touch(finger):
    radius, tube = 2.5, 10.0
    at = (Anatomy().pulp_centre - 1.0, 0.7)
    mesh = add_fixtures(finger, at, radius, tube)
    centre = mesh.points[mesh.node_sets["INDENTER_TURN"][0]]
    assert np.allclose(centre[:2], at)
    assert mesh.points[mesh.node_sets["INDENTER"][0], 2] == pytest.approx(centre[2] - radius)
    palmar = mesh.points[np.unique(faces_on(mesh, mesh.surfaces["PALMAR"]))]
    assert np.linalg.norm(palmar - centre, axis=1).min() == pytest.approx(radius, abs=1e-9)
    dorsal = mesh.points[np.unique(faces_on(mesh, mesh.surfaces["DORSAL"]))]
    axis = mesh.points[mesh.node_sets["TUBE_TURN"][0]]
    assert np.hypot(*(dorsal - axis)[:, 1:].T).max() == pytest.approx(tube - CLEARANCE, abs=1e-9)
    assert np.array_equal(mesh.points[: len(finger.points)], finger.points)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"width": -1.0}, "width"),
        ({"taper": 0.9}, "taper"),
        ({"epidermis": 0.0}, "epidermis"),
        ({"bone_height": 9.0}, "bone_height"),
        ({"bone_width": 12.0}, "bone_width"),
        ({"joint": 31.5}, "joint"),
        ({"bone_cover": 0.7}, "bone_cover"),
        ({"length": float("nan")}, "length"),
    ],
)
def test_impossible_anatomy_is_one_line(change, field):
    with pytest.raises(InputError, match=f"^anatomy: {field}: found .*; expected [^\n]*$"):
        replace(Anatomy(), **change)


def test_other_input_is_refused(finger):
    with pytest.raises(InputError, match="element: found C3D8"):
        finger_mesh(element="C3D8")
    with pytest.raises(InputError, match="size"):
        finger_mesh(size=0.0)
    with pytest.raises(InputError, match="a place above the skin"):
        add_fixtures(finger, (60.0, 0.0))
    with pytest.raises(InputError, match="tube"):
        add_fixtures(finger, (22.0, 0.0), tube=4.0)


def test_quality_of_known_tetrahedra():
    regular = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    corner = np.eye(4)[:, 1:]
    points, nodes = np.concatenate([regular, corner]), np.array([[0, 2, 1, 3], [0, 1, 2, 3], [4, 5, 6, 7]])
    sign = np.sign(volumes(points, nodes))
    assert sorted(sign[:2]) == [-1, 1]
    ratio = radius_ratio(points, nodes)
    assert ratio[:2].max() == pytest.approx(1.0)
    assert ratio[:2].min() == 0.0
    # inscribed (3 - sqrt 3) / 6, circumscribed sqrt 3 / 2
    assert ratio[2] == pytest.approx(3 * (3 - np.sqrt(3)) / 6 / (np.sqrt(3) / 2))
