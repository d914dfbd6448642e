"""Element forces and stiffness: finite differences, patch test, rigid motion."""

import numpy as np
import pytest
from seeds import generator
from solving import MATERIALS, parts_of

from fingerfit.fem.assembly import Body
from fingerfit.fem.rigid import rotation_matrix
from fingerfit.fem.volume import AveragedVolume
from fingerfit.material.ogden import Ogden
from fingerfit.material.spread import spread
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.elements import AXISYMMETRIC, ELEMENTS, rule, shape

MATERIAL = Ogden((0.03,), (1.4,), (0.6,))


def body_of(element, distort=0.0, seed=3):
    if ELEMENTS[element].dim == 3:
        mesh = brick((2.0, 1.0, 1.5), (2, 1, 2), element=element)
    else:
        start = (3.0, 0.0) if ELEMENTS[element].state == AXISYMMETRIC else (0.0, 0.0)
        mesh = layered_block(2.0, [("a", 1.0), ("b", 1.0)], 2, 1, element, origin=start)
    points = mesh.points + distort * generator(seed).uniform(-1, 1, mesh.points.shape)
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
    # of a few random displacements the first that inverts no element
    u, h = next(u for u in size * rng.normal(size=(20, points.size)) if body.forces(u) is not None), 1e-6
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
    if ELEMENTS[element].state == AXISYMMETRIC:
        gradient = np.diag([0.1, -0.08])  # else the hoop's stress is not balanced
    internal = gathered(body, (points @ gradient.T).ravel()).reshape(-1, dim)
    low, high = points.min(axis=0), points.max(axis=0)
    inner = ((points > low + 1e-9) & (points < high - 1e-9)).all(axis=1)
    assert np.abs(internal[inner]).max(initial=0.0) < 1e-12
    assert np.abs(internal[~inner]).max() > 1e-3


def rotations(dim):
    """Rotation matrices: in space about several axes, one of them by nearly half a turn."""
    if dim == 2:
        return [rotation_matrix(np.array([angle])) for angle in (0.7, -2.5)]
    vectors = ([0.7, 0.0, 0.0], [0.0, -1.9, 0.0], [0.0, 0.0, 2.5], [1.1, -0.8, 0.6], [-1.8, 1.8, 1.8])
    return [rotation_matrix(np.array(vector)) for vector in vectors]


def rounding(forces, points, moved):
    """Force by rounding: a strain has eps of each displacement over a length, and sums over up to 27 nodes (found: 6 of 30)."""
    stiffness = np.abs(forces(1e-3 * points)).max() / 1e-3
    return 30 * np.finfo(float).eps * stiffness * np.abs(moved).max()


def whole(element, material):
    """Function of the displacements (nodes, dim) to the forces on the nodes, with those of averaged volumes."""
    plain, points = body_of(element)
    body, terms = parts_of(element, points, plain.connectivity, material, 3.0)

    def forces(u):
        found = gathered(body, u.ravel())
        return sum((term.forces(u.ravel()).force for term in terms), found).reshape(points.shape)

    return forces, points


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_rigid_motion_is_free_of_stress(element, name):
    """In axisymmetry only the way along the axis is a rigid motion."""
    forces, points = whole(element, MATERIALS[name])
    if ELEMENTS[element].state == AXISYMMETRIC:
        motions = [points + np.array([0.0, way]) for way in (0.7, -6.0)]
    else:
        motions = [points @ turn.T + 0.4 for turn in rotations(points.shape[1])]
    for moved in motions:
        assert np.abs(forces(moved - points)).max() < rounding(forces, points, moved - points)


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("element", ELEMENTS)
def test_forces_turn_with_a_deformed_body(element, name, rng):
    forces, points = whole(element, MATERIALS[name])
    deformed = points + 0.04 * rng.normal(size=points.shape)
    still = forces(deformed - points)
    assert np.abs(still).max() > 1e-3
    close = 1e-12 + 1e-12 * np.abs(still).max()
    if ELEMENTS[element].state == AXISYMMETRIC:
        assert forces(deformed + np.array([0.0, 5.0]) - points) == pytest.approx(still, abs=close)
        return
    for turn in rotations(points.shape[1]):
        assert forces(deformed @ turn.T + 0.4 - points) == pytest.approx(still @ turn.T, abs=close)


