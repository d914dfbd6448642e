"""Nearly incompressible solids: linear triangles and tetrahedra lock, and with averaged volumes less."""

import numpy as np
import pytest
from solving import parts_of, solve

from fingerfit.fem.linear import LinearBody, LinearTerm
from fingerfit.material.elastic import Elastic
from fingerfit.material.neo_hooke import NeoHooke
from fingerfit.mesh.blocks import brick, layered_block

MATERIAL = NeoHooke(0.4, (2 / 400.0,))  # nu = 0.499
IN_PLANE_STRESS, INCOMPRESSIBLE = 23.96, 16.442
"""mm, of the middle of the right side of Cook's membrane at small strain under 1 N in all, thickness 1 mm.

The first for E = 1, nu = 1/3 in plane stress (Cook, Malkus and Plesha, Concepts and Applications of Finite Element
Analysis, 3rd ed., section 6.13), the second for E = 1.12499998125, nu = 0.499999975 in plane strain, the usual case of
papers on methods without locking (given so in the examples of SimpleFiniteElements.jl, Example2).
"""


def middle(element, cells, material):
    """Vertical displacement in mm of the middle of the right side, at small strain under 1 N, see above."""
    mesh = layered_block(1.0, [("a", 1.0)], cells, cells, element)
    x, y = mesh.points.T
    points = np.column_stack([48 * x, 44 * x + y * (44 - 28 * x)])
    body, terms = parts_of(element, points, mesh.blocks[0].nodes, material)
    number = np.arange(points.size).reshape(points.shape)
    right = np.flatnonzero(x == 1)[np.argsort(y[x == 1])]
    share = np.zeros(len(right))
    # trapezoids along linear sides, Simpson's rule along quadratic ones
    quadratic = len(right) > cells + 1
    for first in range(0, len(right) - 1, 1 + quadratic):
        share[first : first + 2 + quadratic] += [1 / 6, 4 / 6, 1 / 6] if quadratic else [1 / 2, 1 / 2]
    force = np.zeros(points.size)
    force[number[right, 1]] = share / cells
    terms = [LinearTerm(term, points.size) for term in terms]
    u = solve(LinearBody(body), terms, points.size, number[x == 0].ravel(), force).state.u.reshape(-1, 2)
    return u[right[len(right) // 2], 1]


@pytest.mark.parametrize(
    "element, cells, low, high",
    [("CPS8", 16, 0.998, 1.0), ("CPS8R", 16, 0.998, 1.002), ("CPS6", 16, 0.99, 1.0), ("CPS4", 32, 0.99, 1.0)],
)
def test_cooks_membrane_in_plane_stress(element, cells, low, high):
    assert low < middle(element, cells, Elastic(1.0, 1 / 3)) / IN_PLANE_STRESS < high


@pytest.mark.parametrize(
    "element, low, high",
    [
        ("CPE8H", 0.995, 1.0),
        ("CPE8RH", 0.995, 1.005),
        ("CPE4", 0.99, 1.0),
        ("CPE4H", 0.99, 1.0),
        ("CPE3H", 0.98, 1.0),
        ("CPE3", 0.5, 0.6),  # locks: finer meshes do not help
    ],
)
def test_cooks_membrane_without_compression(element, low, high):
    """With 32 cells. nu = 0.49999 is as far as the answer has digits left, and 2e-4 from the limit."""
    nu = 0.49999
    assert low < middle(element, 32, Elastic(0.75 * (1 + nu), nu)) / INCOMPRESSIBLE < high


def punch(element, cells):
    """Nodes, and force in N of a rigid square of 2 mm side, glued to a block and pressed 0.4 mm into it; a quarter."""
    mu, nu = 0.01, 0.49
    mesh = brick((4.0, 4.0, 3.0), (cells, cells, 3 * cells // 4), element=element)
    x, y, z = mesh.points.T
    material = NeoHooke(mu / 2, (3 * (1 - 2 * nu) / (mu * (1 + nu)),))
    body, terms = parts_of(element, mesh.points, mesh.blocks[0].nodes, material)
    number = np.arange(mesh.points.size).reshape(mesh.points.shape)
    under = (z == 3) & (x <= 1) & (y <= 1)
    given = np.zeros(mesh.points.size)
    given[number[under, 2]] = -0.4
    held = [number[z == 0].ravel(), number[x == 0, 0], number[y == 0, 1], number[under].ravel()]
    end = solve(body, terms, mesh.points.size, np.unique(np.concatenate(held)), given=given, steps=2).state
    return len(mesh.points), -4 * end.internal[number[under, 2]].sum()


def test_a_punch_at_equal_nodes():
    """Found with nu = 0.49 at 567 nodes: C3D4 0.1053 N, C3D4H 0.0744, C3D8H 0.0662, C3D10H 0.0600.

    The reference: C3D10H goes to 0.0587 (11875 nodes) and C3D20RH to 0.0606 (14297), both still falling.
    """
    reference = 0.059
    found = {name: punch(name, cells) for name, cells in (("C3D4", 8), ("C3D4H", 8), ("C3D8H", 8), ("C3D10H", 4))}
    assert {nodes for nodes, _ in found.values()} == {567}
    away = {name: abs(force - reference) for name, (_, force) in found.items()}
    assert away["C3D4"] > 0.7 * reference
    assert 2.5 * away["C3D4H"] < away["C3D4"]
    assert 5 * away["C3D8H"] < away["C3D4"]
    assert away["C3D10H"] < 0.03 * reference
    # averaging takes the locking away as the mesh gets finer, not on a coarse one
    assert 0.2 * reference < away["C3D4H"] < 0.3 * reference


def tip(element, cells, depth=2.0):
    """Vertical displacement in mm of the upper corner of a tapered panel held at the left and sheared at the right.

    Plane strain: both faces are held in z. 48 mm long, 44 mm high on the left and 16 mm on the right.
    """
    mesh = brick((1.0, 1.0, depth), (cells, cells, 1), element=element)
    x, y, z = mesh.points.T
    points = np.column_stack([48 * x, 44 * x + y * (44 - 28 * x), z])
    body, terms = parts_of(element, points, mesh.blocks[0].nodes, MATERIAL)
    number = np.arange(points.size).reshape(points.shape)
    fixed = np.unique(np.concatenate([number[x == 0].ravel(), number[:, 2]]))
    force = np.zeros(points.size)
    right = np.flatnonzero(x == 1)
    force[number[right, 1]] = shares(mesh, right) * 0.1 * 16 * depth
    u = solve(body, terms, points.size, fixed, force).state.u.reshape(-1, 3)
    return u[(x == 1) & (y == 1), 1].mean()


def shares(mesh, nodes):
    """Share of each node in a uniform traction on its side, by the areas around it (linear elements)."""
    y, z = mesh.points[nodes, 1], mesh.points[nodes, 2]
    step = np.unique(y)[1]
    width = np.where((y == 0) | (y == 1), step / 2, step)
    weight = width * np.where((z == z.min()) | (z == z.max()), 1.0, 2.0)
    return weight / weight.sum()


def expanded(element, cells):
    """Radial force in N on the inner side of a tube, expanded from 1 to 1.3 mm and held along its axis."""
    mesh = layered_block(0.5, [("a", 0.25)], cells, cells // 2, element, origin=(1.0, 0.0))
    body, terms = parts_of(element, mesh.points, mesh.blocks[0].nodes, NeoHooke(0.5, (2e-4,)))
    number = np.arange(mesh.points.size).reshape(-1, 2)
    inside = np.abs(mesh.points[:, 0] - 1) < 1e-9
    given = np.zeros(mesh.points.size)
    given[number[inside, 0]] = 0.3
    fixed = np.unique(np.concatenate([number[:, 1], number[inside, 0]]))
    found = solve(body, terms, mesh.points.size, fixed, given=given, steps=2)
    return found.state.internal.reshape(-1, 2)[inside, 0].sum()


@pytest.mark.parametrize("element, close", [("CAX3H", 5e-4), ("CAX6H", 5e-4), ("CAX6", 5e-4), ("CAX3", None)])
def test_a_tube_that_hardly_changes_its_volume(element, close):
    """Against the closed form of an incompressible one. Found: CAX3 10 % too stiff, CAX3H and CAX6H within 0.02 %."""
    a, b = 1.3, np.sqrt(1.5**2 + 1.3**2 - 1)
    r = np.linspace(a, b, 20001)
    stretch = r / np.sqrt(r**2 - a**2 + 1)
    exact = np.trapezoid((stretch**2 - stretch**-2) / r, r) * 2 * np.pi * a * 0.25
    found = expanded(element, 8)
    if close is None:
        assert found > 1.05 * exact
    else:
        assert found == pytest.approx(exact, rel=close)


def test_six_node_hybrids_answer_as_their_siblings():
    """A linear pressure over three points is the pressure at them."""
    assert expanded("CAX6H", 4) == pytest.approx(expanded("CAX6", 4), rel=1e-9)


def test_cooks_membrane():
    """Found: 10.07 (converged), 3.66 and 4.15 (C3D4, 8 and 16 cells), 7.67 and 9.23 (C3D4H).

    With nu = 0.3 C3D4 has 83 and 95 % of the converged value: what C3D4H lacks is bending, not volume.
    """
    fine = tip("C3D8", 24)
    assert tip("C3D4", 16) < 0.45 * fine  # locks
    coarse, averaged = tip("C3D4H", 8), tip("C3D4H", 16)
    assert 0.9 * fine < averaged < fine
    assert fine - averaged < 0.4 * (fine - coarse)
