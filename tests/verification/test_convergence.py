"""Rate of convergence to an exact solution of linear elasticity.

The gradient of a harmonic potential x^3 y - x y^3 solves Navier's equations for every Poisson's ratio: prescribed on the
boundary, it must be found within, with an error in L2 of order h^2 for linear and h^3 for quadratic elements.
"""

import numpy as np
import pytest
from solving import parts_of, solve

from fingerfit.fem.elements import ELEMENTS, rule, shape
from fingerfit.fem.linear import LinearBody, LinearTerm
from fingerfit.material.elastic import Elastic
from fingerfit.meshing import brick, layered_block


def exact(points):
    x, y = points[..., 0], points[..., 1]
    u = np.zeros(points.shape)
    u[..., 0], u[..., 1] = 3 * x**2 * y - y**3, x**3 - 3 * x * y**2
    return u


def error(element, cells):
    """Root of the mean squared error at the integration points; the mesh is distorted smoothly."""
    if ELEMENTS[element].dim == 3:
        mesh = brick((1.0, 1.0, 1.0), (cells, cells, cells), element=element)
    else:
        mesh = layered_block(1.0, [("a", 1.0)], cells, cells, element)
    points = mesh.points.copy()
    points[:, 0] += 0.1 * np.sin(np.pi * points[:, 0]) * np.sin(np.pi * points[:, 1])
    nodes = mesh.blocks[0].nodes
    body, terms = parts_of(element, points, nodes, Elastic(1.0, 0.3))
    outside = ((mesh.points < 1e-9) | (mesh.points > 1 - 1e-9)).any(axis=1)
    given = np.where(outside[:, None], exact(points), 0.0).ravel()
    fixed = np.flatnonzero(np.repeat(outside, points.shape[1]))
    linear = [LinearTerm(term, points.size) for term in terms]
    u = solve(LinearBody(body), linear, points.size, fixed, given=given).state.u.reshape(points.shape)
    values, _ = shape(element, rule(element)[0])
    miss = np.einsum("gn,eni->egi", values, u[nodes]) - exact(np.einsum("gn,eni->egi", values, points[nodes]))
    return float(np.sqrt(((miss**2).sum(axis=-1) * body.weight).sum() / body.weight.sum()))


RATES = {"CPE3": 2, "CPE3H": 2, "CPE4": 2, "CPS4": 2, "CPE6": 3, "CPE6H": 3, "CPE8": 3, "CPE8H": 3, "CPE8RH": 3, "CPS8": 3,
         "C3D4": 2, "C3D4H": 2, "C3D8": 2, "C3D10": 3, "C3D20": 3, "C3D20R": 3}  # fmt: skip


@pytest.mark.parametrize("element", RATES)
def test_rate_of_convergence(element):
    coarse, fine = (4, 8) if ELEMENTS[element].dim == 2 else (3, 6)
    if ELEMENTS[element].dim == 3 and RATES[element] == 3:
        coarse, fine = 2, 4
    rate = np.log2(error(element, coarse) / error(element, fine))
    assert RATES[element] - 0.3 < rate < RATES[element] + 1.2