@pytest.mark.parametrize("name", MATERIALS)
def test_a_foretold_volume_that_cannot_be_is_left_out(name):
    """Turned by half a turn at once: to first order that is a volume of -3, which has no pressure."""
    plain, points = body_of("CPE8H")
    body, _ = parts_of("CPE8H", points, plain.connectivity, MATERIALS[name])
    still, _ = parts_of("CPE8H", points, plain.connectivity, MATERIALS[name])
    half = (-2 * points).ravel()
    body.forces(0 * half, led=True)
    assert body.forces(half, led=True)[1] == pytest.approx(still.forces(half)[1], abs=1e-12)


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


@pytest.mark.parametrize("element", [name for name, kind in ELEMENTS.items() if kind.nodal])
def test_averaged_volume_is_consistent(element, rng):
    body, points = body_of(element, distort=0.05)
    groups = np.arange(len(body.connectivity)) % 2
    term = AveragedVolume(body, groups, [MATERIAL, Ogden((0.03,), (1.4,), (0.2,))])
    u, h = 0.08 * rng.normal(size=points.size), 1e-6
    found = term.forces(u)
    stiffness = np.zeros((points.size, points.size))
    np.add.at(stiffness, (found.rows, found.columns), found.values)
    for dof in range(0, points.size, 5):
        step = np.eye(points.size)[dof] * h
        assert found.force[dof] == pytest.approx((term.energy(u + step) - term.energy(u - step)) / (2 * h), abs=1e-7)
        column = (term.forces(u + step).force - term.forces(u - step).force) / (2 * h)
        assert stiffness[:, dof] == pytest.approx(column, abs=1e-6)


@pytest.mark.parametrize("element", [name for name, kind in ELEMENTS.items() if kind.nodal])
def test_averaged_volume_passes_the_patch_test(element):
    body, points = body_of(element)
    term = AveragedVolume(body, np.zeros(len(body.connectivity), int), [MATERIAL])
    plain, _ = body_of(element.removesuffix("H"))
    dim = points.shape[1]
    gradient = 0.1 * np.array([[1.0, 0.5, 0.2], [-0.3, -0.8, 0.1], [0.2, 0.4, 0.6]])[:dim, :dim]
    if ELEMENTS[element].state == AXISYMMETRIC:
        gradient = np.diag([0.1, -0.08])  # else the stretch around differs from element to element
    u = (points @ gradient.T).ravel()
    close = rounding(lambda u: gathered(plain, u.ravel()), points, u)
    assert gathered(body, u) + term.forces(u).force == pytest.approx(gathered(plain, u), abs=close)


@pytest.mark.parametrize("element", ["CPS4", "CPS8"])
def test_plane_stress_has_no_stress_across(element):
    """Uniaxial tension of a sheet of a compressible material: force and thickness by bisection in three dimensions."""
    body, points = body_of(element)
    stretch, across = 1.4, 0.83
    u = (points @ np.diag([stretch - 1, across - 1])).ravel()
    strain = body._strain(u)
    third = np.sqrt(strain.squared[..., 2])
    first, _ = MATERIAL.derivatives(np.array([stretch, across, third[0, 0]]))
    assert np.ptp(third) < 1e-14
    assert first[2] == pytest.approx(0.0, abs=1e-15)
    right = points[:, 0] == points[:, 0].max()
    area = 3.0 * np.ptp(points[:, 1])
    assert gathered(body, u).reshape(-1, 2)[right, 0].sum() == pytest.approx(first[0] / stretch * area, rel=1e-12)
