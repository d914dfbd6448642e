"""Meshes of outlines in the plane: areas to rounding, sets of parts, regions, ends and holes; and outlines that are none."""

import numpy as np
import pytest

from fingerfit.cli import main
from fingerfit.core.errors import InputError
from fingerfit.deck.mesh_file import read_mesh
from fingerfit.mesh.inside import sizes
from fingerfit.segment.outlines import Shape, mesh_shapes

pytest.importorskip("netgen.meshing")
BOX = ((0.0, 0.0), (12.0, 0.0), (12.0, 12.0), (0.0, 12.0))
LOWER = ((0.0, 0.0), (12.0, 0.0), (12.0, 6.0), (0.0, 6.0))
PATCH = ((5.42, 9.94), (1.42, 6.94), (3.58, 4.06), (7.58, 7.06))
"""Oblique, of 5 by 3.6 mm: its area on rectangular meshes was 20.2 and 18.6 mm2."""


def polygon(radius, centre, corners=48):
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return tuple(zip(centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn), strict=True))


def area_of(radius, corners=48):
    return corners / 2 * np.sin(2 * np.pi / corners) * radius**2


def areas(mesh):
    found = sizes(mesh)
    assert found.min() > 0
    return {name: pytest.approx(found[members].sum(), rel=1e-9) for name, members in mesh.element_sets.items()}


@pytest.mark.parametrize("element", ["CPE6", "CPE6H", "CPE3"])
@pytest.mark.parametrize("size", [0.8, 2.0])
def test_the_area_of_an_oblique_region_is_that_of_its_outline(element, size):
    mesh = mesh_shapes([Shape("GEL", BOX), Shape("PATCH", PATCH, "region")], size, element)
    assert areas(mesh) == {"GEL": 144.0, "PATCH": 18.0}
    assert [block.element for block in mesh.blocks] == [element]
    assert np.isin(mesh.element_sets["PATCH"], mesh.element_sets["GEL"]).all()
    for name, axis, value in (("BOTTOM", 1, 0.0), ("TOP", 1, 12.0), ("LEFT", 0, 0.0), ("RIGHT", 0, 12.0)):
        on = np.flatnonzero(np.abs(mesh.points[:, axis] - value) < 1e-9)
        assert sorted(mesh.node_sets[name].tolist()) == on.tolist()


def test_layers_share_a_side_and_a_region_lies_in_both():
    """The region reaches beyond the body, and shares a corner and a part of a side with it."""
    beyond = ((9.0, 4.0), (14.0, 4.0), (14.0, 8.0), (9.0, 8.0))
    shapes = [Shape("GEL", BOX), Shape("BASE", LOWER), Shape("SCAR", beyond, "region", 0.3)]
    mesh = mesh_shapes(shapes, 1.5)
    assert areas(mesh) == {"GEL": 72.0, "BASE": 72.0, "SCAR": 12.0}
    assert not np.isin(mesh.element_sets["GEL"], mesh.element_sets["BASE"]).any()
    middle = mesh.points[mesh.blocks[0].nodes[:, :3]].mean(axis=1)
    assert (middle[mesh.element_sets["BASE"], 1] < 6).all()
    # finer at the scar, and graded from there
    size = sizes(mesh)
    far = np.hypot(*(middle - [9, 6]).T)
    assert size[mesh.element_sets["SCAR"]].mean() < 0.3 * size[far > 6].mean()


def test_holes_and_pads_are_left_out_and_their_borders_are_node_sets():
    pad = ((4.0, 11.0), (8.0, 11.0), (8.0, 14.0), (4.0, 14.0))
    shapes = [
        Shape("GEL", BOX),
        Shape("DISK", polygon(3, (6, 5)), "region"),
        Shape("PIPE", polygon(1, (6, 5)), "hole"),
        Shape("TOP", pad, "hole"),
    ]
    mesh = mesh_shapes(shapes, 1.0)
    assert {"GEL": 144 - area_of(1) - 4, "DISK": area_of(3) - area_of(1)} == areas(mesh)
    place = mesh.points[mesh.node_sets["TOP"]]
    assert place.min(axis=0).tolist() == [4, 11] and place.max(axis=0).tolist() == [8, 12]
    far = np.hypot(*(mesh.points[mesh.node_sets["PIPE"]] - [6, 5]).T)
    assert (far > np.cos(np.pi / 48) - 1e-9).all() and (far < 1 + 1e-9).all()
    assert np.hypot(*(mesh.points - [6, 5]).T).min() > 0.99


