"""The reference finger: its mesh, its sets, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from fingerfit.anatomy.curved import bone_faces
from fingerfit.anatomy.description import read_finger, tissues_of
from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import CLEARANCE, add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.cli import main
from fingerfit.core.errors import InputError
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.mesh.bent import ease, middles
from fingerfit.mesh.blocks import brick
from fingerfit.mesh.tetrahedra import corners, faces_on, outer_faces, quality, radius_ratio, volumes
from fingerfit.morph.distance import surface_distance

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


def test_quadratic_variant_has_the_same_corners_and_curved_edges(finger):
    curved = finger_mesh(size=COARSE, element="C3D10H")
    assert [block.element for block in curved.blocks] == ["C3D10H", "C3D10"]
    assert np.array_equal(corners(curved), corners(finger))
    assert set(finger.node_sets["END"]) < set(curved.node_sets["END"])
    assert np.allclose(curved.points[curved.node_sets["END"], 0], 0)
    # where edges are straight, the middles of coarse ones are 0.1 mm inside of a much finer surface
    fine = finger_mesh(size=1.0)
    surface = fine.points[faces_on(fine, fine.surfaces["SKIN"])]
    middle = curved.node_sets["EPIDERMIS_OUTER"][len(finger.node_sets["EPIDERMIS_OUTER"]) :]
    between = middles(np.concatenate([block.nodes for block in curved.blocks]))
    edges = np.array([edge for edge, node in between.items() if node in middle])
    middle = np.array([between[a, b] for a, b in edges.tolist()])
    straight = finger.points[edges].mean(axis=1)
    far = [np.percentile(surface_distance(points, surface), 90) for points in (straight, curved.points[middle])]
    assert far[0] > 0.1
    assert far[1] < 0.03
    # the skin keeps its thickness between its corners, and no element is turned inside out anywhere
    below = [between[a, b] for a, b in (edges + len(finger.node_sets["EPIDERMIS_OUTER"])).tolist()]
    depth = np.linalg.norm(curved.points[below] - curved.points[middle], axis=1)
    assert np.allclose(depth, Anatomy().epidermis, rtol=0.15)
    assert ease(curved)[1] == 0
    # an edge between two nodes of the bones' surface may go through the bone: its middle is not on it
    bones = curved.points[curved.node_sets["BONE_SURFACE"]]
    assert surface_distance(bones, fine.points[bone_faces(fine)]).max() < 0.15
    assert len(bones) > 2 * len(finger.node_sets["BONE_SURFACE"])


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


def test_a_finger_from_a_file(tmp_path, capsys):
    (tmp_path / "thin.yaml").write_text("width: 14\nepidermis: 0.5\n", encoding="utf-8")
    out = tmp_path / "thin.inp"
    assert main(["finger", "--anatomy", str(tmp_path / "thin.yaml"), "--size", "5", "--out", str(out)]) == 0
    assert "tetrahedra" in capsys.readouterr().out
    there = read_mesh(out)
    assert there.blocks[0].element == "C3D10H"
    assert np.ptp(there.body[:, 1]) == pytest.approx(14.0, abs=0.2)
    assert len(there.node_sets["INDENTER"]) == 1 and len(there.surfaces["PALMAR"])
    # what holds it is put on again when it has another shape
    bare = read_finger(out)
    assert np.array_equal(bare.points, there.body) and "TUBE" not in bare.node_sets and "PALMAR" not in bare.surfaces


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("widht: 14\n", "widht: found an unknown key; expected width (did you mean that?)"),
        ("width: broad\n", "width: found broad; expected a number"),
        ("width: 6\n", "bone_width: found 5.0; expected bones that fit into the width"),
        ("- 3\n", "file: found [3]; expected keys and values"),
    ],
)
def test_wrong_fingers_are_told_in_one_line(tmp_path, capsys, text, told):
    path = tmp_path / "finger.yaml"
    path.write_text(text, encoding="utf-8")
    assert main(["finger", "--anatomy", str(path), "--out", str(tmp_path / "out.inp")]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(path) in error and told in error
    assert not (tmp_path / "out.inp").exists()


def test_meshes_and_labels_that_are_no_fingers(tmp_path, capsys):
    write_text(tmp_path / "brick.inp", format_mesh(brick((1, 1, 1), (1, 1, 1))))
    with pytest.raises(InputError, match="node set END: found nothing; expected a mesh that `fingerfit finger` wrote"):
        read_finger(tmp_path / "brick.inp")
    for text in ("epidermis", "1=", "1=EPIDERMIS,,", ""):
        with pytest.raises(InputError, match="NUMBER=TISSUE"):
            tissues_of(text)
