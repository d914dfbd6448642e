"""Faults of meshes that people bring: each is found where it is, and a mesh without any has none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.check import faults_of_mesh

WHERE = Path("mesh.inp")


def plane(element="CPE4"):
    return layered_block(12.0, (("top", 6.0), ("bottom", 6.0)), 2, 1, element)


def faults(mesh):
    layers = {name: mesh.element_sets[name] for name in ("TOP", "BOTTOM") if name in mesh.element_sets}
    return [str(error) for error in faults_of_mesh(mesh, layers, WHERE)]


@pytest.mark.parametrize("element", ["CPE3", "CPE4", "CPE6", "CPE8", "CPE8R", "CPS4"])
def test_blocks_have_none(element):
    assert faults(plane(element)) == []


@pytest.mark.parametrize("element", ["C3D4", "C3D8", "C3D10", "C3D20", "C3D20R"])
def test_bricks_have_none(element):
    assert faults(brick((3.0, 2.0, 1.0), (2, 2, 1), element=element, layers=[("top", 1.0)])) == []


def test_an_element_that_is_turned_round_is_named():
    mesh = plane()
    nodes = mesh.blocks[0].nodes.copy()
    nodes[1] = nodes[1][::-1]
    (found,) = faults(replace(mesh, blocks=(replace(mesh.blocks[0], nodes=nodes),)))
    assert found.startswith("mesh.inp: elements: found no volume, or a negative one, in number 2;")


def test_nodes_of_nothing_are_named_and_those_of_tools_are_not():
    mesh = plane()
    more = replace(mesh, points=np.vstack([mesh.points, [[50.0, 50.0]]]))
    number = len(mesh.points)
    (found,) = faults(more)
    assert f"number {number + 1} in no element" in found
    assert faults(replace(more, node_sets={**more.node_sets, "TOOL": np.array([number])})) == []


def test_sides_and_layers_share_nothing():
    mesh = plane()
    sets = {**mesh.node_sets, "TOP": np.append(mesh.node_sets["TOP"], mesh.node_sets["BOTTOM"][0])}
    assert "of the base too" in faults(replace(mesh, node_sets=sets))[0]
    elements = {**mesh.element_sets, "TOP": np.append(mesh.element_sets["TOP"], mesh.element_sets["BOTTOM"][0])}
    assert "in TOP too" in faults(replace(mesh, element_sets=elements))[0]


def test_an_indenter_inside_of_the_body_is_refused():
    mesh = plane()
    inside = np.setdiff1d(np.arange(len(mesh.points)), np.append(mesh.node_sets["TOP"], mesh.node_sets["BOTTOM"]))
    assert "node set INDENTER" in faults(replace(mesh, node_sets={**mesh.node_sets, "INDENTER": inside[:1]}))[0]


def test_coordinates_beyond_all_bodies_are_told_instead_of_overflowing():
    mesh = plane()
    points = mesh.points.copy()
    points[3] = 1e308
    (found,) = faults(replace(mesh, points=points))
    assert "number 4 beyond 1e+06 mm" in found