FILE = """\
unit: cm
parts:
  - {name: gel, outline: [[0, 0], [1.2, 0], [1.2, 1.2], [0, 1.2]]}
regions:
  - {name: patch, outline: patch.csv, size: 0.06}
"""


def test_a_file_of_outlines_and_a_study_give_the_same_areas(tmp_path, capsys):
    table = "x,y\n" + "".join(f"{x / 10},{y / 10}\n" for x, y in PATCH)
    (tmp_path / "patch.csv").write_text(table)
    (tmp_path / "outlines.yaml").write_text(FILE)
    (tmp_path / "steps.csv").write_text("step,force,displacement\n1,3.0,0.5\n")
    layers = "[{name: top, height: 6}, {name: base, height: 6}]"
    region = "{name: patch, outline: [" + ", ".join(f"[{x}, {y}]" for x, y in PATCH) + "]}"
    (tmp_path / "study.yaml").write_text(
        "title: t\nunits: {length: mm, force: N, time: s}\ncontrol: force\nsteps: steps.csv\n"
        f"body: {{width: 12, thickness: 70, layers: {layers}, regions: [{region}]}}\n"
        "noise: {force: 0.01, displacement: 0.01}\nboundary: {base: held, indenter: glued}\n"
    )
    for name, sets in (("outlines", {"GEL": 144, "PATCH": 18}), ("study", {"TOP": 72, "BASE": 72, "PATCH": 18})):
        out = tmp_path / f"{name}.inp"
        assert main(["mesh", str(tmp_path / f"{name}.yaml"), "--size", "1.5", "--out", str(out)]) == 0, name
        mesh = read_mesh(out)
        assert sets == areas(mesh)
        assert mesh.blocks[0].element == "CPE6"
        assert "PATCH: " in (said := capsys.readouterr().out) and "18 mm^2" in said


@pytest.mark.parametrize(
    ("text", "arguments", "says"),
    [
        (FILE.replace("regions", "region"), [], "region: found an unknown key"),
        (FILE.replace("unit: cm", "unit: inch"), [], "unit: found inch"),
        (FILE.replace("patch.csv", "none.csv"), [], "none.csv"),
        (FILE.replace("patch.csv", "[[0, 0], [1, 1], [1, 0], [0, 1]]"), [], "side 1 across side 3"),
        (FILE.replace("patch.csv", "[[2, 2], [3, 2], [3, 3]]"), [], "regions: found PATCH lies in no part"),
        (FILE.replace("size: 0.06", "size: 0"), [], "regions.0.size"),
        (FILE.replace("name: patch", "name: a patch"), [], "regions.0.name: found a patch"),
        (FILE.replace("regions", "holes").replace("patch.csv", "[[2, 2], [3, 2], [3, 3]]"), [], "touches no part"),
        (FILE, ["--element", "C3D10"], "element: found C3D10"),
        (FILE, ["--base", "z-"], "side: found z-"),
        (FILE, ["--labels", "1=FAT"], "--labels: option: found names of labels"),
    ],
)
def test_what_cannot_be_meshed_is_one_line(text, arguments, says, tmp_path, capsys):
    (tmp_path / "patch.csv").write_text("x,y\n0.4,0.4\n0.8,0.4\n0.8,0.8\n")
    (tmp_path / "outlines.yaml").write_text(text)
    out = tmp_path / "body.inp"
    assert main(["mesh", str(tmp_path / "outlines.yaml"), "--size", "1.5", "--out", str(out), *arguments]) == 1
    said = capsys.readouterr().err
    assert says in said
    assert len(said.splitlines()) == 1
    assert not out.exists()


def test_shapes_that_are_covered_and_too_many_corners_are_refused():
    with pytest.raises(InputError, match="BASE is covered by later ones"):
        mesh_shapes([Shape("BASE", LOWER), Shape("GEL", BOX)], 1.5)
    with pytest.raises(InputError, match="corners; expected 4000 at most"):
        mesh_shapes([Shape("GEL", BOX), *[Shape("A", polygon(1, (5, 5), 1000))] * 4], 1.5)
