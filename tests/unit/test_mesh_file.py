"""Meshes as ABAQUS keywords and from other formats."""

import sys
from dataclasses import replace

import meshio
import numpy as np
import pytest
from seeds import generator as seeded

from fingerfit.core.errors import InputError
from fingerfit.deck.mesh_file import format_mesh, read_mesh, with_types
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.mesh import Block

LAYERS = [("top", 4.0), ("bottom", 8.0)]


@pytest.mark.parametrize("element", ["CPE4", "CPE4H", "CPE6", "CPE8", "CPE8H", "CPE8R", "C3D8"])
def test_written_and_read_is_the_same_mesh(tmp_path, element):
    if element == "C3D8":
        mesh = brick([2.0, 3.0, 4.0], [2, 3, 5], element=element)
    else:
        mesh = layered_block(12.0, LAYERS, 15, 2, element, 3.0, (1.0, -2.0))
    (tmp_path / "m.inp").write_text(format_mesh(mesh))
    read = read_mesh(tmp_path / "m.inp")
    assert read.points == pytest.approx(mesh.points, abs=1e-10)
    assert [block.element for block in read.blocks] == [element]
    assert np.array_equal(read.blocks[0].nodes, mesh.blocks[0].nodes)
    for ours, theirs in ((mesh.node_sets, read.node_sets), (mesh.element_sets, read.element_sets)):
        for name, members in ours.items():
            assert np.array_equal(np.sort(theirs[name]), np.sort(members)), name


def test_elements_are_counted_through_all_blocks(tmp_path):
    plain = layered_block(12.0, LAYERS, 2, 1, "CPE8")
    nodes = plain.blocks[0].nodes
    mesh = replace(plain, blocks=(Block("CPE8", nodes[:2]), Block("CPE8R", nodes[2:])))
    (tmp_path / "m.inp").write_text(format_mesh(mesh))
    read = read_mesh(tmp_path / "m.inp")
    assert [(block.element, block.nodes.tolist()) for block in read.blocks] == [
        ("CPE8", nodes[:2].tolist()),
        ("CPE8R", nodes[2:].tolist()),
    ]
    assert read.element_sets["TOP"].tolist() == mesh.element_sets["TOP"].tolist() == [2, 3]
    labels = [line.split(",")[0] for line in format_mesh(mesh).splitlines() if line.count(",") == 8]
    assert labels == ["1", "2", "3", "4"]


def test_the_same_mesh_is_the_same_text():
    first, second = (layered_block(12.0, LAYERS, 4, 2, grading=3.0) for _ in range(2))
    assert format_mesh(first) == format_mesh(second)
    assert format_mesh(first) != format_mesh(layered_block(12.0, LAYERS, 4, 2, grading=3.1))


def test_lines_are_short_enough_for_every_program():
    # ABAQUS and CalculiX take 16 entries on a line of a set
    lines = format_mesh(layered_block(12.0, LAYERS, 30, 2)).splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("*NSET"))
    assert max(line.count(",") for line in lines[at:] if not line.startswith("*")) < 16


def test_other_formats_with_their_sets(monkeypatch, tmp_path):
    points = np.array([[0, 0], [2, 0], [2, 1], [0, 1], [4, 0], [4, 1]], dtype=float)
    cells = [("quad", np.array([[0, 1, 2, 3], [1, 4, 5, 2]]))]
    sets = {"left": [np.array([0])], "right": [np.array([1])]}
    made = meshio.Mesh(points, cells, point_sets={"Bottom": np.array([0, 1, 4])}, cell_sets=sets)
    monkeypatch.setattr(meshio, "read", lambda path: made)
    (tmp_path / "m.other").write_text("what meshio reads")
    read = read_mesh(tmp_path / "m.other")
    assert read.points == pytest.approx(points)
    assert np.array_equal(read.node_sets["BOTTOM"], [0, 1, 4])
    assert np.array_equal(read.element_sets["RIGHT"], [1])
    assert read.dim == 2
    assert read.blocks[0].element == "CPE4"
    assert np.array_equal(read.blocks[0].nodes, cells[0][1])


