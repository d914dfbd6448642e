"""A finer mesh that a study brings is one of the same body: its sets, size and place are compared with `mesh`."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY

from fingerfit.cli import main
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.prepare.prepare import make_mesh
from fingerfit.study.reader import load_study

LAYERS = (("top", 4.0), ("bottom", 4.0))


def block(across=3, rows=2, width=12.0, layers=LAYERS, element="CPE4"):
    return layered_block(width, layers, across, rows, element)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    body = {
        "mesh": "mesh.inp",
        "refined": "fine.inp",
        "thickness": 70,
        "layers": [{"name": "top"}, {"name": "bottom"}],
    }
    write_text(Path("study/study.yaml"), yaml.safe_dump({**STUDY, "body": body}))
    write_text(Path("study/steps.csv"), STEPS)
    model = {key: value for key, value in MODEL.items() if key != "mesh"}
    write_text(Path("config.yaml"), yaml.safe_dump({"study": "study", "model": model, "fit": FIT}))
    write_text(Path("study/mesh.inp"), format_mesh(block()))
    return tmp_path


def refused(finer, capsys):
    """Lines of `fingerfit check` and of the job that makes the finer mesh, which are the same."""
    write_text(Path("study/fine.inp"), format_mesh(finer))
    said = []
    for command in (["check", "study"], ["prepare", "config.yaml", "--refined", "refined.inp"]):
        code = main(command)
        said.append([line for line in capsys.readouterr().err.splitlines() if line])
        assert code == bool(said[-1])
    assert said[0] == said[1]
    return said[0]


def without(mesh, kind, name):
    return replace(mesh, **{kind: {key: value for key, value in getattr(mesh, kind).items() if key != name}})


def moved(mesh, by):
    return replace(mesh, points=mesh.points + by)


@pytest.mark.parametrize(
    ("finer", "pattern"),
    [
        (
            block(6, 4, width=24.0),
            r"study/fine.inp: nodes: found x 0 to 24, y 0 to 8 mm; expected x 0 to 12, y 0 to 8 mm, as in mesh.inp,"
            r" to one element \(4 x 2 mm\)",
        ),
        (moved(block(6, 4), [0.0, 3.0]), "nodes: found x 0 to 12, y 3 to 11 mm; expected x 0 to 12, y 0 to 8 mm"),
        (replace(block(6, 4), points=1000 * block(6, 4).points), "nodes: found x 0 to 1.2e.04, y 0 to 8000 mm"),
        (
            block(6, 4, layers=(("top", 1.5), ("bottom", 6.5))),
            r"element set BOTTOM: found x 0 to 12, y 0 to 6.5 mm; expected x 0 to 12, y 0 to 4 mm, as in mesh.inp",
        ),
        (
            block(6, 4, layers=(("top", 4.0), ("more", 1.0), ("bottom", 3.0))),
            "elements: found 24 of 72 in no layer of the study; expected layers for all of them, as in mesh.inp",
        ),
        (block(2, 1), "mesh: found 9 nodes, fewer than the 20 of mesh.inp; expected a finer mesh of the same body"),
        (
            brick((12.0, 5.0, 8.0), (3, 2, 2), element="C3D8", layers=LAYERS),
            "mesh: found 3 dimensions; expected 2, as mesh.inp has",
        ),
    ],
    ids=["wider", "higher up", "in other units", "thicker layer", "one layer more", "coarser", "in space"],
)
def test_another_body_is_one_line(place, capsys, finer, pattern):
    lines = refused(finer, capsys)
    assert any(re.search(pattern, line) for line in lines), lines
    assert all("study/fine.inp: " in line for line in lines)
    if "element set" not in pattern:
        assert len(lines) == 1


def test_a_set_that_the_finer_mesh_lacks_is_told(place, capsys):
    for kind, members in (("node_sets", [3]), ("element_sets", [3]), ("surfaces", [[3, 1]])):
        more = {"SKIN": np.array(members), "_PICKED": np.array(members)}
        mesh = replace(block(), **{kind: {**getattr(block(), kind), **more}})
        write_text(Path("study/mesh.inp"), format_mesh(mesh))
        what = kind.replace("_", " ")
        assert refused(block(6, 4), capsys) == [
            f"fingerfit: error: study/fine.inp: {what}: found no SKIN; expected the {what} of mesh.inp"
        ]


def test_a_set_of_all_nodes_needs_no_name(place):
    write_text(Path("study/fine.inp"), format_mesh(block(6, 4)).replace("*NODE, NSET=ALL", "*NODE"))
    assert "NSET=ALL" in Path("study/mesh.inp").read_text()
    assert make_mesh(load_study(Path("study")), None, finer=True).element_count == 48


def test_a_set_elsewhere_is_told(place, capsys):
    mesh, fine = block(), block(6, 4)
    middle = mesh.points[mesh.node_sets["TOP"]][:, 0] <= 4
    pressed = replace(mesh, node_sets={**mesh.node_sets, "PATCH": mesh.node_sets["TOP"][middle]})
    write_text(Path("study/mesh.inp"), format_mesh(pressed))
    for left, right, well in ((0, 4, True), (0, 12, True), (8, 12, True), (10, 12, False)):
        x = fine.points[fine.node_sets["TOP"]][:, 0]
        chosen = fine.node_sets["TOP"][(left <= x) & (x <= right)]
        lines = refused(replace(fine, node_sets={**fine.node_sets, "PATCH": chosen}), capsys)
        assert bool(lines) != well, (left, right, lines)
        if lines:
            assert f"node set PATCH: found x {left} to {right}, y 8 to 8 mm; expected x 0 to 4, y 8 to 8 mm" in lines[0]


def kept(mesh, cells, points=None, border=0.0):
    """The elements of a mesh that are chosen, its layers above and below a height, and base and indenter at its ends."""
    points = mesh.points if points is None else points
    used, index = np.unique(mesh.blocks[0].nodes[cells], return_inverse=True)
    points, nodes = points[used], index.reshape(-1, 4)
    upper = np.flatnonzero(points[nodes].mean(axis=1)[:, 1] > border)
    lower = np.setdiff1d(np.arange(len(nodes)), upper)
    ends = [np.flatnonzero(points[:, 1] == side) for side in (points[:, 1].min(), points[:, 1].max())]
    sets = {"BOTTOM": ends[0], "TOP": ends[1]}
    return Mesh(points, (Block("CPE4", nodes),), sets, {"TOP": upper, "BOTTOM": lower})


def disc(count, whole):
    """A disc of radius 6 by squares: whole ones whose middle is in it, as voxels are, or bent to its edge."""
    mesh = layered_block(12.0, (("body", 12.0),), count, count, "CPE4")
    points = mesh.points - 6.0
    if whole:
        middle = points[mesh.blocks[0].nodes].mean(axis=1)
        return kept(mesh, np.linalg.norm(middle, axis=1) <= 6.0, points)
    x, y = (points / 6.0).T
    bent = 6.0 * np.column_stack([x * np.sqrt(1 - y**2 / 2), y * np.sqrt(1 - x**2 / 2)])
    return kept(mesh, slice(None), bent)


@pytest.mark.parametrize(
    ("mesh", "finer"),
    [(block(), block()), (block(), block(6, 4)), (block(2, 1), block(3, 2, element="CPE8"))]
    + [(block(4, 2), block(5, 3, element="CPE6H")), (block(), without(block(6, 4), "node_sets", "INDENTER"))]
    + [(disc(n, False), disc(m, False)) for n, m in ((4, 8), (4, 5), (6, 20), (8, 9))]
    + [(disc(n, True), disc(m, True)) for n, m in ((6, 12), (7, 9), (8, 31), (20, 21))],
    ids=lambda mesh: f"{mesh.element_count}",
)
def test_meshes_of_the_same_body_are_taken(place, mesh, finer):
    for name, one in (("mesh.inp", mesh), ("fine.inp", finer)):
        write_text(Path(f"study/{name}"), format_mesh(one))
    assert len(make_mesh(load_study(Path("study")), None, finer=True).points) == len(finer.points)


def test_what_is_thinner_than_an_element_may_be_lost(place, capsys):
    """A tip beyond the coarse mesh is one of the same body where it is thin, and of another one where it is thick."""
    mesh = block(20, 4, width=20.0)
    middle = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    for high, well in ((1.0, True), (2.0, True), (3.0, False), (6.0, False)):
        longer = kept(mesh, (middle[:, 0] < 12) | (middle[:, 1] < high), border=4.0)
        lines = refused(longer, capsys)
        assert bool(lines) != well, (high, lines)
        assert well or "nodes: found x 0 to 20, y 0 to 8 mm; expected x 0 to 12, y 0 to 8 mm" in lines[0]
