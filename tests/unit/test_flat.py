"""What a body with a mesh of its own has: flat sides, flat layers, and effects on them as a block has."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import LAYERS, MU, phantom

from fingerfit.deck.context import deck_context
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.flat import LEVEL, is_flat, is_stacked
from fingerfit.mesh.mesh import Block, Mesh
from fingerfit.model.applicable import unmet
from fingerfit.model.catalogue import catalogue
from fingerfit.study.study import Body

MATERIAL = {"alpha": 1.4, "poisson": 0.495}
NAMES = [name for name, _ in LAYERS]
HEIGHT = sum(height for _, height in LAYERS)


def mapped(x, y, element="CPE8H"):
    """The phantom's mesh with its nodes elsewhere: functions of width and height from 0 to 1, mm."""
    mesh = layered_block(12.0, LAYERS, 6, 2, element)
    s, t = mesh.points[:, 0] / 12.0, mesh.points[:, 1] / HEIGHT
    return replace(mesh, points=mesh.points + np.stack([x(s, t), y(s, t)], axis=-1))


def none(s, t):
    return 0 * s


def bulge(s, t):
    return 4 * (s - 0.5) * t * (1 - t)


def lacks(name, mesh):
    study = phantom("displacement", [1.0])
    study = replace(study, body=Body(study.body.layers, mesh="body.inp", thickness=70.0))
    steps = tuple(replace(step, time=1.0, picture="picture.nii.gz") for step in study.steps)
    return [need for need in unmet(catalogue()[name], replace(study, steps=steps), mesh, True) if "flat" in need]


@pytest.mark.parametrize("element", ["CPE4", "CPE8H", "CPE6H"])
def test_bulging_sides_leave_ends_and_layers_flat(element):
    mesh = mapped(bulge, none, element)
    assert is_flat(mesh, "TOP") and is_flat(mesh, "BOTTOM") and is_stacked(mesh, NAMES)
    for name in ("base_slip", "base_probe", "tilt", "indenter_probe", "skin", "gradient", "interface", "wall"):
        assert not lacks(name, mesh)


def test_a_round_base_and_what_lies_on_it_are_not_flat():
    mesh = mapped(none, lambda s, t: 4 * s * (1 - s) * (1 - t))
    assert is_flat(mesh, "TOP") and not is_flat(mesh, "BOTTOM") and not is_stacked(mesh, NAMES)
    assert lacks("base_slip", mesh) == ["a flat base"]
    assert lacks("interface", mesh) == ["flat layers on top of each other"]
    assert not lacks("tilt", mesh) and not lacks("sideways_gradient", mesh)


@pytest.mark.parametrize(("share", "flat"), [(0.9, True), (1.1, False)])
def test_how_level_a_side_has_to_be(share, flat):
    mesh = mapped(none, lambda s, t: share * LEVEL * 12.0 * s * t)
    assert is_flat(mesh, "TOP") is flat


def test_layers_are_named_from_the_indenter_down():
    assert not is_stacked(mapped(none, none), NAMES[::-1])


def test_nodes_that_are_no_face_are_no_side():
    mesh = mapped(none, none)
    every_other = {**mesh.node_sets, "TOP": mesh.node_sets["TOP"][::2]}
    assert not is_flat(replace(mesh, node_sets=every_other), "TOP")
    assert not is_flat(replace(mesh, node_sets={}), "TOP")


@pytest.mark.parametrize("element", ["C3D8", "C3D20H", "C3D4", "C3D10H"])
def test_in_space(element):
    mesh = brick((12.0, 10.0, 8.0), (2, 2, 2), element=element, layers=[("top", 4.0), ("bottom", 4.0)])
    assert is_flat(mesh, "TOP") and is_flat(mesh, "BOTTOM") and is_stacked(mesh, ["top", "bottom"])
    bent = replace(mesh, points=mesh.points + [0, 0, 0.05] * mesh.points[:, [0]] ** 2 * mesh.points[:, [2]] / 8.0)
    assert not is_flat(bent, "TOP") and is_flat(bent, "BOTTOM")


def asked(mesh, what, *args):
    return deck_context(phantom("force", [20.0]), mesh, "mesh.inp", MU, MATERIAL)[what](*args)


def test_areas_do_not_depend_on_how_a_side_is_meshed():
    """A linear and a quadratic element side by side under the indenter: each node has its share of its own face."""
    points = np.array([[0, 0], [4, 0], [4, 2], [0, 2], [10, 0], [10, 2], [7, 0], [10, 1], [7, 2], [4, 1.0]], float)
    blocks = (Block("CPE4", np.array([[0, 1, 2, 3]])), Block("CPE8", np.array([[1, 4, 5, 2, 6, 7, 8, 9]])))
    sets = {"TOP": np.array([5, 2, 8, 3]), "BOTTOM": np.array([0, 1, 6, 4]), "INDENTER": np.array([2])}
    layers = {name.upper(): np.array([0, 1]) for name in NAMES}
    found = asked(Mesh(points, blocks, sets, layers), "areas", "TOP")
    assert [node - 1 for node, _ in found] == [3, 2, 8, 5]
    assert [area / 70.0 for _, area in found] == pytest.approx([2.0, 2.0 + 1.0, 4.0, 1.0])


@pytest.mark.parametrize("way", [-1, 1])
def test_a_wall_faces_all_of_a_bulging_side_and_nothing_else(way):
    block, barrel = layered_block(12.0, LAYERS, 6, 2, "CPE8H"), mapped(bulge, none)
    plain, round_one = asked(block, "side", way), asked(barrel, "side", way)
    assert len(plain["faces"]) == 2 * len(LAYERS)
    assert round_one["faces"] == plain["faces"]
    assert round_one["x"] == pytest.approx(6 + way * 6.5) and plain["x"] == pytest.approx(6 + way * 6)
