"""Rate of convergence to a deformation that was chosen, whose volume changes, at finite and at small strain.

The body force that keeps it in equilibrium, b = -Div P, comes from closed forms of the stress and complex steps: of
the package only shape functions and Jacobians are in it. Errors in L2 fall as h^2 with linear and h^3 with quadratic
elements; C3D10H has one pressure for each element, too few for that, and falls as h^2.
"""

import numpy as np
import pytest
from solving import parts_of, solve

from fingerfit.fem.linear import LinearBody, LinearTerm
from fingerfit.material.elastic import Elastic
from fingerfit.material.neo_hooke import NeoHooke
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.elements import AXISYMMETRIC, ELEMENTS, STRESS, shape

C10, D, YOUNG, POISSON = 0.4, 0.8, 1.0, 0.35
WAVES = np.array([[1.5, 0.8, -0.6], [0.7, -1.2, 0.9], [-0.5, 1.0, 1.3]])
"""Wave vectors of the components of the displacement, 1/mm."""
PHASES = np.array([0.3, 1.1, -0.4])
HIGH = 0.12
"""mm; the strain goes up to 0.3 and the change of volume to 0.35."""


def exact(points):
    """Displacements of shape (..., dim), and their gradient."""
    dim = points.shape[-1]
    waves, phases = WAVES[:dim, :dim], PHASES[:dim]
    angle = points @ waves.T + phases
    return HIGH * np.sin(angle), HIGH * np.cos(angle)[..., None] * waves


def full_gradient(points, state):
    """Deformation gradient in three dimensions, the third direction out of the plane or the hoop's."""
    u, gradient = exact(points)
    dim = points.shape[-1]
    f = np.zeros((*points.shape[:-1], 3, 3), dtype=points.dtype)
    f[...] = np.eye(3)
    f[..., :dim, :dim] += gradient
    if state == AXISYMMETRIC:
        f[..., 2, 2] += u[..., 0] / points[..., 0]
    return f


def finite(points, state):
    """First Piola-Kirchhoff stress of W = C10 (J^(-2/3) tr C - 3) + (J - 1)^2 / D."""
    f = full_gradient(points, state)

    def stress(f):
        jacobian, inverse = np.linalg.det(f)[..., None, None], np.swapaxes(np.linalg.inv(f), -1, -2)
        first = (f * f).sum(axis=(-1, -2))[..., None, None]
        return 2 * C10 * jacobian ** (-2 / 3) * (f - first / 3 * inverse) + 2 / D * (jacobian - 1) * jacobian * inverse

    if state == STRESS:
        # the thickness by Newton's method with a secant of fixed length: good for complex steps too
        for _ in range(40):
            more = f.copy()
            more[..., 2, 2] += 1e-4
            now = stress(f)[..., 2, 2]
            f[..., 2, 2] -= now / (stress(more)[..., 2, 2] - now) * 1e-4
        assert np.abs(stress(f)[..., 2, 2]).max() < 1e-14
    return stress(f)


def small(points, state):
    """Stress of linear elasticity."""
    gradient = full_gradient(points, state) - np.eye(3)
    strain = (gradient + np.swapaxes(gradient, -1, -2)) / 2
    lame, shear = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
    if state == STRESS:
        strain[..., 2, 2] = -lame / (lame + 2 * shear) * (strain[..., 0, 0] + strain[..., 1, 1])
    return lame * np.trace(strain, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) + 2 * shear * strain


def body_force(points, law, state):
    """-Div P in N/mm^3, shape (..., dim)."""
    dim = points.shape[-1]
    force = np.zeros(points.shape)
    for axis in range(dim):
        force -= law(points + 1e-30j * np.eye(dim)[axis], state)[..., :dim, axis].imag / 1e-30
    if state == AXISYMMETRIC:
        stress = law(points, state)
        force -= stress[..., :2, 0] / points[..., :1]
        force[..., 0] += stress[..., 2, 2] / points[..., 0]
    return force