def test_a_file_of_another_format(tmp_path):
    points = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], dtype=float)
    meshio.Mesh(points, [("quad", np.array([[0, 1, 2, 3]]))]).write(tmp_path / "m.vtk", binary=False)
    read = read_mesh(tmp_path / "m.vtk")
    assert (read.dim, read.blocks[0].element, read.blocks[0].nodes.tolist()) == (2, "CPE4", [[0, 1, 2, 3]])
    assert read.points == pytest.approx(points[:, :2])


def test_a_file_without_known_elements_is_told(tmp_path):
    meshio.Mesh(np.eye(3), [("line", np.array([[0, 1], [1, 2]]))]).write(tmp_path / "m.vtk", binary=False)
    with pytest.raises(InputError, match="found line; expected one of triangle, triangle6, quad, quad8, tetra,"):
        read_mesh(tmp_path / "m.vtk")


UNREADABLE = {
    "m.nothing": "no mesh",
    "m.vtk": "no mesh",
    "m.vtu": "no mesh",
    "m.msh": "no mesh",
    "m.xdmf": "no mesh",
    "m.xml": "<mesh",
    "m.bdf": "no mesh",
    "m.dat": "no mesh",
    "m.su2": "no mesh",
    "m.avs": "no mesh",
    "m.node": "",
}
"""meshio answers with its own errors, with SystemExit, and with whatever its code runs into."""


@pytest.mark.parametrize("name", UNREADABLE)
def test_an_unreadable_file_is_told(tmp_path, name):
    (tmp_path / name).write_text(UNREADABLE[name])
    with pytest.raises(InputError, match="a mesh that meshio reads") as found:
        read_mesh(tmp_path / name)
    assert "\n" not in str(found.value)
    assert "found 1;" not in str(found.value), "the exit code of meshio"


def test_a_format_that_needs_another_package_is_told(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "netCDF4", None)
    (tmp_path / "m.e").write_text("no mesh")
    with pytest.raises(InputError, match=r"found a \.e file; expected .*netCDF4 \(pip install netCDF4\)"):
        read_mesh(tmp_path / "m.e")


GROUPS = """\
$PhysicalNames
4
1 3 "base"
1 4 "indenter"
2 1 "lump"
2 2 "gel"
$EndPhysicalNames
"""
GMSH = f"""\
$MeshFormat
2.2 0 8
$EndMeshFormat
{GROUPS}$Nodes
8
1 0 0 0
2 2 0 0
3 2 1 0
4 0 1 0
5 4 0 0
6 4 1 0
7 1 7 0
8 3 1.5 0
$EndNodes
$Elements
6
1 1 2 3 1 1 2
2 1 2 3 1 2 5
3 1 2 4 2 4 3
4 3 2 1 1 1 2 3 4
5 2 2 2 2 2 5 3
6 2 2 2 2 3 6 5
$EndElements
"""
"""A quadrilateral and two triangles, the last one clockwise; nodes 7 and 8 belong to nothing."""


NEWER = f"""\
$MeshFormat
4.1 0 8
$EndMeshFormat
{GROUPS}$Entities
6 7 2 0
1 0 0 0 0
2 2 0 0 0
3 2 1 0 0
4 0 1 0 0
5 4 0 0 0
6 4 1 0 0
1 0 0 0 2 0 0 1 3 2 1 -2
2 2 0 0 2 1 0 0 2 2 -3
3 0 1 0 2 1 0 1 4 2 3 -4
4 0 0 0 0 1 0 0 2 4 -1
5 2 0 0 4 0 0 1 3 2 2 -5
6 4 0 0 4 1 0 0 2 5 -6
7 2 1 0 4 1 0 0 2 6 -3
1 0 0 0 2 1 0 1 1 4 1 2 3 4
2 2 0 0 4 1 0 1 2 4 5 6 7 -2
$EndEntities
$Nodes
11 6 1 6
0 1 0 1
1
0 0 0
0 2 0 1
2
2 0 0
0 3 0 1
3
2 1 0
0 4 0 1
4
0 1 0
0 5 0 1
5
4 0 0
0 6 0 1
6
4 1 0
1 1 0 0
1 3 0 0
1 5 0 0
2 1 0 0
2 2 0 0
$EndNodes
$Elements
5 6 1 6
1 1 1 1
1 1 2
1 3 1 1
2 3 4
1 5 1 1
3 2 5
2 1 3 1
4 1 2 3 4
2 2 2 2
5 2 5 3
6 3 5 6
$EndElements
"""


