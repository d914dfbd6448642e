"""Element forces and stiffness: finite differences, patch test, rigid motion."""

import numpy as np
import pytest

from fingerfit.fem.assembly import Body
from fingerfit.fem.elements import ELEMENTS, rule, shape
from fingerfit.material.ogden import Ogden, spread
from fingerfit.meshing import brick, layered_block

MATERIAL = Ogden((0.03,), (1.4,), (0.6,))


def body_of(element, distort=0.0, seed=3):
    if ELEMENTS[element].dim == 3:
        mesh = brick((2.0, 1.0, 1.5), (2, 1, 2), element=element)
    else:
        mesh = layered_block(2.0, [("a", 1.0), ("b", 1.0)], 2, 1, element)
    points = mesh.points + distort * np.random.default_rng(seed).uniform(-1, 1, mesh.points.shape)
    nodes = mesh.blocks[0].nodes
    count = len(nodes) * len(rule(element)[1])
    return Body(element, points, nodes, spread([MATERIAL], [count]), np.full(len(nodes), 3.0)), points


def gathered(body, u):
    forces, _ = body.forces(u)
    return np.bincount(body.dofs.ravel(), forces.ravel(), minlength=len(u))


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("size", [0.0, 0.08], ids=["undeformed", "deformed"])
def test_forces_and_stiffness_are_derivatives_of_the_energy(element, size, rng):
    body, points = body_of(element, distort=0.05)
    u, h = size * rng.normal(size=points.size), 1e-6
    stiffness = np.zeros((points.size, points.size))
    for dofs, block in zip(body.dofs, body.forces(u)[1], strict=True):
        stiffness[np.ix_(dofs, dofs)] += block
    internal = gathered(body, u)
    for dof in range(0, points.size, 5):
        step = np.eye(points.size)[dof] * h
        slope = (body.energy(u + step) - body.energy(u - step)) / (2 * h)
        assert internal[dof] == pytest.approx(slope, abs=1e-7)
        column = (gathered(body, u + step) - gathered(body, u - step)) / (2 * h)
        assert stiffness[:, dof] == pytest.approx(column, abs=1e-6)
    assert stiffness == pytest.approx(stiffness.T, abs=1e-12)


@pytest.mark.parametrize("element", ELEMENTS)
def test_patch(element):
    body, points = body_of(element)
    dim = points.shape[1]
    gradient = 0.1 * np.array([[1.0, 0.5, 0.2], [-0.3, -0.8, 0.1], [0.2, 0.4, 0.6]])[:dim, :dim]
    internal = gathered(body, (points @ gradient.T).ravel()).reshape(-1, dim)
    low, high = points.min(axis=0), points.max(axis=0)
    inner = ((points > low + 1e-9) & (points < high - 1e-9)).all(axis=1)
    assert np.abs(internal[inner]).max(initial=0.0) < 1e-12
    assert np.abs(internal[~inner]).max() > 1e-3


@pytest.mark.parametrize("element", ELEMENTS)
def test_rigid_rotation_is_free_of_stress(element):
    body, points = body_of(element)
    dim, angle = points.shape[1], 0.7
    rotation = np.eye(dim)
    rotation[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    assert np.abs(gathered(body, (points @ rotation.T - points).ravel())).max() < 1e-13


@pytest.mark.parametrize("element", ELEMENTS)
def test_shape_functions(element, rng):
    xi = rng.uniform(0.05, 0.45, (5, ELEMENTS[element].dim))
    values, gradients = shape(element, xi)
    assert values.sum(axis=1) == pytest.approx(np.ones(5), abs=1e-14)
    for axis in range(xi.shape[1]):
        step = 1e-6 * np.eye(xi.shape[1])[axis]
        slope = (shape(element, xi + step)[0] - shape(element, xi - step)[0]) / 2e-6
        assert gradients[..., axis] == pytest.approx(slope, abs=1e-9)


def test_an_inverted_element_has_no_forces():
    body, points = body_of("CPE4")
    u = np.zeros(points.shape)
    u[points[:, 1] == points[:, 1].max(), 1] = -1.5
    assert body.forces(u.ravel()) is None
    assert body.energy(u.ravel()) == np.inf