def fine_rule(element):
    """Gauss points, four in each direction; in triangles and tetrahedra of squares and cubes pressed into them."""
    kind = ELEMENTS[element]
    x, w = np.polynomial.legendre.leggauss(4)
    xi = np.stack([g.ravel() for g in np.meshgrid(*[x] * kind.dim, indexing="ij")], axis=1)
    weight = np.prod([g.ravel() for g in np.meshgrid(*[w] * kind.dim, indexing="ij")], axis=0)
    if kind.is_simplex:
        cube, left = (1 + xi) / 2, np.ones(len(xi))
        weight = weight / 2**kind.dim
        xi = np.empty_like(cube)
        for axis in range(kind.dim):
            xi[:, axis] = cube[:, axis] * left
            weight = weight * left
            left = left * (1 - cube[:, axis])
    return xi, weight


def error(element, cells, law):
    """Root of the mean squared error; the mesh is distorted smoothly."""
    kind = ELEMENTS[element]
    if kind.dim == 3:
        mesh = brick((1.0, 1.0, 1.0), (cells, cells, cells), element=element)
    else:
        mesh = layered_block(1.0, [("a", 1.0)], cells, cells, element)
    points = mesh.points.copy()
    points[:, 0] += 0.1 * np.sin(np.pi * points[:, 0]) * np.sin(np.pi * points[:, 1])
    if kind.state == AXISYMMETRIC:
        points[:, 0] += 0.5
    nodes = mesh.blocks[0].nodes
    xi, weight = fine_rule(element)
    values, gradients = shape(element, xi)
    place = np.einsum("gn,eni->egi", values, points[nodes])
    volume = np.linalg.det(np.einsum("eni,gnj->egij", points[nodes], gradients)) * weight
    if kind.state == AXISYMMETRIC:
        volume = volume * 2 * np.pi * place[..., 0]
    loads = np.einsum("gn,egi,eg->eni", values, body_force(place, law, kind.state), volume)
    force = np.zeros(points.shape)
    np.add.at(force, nodes, loads)
    outside = ((mesh.points < 1e-9) | (mesh.points > 1 - 1e-9)).any(axis=1)
    given = np.where(outside[:, None], exact(points)[0], 0.0).ravel()
    fixed = np.flatnonzero(np.repeat(outside, kind.dim))
    body, terms = parts_of(element, points, nodes, NeoHooke(C10, (D,)) if law is finite else Elastic(YOUNG, POISSON))
    if law is small:
        body, terms = LinearBody(body), [LinearTerm(term, points.size) for term in terms]
    u = solve(body, terms, points.size, fixed, force.ravel(), given).state.u.reshape(points.shape)
    miss = np.einsum("gn,eni->egi", values, u[nodes]) - exact(place)[0]
    return float(np.sqrt(((miss**2).sum(axis=-1) * volume).sum() / volume.sum()))


RATES = {name: 3 if kind.nodes > kind.corners and name != "C3D10H" else 2 for name, kind in ELEMENTS.items()}


def test_the_rule_of_the_test_is_exact():
    for element, volume in (("CPE6", 1 / 2), ("C3D10", 1 / 6)):
        xi, weight = fine_rule(element)
        assert weight.sum() == pytest.approx(volume, rel=1e-13)
        # int x^a over the simplex: a! / (a + dim)!
        assert xi.T**3 @ weight == pytest.approx({2: 6 / 120, 3: 6 / 720}[xi.shape[1]], rel=1e-12)


@pytest.mark.parametrize("law", [finite, small], ids=["finite", "small"])
@pytest.mark.parametrize("element", ELEMENTS)
def test_rate_of_convergence(element, law):
    dim, rate = ELEMENTS[element].dim, RATES[element]
    # two come near their rates later than the others
    coarse, fine = (4, 8) if dim == 2 or element == "C3D10H" else (2, 4) if rate == 3 else (3, 6)
    if element == "CAX3H":
        coarse, fine = 8, 16
    first, second = error(element, coarse, law), error(element, fine, law)
    found = np.log2(first / second)
    assert rate - 0.3 < found < rate + 1.2
    # and the error is small itself, beside displacements of 0.1 mm
    assert second < {2: 1.5e-3, 3: 1.5e-4}[rate]