def test_groups_of_gmsh_are_sets_of_a_mixed_mesh(tmp_path):
    (tmp_path / "m.msh").write_text(GMSH)
    read = read_mesh(tmp_path / "m.msh")
    assert [(block.element, block.nodes.tolist()) for block in read.blocks] == [
        ("CPE4", [[0, 1, 2, 3]]),
        ("CPE3H", [[1, 4, 2], [2, 4, 5]]),
    ]
    assert {name: members.tolist() for name, members in read.element_sets.items()} == {"LUMP": [0], "GEL": [1, 2]}
    assert {name: nodes.tolist() for name, nodes in read.node_sets.items()} == {"BASE": [0, 1, 4], "INDENTER": [2, 3]}
    assert len(read.points) == 6
    # the newer format, as gmsh 4.15 wrote the same body
    (tmp_path / "new.msh").write_text(NEWER)
    again = read_mesh(tmp_path / "new.msh")
    assert sorted(again.element_sets) == ["GEL", "LUMP"]
    assert {name: nodes.tolist() for name, nodes in again.node_sets.items()} == {"BASE": [0, 1, 4], "INDENTER": [2, 3]}
    assert [block.element for block in again.blocks] == ["CPE4", "CPE3H"]
    assert len(again.element_sets["GEL"]) == 2


def test_lines_of_an_inp_of_a_generator_become_node_sets(tmp_path):
    lines = [
        "*NODE", "1, 0, 0, 0", "2, 2, 0, 0", "3, 2, 1, 0", "4, 0, 1, 0",
        "*ELEMENT, type=T3D2, ELSET=Line1", "1, 1, 2",
        "*ELEMENT, type=CPS3, ELSET=Surface1", "2, 1, 2, 3", "3, 1, 3, 4",
        "*ELSET, ELSET=base", "1", "*ELSET, ELSET=gel", "2, 3",
    ]  # fmt: skip
    (tmp_path / "m.inp").write_text("\n".join(lines))
    read = with_types(read_mesh(tmp_path / "m.inp"), ["CPE3H"], tmp_path / "study.yaml")
    assert [block.element for block in read.blocks] == ["CPE3H"]
    assert read.node_sets["BASE"].tolist() == [0, 1]
    assert {name: len(members) for name, members in read.element_sets.items()} == {"SURFACE1": 2, "GEL": 2}


def test_a_type_that_fits_no_element_is_told(tmp_path):
    (tmp_path / "m.msh").write_text(GMSH)
    with pytest.raises(InputError, match=r"study.yaml: body.types: found CPE8H; expected types for .* CPE4, CPE3H"):
        with_types(read_mesh(tmp_path / "m.msh"), ["CPE4H", "CPE8H"], tmp_path / "study.yaml")


@pytest.mark.parametrize(
    ("cell", "nodes", "place", "found"),
    [("triangle", 3, 0.5, "a surface in space"), ("wedge", 6, 0.5, "wedge"), ("quad9", 9, 0.0, "quad9")],
)
def test_what_has_no_element_is_told(tmp_path, cell, nodes, place, found):
    points = seeded(1).normal(size=(nodes, 3)) * [1, 1, place]
    meshio.Mesh(points, [(cell, np.arange(nodes)[None])]).write(tmp_path / "m.vtk", binary=False)
    with pytest.raises(InputError, match=f"mesh: found {found}"):
        read_mesh(tmp_path / "m.vtk")
